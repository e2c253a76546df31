"""Sessions of a run: samples, set-points, events and steps, and as the recording that `isorig export` makes of them."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import Any, Optional

import numpy as np
import numpy.typing as npt

from ._native import FloatArray
from .recording import UNITS, Recording, Specimen
from .tables import Table, Tables, unit_of

SEVERITIES = ("info", "warning", "program stop", "safe state")
TABLES = ("ramps", "holds", "steps", "setpoints", "events")


@dataclass(frozen=True)
class Stream:
    """Samples of one device, a row each, in the order of their time.

    mono_ns: CLOCK_MONOTONIC; for an average, the middle of its time. bound_ns: the stamp's error is inside of it; infinite
    where it is not known. repeatability_ns: scatter of the stamp, one standard deviation. device_us, sequence: the
    device's own clock and sample counter; for an average, their middle. step: index into the plan. averaged: the row
    stands for `samples` samples, and `least`, `most` are their extremes. values: by name, with units: position_mm, force_N;
    or pressure_psi and the sensor's temperature_C, which has no extremes. status: of a pressure word, 0 for a current one
    (messages/elvh.hpp).
    """

    mono_ns: npt.NDArray[np.int64]
    bound_ns: FloatArray
    step: npt.NDArray[np.int64]
    averaged: npt.NDArray[np.bool_]
    samples: npt.NDArray[np.int64]
    values: "dict[str, FloatArray]"
    least: "dict[str, FloatArray]"
    most: "dict[str, FloatArray]"
    repeatability_ns: FloatArray
    device_us: FloatArray
    sequence: FloatArray
    status: npt.NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.mono_ns)


@dataclass(frozen=True)
class Setpoints:
    """What the controller wanted and did, as recorded: 100 Hz in full stretches, else once per averaging interval.

    state: 0 idle, 1 ready, 2 running, 3 paused, 4 stopping, 5 faulted, 6 armed, 7 countdown, 8 setup. setpoint_psi: gauge.
    target_mm: where the frame is sent. velocity_mm_s: how fast, a magnitude. fill_permille, vent_permille: openings of the
    valves.
    """

    mono_ns: npt.NDArray[np.int64]
    step: npt.NDArray[np.int64]
    state: npt.NDArray[np.int64]
    setpoint_psi: FloatArray
    target_mm: FloatArray
    velocity_mm_s: FloatArray
    fill_permille: npt.NDArray[np.int64]
    vent_permille: npt.NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.mono_ns)


@dataclass(frozen=True)
class Event:
    """code: for machines (docs/commissioning.md). severity: 0 info, 1 warning, 2 program stop, 3 safe state."""

    mono_ns: int
    step: int
    severity: int
    code: str
    text: str
    value: float
    threshold: float


@dataclass(frozen=True)
class PlannedStep:
    """kind: "pressurize", "settle", "ramp", "hold", "wave", "mark". text: in words. from_mm, to_mm: position before and
    after it. velocity_mm_s: of a ramp, extension positive; of a wave its peak. pressure_psi: set-point."""

    kind: str
    text: str
    from_mm: float
    to_mm: float
    velocity_mm_s: float
    pressure_psi: float


@dataclass
class Session:
    """One repetition at one pressure, as one attempt recorded it.

    complete: it was carried to its end. pressure: current words; unmeasured: those that were stale or faulty, as they came
    (their values are no measurement), and not_measured how many there were, those within averages included, of which no
    value is kept. plan: the steps of the run's protocol; None where it is not known. end_mono_ns: of its end mark, 0 without.
    about: what recording.toml of `isorig export` says beside the specimen: run, rig, plan, versions, ...; without its times.
    missing: samples of frame and pressure that never came.
    """

    index: int
    repetition: int
    specimen: Specimen
    complete: bool
    attempt: int
    frame: Stream
    pressure: Stream
    setpoints: Setpoints
    unmeasured: Stream
    not_measured: int = 0
    events: "list[Event]" = field(default_factory=list)
    name: str = ""
    about: "dict[str, Any]" = field(default_factory=dict)
    epoch_unix_us: int = 0
    missing: "tuple[int, int]" = (0, 0)
    plan: "Optional[tuple[PlannedStep, ...]]" = None
    end_mono_ns: int = 0

    @property
    def start_mono_ns(self) -> int:
        """CLOCK_MONOTONIC where the recording's `t_s` is 0: the first sample, of whichever stream."""
        return min((int(s.mono_ns[0]) for s in (self.frame, self.pressure) if len(s)), default=0)

    @property
    def tables(self) -> Tables:
        """Ramps, holds, steps, set-points and events, as `isorig export` writes them, before it rounds."""
        return Tables(TABLES, self._table, f"session {self.index}")

    def recording(self) -> Recording:
        """As `isorig export` makes it, with its columns and tables, before it rounds: seconds from the session's first
        sample, of whichever stream."""
        first_ns = self.start_mono_ns
        gauge = len(self.pressure) > 0
        return Recording(self.specimen, _seconds(_rising(self.frame.mono_ns), first_ns), self.frame.values["position_mm"],
                         self.frame.values["force_N"],
                         _seconds(_rising(self.pressure.mono_ns), first_ns) if gauge else None,
                         self.pressure.values["pressure_psi"] if gauge else None, self.name, self._metadata(),
                         _further(self.frame), _further(self.pressure) if gauge else {}, self.tables)

    def _metadata(self) -> "dict[str, Any]":
        """The further keys of recording.toml, as `isorig export` writes them."""
        start_ns = self.start_mono_ns
        metadata: "dict[str, Any]" = {
            "units": UNITS, **self.about, "session": self.index, "repetition": self.repetition, "attempt": self.attempt,
            "complete": self.complete, "start_mono_ns": start_ns}
        if self.epoch_unix_us:
            metadata["start_unix_us"] = self.epoch_unix_us + start_ns // 1000
        steps, happened = [], []
        for event in self.events:
            at: "dict[str, Any]" = {"t_s": (event.mono_ns - start_ns) * 1e-9}
            if event.code in ("step", "mark"):
                steps.append({**at, "step": event.step, "mark" if event.code == "mark" else "do": _printable(event.text)})
                continue
            at.update(severity=_severity(event), code=_printable(event.code), text=_printable(event.text))
            at.update((name, value) for name, value in (("value", event.value), ("threshold", event.threshold))
                      if math.isfinite(value) and value)
            happened.append(at)
        metadata.update({name: rows for name, rows in (("steps", steps), ("events", happened)) if rows})
        metadata["missing"] = {"frame_samples": self.missing[0], "pressure_samples": self.missing[1]}
        return metadata

    def _table(self, name: str) -> Table:
        columns = {"setpoints": self._setpoint_columns, "events": self._event_columns}.get(name)
        table = columns() if columns else self._step_columns(name)
        return Table(table, {column: unit_of(column) for column in table}, {column: "" for column in table})

    def _setpoint_columns(self) -> "dict[str, npt.NDArray[Any]]":
        s, ns = self.setpoints, _rising(self.setpoints.mono_ns)
        return {"t_s": _seconds(ns, self.start_mono_ns), "setpoint_psi": s.setpoint_psi, "target_mm": s.target_mm,
                "velocity_mm_s": s.velocity_mm_s, "fill_permille": s.fill_permille, "vent_permille": s.vent_permille,
                "state": s.state, "step": s.step, "mono_ns": ns}

    def _event_columns(self) -> "dict[str, npt.NDArray[Any]]":
        events = [each for each in self.events if each.code != "step"]  # those have a table of their own
        ns = np.array([each.mono_ns for each in events], dtype=np.int64)
        return {"t_s": _seconds(ns, self.start_mono_ns), "step": np.array([each.step for each in events], dtype=np.int64),
                "severity": np.array([_severity(each) for each in events], dtype=str),
                "code": np.array([_printable(each.code) for each in events], dtype=str),
                "text": np.array([_printable(each.text) for each in events], dtype=str),
                "value": np.array([each.value for each in events], dtype=np.float64),
                "threshold": np.array([each.threshold for each in events], dtype=np.float64), "mono_ns": ns}

    def _step_columns(self, name: str) -> "dict[str, npt.NDArray[Any]]":
        """steps, or of these the ramps or the holds."""
        begun = [each for each in self.events if each.code in ("step", "mark")]
        end_ns = self.end_mono_ns or max((int(_rising(s.mono_ns)[-1]) for s in (self.frame, self.pressure) if len(s)),
                                         default=self.start_mono_ns)
        targets = self._targets()
        done = [self._planned(each, targets) for each in begun]
        start = np.array([each.mono_ns for each in begun], dtype=np.int64)
        end = np.append(start[1:], end_ns)[:len(start)].astype(np.int64)
        complete = np.ones(len(begun), dtype=np.int64)
        complete[-1:] = self.complete
        # What is recorded behind the session.end is the venting.
        told = [each.mono_ns for each in self.events if each.code == "session.end"]
        if told and not (self.complete and end_ns < told[-1]):
            end[-1:], complete[-1:] = told[-1], 1
        kind = np.array([each.kind for each in done], dtype=str)
        from_mm, to_mm, velocity_mm_s, pressure_psi = (
            np.array([getattr(each, column) for each in done], dtype=np.float64)
            for column in ("from_mm", "to_mm", "velocity_mm_s", "pressure_psi"))
        columns: "dict[str, npt.NDArray[Any]]" = {
            "step": np.array([each.step for each in begun], dtype=np.int64),
            "t_start_s": _seconds(start, self.start_mono_ns), "t_end_s": _seconds(end, self.start_mono_ns),
            "complete": complete}
        if name == "steps":
            return {**columns, "kind": kind, "text": np.array([each.text for each in done], dtype=str), "from_mm": from_mm,
                    "to_mm": to_mm, "velocity_mm_s": velocity_mm_s, "pressure_psi": pressure_psi, "start_mono_ns": start,
                    "end_mono_ns": end}
        if name == "ramps":
            length_mm = self.specimen.pressurized_rest_length_mm or self.specimen.rest_length_mm or math.nan
            columns.update(from_mm=from_mm, to_mm=to_mm, velocity_mm_s=velocity_mm_s,
                           strain_rate_per_s=velocity_mm_s / length_mm, pressure_psi=pressure_psi)
            return {column: values[kind == "ramp"] for column, values in columns.items()}
        columns.update(kind=kind, position_mm=to_mm, pressure_psi=pressure_psi)
        return {column: values[(kind == "hold") | (kind == "settle")] for column, values in columns.items()}

    def _targets(self) -> "dict[int, tuple[float, float, float]]":
        """Target, velocity and set-point that the controller said first in each step, in the order of the steps."""
        s = self.setpoints
        steps, first = np.unique(s.step, return_index=True)
        return {int(step): (float(s.target_mm[k]), float(s.velocity_mm_s[k]), float(s.setpoint_psi[k]))
                for step, k in zip(steps, first)}

    def _planned(self, event: Event, targets: "dict[int, tuple[float, float, float]]") -> PlannedStep:
        if self.plan is not None and 0 <= event.step < len(self.plan):
            return self.plan[event.step]
        text = _printable(event.text)
        kind = "mark" if event.code == "mark" else text
        if event.step not in targets:
            return PlannedStep(kind, text, math.nan, math.nan, math.nan, math.nan)
        to_mm, velocity_mm_s, setpoint_psi = targets[event.step]
        before = [step for step in targets if step < event.step]
        from_mm = targets[before[-1]][0] if before else math.nan
        return PlannedStep(kind, text, from_mm, to_mm,
                           math.copysign(velocity_mm_s, to_mm - from_mm) if kind == "ramp" else 0.0, setpoint_psi)


def _further(stream: Stream) -> "dict[str, npt.NDArray[Any]]":
    """The columns behind those of the recording format; NaN is what does not exist."""
    columns: "dict[str, npt.NDArray[Any]]" = {}
    for name in stream.least:
        quantity, _, unit = name.rpartition("_")
        for which, values in (("min", stream.least[name]), ("max", stream.most[name])):
            columns[f"{quantity}_{which}_{unit}"] = np.where(stream.averaged, values, np.nan)
    columns.update((name, values) for name, values in stream.values.items() if name not in stream.least)
    columns.update(averaged=stream.averaged.astype(np.int64), samples=stream.samples, step=stream.step,
                   mono_ns=_rising(stream.mono_ns),
                   bound_ns=np.where(np.isfinite(stream.bound_ns), stream.bound_ns, np.nan),
                   repeatability_ns=stream.repeatability_ns, device_us=stream.device_us, sequence=stream.sequence)
    return columns


def _rising(mono_ns: "npt.NDArray[np.int64]") -> "npt.NDArray[np.int64]":
    """Each row later than the one before by 2 ns at least, as in an export."""
    ns = mono_ns.copy()
    for k in np.flatnonzero(np.diff(ns) < 2) + 1:
        while k < len(ns) and ns[k] < ns[k - 1] + 2:
            ns[k] = ns[k - 1] + 2
            k += 1
    return ns


def _seconds(mono_ns: "npt.NDArray[np.int64]", first_ns: int) -> FloatArray:
    return np.asarray((mono_ns - first_ns) / 1e9, dtype=np.float64)


def _severity(event: Event) -> str:
    return SEVERITIES[event.severity] if 0 <= event.severity < len(SEVERITIES) else "?"


#: What hides or turns text, as base/printable.cpp has it.
_HIDDEN = re.compile("[\0-\x1f\x7f-\x9f\xad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb"
                     "\U000e0000-\U000e007f]")


def _printable(text: str) -> str:
    """Of a recording's text, as an export writes it."""
    short = {"\n": "\\n", "\r": "\\r", "\t": "\\t"}

    def shown(found: "re.Match[str]") -> str:
        code = ord(found[0])
        return short.get(found[0]) or (f"\\U{code:08x}" if code > 0xFFFF else f"\\u{code:04x}")
    return _HIDDEN.sub(shown, text)

"""Runs: the directory that the daemon or `isorig run` records into (docs/data.md)."""

from __future__ import annotations

import ctypes
import fcntl
import math
import os
import re
import sqlite3
import struct
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Iterator, Optional

import numpy as np
import numpy.typing as npt

from . import _native
from ._native import FloatArray
from .errors import BadInput, located
from .log import LogEvent, read_log
from .recording import UNITS, PathLike, Recording, Specimen

STATES = ("whole", "incomplete", "interrupted", "damaged")
SEVERITIES = ("info", "warning", "program stop", "safe state")
_SEGMENT = re.compile(r"segment-\d{4,}\.lcm\Z")


@dataclass(frozen=True)
class Stream:
    """Samples of one device, a row each, in the order of their time.

    mono_ns: CLOCK_MONOTONIC; for an average, the middle of its time. bound_ns: the stamp's error is inside of it.
    step: index into the plan. averaged: the row stands for `samples` samples, and `least`, `most` are their extremes.
    values: by name, with units: position_mm, force_N; or pressure_psi.
    """

    mono_ns: npt.NDArray[np.int64]
    bound_ns: FloatArray
    step: npt.NDArray[np.int64]
    averaged: npt.NDArray[np.bool_]
    samples: npt.NDArray[np.int64]
    values: "dict[str, FloatArray]"
    least: "dict[str, FloatArray]"
    most: "dict[str, FloatArray]"

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


@dataclass
class Session:
    """One repetition at one pressure.

    complete: it was carried to its end. about: what recording.toml of `isorig export` says beside the specimen: run, rig,
    plan, versions, ...; without its times. missing: samples of frame and pressure that never came.
    """

    index: int
    repetition: int
    specimen: Specimen
    complete: bool
    attempt: int
    frame: Stream
    pressure: Stream
    events: "list[Event]" = field(default_factory=list)
    name: str = ""
    about: "dict[str, Any]" = field(default_factory=dict)
    epoch_unix_us: int = 0
    missing: "tuple[int, int]" = (0, 0)

    @property
    def start_mono_ns(self) -> int:
        """CLOCK_MONOTONIC where the recording's `t_s` is 0: the first sample, of whichever stream."""
        return min((int(s.mono_ns[0]) for s in (self.frame, self.pressure) if len(s)), default=0)

    def recording(self) -> Recording:
        """As `isorig export` makes it, before it rounds: seconds from the session's first sample, of whichever stream."""
        first_ns = self.start_mono_ns
        gauge = len(self.pressure) > 0
        return Recording(self.specimen, _seconds(self.frame, first_ns), self.frame.values["position_mm"],
                         self.frame.values["force_N"], _seconds(self.pressure, first_ns) if gauge else None,
                         self.pressure.values["pressure_psi"] if gauge else None, self.name, self._metadata())

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
            severity = SEVERITIES[event.severity] if 0 <= event.severity < len(SEVERITIES) else "?"
            at.update(severity=severity, code=_printable(event.code), text=_printable(event.text))
            at.update((name, value) for name, value in (("value", event.value), ("threshold", event.threshold))
                      if math.isfinite(value) and value)
            happened.append(at)
        metadata.update({name: rows for name, rows in (("steps", steps), ("events", happened)) if rows})
        metadata["missing"] = {"frame_samples": self.missing[0], "pressure_samples": self.missing[1]}
        return metadata


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


def _seconds(stream: Stream, first_ns: int) -> FloatArray:
    """Each row later than the one before by 2 ns at least, as in an export."""
    ns = stream.mono_ns - first_ns
    for k in np.flatnonzero(np.diff(ns) < 2) + 1:
        while k < len(ns) and ns[k] < ns[k - 1] + 2:
            ns[k] = ns[k - 1] + 2
            k += 1
    return np.asarray(ns / 1e9, dtype=np.float64)


class _Rows:
    """Batches of one device, gathered."""

    _UNITS = ("position_mm", "force_N", "pressure_psi")

    def __init__(self, names: "tuple[str, ...]") -> None:
        self.names = names
        self.parts: "dict[str, list[npt.NDArray[Any]]]" = {}
        self.rows = 0

    def _add(self, **columns: Any) -> None:
        for name, values in columns.items():
            self.parts.setdefault(name, []).append(np.asarray(values))
        self.rows += len(columns["mono_ns"])

    def full(self, m: Any, keep: "npt.NDArray[np.bool_]") -> None:
        ones = np.ones(m.count)
        columns = {"mono_ns": m.mono_ns + np.asarray(m.mono_offset_ns, dtype=np.int64), "bound_ns": m.bound_ns,
                   "step": m.step * ones, "averaged": 0 * ones, "samples": ones}
        for name in self.names:
            columns.update({name: getattr(m, name), "min_" + name: getattr(m, name), "max_" + name: getattr(m, name)})
        self._add(**{name: np.asarray(column)[keep] for name, column in columns.items()})

    def averages(self, m: Any, samples: "tuple[int, ...]") -> None:
        keep = np.asarray(samples) > 0
        first, last = np.asarray(m.first_mono_ns, dtype=np.int64), np.asarray(m.last_mono_ns, dtype=np.int64)
        ones = np.ones(m.count)
        columns = {"mono_ns": first + (last - first) // 2, "bound_ns": m.bound_ns, "step": m.step * ones,
                   "averaged": ones, "samples": samples}
        for name in self.names:
            columns.update({name: getattr(m, "mean_" + name), "min_" + name: getattr(m, "min_" + name),
                            "max_" + name: getattr(m, "max_" + name)})
        self._add(**{name: np.asarray(column)[keep] for name, column in columns.items()})

    def stream(self) -> Stream:
        def joined(name: str, kind: Any) -> Any:
            parts = self.parts.get(name, [])
            return np.concatenate(parts).astype(kind) if parts else np.empty(0, kind)
        mono_ns = joined("mono_ns", np.int64)
        order = np.argsort(mono_ns, kind="stable")
        values, least, most = ({name: joined(prefix + name, np.float64)[order] for name in self.names}
                               for prefix in ("", "min_", "max_"))
        return Stream(mono_ns[order], joined("bound_ns", np.float64)[order], joined("step", np.int64)[order],
                      joined("averaged", np.bool_)[order], joined("samples", np.int64)[order], values, least, most)


class _Open:
    """A session while it is read."""

    def __init__(self, header: Any, planned: Any) -> None:
        self.header, self.planned, self.attempt, self.complete = header, planned, header.attempt, False
        self.frame, self.pressure = _Rows(("position_mm", "force_N")), _Rows(("pressure_psi",))
        self.events: "list[Event]" = []
        self.missing = (0, 0)


class Run:
    """A run's directory, or one segment of it.

    state: "whole", "incomplete", "interrupted" or "damaged", and complaints what is wrong with it: as `isorig show`
    has both. header: the run's own (isorig_msgs.run_header_t): inputs, versions, specimen, planned sessions.
    outcome, operator: what the catalogue beside the run has of it; "" where there is none.
    """

    def __init__(self, path: PathLike) -> None:
        self.path = Path(path)
        if self.path.is_dir():
            self.segments = sorted(p for p in self.path.iterdir() if _SEGMENT.match(p.name))
        else:
            self.segments = [self.path] if self.path.is_file() else []
        if not self.segments:
            raise located(self.path, None, "not a run: it has no segment-0001.lcm (a run is a directory in runs/; "
                          "isorig runs lists them)")
        self.outcome, self.operator = _catalogued(self.path)
        state = ctypes.c_int(-1)
        _native.check(_native.library.isorig_run_state(
            str(self.path).encode(), self.outcome.encode(), _is_held(self.path), ctypes.byref(state)))
        self.state: str = STATES[state.value]
        complaints = _native.text(_native.library.isorig_run_complaints())
        self.complaints: "tuple[str, ...]" = tuple(complaints.splitlines())
        self.header: Any = next((e.decode() for e in self.messages("ISORIG_HEADER")), None)
        if self.header is None:
            raise located(self.segments[0], None, "no header of a run is in it; it was cut, or is no recording of isorig")

    @property
    def inputs(self) -> "dict[str, str]":
        """What it was started with, whole: "rig.toml", "protocol.toml", ..."""
        return {each.name: each.text for each in self.header.texts}

    @property
    def versions(self) -> "dict[str, str]":
        """Programs and devices that made it."""
        return {each.name: each.text for each in self.header.versions}

    @property
    def about(self) -> "dict[str, Any]":
        """run.toml, which a lone segment does not have."""
        file = self.path / "run.toml"
        return tomllib.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}

    def messages(self, *channels: str) -> Iterator[LogEvent]:
        """Every message of these channels (of all, when none is named), in the order of writing."""
        for segment in self.segments:
            for event in read_log(segment):
                if not channels or event.channel in channels:
                    yield event

    def sessions(self) -> "list[Session]":
        """Every session that has samples of the frame. Of several attempts at one the last with such samples counts,
        unless only an earlier one is complete; specimen and plan are those of its attempt. Pressure words that were
        stale or faulty are left out."""
        found: "dict[int, list[_Open]]" = {}
        missing_before: "dict[int, tuple[int, int]]" = {}
        header = self.header
        planned = {each.session: each for each in header.sessions}
        for event in self.messages():
            if event.channel in ("ISORIG_CHAIN", "ISORIG_STATE", "ISORIG_CLOCK", "ISORIG_SYNC"):
                continue
            try:
                message = event.decode()
            except ValueError:
                continue  # counted among the complaints
            if event.channel == "ISORIG_HEADER":
                if message.attempt != header.attempt:  # each segment repeats its attempt's
                    header, planned = message, {each.session: each for each in message.sessions}
                continue
            index = message.session.session if event.channel == "ISORIG_SESSION" else message.session
            if index not in planned:
                if index >= 0 and event.channel != "ISORIG_EVENT":
                    raise BadInput(f"{self.path}: the recording has samples of session {index}, which its header does "
                                   "not know")
                continue
            attempts = found.setdefault(index, [])
            if not attempts or attempts[-1].attempt != header.attempt:
                attempts.append(_Open(header, planned[index]))
            _take(attempts[-1], event.channel, message)
            if event.channel == "ISORIG_SESSION" and message.kind == message.END:  # its counts are of the whole attempt
                before = missing_before.get(message.attempt, (0, 0))
                now = missing_before[message.attempt] = (message.frame_missing, message.pressure_missing)
                attempts[-1].missing = (now[0] - before[0], now[1] - before[1])
        counting = ((index, _counting(found[index])) for index in sorted(found))
        return [_session(index, each, self._about(each.header)) for index, each in counting if each is not None]

    def _about(self, header: Any) -> "dict[str, Any]":
        """Of a session with this header: what is the run's in recording.toml."""
        about: "dict[str, Any]" = {
            "run": self.path.resolve().name, "rig": header.rig, "virtual_time": header.virtual_time != 0,
            "seed": header.seed, "plan": header.plan_summary, "time_mapping": "online",
            "average_interval_s": header.average_interval_s,
            "versions": {each.name: each.text for each in header.versions}, "recording_state": self.state}
        if self.complaints:
            about["recording_complaints"] = list(self.complaints)
        about.update({name: text for name, text in (("outcome", self.outcome), ("operator", self.operator)) if text})
        for each in header.texts:
            if each.name == "operator":
                about["operator"] = each.text
            if each.name == "calibration.toml":
                about["calibration"] = tomllib.loads(each.text)
        return about


def _catalogued(run: Path) -> "tuple[str, str]":
    """Outcome and operator of a run, by the catalogue that it lies in; empty where there is none."""
    run = run.resolve()
    file = run.parent / "catalogue.sqlite"
    if not run.is_dir() or not file.is_file():
        return "", ""
    try:
        # Read-only for the library; the file's own mode lets a write-ahead log be read through its shared memory.
        catalogue = sqlite3.connect(f"{file.as_uri()}?mode=rw", uri=True, timeout=2.0)
        try:
            catalogue.execute("PRAGMA query_only = 1")
            row = catalogue.execute("SELECT state, operator FROM runs WHERE id = ?", (run.name,)).fetchone()
        finally:
            catalogue.close()
    except sqlite3.Error:
        return "", ""
    return (str(row[0]), str(row[1])) if row else ("", "")


def _is_held(run: Path) -> int:
    """A recorder holds the lock of this run, so that it has no end yet."""
    try:
        lock = os.open(run / ".lock", os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return 0
    layout = "hhqqi4x"  # struct flock: type, whence, start, length, pid
    try:
        answer = fcntl.fcntl(lock, fcntl.F_OFD_GETLK, struct.pack(layout, fcntl.F_RDLCK, os.SEEK_SET, 0, 0, 0))
    except OSError:
        return 0
    finally:
        os.close(lock)
    return int(struct.unpack(layout, answer)[0] != fcntl.F_UNLCK)


def _session(index: int, session: _Open, about: "dict[str, Any]") -> Session:
    planned = session.planned
    pressurized, nominal = float(planned.pressurized_rest_length_mm), float(planned.pressure_psi)
    rest_length_mm = float(session.header.rest_length_mm)
    specimen = Specimen(rest_length_mm if rest_length_mm > 0 else None, None if np.isnan(pressurized) else pressurized,
                        None if np.isnan(nominal) else nominal)
    return Session(index, planned.repetition, specimen, session.complete, session.attempt, session.frame.stream(),
                   session.pressure.stream(), session.events, session.header.specimen, about,
                   session.header.epoch_unix_us, session.missing)


def _take(session: _Open, channel: str, message: Any) -> None:
    if channel == "ISORIG_FRAME":
        session.frame.full(message, np.ones(message.count, dtype=bool))
    elif channel == "ISORIG_PRESSURE":
        session.pressure.full(message, np.frombuffer(bytes(message.status), dtype=np.uint8) == 0)
    elif channel == "ISORIG_FRAME_AVERAGE":
        session.frame.averages(message, message.samples)
    elif channel == "ISORIG_PRESSURE_AVERAGE":
        session.pressure.averages(message, message.current)
    elif channel == "ISORIG_EVENT":
        session.events.append(Event(message.mono_ns, message.step, message.severity, message.code, message.text,
                                    message.value, message.threshold))
    elif channel == "ISORIG_SESSION" and message.kind == message.END:
        session.complete = message.complete != 0


def _counting(attempts: "list[_Open]") -> Optional[_Open]:
    """As `isorig export` chooses; None when no attempt has a row of the frame."""
    measured = [each for each in attempts if each.frame.rows > 0]
    return next((each for each in reversed(measured) if each.complete), measured[-1] if measured else None)

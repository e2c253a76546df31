"""Runs: the directory that the daemon or `isorig run` records into (docs/data.md)."""

from __future__ import annotations

import ctypes
import fcntl
import os
import re
import sqlite3
import struct
import tomllib
from array import array
from pathlib import Path
from typing import Any, Iterator, Optional

import numpy as np
import numpy.typing as npt

from . import _native
from .errors import BadInput, located
from .log import LogEvent, read_log, read_segments
from .recording import PathLike, Specimen
from .session import Event, PlannedStep, Session, Setpoints, Stream

STATES = ("whole", "incomplete", "interrupted", "damaged")
_SEGMENT = re.compile(r"segment-\d{4,}\.lcm\Z")
_SETPOINTS = {"mono_ns": "q", "step": "q", "state": "q", "setpoint_psi": "d", "target_mm": "d", "velocity_mm_s": "d",
              "fill_permille": "q", "vent_permille": "q"}
_COUNTS = float(1 << 32)  # the devices' counters have 32 bits


class _Rows:
    """Batches of one device, gathered. names: quantities whose extremes are recorded; others: those without."""

    def __init__(self, names: "tuple[str, ...]", others: "tuple[str, ...]" = ()) -> None:
        self.names, self.others = names, others
        self.parts: "dict[str, list[npt.NDArray[Any]]]" = {}
        self.rows = 0

    def _add(self, keep: "npt.NDArray[np.bool_]", columns: "dict[str, Any]") -> None:
        for name, values in columns.items():
            self.parts.setdefault(name, []).append(np.asarray(values)[keep])
        self.rows += int(np.count_nonzero(keep))

    def full(self, m: Any, status: "npt.NDArray[np.uint8]", keep: "npt.NDArray[np.bool_]") -> None:
        ones = np.ones(m.count)
        columns = {"mono_ns": m.mono_ns + np.asarray(m.mono_offset_ns, dtype=np.int64), "bound_ns": m.bound_ns,
                   "repeatability_ns": m.repeatability_ns, "step": m.step * ones, "averaged": 0 * ones, "samples": ones,
                   "device_us": m.device_us + np.asarray(m.device_offset_us, dtype=np.int64),
                   "sequence": m.sequence + np.asarray(m.sequence_offset, dtype=np.int64), "status": status}
        for name in self.names:
            columns.update({name: getattr(m, name), "min_" + name: getattr(m, name), "max_" + name: getattr(m, name)})
        columns.update({name: getattr(m, name) for name in self.others})
        self._add(keep, columns)

    def averages(self, m: Any, samples: "tuple[int, ...]") -> None:
        def span(name: str) -> "tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]":
            first, last = (np.asarray(getattr(m, f"{end}_{name}"), dtype=np.int64) for end in ("first", "last"))
            return first, last - first
        ones = np.ones(m.count)
        (first_ns, ns), (first_us, us), (first_count, counts) = span("mono_ns"), span("device_us"), span("sequence")
        counted = counts - _COUNTS * np.rint(counts / _COUNTS)
        columns = {"mono_ns": first_ns + ns // 2, "bound_ns": m.bound_ns, "repeatability_ns": m.repeatability_ns,
                   "step": m.step * ones, "averaged": ones, "samples": samples, "device_us": first_us + 0.5 * us,
                   "sequence": first_count + 0.5 * counted, "status": 0 * ones}
        for name in self.names:
            columns.update({name: getattr(m, "mean_" + name), "min_" + name: getattr(m, "min_" + name),
                            "max_" + name: getattr(m, "max_" + name)})
        columns.update({name: getattr(m, "mean_" + name) for name in self.others})
        self._add(np.asarray(samples) > 0, columns)

    def stream(self) -> Stream:
        def joined(name: str, kind: Any) -> Any:
            parts = self.parts.get(name, [])
            return np.concatenate(parts).astype(kind) if parts else np.empty(0, kind)
        mono_ns = joined("mono_ns", np.int64)
        order = np.argsort(mono_ns, kind="stable")
        kinds = (("", self.names + self.others), ("min_", self.names), ("max_", self.names))
        values, least, most = ({name: joined(prefix + name, np.float64)[order] for name in names} for prefix, names in kinds)
        return Stream(mono_ns[order], joined("bound_ns", np.float64)[order], joined("step", np.int64)[order],
                      joined("averaged", np.bool_)[order], joined("samples", np.int64)[order], values, least, most,
                      joined("repeatability_ns", np.float64)[order], joined("device_us", np.float64)[order],
                      joined("sequence", np.float64)[order], joined("status", np.uint8)[order])


def _setpoints(columns: "dict[str, array[Any]]") -> Setpoints:
    """In the order of their time."""
    order = np.argsort(np.array(columns["mono_ns"]), kind="stable")
    return Setpoints(**{name: np.array(column)[order] for name, column in columns.items()})


class _Open:
    """A session while it is read."""

    def __init__(self, header: Any, planned: Any) -> None:
        self.header, self.planned, self.attempt, self.complete = header, planned, header.attempt, False
        self.frame = _Rows(("position_mm", "force_N"))
        self.pressure, self.unmeasured = (_Rows(("pressure_psi",), ("temperature_C",)) for _ in range(2))
        # Columns at once: a long run has a million of them, which as messages take 0.6 kB each.
        self.setpoints: "dict[str, array[Any]]" = {name: array(kind) for name, kind in _SETPOINTS.items()}
        self.not_measured = 0
        self.events: "list[Event]" = []
        self.missing = (0, 0)
        self.end_mono_ns = 0


class Run:
    """A run's directory, or one segment of it.

    state: "whole", "incomplete", "interrupted" or "damaged", and complaints what is wrong with it: as `isorig show`
    has both. is_being_written: a recorder is at it at this moment; "interrupted" then says no more than that it has no
    end yet. header: the run's own (isorig_msgs.run_header_t): inputs, versions, specimen, planned sessions.
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
        self.is_being_written = bool(_is_held(self.path))
        state = ctypes.c_int(-1)
        _native.check(_native.library.isorig_run_state(
            str(self.path).encode(), self.outcome.encode(), int(self.is_being_written), ctypes.byref(state)))
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
        for event in read_segments(self.segments) if self.path.is_dir() else read_log(self.path):
            if not channels or event.channel in channels:
                yield event

    def sessions(self, every_attempt: bool = False) -> "list[Session]":
        """The sessions, as `isorig export` chooses them: those that have samples of the frame; of several attempts at one
        the last with such samples, unless only an earlier one is complete. Specimen and plan are those of its attempt.

        every_attempt: each attempt at each session, also without a sample of the frame: every sample of every session, once.
        What was recorded outside of sessions is among `messages()`.
        """
        found: "dict[int, list[_Open]]" = {}
        missing_before: "dict[int, tuple[int, int]]" = {}
        header = self.header
        planned = {each.session: each for each in header.sessions}
        for event in self.messages():
            if event.channel in ("ISORIG_CHAIN", "ISORIG_CLOCK", "ISORIG_SYNC"):
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
                if index >= 0 and event.channel not in ("ISORIG_EVENT", "ISORIG_STATE"):
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
        if not every_attempt:
            found = {index: [best] for index, each in found.items() if (best := _counting(each)) is not None}
        headers = {each.attempt: each.header for attempts in found.values() for each in attempts}
        plans = {attempt: _plan(each) for attempt, each in headers.items()}
        return [_session(index, each, self._about(each.header), plans[each.attempt])
                for index in sorted(found) for each in found[index]]

    def _about(self, header: Any) -> "dict[str, Any]":
        """Of a session with this header: what is the run's in recording.toml."""
        about: "dict[str, Any]" = {
            "run": self.path.resolve().name, "run_directory": str(self.path.resolve()), "rig": header.rig,
            "virtual_time": header.virtual_time != 0, "seed": header.seed, "plan": header.plan_summary,
            "time_mapping": "online", "average_interval_s": header.average_interval_s,
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


def _session(index: int, session: _Open, about: "dict[str, Any]", plan: "Optional[tuple[PlannedStep, ...]]") -> Session:
    planned, header = session.planned, session.header
    pressurized, nominal = float(planned.pressurized_rest_length_mm), float(planned.pressure_psi)
    rest_length_mm = float(header.rest_length_mm)
    specimen = Specimen(rest_length_mm if rest_length_mm > 0 else None, None if np.isnan(pressurized) else pressurized,
                        None if np.isnan(nominal) else nominal)
    return Session(index, planned.repetition, specimen, session.complete, session.attempt, session.frame.stream(),
                   session.pressure.stream(), _setpoints(session.setpoints), session.unmeasured.stream(),
                   session.not_measured, session.events, header.specimen, about, header.epoch_unix_us, session.missing,
                   plan, session.end_mono_ns)


def _plan(header: Any) -> "Optional[tuple[PlannedStep, ...]]":
    """Compiled again from the protocol in the recording; None where it is not there, or of a language that has changed."""
    text = next((each.text for each in header.texts if each.name == "protocol.toml"), None)
    plan = _native.library.isorig_plan_new(text.encode(), b"protocol.toml") if text else None
    if not plan:
        return None
    try:
        steps = []
        record = _native.StepRecord()
        for index in range(_native.library.isorig_plan_count(plan)):
            _native.check(_native.library.isorig_plan_step(plan, index, ctypes.byref(record)))
            steps.append(PlannedStep(_native.text(record.kind), _native.text(record.text), record.from_mm, record.to_mm,
                                     record.velocity_mm_s, record.pressure_psi))
        return tuple(steps)
    finally:
        _native.library.isorig_plan_free(plan)


def _take(session: _Open, channel: str, message: Any) -> None:
    if channel == "ISORIG_FRAME":
        session.frame.full(message, np.zeros(message.count, dtype=np.uint8), np.ones(message.count, dtype=bool))
    elif channel == "ISORIG_PRESSURE":
        status = np.frombuffer(bytes(message.status), dtype=np.uint8)
        session.pressure.full(message, status, status == 0)
        session.unmeasured.full(message, status, status != 0)
        session.not_measured += int(np.count_nonzero(status))
    elif channel == "ISORIG_STATE":
        for name, column in session.setpoints.items():
            column.extend([getattr(each, name) for each in message.samples])
    elif channel == "ISORIG_FRAME_AVERAGE":
        session.frame.averages(message, message.samples)
    elif channel == "ISORIG_PRESSURE_AVERAGE":
        session.pressure.averages(message, message.current)
        session.not_measured += sum(max(0, all_ - current) for all_, current in zip(message.samples, message.current))
    elif channel == "ISORIG_EVENT":
        session.events.append(Event(message.mono_ns, message.step, message.severity, message.code, message.text,
                                    message.value, message.threshold))
    elif channel == "ISORIG_SESSION" and message.kind == message.END:
        session.complete, session.end_mono_ns = message.complete != 0, message.mono_ns


def _counting(attempts: "list[_Open]") -> Optional[_Open]:
    """As `isorig export` chooses; None when no attempt has a row of the frame."""
    measured = [each for each in attempts if each.frame.rows > 0]
    return next((each for each in reversed(measured) if each.complete), measured[-1] if measured else None)

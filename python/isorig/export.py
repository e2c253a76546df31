"""HDF5 exports: what `isorig export --format hdf5` writes (docs/formats/hdf5.md). Needs h5py (Debian: python3-h5py)."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Optional

import numpy as np
import numpy.typing as npt

from .errors import IsorigError, located
from .recording import UNITS, PathLike, Recording, Specimen
from .tables import Table, Tables

FORMAT = "isorig-export/1"
_NEEDED = {"frame": ("t_s", "position_mm", "force_N"), "pressure": ("t_s", "pressure_psi")}


def _h5py() -> Any:
    try:
        import h5py
    except ImportError:
        raise IsorigError("reading HDF5 needs h5py, which is not installed: apt-get install python3-h5py, or "
                          "pip install h5py") from None
    return h5py


class Export:
    """An HDF5 export of a run.

    attributes: of the file: run, rig, specimen, plan, versions, calibrations. inputs: what the run was started with.
    names: of its sessions, in their order.
    """

    def __init__(self, path: PathLike) -> None:
        self.path = Path(path)
        with self._opened() as file:
            self.attributes: "dict[str, Any]" = _attributes(file)
            if self.attributes.get("format") != FORMAT:
                raise located(self.path, None, f"`format` is {self.attributes.get('format')!r}; this reads \"{FORMAT}\": "
                              "is this what isorig export --format hdf5 wrote?")
            self.inputs: "dict[str, Any]" = _attributes(file["inputs"]) if "inputs" in file else {}
            self.sessions = _table(file["sessions"])
            self.names: "tuple[str, ...]" = tuple(str(name) for name in self.sessions["name"])

    def _opened(self) -> Any:
        h5py = _h5py()
        if not self.path.is_file():
            raise located(self.path, None, "no such file")
        try:
            return h5py.File(self.path, "r")
        except OSError as e:
            raise located(self.path, None, f"this is no HDF5 file, or a damaged one: {e}") from None

    def table(self, session: str, name: str) -> Table:
        """A table of a session: "frame", "pressure", "setpoints", "steps", "ramps", "holds", "events", "sessions"."""
        with self._opened() as file:
            group = self._group(file, session)
            if name not in group:
                raise located(self.path, None, f"{session} has no table {name}; it has: {', '.join(group)}")
            return _table(group[name])

    def session_attributes(self, session: str) -> "dict[str, Any]":
        """What recording.toml of the session says, its tables flattened ("versions_isorig")."""
        with self._opened() as file:
            return _attributes(self._group(file, session))

    def _group(self, file: Any, session: str) -> Any:
        if session not in self.names:
            raise located(self.path, None, f"no session {session}; it has: {', '.join(self.names)}")
        return file[session]

    def recording(self, session: str) -> Recording:
        """The session as a recording, with its tables; its other columns of numbers are `further`, integers (mono_ns) as
        such."""
        attributes = self.session_attributes(session)
        frame = self._stream(session, "frame")
        with self._opened() as file:
            gauge_there = "pressure" in file[session] and len(file[session]["pressure/t_s"]) > 0
            tables = [name for name in file[session] if name not in _NEEDED]
        gauge = self._stream(session, "pressure") if gauge_there else {}
        specimen = Specimen(_number(attributes, "rest_length_mm"), _number(attributes, "pressurized_rest_length_mm"),
                            _number(attributes, "nominal_pressure_psi"))
        metadata = {key: value.item() if isinstance(value, np.generic) else value for key, value in attributes.items()}
        metadata["units"] = UNITS  # an export's are known
        return Recording(specimen, frame.pop("t_s"), frame.pop("position_mm"), frame.pop("force_N"),
                         gauge.pop("t_s", None), gauge.pop("pressure_psi", None), str(attributes["specimen"]), metadata,
                         frame, gauge, Tables(tables, lambda name: self.table(session, name), f"{self.path}: {session}"))

    def _stream(self, session: str, name: str) -> "dict[str, npt.NDArray[Any]]":
        table = self.table(session, name)
        missing = [column for column in _NEEDED[name] if column not in table.columns]
        if missing:
            raise located(self.path, None, f"{session}/{name} has no column {missing[0]}")
        return {key: values for key, values in table.columns.items() if values.dtype.kind in "fiu"}


def _number(attributes: "dict[str, Any]", key: str) -> Optional[float]:
    return float(attributes[key]) if key in attributes else None


def _attributes(group: Any) -> "dict[str, Any]":
    return {key: value.decode() if isinstance(value, bytes) else value for key, value in group.attrs.items()}


def _table(group: Any) -> Table:
    columns, units, descriptions = {}, {}, {}
    for name, column in group.items():
        values = column[:]
        if values.dtype.kind == "O":  # text of variable length
            values = np.array([v.decode() if isinstance(v, bytes) else str(v) for v in values], dtype=str)
        columns[name] = values
        about = _attributes(column)
        units[name], descriptions[name] = str(about.get("unit", "")), str(about.get("description", ""))
    return Table(columns, units, descriptions)

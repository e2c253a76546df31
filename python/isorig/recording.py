"""Recordings: one folder with ``recording.toml``, ``frame.csv`` and, where there is one, ``pressure.csv``."""

from __future__ import annotations

import contextlib
import ctypes
import math
import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _native
from ._native import FloatArray
from ._toml import toml_text
from .errors import BadInput, located
from .tables import NAMES as TABLES, Tables

PathLike = Union[str, Path]
FORMAT = "isorig-recording/1"
UNITS = "s, mm, N, psi"

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\Z")
_WHOLE = re.compile(r"[-+]?[0-9]+\Z")
#: Further columns of an export that count (docs/formats/recording.md). bound_ns is a real number whose decimals are not written.
_COUNTS = {"averaged", "samples", "step", "mono_ns"}
#: What a cell may hold at most, by the end of its column's name (docs/data.md).
_RANGES = {"t_s": 1e10, "_mm": 1e4, "_N": 1e6, "_psi": 1e3}
_SHORTEST_STEP_S, _LONGEST_STEP_S = 1e-9, 1e5


@dataclass(frozen=True)
class Specimen:
    """What positions, strains and pressures are counted from.

    rest_length_mm: unpressurized; the zero of ``position_mm``. None: there are no strains.
    pressurized_rest_length_mm, nominal_pressure_psi: only a McKibben has these two.
    """

    rest_length_mm: Optional[float] = None
    pressurized_rest_length_mm: Optional[float] = None
    nominal_pressure_psi: Optional[float] = None

    def strain(self, position_mm: FloatArray) -> FloatArray:
        """Strain of the pressurized rest length (1): zero at the length that the specimen has without load.

        >>> float(Specimen(100.0, 80.0).strain(np.array([-4.0]))[0])
        0.2
        """
        if self.rest_length_mm is None:
            raise BadInput("this specimen has no rest_length_mm, so there are no strains")
        reference_mm = self.pressurized_rest_length_mm or self.rest_length_mm
        return (np.asarray(position_mm) + self.rest_length_mm - reference_mm) / reference_mm

    def _record(self) -> _native.SpecimenRecord:
        nan = math.nan
        return _native.SpecimenRecord(*(nan if value is None else value for value in (
            self.rest_length_mm, self.pressurized_rest_length_mm, self.nominal_pressure_psi)))


def read_columns(file: PathLike, required: "tuple[str, ...]") -> "dict[str, npt.NDArray[Any]]":
    """A CSV whose header begins with ``required``; the first is the time, ``t_s``. Further columns of numbers are read too, an
    empty cell as NaN: as int64 what an export counts and what doubles would round. Further columns of words are not.

    Raises BadInput with file and line for a column that is missing or not in its place, a cell that is no finite number, time that does not
    increase, a number that no machine records, a last line that was cut.
    """
    file = Path(file)
    try:
        data = file.read_bytes()
    except FileNotFoundError:
        raise located(file, None, "no such file") from None
    except OSError as e:
        raise located(file, None, e.strerror or str(e)) from None
    try:
        content = data.decode("utf-8-sig")
    except UnicodeDecodeError as e:
        raise located(file, data.count(b"\n", 0, e.start) + 1, "this is no UTF-8 text") from None
    lines = [line[:-1] if line.endswith("\r") else line for line in content.split("\n")]
    if not content:
        raise located(file, 1, f"the file is empty; it has to begin with `{','.join(required)}`")
    names = lines[0].split(",")
    for name in required:
        if names.count(name) != 1:
            raise located(file, 1, f"the header is \"{lines[0][:40]}\"; column `{name}` "
                          + ("is missing" if name not in names else "stands twice"))
    if tuple(names[:len(required)]) != required or len(set(names)) != len(names):
        raise located(file, 1, f"the header is \"{lines[0][:40]}\"; it has to begin with `{','.join(required)}`, and to "
                      "have each name once")
    ended = lines[-1] == ""
    rows = lines[1:-1] if ended else lines[1:]
    if not rows:
        raise located(file, 2, "no rows below the header")
    columns: "list[list[str]]" = [[] for _ in names]
    for index, row in enumerate(rows):
        cells = row.split(",")
        if len(cells) != len(names):
            raise located(file, index + 2, f"{len(cells)} cells where the header has {len(names)}")
        for column, cell in zip(columns, cells):
            column.append(cell)
    table = {name: _numbers(file, name, column) for name, column in zip(names, columns) if name in required}
    for name, column in zip(names, columns):
        if name not in required and (further := _further(name, column)) is not None:
            table[name] = further
    _check_times(file, table[required[0]])
    if not ended and not _last_is_whole(rows):
        raise located(file, len(rows) + 1, "the last line has no line end, so that its last number may have been cut; "
                      "if it is whole, end the file with a line end")
    return table


def _numbers(file: Path, name: str, cells: "list[str]") -> FloatArray:
    # float() takes "nan", "1_0" and "infinity", which no recording has.
    if set("".join(cells)) - set("0123456789+-.eE \t") or "" in cells:
        for index, cell in enumerate(cells):
            if not _NUMBER.match(cell.strip()):
                raise located(file, index + 2, f"`{name}` is \"{cell[:40]}\"; a finite number is needed")
    try:
        values = np.array([float(cell) for cell in cells])
    except ValueError:
        bad = next(k for k, cell in enumerate(cells) if not _NUMBER.match(cell.strip()))
        raise located(file, bad + 2, f"`{name}` is \"{cells[bad][:40]}\"; a finite number is needed") from None
    most = _most(name)
    beyond = np.flatnonzero(~(np.abs(values) <= most))
    if len(beyond):
        raise located(file, int(beyond[0]) + 2, f"`{name}` is {values[beyond[0]]:.9g}; it lies between {-most:g} and "
                      f"{most:g}: is the line damaged, or the column in another unit?")
    return values


def _most(name: str) -> float:
    return next((most for suffix, most in _RANGES.items() if name.endswith(suffix)), float(np.finfo(float).max))


def _further(name: str, cells: "list[str]") -> "Optional[npt.NDArray[Any]]":
    """An empty cell is a value that does not exist (NaN). None for a column of words."""
    # A double holds whole numbers up to 2^53 alone: the `mono_ns` of a computer that is up for 105 days would be rounded.
    # What would not be is a double whatever its cells look like: a temperature of 20 to 21 takes a 20.5.
    if all(_WHOLE.match(cell) for cell in cells):
        whole = [int(cell) for cell in cells]
        most = max((abs(each) for each in whole), default=0)
        if most < 2**63 and (name in _COUNTS or most > 2**53):
            return np.array(whole, dtype=np.int64)
    try:
        return np.array([float(cell) if cell else math.nan for cell in cells])
    except ValueError:
        return None


def _check_times(file: Path, t_s: FloatArray) -> None:
    steps = np.diff(t_s)
    wrong = np.flatnonzero(~((steps >= _SHORTEST_STEP_S) & (steps <= _LONGEST_STEP_S)))
    if len(wrong):
        k = int(wrong[0])
        raise located(file, k + 3, f"time goes from {t_s[k]:.9g} s to {t_s[k + 1]:.9g} s; every row is later than the "
                      f"one before, by {_SHORTEST_STEP_S:g} to {_LONGEST_STEP_S:g} s")


def _last_is_whole(rows: "list[str]") -> bool:
    """Only a last column with a fixed number of decimals tells whether a line without an end is whole."""
    def decimals(row: str) -> int:
        digits = row.rpartition(".")[2] if "." in row else ""
        return len(digits) if digits.isdigit() else 0
    wanted = decimals(rows[-1])
    return wanted > 0 and len(rows) > 1 and all(decimals(row) == wanted for row in rows)


@dataclass
class Recording:
    """A recording. Extension and tension are positive; columns of one stream have equal lengths.

    specimen, name: what was tested. metadata: the whole of recording.toml.
    t_s: seconds, increasing, not evenly spaced. position_mm: of the crosshead, relative to the unpressurized rest
    length. force_N: of the load cell. pressure_t_s, pressure_psi: gauge, on the same clock; None without a pneumatic
    part. further, pressure_further: the other columns of the two files, by their names.
    tables: what `isorig export` writes beside them (ramps, holds, steps, setpoints, events, sessions), by name, each read
    when it is asked for; `write` does not write them.

    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp()) / "new"
    >>> made = Recording(Specimen(100.0), [0, 1, 2], [0.0, 1.0, 2.0], [0.0, 1.5, 2.5], name="wire")
    >>> made.write(folder)
    >>> Recording.read(folder).force_N
    array([0. , 1.5, 2.5])
    """

    specimen: Specimen
    t_s: FloatArray
    position_mm: FloatArray
    force_N: FloatArray
    pressure_t_s: Optional[FloatArray] = None
    pressure_psi: Optional[FloatArray] = None
    name: str = ""
    metadata: "dict[str, Any]" = field(default_factory=dict)
    further: "dict[str, npt.NDArray[Any]]" = field(default_factory=dict)
    pressure_further: "dict[str, npt.NDArray[Any]]" = field(default_factory=dict)
    tables: Tables = field(default_factory=Tables)

    def __post_init__(self) -> None:
        for name, values in self._columns().items():
            setattr(self, name, values)

    def _columns(self) -> "dict[str, FloatArray]":
        """As they stand now, contiguous doubles of equal lengths: whoever has the recording may have set others. The
        library knows only where they begin, so every call into it is given these.
        """
        t_s = _native.column("t_s", self.t_s)
        columns = {"t_s": t_s, "position_mm": _native.column("position_mm", self.position_mm, len(t_s)),
                   "force_N": _native.column("force_N", self.force_N, len(t_s))}
        if self.pressure_t_s is not None:
            gauge_t_s = columns["pressure_t_s"] = _native.column("pressure_t_s", self.pressure_t_s)
            columns["pressure_psi"] = _native.column(
                "pressure_psi", [] if self.pressure_psi is None else self.pressure_psi, len(gauge_t_s))
        return columns

    @property
    def output(self) -> str:
        """The column that a model is to predict: "force", "position" or "pressure"."""
        return str(self.metadata.get("output", "force"))

    @classmethod
    def read(cls, folder: PathLike) -> "Recording":
        """Opens a folder. Raises BadInput with file and line; nothing is half-read.

        Lengths whose unit is in doubt are refused as by every command of isorig (docs/data.md).
        """
        folder = Path(folder)
        if not folder.is_dir():
            raise located(folder, None, "not a recording: no such folder (a recording is a folder with recording.toml, "
                          "frame.csv and, if it has one, pressure.csv)")
        inside = sorted(each.parent.name for each in folder.glob("*/recording.toml"))
        if inside and not (folder / "recording.toml").exists():
            raise located(folder, None, f"not a recording, but a folder of {len(inside)} ({inside[0]}"
                          f"{', ...' if len(inside) > 1 else ''}); name the one that is meant")
        metadata = _read_toml(folder / "recording.toml")
        specimen = _specimen_of(metadata, folder / "recording.toml")
        of_pressure_alone = metadata.get("output") == "pressure" and not (
            (folder / "frame.csv").exists() or (folder / "frame.csv").is_symlink())
        frame: "dict[str, npt.NDArray[Any]]" = (
            {name: np.empty(0) for name in ("t_s", "position_mm", "force_N")} if of_pressure_alone
            else read_columns(folder / "frame.csv", ("t_s", "position_mm", "force_N")))
        gauge: "dict[str, npt.NDArray[Any]]" = {}
        if metadata.get("output") == "pressure" or (folder / "pressure.csv").exists() or (folder / "pressure.csv").is_symlink():
            gauge = read_columns(folder / "pressure.csv", ("t_s", "pressure_psi"))
        recording = cls(specimen, frame.pop("t_s"), frame.pop("position_mm"), frame.pop("force_N"),
                        gauge.pop("t_s", None), gauge.pop("pressure_psi", None), str(metadata["specimen"]), metadata,
                        frame, gauge, Tables.of_folder(folder))
        if "units" not in metadata and (doubt := recording.unit_in_doubt()):
            raise located(folder / "frame.csv", None, doubt)
        return recording

    def unit_in_doubt(self) -> str:
        """What makes it doubtful that lengths are millimetres; "" for nothing. In the words of the terminal."""
        specimen = self.specimen._record()
        position_mm = _native.column("position_mm", self.position_mm)
        return _native.text(_native.library.isorig_unit_in_doubt(
            ctypes.byref(specimen), len(position_mm), _native.pointer(position_mm)))

    @property
    def strain(self) -> FloatArray:
        """Of every row, as in the paper: of the pressurized rest length (1)."""
        return self.specimen.strain(self.position_mm)

    @property
    def velocity_mm_s(self) -> FloatArray:
        """Change of position per time from the row before to the row after (mm/s); as noisy as the reading."""
        return np.asarray(np.gradient(self.position_mm, self.t_s), dtype=np.float64)

    def write(self, folder: PathLike) -> None:
        """Writes the folder; numbers read back as the same doubles, further keys and tables of ``metadata`` as they
        are. Of another recording that is there nothing stays: its tables (ramps, events, ...) go; those of a recording
        that was read from this folder stay. Raises BadInput, and writes nothing, for what could not be read back: a
        time that does not increase, a force that is no finite number, columns of unequal lengths.
        """
        folder = Path(folder)
        own = self._columns()
        gauge = {"t_s": own.pop("pressure_t_s"), "pressure_psi": own.pop("pressure_psi")} if "pressure_t_s" in own else {}
        if self.output == "pressure" and not gauge:
            raise located(folder / "pressure.csv", None, "not written: the pressure is the output, and there is none")
        files = {"recording.toml": self._toml(folder / "recording.toml")}
        if self.output != "pressure" or len(own["t_s"]):
            files["frame.csv"] = _csv_text(folder / "frame.csv", own, self.further)
        if gauge:
            files["pressure.csv"] = _csv_text(folder / "pressure.csv", gauge, self.pressure_further)
        # recording.toml last: it goes with the numbers that stand beside it.
        files["recording.toml"] = files.pop("recording.toml")
        gone = [name for name in ("frame.csv", "pressure.csv") if name not in files]
        if (folder / "recording.toml").exists() and not self.tables.are_of(folder):
            gone += [f"{name}.csv" for name in TABLES]
        folder.mkdir(parents=True, exist_ok=True)
        asides = {name: folder / (name + ".new") for name in files}
        try:
            for name, text in files.items():
                asides[name].write_text(text, encoding="utf-8")
            for name in files:
                if name == "recording.toml":
                    for old in gone:
                        (folder / old).unlink(missing_ok=True)
                asides[name].replace(folder / name)
        finally:
            for aside in asides.values():
                with contextlib.suppress(OSError):
                    aside.unlink(missing_ok=True)

    def _toml(self, file: Path) -> str:
        specimen = self.specimen
        own = {"format": FORMAT, "specimen": self.name, "rest_length_mm": specimen.rest_length_mm,
               "pressurized_rest_length_mm": specimen.pressurized_rest_length_mm,
               "nominal_pressure_psi": specimen.nominal_pressure_psi}
        keys: "dict[str, Any]" = {key: float(value) if isinstance(value, (int, float)) else value
                                  for key, value in own.items() if value is not None}
        keys.update((key, value) for key, value in self.metadata.items() if key not in own)
        _specimen_of(keys, file)
        text = toml_text(keys, file)
        tomllib.loads(text)  # what is written can be read
        return text


def _csv_text(file: Path, own: "dict[str, FloatArray]", further: "dict[str, npt.NDArray[Any]]") -> str:
    for name, values in own.items():
        wrong = np.flatnonzero(~(np.abs(values) <= _most(name)))
        if len(wrong):
            raise located(file, None, f"not written: row {wrong[0]} (counted from 0): `{name}` is {values[wrong[0]]:.9g}; "
                          f"a number between {-_most(name):g} and {_most(name):g} is needed")
    if not len(own["t_s"]):
        raise located(file, None, "not written: there are no rows")
    _check_times(file, own["t_s"])
    columns = {name: [repr(value) for value in values.tolist()] for name, values in own.items()}
    for name, column in further.items():
        values = np.asarray(column)
        if name in own or not name or set(name) & set(',"\r\n') or values.ndim != 1 or values.dtype.kind not in "fiub":
            raise located(file, None, f"not written: {name!r} is no further column: one of numbers is needed, with a name "
                          "of its own")
        # An empty cell is a value that does not exist.
        columns[name] = ["" if value != value else repr(value) for value in (values * 1).tolist()]
    try:
        rows = [",".join(row) for row in zip(*columns.values(), strict=True)]
    except ValueError:
        raise located(file, None, "not written: its columns are not of one length: "
                      + ", ".join(f"{name} has {len(column)} rows" for name, column in columns.items())) from None
    return ",".join(columns) + "\n" + "".join(row + "\n" for row in rows)


def _read_toml(file: Path) -> "dict[str, Any]":
    try:
        return tomllib.loads(file.read_bytes().decode("utf-8-sig"))  # editors of Windows put a mark before it
    except FileNotFoundError:
        raise located(file, None, "no such file") from None
    except OSError as e:
        raise located(file, None, e.strerror or str(e)) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as e:
        line = re.search(r"line (\d+)", str(e))
        raise located(file, int(line[1]) if line else None, str(e)) from None


def _specimen_of(metadata: "dict[str, Any]", file: Path) -> Specimen:
    def number(key: str) -> Optional[float]:
        value = metadata.get(key)
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise located(file, None, f"`{key}` is {value!r}; a number is needed")
        if key.endswith("_mm") and not 0 < value <= 1e4:
            raise located(file, None, f"`{key}` is {value}; it lies between 0 and 10000 mm")
        return float(value)

    if metadata.get("format") != FORMAT:
        raise located(file, None, f"`format` is {metadata.get('format')!r}; this reads \"{FORMAT}\"")
    if not isinstance(metadata.get("specimen"), str):
        raise located(file, None, "`specimen` is missing: a text is needed")
    if "units" in metadata and metadata["units"] != UNITS:
        raise located(file, None, f"`units` is {metadata['units']!r}; it says \"{UNITS}\" or nothing")
    if metadata.get("output", "force") not in ("force", "position", "pressure"):
        raise located(file, None, f"`output` is {metadata['output']!r}; it is \"force\" (the default), \"position\" or "
                      "\"pressure\"")
    specimen = Specimen(number("rest_length_mm"), number("pressurized_rest_length_mm"), number("nominal_pressure_psi"))
    if specimen.rest_length_mm is None and specimen.pressurized_rest_length_mm is not None:
        raise located(file, None, "`pressurized_rest_length_mm` is stated without `rest_length_mm`, which positions are "
                      "counted from; state both, or neither")
    return specimen


__all__ = ["BadInput", "FORMAT", "Recording", "Specimen", "UNITS", "read_columns"]

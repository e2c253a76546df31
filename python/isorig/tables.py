"""Tables of an export: what a protocol did in a session, and what happened (docs/formats/recording.md)."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Iterable, Iterator, Mapping

import numpy as np
import numpy.typing as npt

from .errors import located

#: Of a session, beside frame and pressure.
NAMES = ("ramps", "holds", "steps", "setpoints", "events", "sessions")
_TEXT = {"kind", "text", "severity", "code", "name"}
_WHOLE = {"step", "complete", "state", "session", "attempt", "repetition", "frame_rows", "pressure_rows", "start_unix_us"}
#: By the end of a column's name, the longer first.
_UNITS = {"_mm_s": "mm/s", "_per_s": "1/s", "_permille": "permille", "_psi": "psi", "_mm": "mm", "_ns": "ns", "_us": "us",
          "_C": "degC", "_N": "N", "_s": "s"}


@dataclass(frozen=True)
class Table:
    """columns: by name; text as str, NaN where a value does not exist. units, descriptions: of each column."""

    columns: "dict[str, npt.NDArray[Any]]"
    units: "dict[str, str]"
    descriptions: "dict[str, str]"

    def __getitem__(self, name: str) -> "npt.NDArray[Any]":
        if name not in self.columns:
            raise KeyError(f"no column {name}; the table has: {', '.join(self.columns)}")
        return self.columns[name]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))


class Tables(Mapping[str, Table]):
    """Tables by name, each read when it is first asked for. What is not there raises a KeyError that says what is."""

    def __init__(self, names: Iterable[str] = (), read: "Callable[[str], Table] | None" = None, where: str = "") -> None:
        self._names, self._read, self._where = tuple(names), read, where
        self._tables: "dict[str, Table]" = {}
        self._folder: "Path | None" = None

    @classmethod
    def of_folder(cls, folder: Path) -> "Tables":
        """The CSV files beside a recording's own."""
        there = [name for name in NAMES if (folder / f"{name}.csv").exists() or (folder / f"{name}.csv").is_symlink()]
        tables = cls(there, lambda name: read_table(folder / f"{name}.csv"), str(folder))
        tables._folder = folder.resolve()
        return tables

    def are_of(self, folder: Path) -> bool:
        """Whether they are the files of this folder."""
        return self._folder == folder.resolve()

    def __getitem__(self, name: str) -> Table:
        if name not in self._names or self._read is None:
            where = f"{self._where}: " if self._where else ""
            has = (f"it has: {', '.join(self._names)}" if self._names
                   else f"it has none; isorig export writes {', '.join(NAMES)}")
            raise KeyError(f"{where}no table {name}; {has}")
        if name not in self._tables:
            self._tables[name] = self._read(name)
        return self._tables[name]

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __repr__(self) -> str:
        return f"Tables({', '.join(self._names)})"


def unit_of(column: str) -> str:
    """By its name; "" for a number without one."""
    return next((unit for end, unit in _UNITS.items() if column.endswith(end)), "")


def read_table(file: Path) -> Table:
    """A CSV as `isorig export` writes it. Raises BadInput with file and line."""
    try:
        text = file.read_text(encoding="utf-8")
        lines = csv.reader(io.StringIO(text, newline=""), strict=True)
        names: "list[str]" = next(lines, [])
        if not names or len(set(names)) != len(names):
            raise located(file, 1, "the header has to name each column, each once")
        cells: "list[list[str]]" = [[] for _ in names]
        numbers: "list[int]" = []
        for row in lines:
            if len(row) != len(names):
                raise located(file, lines.line_num, f"{len(row)} cells where the header has {len(names)}")
            numbers.append(lines.line_num)
            for column, cell in zip(cells, row):
                column.append(cell)
    except OSError as e:
        raise located(file, None, e.strerror or str(e)) from None
    except (UnicodeDecodeError, csv.Error) as e:
        raise located(file, None, f"this is no CSV of an export: {e}") from None
    columns = {name: _column(file, name, column, numbers) for name, column in zip(names, cells)}
    return Table(columns, {name: unit_of(name) for name in names}, {name: "" for name in names})


def _column(file: Path, name: str, cells: "list[str]", lines: "list[int]") -> "npt.NDArray[Any]":
    if name in _TEXT:
        return np.array(cells, dtype=str)
    whole = name in _WHOLE or name.endswith(("_ns", "_permille"))
    values: "list[float]" = []
    for cell, line in zip(cells, lines):
        try:
            values.append(int(cell) if whole else float(cell) if cell else np.nan)
        except ValueError:
            kind = "a whole number" if whole else "a number, or nothing,"
            raise located(file, line, f"`{name}` is \"{cell[:40]}\"; {kind} is needed") from None
    return np.array(values, dtype=np.int64 if whole else np.float64)

"""TOML as text: the keys and tables of a recording.toml that was read with tomllib (which does not write)."""

from __future__ import annotations

import datetime
import re
from pathlib import Path
from typing import Any

import numpy as np

from .errors import located

_BARE = re.compile(r"[A-Za-z0-9_-]+\Z")


def toml_text(table: "dict[str, Any]", file: Path) -> str:
    """Raises BadInput, with the key, for a value that TOML 1.0 does not have."""
    return "".join(line + "\n" for line in _lines(table, (), file))


def _lines(table: "dict[str, Any]", path: "tuple[str, ...]", file: Path) -> "list[str]":
    plain: "list[str]" = []
    tables: "list[str]" = []
    for key, value in table.items():
        where = (*path, key)
        if isinstance(value, dict):
            tables += [f"[{_name(where, file)}]", *_lines(value, where, file)]
        elif isinstance(value, (list, tuple)) and value and all(isinstance(each, dict) for each in value):
            for each in value:
                tables += [f"[[{_name(where, file)}]]", *_lines(each, where, file)]
        else:
            plain.append(f"{_name((key,), file)} = {_value(value, where, file)}")
    return plain + tables  # a key below the name of a table would be the table's


def _name(path: "tuple[str, ...]", file: Path) -> str:
    return ".".join(key if isinstance(key, str) and _BARE.match(key) else _string(key, path, file) for key in path)


def _string(value: Any, path: "tuple[str, ...]", file: Path) -> str:
    if not isinstance(value, str) or any(0xD800 <= ord(c) <= 0xDFFF for c in value):
        raise located(file, None, f"not written: {value!r} (in `{'.'.join(map(str, path))}`) is no text")
    escaped = "".join(c if c.isprintable() and c not in '"\\' else f"\\U{ord(c):08x}" for c in value)
    return f'"{escaped}"'


def _value(value: Any, path: "tuple[str, ...]", file: Path) -> str:
    if isinstance(value, (np.generic, np.ndarray)):
        value = value.tolist()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _string(value, path, file)
    if isinstance(value, float) or (isinstance(value, int) and -(2**63) <= value < 2**63):
        return repr(value)
    if isinstance(value, (datetime.datetime, datetime.date, datetime.time)):
        return value.isoformat()
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_value(each, path, file) for each in value) + "]"
    if isinstance(value, dict):
        inside = (f"{_name((key,), file)} = {_value(each, (*path, key), file)}" for key, each in value.items())
        return "{" + ", ".join(inside) + "}"
    raise located(file, None, f"not written: `{'.'.join(map(str, path))}` is {value!r}, which TOML has no value for")

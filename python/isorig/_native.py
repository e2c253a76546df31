"""libisorig_model, loaded: the arithmetic of `isorig predict` behind a C interface (isorig_model.h)."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_char_p, c_double, c_int, c_int32, c_int64, c_size_t, c_uint32, c_void_p
from pathlib import Path
from typing import Any, Optional

import numpy as np
import numpy.typing as npt

from .errors import BadInput, IsorigError

ABI = 2
FloatArray = npt.NDArray[np.float64]
_DoublePointer = POINTER(c_double)


class NumberRecord(ctypes.Structure):
    """``isorig_number``."""

    _fields_ = [
        ("part", c_int64), ("physics", c_char_p), ("law", c_char_p), ("name", c_char_p), ("what", c_char_p),
        ("value", c_double), ("lower", c_double), ("upper", c_double), ("coefficient", c_int32), ("fixed", c_int32),
    ]


class SpecimenRecord(ctypes.Structure):
    """``isorig_specimen``."""

    _fields_ = [("rest_length_mm", c_double), ("pressurized_rest_length_mm", c_double),
                ("nominal_pressure_psi", c_double)]


class StepRecord(ctypes.Structure):
    """``isorig_step``."""

    _fields_ = [("kind", c_char_p), ("text", c_char_p), ("from_mm", c_double), ("to_mm", c_double),
                ("velocity_mm_s", c_double), ("pressure_psi", c_double)]


def _load() -> ctypes.CDLL:
    path = Path(__file__).with_name("libisorig_model.so")
    try:
        library = ctypes.CDLL(str(path))
    except OSError as e:
        raise ImportError(f"{path}: {e}; it comes with the package python3-isorig, and in a build tree with "
                          "`ninja isorig_python`") from None
    arguments: "dict[str, tuple[Any, list[Any]]]" = {
        "isorig_model_abi": (c_int, []),
        "isorig_model_version": (c_char_p, []),
        "isorig_model_error": (c_char_p, []),
        "isorig_model_notes": (c_char_p, []),
        "isorig_model_parse": (c_void_p, [c_char_p, c_char_p]),
        "isorig_model_nominal": (c_void_p, [c_char_p]),
        "isorig_model_copy": (c_void_p, [c_void_p]),
        "isorig_model_free": (None, [c_void_p]),
        "isorig_model_text": (c_char_p, [c_void_p]),
        "isorig_model_name": (c_char_p, [c_void_p]),
        "isorig_model_has_band": (c_int, [c_void_p]),
        "isorig_model_number_count": (c_size_t, [c_void_p]),
        "isorig_model_number": (c_int, [c_void_p, c_size_t, POINTER(NumberRecord)]),
        "isorig_model_set": (c_int, [c_void_p, c_size_t, c_double]),
        "isorig_drive_new": (c_void_p, [POINTER(SpecimenRecord), c_size_t, _DoublePointer, _DoublePointer, c_size_t,
                                        _DoublePointer, _DoublePointer]),
        "isorig_drive_free": (None, [c_void_p]),
        "isorig_drive_was_read_with": (c_int, [c_void_p, _DoublePointer]),
        "isorig_model_predict": (c_int, [c_void_p, c_void_p, _DoublePointer, _DoublePointer, _DoublePointer,
                                         _DoublePointer]),
        "isorig_unit_in_doubt": (c_char_p, [POINTER(SpecimenRecord), c_size_t, _DoublePointer]),
        "isorig_stepper_new": (c_void_p, [c_void_p, POINTER(SpecimenRecord)]),
        "isorig_stepper_free": (None, [c_void_p]),
        "isorig_stepper_run": (c_int, [c_void_p, c_size_t, _DoublePointer, _DoublePointer, _DoublePointer,
                                       _DoublePointer]),
        "isorig_response_read": (c_void_p, [c_char_p]),
        "isorig_response_free": (None, [c_void_p]),
        "isorig_response_name": (c_char_p, [c_void_p]),
        "isorig_response_output": (c_char_p, [c_void_p]),
        "isorig_response_error": (c_double, [c_void_p]),
        "isorig_response_predict": (c_int, [c_void_p, c_char_p, c_size_t, _DoublePointer, _DoublePointer, _DoublePointer,
                                            c_size_t, _DoublePointer, _DoublePointer, _DoublePointer, _DoublePointer,
                                            _DoublePointer]),
        "isorig_plan_new": (c_void_p, [c_char_p, c_char_p]),
        "isorig_plan_free": (None, [c_void_p]),
        "isorig_plan_count": (c_size_t, [c_void_p]),
        "isorig_plan_step": (c_int, [c_void_p, c_size_t, POINTER(StepRecord)]),
        "isorig_run_state": (c_int, [c_char_p, c_char_p, c_int, POINTER(c_int)]),
        "isorig_run_complaints": (c_char_p, []),
        "isorig_crc32c": (c_uint32, [c_char_p, c_size_t, c_uint32]),
    }
    for name, (result, takes) in arguments.items():
        function = getattr(library, name)
        function.restype = result
        function.argtypes = takes
    if library.isorig_model_abi() != ABI:
        raise ImportError(f"{path} is of another version of isorig (interface {library.isorig_model_abi()}, "
                          f"this package has {ABI}); install both from one release")
    return library


library = _load()


def text(value: Optional[bytes]) -> str:
    """Of a C string."""
    return value.decode("utf-8", "replace") if value else ""


def failure() -> IsorigError:
    """The library's last error."""
    return BadInput(text(library.isorig_model_error()))


def version() -> str:
    """Of isorig."""
    return text(library.isorig_model_version())


def check(result: int) -> None:
    """Raises what the library says when a call has failed."""
    if result != 0:
        raise failure()


def column(name: str, values: npt.ArrayLike, rows: Optional[int] = None) -> FloatArray:
    """One-dimensional, contiguous doubles; ``rows`` of them where that is given."""
    try:
        array = np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError) as e:
        raise BadInput(f"{name}: numbers are needed: {e}") from None
    if array.ndim != 1:
        raise BadInput(f"{name}: one column is needed, and it has {array.ndim} dimensions")
    if rows is not None and len(array) != rows:
        raise BadInput(f"{name} has {len(array)} rows where {rows} are needed")
    return array


def pointer(array: Optional[FloatArray]) -> Any:
    """NULL for None."""
    return None if array is None else array.ctypes.data_as(_DoublePointer)


def crc32c(data: bytes, before: int = 0) -> int:
    """CRC-32C (Castagnoli; RFC 3720, B.4) of bytes; ``before`` continues an earlier one."""
    return int(library.isorig_crc32c(data, len(data), before))

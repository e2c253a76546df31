"""Models of positions and pressures: what `isorig diagnose` makes of recordings whose output is not the force."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import _native
from ._native import FloatArray
from .errors import BadInput, located
from .recording import PathLike, Recording

FORMAT = "isorig-response/1"


@dataclass(frozen=True)
class Answer:
    """A position (mm) or a pressure (psi), row by row of its own file.

    low95, high95: the band that 95 % of readings should lie in; NaN for a model that does not know its error.
    """

    t_s: FloatArray
    value: FloatArray
    low95: FloatArray
    high95: FloatArray


class ResponseModel:
    """model.toml or nominal.toml of a diagnosis of positions or pressures.

    name: as the file has it. output: what it answers with, "position" or "pressure". unit: "mm" or "psi". error: rms of
    readings that were left out of its fit, in that unit; 0 where it is not known.
    """

    def __init__(self, file: PathLike) -> None:
        """Reads a file, or that of a diagnosis' folder. Raises BadInput with every fault of the file."""
        self.file = Path(file) / "model.toml" if Path(file).is_dir() else Path(file)
        self._handle = ctypes.c_void_p()
        try:
            #: The file, as it is.
            self.toml = self.file.read_text(encoding="utf-8")
        except FileNotFoundError:
            raise located(self.file, None, "no such file") from None
        except (OSError, UnicodeDecodeError) as e:
            raise located(self.file, None, str(e)) from None
        handle = _native.library.isorig_response_read(str(self.file).encode())
        if not handle:
            raise _native.failure()
        self._handle = ctypes.c_void_p(handle)
        self.name = _native.text(_native.library.isorig_response_name(self._handle))
        self.output = _native.text(_native.library.isorig_response_output(self._handle))
        self.unit = "psi" if self.output == "pressure" else "mm"
        self.error = float(_native.library.isorig_response_error(self._handle))

    @classmethod
    def read(cls, file: PathLike) -> "ResponseModel":
        """As the constructor; as `Model.read` is called."""
        return cls(file)

    def __del__(self) -> None:
        handle, self._handle = getattr(self, "_handle", None), ctypes.c_void_p()
        if handle:
            _native.library.isorig_response_free(handle)

    def predict(self, recording: Recording) -> Answer:
        """What `isorig predict` writes for this recording, digit for digit. Of the output's own readings only the
        beginning is looked at: it starts there."""
        if recording.output != self.output:
            raise BadInput(f"{self.file}: describes the {self.output}, and the output of this recording is the "
                           f"{recording.output}")
        columns = recording._columns()  # held here until the library has read them
        frame = [_native.pointer(columns[name]) for name in ("t_s", "position_mm", "force_N")]
        gauge_t_s, pressure_psi = columns.get("pressure_t_s"), columns.get("pressure_psi")
        t_s = gauge_t_s if self.output == "pressure" else columns["t_s"]
        if t_s is None:
            raise BadInput("the pressure is the output of this recording, and it has none")
        value, low, high = (np.empty(len(t_s)) for _ in range(3))
        _native.check(_native.library.isorig_response_predict(
            self._handle, b"the recording", len(columns["t_s"]), *frame, 0 if gauge_t_s is None else len(gauge_t_s),
            _native.pointer(gauge_t_s), _native.pointer(pressure_psi), _native.pointer(value), _native.pointer(low),
            _native.pointer(high)))
        return Answer(t_s.copy(), value, low, high)


def is_response(text: str) -> bool:
    """The TOML text says that it is such a model, as `isorig predict` looks for it."""
    return next((FORMAT in line for line in text.splitlines() if line.startswith("format")), False)

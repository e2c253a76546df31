"""Models: ``model.toml`` of a diagnosis, stepped by the arithmetic of `isorig predict`."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Iterator, Optional

import numpy as np
import numpy.typing as npt

from . import _native
from ._native import FloatArray
from .errors import BadInput, located
from .recording import PathLike, Recording, Specimen
from .response import is_response


@dataclass(frozen=True)
class Number:
    """One number of a model.

    key: ``physics.name`` ("maxwell.time_constant_s"), with ``#2``, ``#3`` behind the physics where there are several.
    name: with its unit. lower, upper: the range that the law is meant for. coefficient: the force is linear in it.
    fixed: given, not identified.
    """

    key: str
    physics: str
    law: str
    name: str
    what: str
    value: float
    lower: float
    upper: float
    coefficient: bool
    fixed: bool


@dataclass(frozen=True)
class Prediction:
    """A force, row by row of what it was predicted for.

    low95_N, high95_N: the band that 95 % of readings should lie in; NaN for a model that does not say what it has
    seen. outside: where the model leaves that. notes: what it leaves, by how much.
    """

    t_s: FloatArray
    force_N: FloatArray
    low95_N: FloatArray
    high95_N: FloatArray
    outside: npt.NDArray[np.bool_]
    notes: "tuple[str, ...]"


class Model:
    """A model whose numbers can be read and set.

    >>> model = Model.nominal("slse1")
    >>> sorted(model)
    ['constant.force_N', 'maxwell.stiffness_N_mm', 'maxwell.time_constant_s', 'spring.stiffness_N_mm']
    >>> model["spring.stiffness_N_mm"] = 2.0
    >>> model["maxwell.stiffness_N_mm"] = 0.0
    >>> model.simulate([0.0, 1.0, 2.0], [0.0, 0.5, 1.5], Specimen(100.0))
    array([0., 1., 3.])
    """

    def __init__(self, handle: int) -> None:
        """Use read(), parse() or nominal()."""
        self._handle = ctypes.c_void_p(handle)

    @classmethod
    def read(cls, file: PathLike) -> "Model":
        """Of a file, or of a diagnosis' folder. Raises BadInput with every fault of the file."""
        file = Path(file)
        if file.is_dir():
            file = file / "model.toml"
        try:
            text = file.read_text(encoding="utf-8")
        except FileNotFoundError:
            raise located(file, None, "no such file") from None
        except (OSError, UnicodeDecodeError) as e:
            raise located(file, None, str(e)) from None
        if is_response(text):
            raise located(file, None, "this is a model of positions or pressures, not of forces; open it with "
                          "isorig.ResponseModel")
        return cls.parse(text, str(file))

    @classmethod
    def parse(cls, text: str, name: str = "model.toml") -> "Model":
        """TOML ("isorig-model/1"); ``name`` stands in its errors."""
        if "\0" in text:
            raise located(name, text.count("\n", 0, text.index("\0")) + 1, "a zero byte, which no TOML has")
        return cls._made(_native.library.isorig_model_parse(text.encode(), name.encode()))

    @classmethod
    def nominal(cls, name: str) -> "Model":
        """"slse1" or "slse2": one or two standard linear solids in parallel, with starting values."""
        return cls._made(_native.library.isorig_model_nominal(name.encode()))

    @classmethod
    def _made(cls, handle: Optional[int]) -> "Model":
        if not handle:
            raise _native.failure()
        return cls(handle)

    def __del__(self) -> None:
        handle, self._handle = getattr(self, "_handle", None), ctypes.c_void_p()
        if handle:
            _native.library.isorig_model_free(handle)

    def copy(self) -> "Model":
        """One that can be changed without changing this."""
        return self._made(_native.library.isorig_model_copy(self._handle))

    @property
    def name(self) -> str:
        """As the file has it."""
        return _native.text(_native.library.isorig_model_name(self._handle))

    @property
    def has_band(self) -> bool:
        """It says what it was fitted to ([seen]), so that its predictions have a band."""
        return bool(_native.library.isorig_model_has_band(self._handle))

    @property
    def toml(self) -> str:
        """As it stands now: for a file that `isorig predict` and the simulated rig take."""
        return _native.text(_native.library.isorig_model_text(self._handle))

    @property
    def numbers(self) -> "list[Number]":
        """Parameters and coefficients of every part, in the order of the file."""
        found = []
        for index in range(_native.library.isorig_model_number_count(self._handle)):
            record = _native.NumberRecord()
            _native.check(_native.library.isorig_model_number(self._handle, index, ctypes.byref(record)))
            found.append(record)
        order: "dict[bytes, list[int]]" = {}
        for record in found:
            parts = order.setdefault(record.physics, [])
            if record.part not in parts:
                parts.append(record.part)
        return [self._number(record, order[record.physics].index(record.part)) for record in found]

    @staticmethod
    def _number(record: Any, nth: int) -> Number:
        physics, name = _native.text(record.physics), _native.text(record.name)
        key = f"{physics}{f'#{nth + 1}' if nth else ''}.{name}"
        return Number(key, physics, _native.text(record.law), name, _native.text(record.what), record.value,
                      record.lower, record.upper, bool(record.coefficient), bool(record.fixed))

    def __iter__(self) -> Iterator[str]:
        return iter([number.key for number in self.numbers])

    def _index(self, key: str) -> int:
        keys = list(self)
        if key not in keys:
            raise BadInput(f"the model has no number \"{key}\"; it has: {', '.join(keys)}")
        return keys.index(key)

    def __getitem__(self, key: str) -> float:
        return self.numbers[self._index(key)].value

    def __setitem__(self, key: str, value: float) -> None:
        _native.check(_native.library.isorig_model_set(self._handle, self._index(key), value))

    def predict(self, recording: "Recording | Drive") -> Prediction:
        """What `isorig predict` writes for this recording, digit for digit. Its measured force is not looked at.

        Motion and pressure are reconstructed from their noisy readings, which takes longer than the rest: who predicts
        one recording many times gives its Drive. Where the model leaves what it has seen it fades to its nominal model,
        and the band widens.
        """
        drive = Drive(recording) if isinstance(recording, Recording) else recording
        force, low, high, outside = (np.empty(len(drive.t_s)) for _ in range(4))
        _native.check(_native.library.isorig_model_predict(
            self._handle, drive._handle, _native.pointer(force), _native.pointer(low), _native.pointer(high),
            _native.pointer(outside)))
        notes = tuple(_native.text(_native.library.isorig_model_notes()).splitlines())
        return Prediction(drive.t_s, force, low, high, outside == 1.0, notes)

    def simulate(self, t_s: npt.ArrayLike, position_mm: npt.ArrayLike, specimen: Specimen,
                 pressure_psi: Optional[npt.ArrayLike] = None) -> FloatArray:
        """The force (N) on a motion that is known: position (mm, relative to the unpressurized rest length) and
        pressure (psi, gauge; the nominal one if left out) change evenly between rows. The specimen has rested at the
        first position. No noise is looked for, nothing fades.
        """
        return Stepper(self, specimen).run(t_s, position_mm, pressure_psi)


class Drive:
    """What drives a model: motion and pressure of a recording, reconstructed once from their noisy readings."""

    def __init__(self, recording: Recording) -> None:
        """The recording's force is not looked at but to know the recording again that a model was made from; its later
        changes do not concern this. Raises BadInput for a recording
        whose output is not the force: the models here pull; `ResponseModel` answers for the others."""
        if recording.output != "force":
            raise BadInput(f"the output of this recording is the {recording.output}, and these models predict forces; "
                           "use isorig.ResponseModel with model.toml of a diagnosis of such recordings")
        self._handle = ctypes.c_void_p()
        specimen = recording.specimen._record()
        columns = recording._columns()  # held here until the library has read them
        self._t_s = columns["t_s"].copy()
        gauge_t_s, pressure_psi = columns.get("pressure_t_s"), columns.get("pressure_psi")
        handle = _native.library.isorig_drive_new(
            ctypes.byref(specimen), len(self._t_s), _native.pointer(self._t_s), _native.pointer(columns["position_mm"]),
            0 if gauge_t_s is None else len(gauge_t_s), _native.pointer(gauge_t_s), _native.pointer(pressure_psi))
        if not handle:
            raise _native.failure()
        self._handle = ctypes.c_void_p(handle)
        # By its readings a model knows the recording that it was made from, whose slips it predicts.
        _native.check(_native.library.isorig_drive_was_read_with(self._handle, _native.pointer(columns["force_N"])))

    @property
    def t_s(self) -> FloatArray:
        """Of its rows, as they were read: a prediction has as many."""
        return self._t_s

    def __del__(self) -> None:
        handle, self._handle = getattr(self, "_handle", None), ctypes.c_void_p()
        if handle:
            _native.library.isorig_drive_free(handle)


class Stepper:
    """A model that runs, one instant or many at a time: for loops that decide as they go.

    >>> model = Model.nominal("slse1")
    >>> stepper = Stepper(model, Specimen(100.0))
    >>> forces = [stepper.step(0.01 * k, min(0.02 * k, 1.0)) for k in range(200)]
    >>> forces[50] > forces[199] > forces[0]  # it relaxes once it is held
    True
    """

    def __init__(self, model: Model, specimen: Specimen) -> None:
        """The model is copied: what is set in it later does not change this."""
        record = specimen._record()
        handle = _native.library.isorig_stepper_new(model._handle, ctypes.byref(record))
        if not handle:
            raise _native.failure()
        self._handle = ctypes.c_void_p(handle)

    def __del__(self) -> None:
        handle, self._handle = getattr(self, "_handle", None), ctypes.c_void_p()
        if handle:
            _native.library.isorig_stepper_free(handle)

    def run(self, t_s: npt.ArrayLike, position_mm: npt.ArrayLike,
            pressure_psi: Optional[npt.ArrayLike] = None) -> FloatArray:
        """The force (N) at each row; goes on where the last call ended. Time (s) has to increase."""
        t = _native.column("t_s", t_s)
        position = _native.column("position_mm", position_mm, len(t))
        pressure = None if pressure_psi is None else _native.column("pressure_psi", pressure_psi, len(t))
        force = np.empty(len(t))
        _native.check(_native.library.isorig_stepper_run(
            self._handle, len(t), _native.pointer(t), _native.pointer(position), _native.pointer(pressure),
            _native.pointer(force)))
        return force

    def step(self, t_s: float, position_mm: float, pressure_psi: Optional[float] = None) -> float:
        """The force (N) at one instant."""
        return float(self.run([t_s], [position_mm], None if pressure_psi is None else [pressure_psi])[0])

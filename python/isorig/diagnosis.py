"""Diagnoses: the folder that `isorig diagnose` writes."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Optional, Union

from .errors import located
from .model import Model
from .recording import PathLike
from .response import ResponseModel, is_response

FORMAT = "isorig-diagnosis/1"
VERDICTS = ("consistent", "missing_physics", "unknown_physics", "cannot_judge")


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval, in the unit that its name ends with."""

    value: float
    low95: float
    high95: float


@dataclass(frozen=True)
class Effect:
    """Physics that the given model lacks. probability: that it is there. size_N: rms of what it does to the force."""

    name: str
    probability: float
    size_N: Optional[float]
    formula: str
    parameters: "dict[str, Estimate]"
    details: "dict[str, Any]"


@dataclass(frozen=True)
class Diagnosis:
    """verdict: one of VERDICTS. missing: most important first. document: the whole of diagnosis.json.

    >>> diagnosis = Diagnosis.parse('{"format": "isorig-diagnosis/1", "verdict": "missing_physics", "missing": '
    ...     '[{"effect": "coulomb_friction", "probability": 0.97, "formula": "F = 0.81 N * sign(v)", '
    ...     '"parameters": {"force_N": {"value": 0.81, "ci95": [0.79, 0.83]}}}]}')
    >>> diagnosis.missing[0].parameters["force_N"]
    Estimate(value=0.81, low95=0.79, high95=0.83)
    """

    verdict: str
    missing: "tuple[Effect, ...]"
    document: "dict[str, Any]"
    folder: Optional[Path] = None

    @classmethod
    def read(cls, folder: PathLike) -> "Diagnosis":
        """Of a folder, or of its diagnosis.json."""
        file = Path(folder)
        if file.is_dir() or not file.suffix:
            file = file / "diagnosis.json"
        try:
            text = file.read_text(encoding="utf-8")
        except FileNotFoundError:
            raise located(file, None, "no such file: is this the folder that isorig diagnose --out was given?") from None
        except (OSError, UnicodeDecodeError) as e:
            raise located(file, None, str(e)) from None
        return cls.parse(text, file)

    @classmethod
    def parse(cls, text: str, file: PathLike = "diagnosis.json") -> "Diagnosis":
        """Of JSON text; ``file`` stands in its errors."""
        try:
            document = json.loads(text)
        except json.JSONDecodeError as e:
            raise located(file, e.lineno, f"this is no JSON: {e.msg}") from None
        if not isinstance(document, dict) or document.get("format") != FORMAT:
            found = document.get("format") if isinstance(document, dict) else None
            raise located(file, None, f"`format` is {found!r}; this reads \"{FORMAT}\"")
        if document.get("verdict") not in VERDICTS:
            raise located(file, None, f"`verdict` is {document.get('verdict')!r}; it is one of {', '.join(VERDICTS)}")
        try:
            missing = tuple(_effect(each) for each in document.get("missing", []))
        except (KeyError, TypeError, ValueError) as e:
            raise located(file, None, f"`missing` is not as docs/diagnosis.md has it: {e!r}") from None
        path = Path(file)
        return cls(document["verdict"], missing, document, path.parent if path.exists() else None)

    @property
    def model(self) -> Union[Model, ResponseModel]:
        """model.toml: the given model with what it lacked. A `ResponseModel` of a diagnosis of positions or pressures."""
        return self._model("model.toml")

    @property
    def nominal(self) -> Union[Model, ResponseModel]:
        """nominal.toml: the given model, refitted."""
        return self._model("nominal.toml")

    def _model(self, name: str) -> Union[Model, ResponseModel]:
        if self.folder is None:
            raise located(name, None, "this diagnosis was not read from a folder")
        file = self.folder / name
        if file.is_file() and is_response(file.read_text(encoding="utf-8", errors="replace")):
            return ResponseModel(file)
        return Model.read(file)


def _effect(entry: "dict[str, Any]") -> Effect:
    parameters = {name: Estimate(float(p["value"]), *(float("nan") if x is None else float(x) for x in p["ci95"]))
                  for name, p in entry.get("parameters", {}).items()}
    return Effect(entry["effect"], float(entry["probability"]), entry.get("size_N"), entry.get("formula", ""),
                  parameters, entry)

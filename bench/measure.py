"""What the rows of bench/run share: commands timed as whole processes, in turn with what they stand beside."""
from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

TREE = Path(__file__).resolve().parent.parent
PEERS = TREE / "bench" / "peers"
PLOTS = TREE / "bench" / "plots"


class NotMeasured(Exception):
    """A row that cannot be measured here; the text says why and what to do."""


@dataclass
class Figure:
    """One line of the page: values of ours and, where there is something beside it, of a peer, measured in turn."""
    what: str
    unit: str
    ours: list[float]
    peer: str = ""
    beside: list[float] = field(default_factory=list)
    target: str = ""
    met: bool | None = None
    note: str = ""

    def ratio(self) -> list[float]:
        """Ours over the peer's, pair by pair; empty where there are no pairs."""
        return sorted(a / b for a, b in zip(self.ours, self.beside) if b) if self.beside else []


@dataclass
class Ran:
    wall_s: float
    cpu_s: float
    out: str


def run(*command: object, env: dict[str, str] | None = None, cwd: Path | None = None, ok: tuple[int, ...] = (0,)) -> Ran:
    """Runs a command to its end; raises NotMeasured with its last words when it fails."""
    words = [str(c) for c in command]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begin = time.perf_counter()
    try:
        done = subprocess.run(words, capture_output=True, text=True, cwd=cwd, env={**os.environ, **(env or {})}, check=False)
    except OSError as e:
        raise NotMeasured(f"`{words[0]}` cannot be run: {e.strerror}") from e
    wall_s = time.perf_counter() - begin
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in ok:
        raise NotMeasured(f"`{' '.join(words)}` ended with {done.returncode}: {(done.stderr or done.stdout).strip()[-400:]}")
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Ran(wall_s, cpu_s, done.stdout)


def objects(text: str) -> list[dict[str, Any]]:
    """The JSON objects that a program printed, one a line."""
    return [json.loads(line) for line in text.splitlines() if line.startswith("{")]


def python(modules: str = "numpy, scipy", package: str = "python3-scipy") -> str:
    """A Python that has these modules (Debian's own, where another is first on the PATH)."""
    for each in ("/usr/bin/python3", "python3"):
        if subprocess.run([each, "-c", f"import {modules}"], capture_output=True, check=False).returncode == 0:
            return each
    raise NotMeasured(f"no Python with {modules.replace(', ', ' and ')}: scripts/setup bench, or apt install {package}")


def needs(program: str, package: str) -> str:
    """Path of a program, or NotMeasured with the Debian package that has it."""
    for folder in [*os.environ["PATH"].split(":"), "/usr/sbin", "/sbin"]:
        path = Path(folder) / program
        if os.access(path, os.X_OK):
            return str(path)
    raise NotMeasured(f"no {program} on the PATH: scripts/setup bench, or apt install {package}")


def steal_share() -> tuple[float, float]:
    """Jiffies stolen by the hypervisor and jiffies in all, since the start of the machine."""
    numbers = [float(n) for n in Path("/proc/stat").read_text().splitlines()[0].split()[1:]]
    return numbers[7], sum(numbers[:8])


def spread(values: list[float]) -> tuple[float, float, float]:
    """Median, least and greatest."""
    return statistics.median(values), min(values), max(values)

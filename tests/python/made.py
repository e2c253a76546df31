"""What the tests of the package are given: programs, a run of the simulated rig and its export."""

from __future__ import annotations

import atexit
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

BIN = Path(os.environ["ISORIG_BIN"])
SOURCE = Path(os.environ["ISORIG_SOURCE"])


def isorig(*words: object, code: int = 0) -> "subprocess.CompletedProcess[str]":
    """A command of the terminal, which has to end with `code`."""
    done = subprocess.run([BIN / "isorig", *map(str, words)], capture_output=True, text=True, timeout=120)
    assert done.returncode == code, f"isorig {words}: code {done.returncode}\n{done.stdout}{done.stderr}"
    return done


class Made:
    """A protocol on the simulated rig, in virtual time, once for all tests of a file."""

    def __init__(self, protocol: str = "vma-smoke") -> None:
        self.folder = Path(tempfile.mkdtemp())
        atexit.register(shutil.rmtree, self.folder)
        isorig("run", SOURCE / f"config/protocols/{protocol}.toml", "--rig", SOURCE / "config/rigs/sim.toml", "--runs",
               self.folder / "runs", "--quiet")
        self.run = next(p for p in (self.folder / "runs").iterdir() if p.is_dir())
        isorig("export", self.run, "--out", self.folder / "recordings")
        self.recording = next((self.folder / "recordings").glob("rep-1_*"))

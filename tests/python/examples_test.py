"""What the documents show is run: docstrings, the examples, the ten lines of Python and of Octave."""

import csv
import doctest
import importlib
import os
import pkgutil
import re
import subprocess
import sys
import types
import unittest
from pathlib import Path

import numpy as np

import isorig as package
from made import SOURCE, Made, isorig

EXAMPLES = SOURCE / "python/examples"


class Docstrings(unittest.TestCase):
    def test_examples_hold(self) -> None:
        tried = 0
        for module in pkgutil.iter_modules(package.__path__, "isorig."):
            if module.name.endswith("libisorig_model"):
                continue  # no Python module: plain C
            result = doctest.testmod(importlib.import_module(module.name))
            self.assertEqual(result.failed, 0, module.name)
            tried += result.attempted
        self.assertGreater(tried, 15)

    def test_the_page_shows_the_examples_as_they_are(self) -> None:
        page = (SOURCE / "docs/python.md").read_text()
        for name, language in (("force_velocity.py", "python"), ("force_velocity.m", "matlab"), ("refit.py", "python")):
            self.assertIn(f"```{language}\n{(EXAMPLES / name).read_text()}```", page, name)

    def test_the_blocks_of_the_page_can_be_run(self) -> None:
        page = (SOURCE / "docs/python.md").read_text()
        blocks = re.findall(r"```pycon\n(.*?)```", page, re.S)
        self.assertGreater(len(blocks), 2)
        os.chdir(OnARecording.tree())
        test = doctest.DocTestParser().get_doctest("\n".join(blocks), {}, "docs/python.md", "docs/python.md", 0)
        runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
        self.assertEqual(runner.run(test).failed, 0)


class OnARecording(unittest.TestCase):
    made: "Made | None" = None

    @classmethod
    def tree(cls) -> Path:
        """A folder as ./run and the README's tour leave it."""
        if OnARecording.made is None:
            made = OnARecording.made = Made("vma-short")
            out = made.folder / "out"
            out.mkdir()
            (made.folder / "recordings").rename(out / "recordings")
            isorig("fv", out / "recordings/rep-1_10-psi", "--out", out / "fv")
        return OnARecording.made.folder

    def setUp(self) -> None:
        os.chdir(self.tree())

    def ramps(self) -> "list[tuple[float, float]]":
        with open("out/fv/ramps.csv") as file:
            return [(float(row["velocity_mm_s"]), float(row["peak_force_N"])) for row in csv.DictReader(file)]

    def compare(self, shortening_mm_s: np.ndarray, force_N: np.ndarray) -> None:
        # The example ends a ramp 1 % of its travel before it stands: 0.02 mm * 3.1 N/mm (both springs of the simulated
        # specimen) = 0.062 N. It takes a single reading, with 10 mN of noise, of a row that is up to 1 ms * 10 mm/s *
        # 3.1 N/mm = 0.031 N late: 0.062 + 0.031 + 4 * 0.010 N. Its velocity is the plan's; the simulated frame overshoots
        # it by up to 4.5 % on the way.
        ramps = self.ramps()
        self.assertEqual(len(ramps), 4)
        self.assertEqual(len(force_N), 8)  # four of them the ways back, which the analysis leaves out
        for velocity, force in ramps:
            k = np.argmin(np.abs(-shortening_mm_s - velocity))
            self.assertAlmostEqual(-shortening_mm_s[k] / velocity, 1.0, delta=0.06)
            self.assertAlmostEqual(force_N[k], force, delta=0.135)

    def test_ten_lines_of_python(self) -> None:
        drawn: "list[tuple[np.ndarray, np.ndarray]]" = []
        pyplot = types.ModuleType("matplotlib.pyplot")
        pyplot.plot = lambda x, y, style: drawn.append((x, y))  # type: ignore[attr-defined]
        for name in ("xlabel", "ylabel", "savefig"):
            setattr(pyplot, name, lambda *_: None)
        plain = types.ModuleType("matplotlib")
        plain.pyplot = pyplot  # type: ignore[attr-defined]
        sys.modules.update({"matplotlib": plain, "matplotlib.pyplot": pyplot})
        exec((EXAMPLES / "force_velocity.py").read_text(), {})
        self.compare(*drawn[0])

    def test_ten_lines_of_octave(self) -> None:
        stubs = Path("octave")
        stubs.mkdir()
        (stubs / "plot.m").write_text("function plot(x, y, s)\n  printf('%.17g %.17g\\n', [x y]');\nend\n")
        for name in ("xlabel", "ylabel", "print"):
            (stubs / f"{name}.m").write_text(f"function {name}(varargin)\nend\n")
        done = subprocess.run(["octave-cli", "--norc", "--no-history", "-q", "--eval",
                               f"warning('off', 'all'); addpath('octave'); source('{EXAMPLES / 'force_velocity.m'}')"],
                              capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)
        table = np.array([[float(cell) for cell in line.split()] for line in done.stdout.splitlines()])
        self.compare(table[:, 0], table[:, 1])

    def test_a_refit(self) -> None:
        # The recording's motion and pressure, and the force of a known model with 10 mN of noise: the example finds its
        # numbers to the four digits that it prints, give or take the last one by rounding and 0.1 % by noise.
        recording = package.Recording.read("out/recordings/rep-1_10-psi")
        truth = package.Model.nominal("slse1")
        numbers = {"spring.stiffness_N_mm": 1.7, "maxwell.stiffness_N_mm": 1.3, "maxwell.time_constant_s": 4.0}
        for name, value in numbers.items():
            truth[name] = value
        noise_N = 0.01 * np.random.default_rng(3).standard_normal(len(recording.t_s))
        recording.force_N = truth.predict(recording).force_N + noise_N
        recording.write("known/out/recordings/rep-1_10-psi")
        done = subprocess.run([sys.executable, EXAMPLES / "refit.py"], capture_output=True, text=True, timeout=100, cwd="known")
        self.assertEqual(done.returncode, 0, done.stderr)
        found = dict(line.split() for line in done.stdout.splitlines()[:4])
        for name, value in numbers.items():
            self.assertAlmostEqual(float(found[name]) / value, 1.0, delta=0.002, msg=name)
        self.assertIn("rms 0.0100 N", done.stdout)
        isorig("predict", "known/out/recordings/rep-1_10-psi", "--model", "known/refitted.toml", "--out", "refitted.csv")


if __name__ == "__main__":
    unittest.main()

"""Models: the package steps what the terminal steps; the rest is compared with laws in closed form."""

import math
import shutil
import tempfile
import unittest
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from isorig import BadInput, Diagnosis, Drive, Model, Recording, ResponseModel, Specimen, Stepper
from made import Made, isorig

SPECIMEN = Specimen(100.0, 80.0, 10.0)


def slse(k1: float, k2: float, tau: float) -> Model:
    model = Model.nominal("slse1")
    model["spring.stiffness_N_mm"] = k1
    model["maxwell.stiffness_N_mm"] = k2
    model["maxwell.time_constant_s"] = tau
    return model


class Prediction(unittest.TestCase):
    @classmethod
    def setUpClass(cls) -> None:
        cls.made = Made()
        cls.recording = Recording.read(cls.made.recording)

    def table(self, model_file) -> np.ndarray:
        out = self.made.folder / "predicted.csv"
        isorig("predict", self.made.recording, "--model", model_file, "--out", out)
        return np.array([[float(cell) for cell in row.split(",")] for row in out.read_text().split()[1:]])

    def test_is_that_of_the_terminal_digit_for_digit(self) -> None:
        folder = self.made.folder / "diagnosis"
        isorig("diagnose", self.made.recording, "--model", "slse1", "--out", folder)
        for name in ("model.toml", "nominal.toml"):
            table = self.table(folder / name)
            predicted = Model.read(folder / name).predict(self.recording)
            np.testing.assert_array_equal(predicted.t_s, table[:, 0])
            np.testing.assert_array_equal(predicted.force_N, table[:, 1])
            if table.shape[1] == 5:
                np.testing.assert_array_equal(predicted.low95_N, table[:, 2])
                np.testing.assert_array_equal(predicted.high95_N, table[:, 3])
                np.testing.assert_array_equal(predicted.outside, table[:, 4] == 1.0)
        self.assertTrue(Model.read(folder).has_band)
        diagnosis = Diagnosis.read(folder)
        self.assertEqual(diagnosis.model.toml, Model.read(folder / "model.toml").toml)
        np.testing.assert_array_equal(diagnosis.model.predict(self.recording).force_N, self.table(folder / "model.toml")[:, 1])

    def test_never_looks_at_the_force(self) -> None:
        model = slse(1.5, 1.0, 2.0)
        before = model.predict(self.recording).force_N
        self.recording.force_N = self.recording.force_N + 7.0
        np.testing.assert_array_equal(model.predict(self.recording).force_N, before)

    def test_columns_that_were_set_are_read_as_they_are(self) -> None:
        # Every other row as a view, or in another precision, is what a copy of it in contiguous doubles is.
        model, whole = slse(1.5, 1.0, 2.0), Recording.read(self.made.recording)
        copied = Recording(whole.specimen, whole.t_s[::2].copy(), whole.position_mm[::2].copy(), whole.force_N[::2].copy(),
                           whole.pressure_t_s[::3].copy(), whole.pressure_psi[::3].copy())
        viewed = Recording.read(self.made.recording)
        viewed.t_s, viewed.position_mm, viewed.force_N = whole.t_s[::2], whole.position_mm[::2], whole.force_N[::2]
        viewed.pressure_t_s, viewed.pressure_psi = whole.pressure_t_s[::3], whole.pressure_psi[::3]
        expected = model.predict(copied).force_N
        np.testing.assert_array_equal(model.predict(viewed).force_N, expected)
        self.assertEqual(viewed.unit_in_doubt(), copied.unit_in_doubt())
        viewed.position_mm = np.float32(copied.position_mm)
        copied.position_mm = viewed.position_mm.astype(np.float64)
        np.testing.assert_array_equal(model.predict(viewed).force_N, model.predict(copied).force_N)
        viewed.position_mm = whole.position_mm[:10]
        with self.assertRaises(BadInput) as caught:
            model.predict(viewed)
        self.assertIn(f"position_mm has 10 rows where {len(copied.t_s)} are needed", str(caught.exception))
        with self.assertRaises(AttributeError):
            Drive(copied).t_s = copied.t_s[:10]

    def test_has_no_band_without_what_was_seen(self) -> None:
        predicted = slse(1.5, 1.0, 2.0).predict(self.recording)
        self.assertTrue(np.isnan(predicted.low95_N).all() and not predicted.outside.any())

    def test_a_model_that_was_changed_is_written_and_read_again(self) -> None:
        model = slse(1.5, 1.0, 2.0)
        file = self.made.folder / "own.toml"
        file.write_text(model.toml)
        np.testing.assert_array_equal(model.predict(self.recording).force_N, self.table(file)[:, 1])


class Stepping(unittest.TestCase):
    def test_a_ramp_is_the_closed_form(self) -> None:
        # F = k1 (e0 + v t) + k2 e0 exp(-t / tau) + k2 tau v (1 - exp(-t / tau)) for one standard linear solid. It rests
        # at its first position, so that the arm holds nothing: k2 e0 = 0. Both sides round some hundred times.
        k1, k2, tau, v = 1.7, 1.3, 0.8, 3.0
        t = np.sort(np.random.default_rng(1).uniform(0.0, 4.0, 300))
        t[0] = 0.0
        force = slse(k1, k2, tau).simulate(t, v * t - 5.0, SPECIMEN)
        law = k1 * (20.0 - 5.0 + v * t) + k2 * tau * v * -np.expm1(-t / tau)
        np.testing.assert_allclose(force, law, rtol=0, atol=300 * np.finfo(float).eps * np.abs(law).max())

    def test_does_not_depend_on_how_often_it_is_asked(self) -> None:
        # Exact steps between instants of constant velocity: a thousand or ten give the same end, but for rounding.
        model = slse(1.7, 1.3, 0.8)
        ends = [model.simulate(np.linspace(0, 2, n), np.linspace(0, 4, n), SPECIMEN)[-1] for n in (11, 1001)]
        self.assertAlmostEqual(ends[0], ends[1], delta=2000 * np.finfo(float).eps * abs(ends[0]))

    def test_pieces_are_the_whole(self) -> None:
        t = np.linspace(0, 3, 301)
        x = np.sin(2 * t)
        model = Model.nominal("slse2")
        whole = model.simulate(t, x, SPECIMEN)
        stepper = Stepper(model, SPECIMEN)
        model["spring.stiffness_N_mm"] = 99.0  # no longer concerns it
        pieces = [stepper.run(t[:100], x[:100]), [stepper.step(a, b) for a, b in zip(t[100:200], x[100:200])],
                  stepper.run(t[200:], x[200:])]
        np.testing.assert_array_equal(np.concatenate(pieces), whole)

    def test_pressure_acts_as_its_law_says(self) -> None:
        model = Model.parse('format = "isorig-model/1"\nname = "p"\n[[part]]\nphysics = "pressure_coupling"\n'
                            'law = "force"\nforce_N_psi = 2.5\n')
        force = model.simulate([0.0, 1.0, 2.0], [0.0, 0.0, 0.0], SPECIMEN, [10.0, 11.0, 9.0])
        np.testing.assert_allclose(force, [0.0, 2.5, -2.5], atol=1e-14)

    def test_a_refit_finds_what_made_the_force(self) -> None:
        # Gaussian noise of 10 mN: the estimate is within four standard errors of the truth (by the fit's own Jacobian)
        # in all but 1 of 5000 draws for three numbers; the seed is fixed.
        truth, noise_N = np.array([1.7, 1.3, 0.8]), 0.01
        t = np.linspace(0, 20, 2001)
        x = 2.0 * np.interp(t, [0, 2, 3, 10, 12, 20], [0, 0, 1, 1, -1, -1])
        measured = slse(*truth).simulate(t, x, SPECIMEN) + noise_N * np.random.default_rng(2).standard_normal(len(t))
        fit = least_squares(lambda p: slse(*p).simulate(t, x, SPECIMEN) - measured, [1.0, 1.0, 2.0], bounds=(1e-3, 100))
        error = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac))) * noise_N
        self.assertTrue((np.abs(fit.x - truth) < 4 * error).all(), f"{fit.x} +- {error}")
        self.assertTrue((error < 0.01).all())


class Answers(unittest.TestCase):
    """Models of positions and pressures."""

    @classmethod
    def setUpClass(cls) -> None:
        cls.folder = Path(tempfile.mkdtemp())
        cls.addClassCleanup(shutil.rmtree, cls.folder)

    def compare(self, recording: Recording, column: str) -> ResponseModel:
        """The model of a diagnosis, which is asked by the terminal and by the package."""
        name = recording.output
        recording.write(self.folder / name)
        isorig("diagnose", self.folder / name, "--model", "slse1", "--out", self.folder / "diagnosis" / name)
        diagnosis = Diagnosis.read(self.folder / "diagnosis" / name)
        for file, model in (("model.toml", diagnosis.model), ("nominal.toml", diagnosis.nominal)):
            self.assertIsInstance(model, ResponseModel)
            isorig("predict", self.folder / name, "--model", self.folder / "diagnosis" / name / file, "--out", self.folder / "p.csv")
            header, *rows = (self.folder / "p.csv").read_text().split()
            self.assertEqual(header, f"t_s,{column},low95_{model.unit},high95_{model.unit}")
            answer = model.predict(Recording.read(self.folder / name))
            np.testing.assert_array_equal([[float(cell) for cell in row.split(",")] for row in rows],
                                          np.column_stack([answer.t_s, answer.value, answer.low95, answer.high95]))
            self.assertTrue((np.abs(answer.high95 - answer.value - 1.96 * model.error) < 1e-12).all())
        return diagnosis.model

    def test_a_position_is_that_of_the_terminal_digit_for_digit(self) -> None:
        # 0.2 mm/psi at once and 0.05 mm/psi with 3 s, on steps of the pressure that are read 5 ms apart from the position.
        t = np.arange(0, 60, 0.05)

        def level_psi(at: np.ndarray) -> np.ndarray:
            return 5 + 5 * (np.floor(at / 10) % 2)
        lag = np.zeros(len(t))
        for k in range(1, len(t)):
            lag[k] = level_psi(t[k]) + (lag[k - 1] - level_psi(t[k])) * np.exp(-0.05 / 3)
        noise = np.random.default_rng(5)
        position_mm = 0.2 * level_psi(t) + 0.05 * lag + 0.002 * noise.standard_normal(len(t))
        recording = Recording(Specimen(), t, position_mm, np.zeros(len(t)), t + 0.005,
                              level_psi(t + 0.005) + 0.01 * noise.standard_normal(len(t)), "muscle", {"output": "position"})
        model = self.compare(recording, "position_mm")
        self.assertEqual((model.output, model.unit), ("position", "mm"))
        without = Recording(Specimen(), t, position_mm, np.zeros(len(t)), metadata={"output": "position"})
        with self.assertRaisesRegex(BadInput, "the recording: the model answers to pressure_psi, and the recording has none"):
            model.predict(without)
        late = Recording(Specimen(), [0, 0], [1, 1], [0, 0], metadata={"output": "position"})
        with self.assertRaisesRegex(BadInput, "t_s is 0 s after 0 s"):
            model.predict(late)

    def test_a_pressure_is_that_of_the_terminal_digit_for_digit(self) -> None:
        t = np.arange(0, 100, 0.1)
        psi = 10 * np.exp(-t / 20) + 0.02 * np.random.default_rng(6).standard_normal(len(t))
        model = self.compare(Recording(Specimen(), [], [], [], t, psi, "leak", {"output": "pressure"}), "pressure_psi")
        force = Recording(Specimen(), [0, 1], [0, 1], [0, 1])
        with self.assertRaisesRegex(BadInput, "model.toml: describes the pressure, and the output of this recording is the force"):
            model.predict(force)
        with self.assertRaisesRegex(BadInput, "of positions or pressures, not of forces; open it with isorig.ResponseModel"):
            Model.read(model.file)

    def test_wrong_files_are_named(self) -> None:
        file = self.folder / "wrong.toml"
        file.write_text('format = "isorig-response/1"\nname = "x"\noutput = "force"\n')
        with self.assertRaises(BadInput) as caught:
            ResponseModel(file)
        self.assertIn('wrong.toml:3:10: `output` = "force"', str(caught.exception))
        with self.assertRaisesRegex(BadInput, "none.toml: no such file"):
            ResponseModel(self.folder / "none.toml")


class Errors(unittest.TestCase):
    def says(self, text: str, call, *words: object) -> None:
        with self.assertRaises(BadInput) as caught:
            call(*words)
        self.assertIn(text, str(caught.exception))

    def test_a_model_is_refused_in_the_words_of_the_terminal(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            file = f"{folder}/wrong.toml"
            with open(file, "w") as out:
                out.write('format = "isorig-model/1"\nname = "x"\n[[part]]\nphysics = "sprung"\nspeed = 3\n')
            said = isorig("predict", folder, "--model", file, "--out", f"{folder}/p.csv", code=3).stderr
            with self.assertRaises(BadInput) as caught:
                Model.read(file)
            self.assertEqual(str(caught.exception), said.removeprefix("isorig: ").rstrip("\n"))
            self.assertEqual(caught.exception.exit_code, 3)

    def test_numbers_out_of_their_range(self) -> None:
        model = Model.nominal("slse1")
        self.says("maxwell.time_constant_s is -1; it lies between", model.__setitem__, "maxwell.time_constant_s", -1.0)
        self.says("spring.stiffness_N_mm is nan", model.__setitem__, "spring.stiffness_N_mm", math.nan)
        self.says("has no number \"stiffness\"; it has: spring.stiffness_N_mm", model.__getitem__, "stiffness")
        self.says("there are slse1, slse2", Model.nominal, "slse3")

    def test_several_of_one_kind_are_numbered(self) -> None:
        keys = list(Model.nominal("slse2"))
        self.assertEqual([k for k in keys if k.endswith("time_constant_s")],
                         ["maxwell.time_constant_s", "maxwell#2.time_constant_s"])

    def test_motions_that_are_none(self) -> None:
        model = Model.nominal("slse1")
        self.says("row 2 (counted from 0): t_s is 1 s after 1 s", model.simulate, [0, 1, 1], [0, 0, 0], SPECIMEN)
        self.says("row 1 (counted from 0): position_mm is no finite number", model.simulate, [0, 1], [0, math.nan], SPECIMEN)
        self.says("position_mm has 2 rows where 3 are needed", model.simulate, [0, 1, 2], [0, 0], SPECIMEN)
        self.says("one column is needed", model.simulate, [[0, 1]], [[0, 0]], SPECIMEN)
        self.says("numbers are needed", model.simulate, ["a"], [0], SPECIMEN)
        self.says("rest_length_mm is -1", model.simulate, [0], [0], Specimen(-1.0))
        stepper = Stepper(model, SPECIMEN)
        stepper.step(0.0, 0.0)
        self.says("t_s is 0 s after 0 s", stepper.step, 0.0, 1.0)
        self.assertGreater(stepper.step(1.0, 1.0), 0.0)  # goes on as if the wrong call had not been


if __name__ == "__main__":
    unittest.main()

"""Recordings, runs and diagnoses: the package opens what the terminal writes, and refuses what is none."""

import json
import shutil
import struct
import tempfile
import tomllib
import unittest
from pathlib import Path
from typing import Any, Callable

import numpy as np

from isorig import BadInput, Diagnosis, Event, Model, Recording, Run, Session, Specimen, read_log
from isorig_msgs import pressure_batch_t, run_header_t
from made import Made, isorig

TOML = 'format = "isorig-recording/1"\nspecimen = "s"\nrest_length_mm = 90.0\n'


class Recordings(unittest.TestCase):
    def folder(self, frame: str, toml: str = TOML, pressure: "str | None" = None) -> Path:
        folder = Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, folder)
        (folder / "recording.toml").write_text(toml)
        (folder / "frame.csv").write_text(frame)
        if pressure is not None:
            (folder / "pressure.csv").write_text(pressure)
        return folder

    def refused(self, folder: Path) -> str:
        with self.assertRaises(BadInput) as caught:
            Recording.read(folder)
        return str(caught.exception)

    def test_further_columns_are_kept(self) -> None:
        folder = self.folder("t_s,position_mm,force_N,temperature_C,note,force_max_N\r\n0,0,1,20,a,\r\n1,2,3,21,,4\r\n", pressure="t_s,pressure_psi\n0,5\n")
        recording = Recording.read(folder)
        np.testing.assert_array_equal(recording.further["temperature_C"], [20.0, 21.0])
        np.testing.assert_array_equal(recording.further["force_max_N"], [np.nan, 4.0])
        self.assertNotIn("note", recording.further)
        np.testing.assert_array_equal(recording.pressure_psi, [5.0])
        self.assertIsNone(recording.specimen.pressurized_rest_length_mm)

    def test_tables_are_read_when_they_are_asked_for(self) -> None:
        folder = self.folder("t_s,position_mm,force_N\n0,0,0\n1,1,1\n")
        (folder / "events.csv").write_text('t_s,step,severity,code,text,value,threshold,mono_ns\r\n'
                                           '0.5,-1,info,mark,"a ""b"", c\nd",,2,9007199254740993\r\n')
        (folder / "ramps.csv").write_text("step,t_start_s,t_end_s,complete,from_mm,to_mm,velocity_mm_s,strain_rate_per_s,pressure_psi\n")
        (folder / "steps.csv").write_text("step,t_start_s\n1,0\n2,x\n")
        (folder / "holds.csv").write_text("step,t_start_s\n1,0\n2\n")
        (folder / "sessions.csv").write_text("step,step\n")
        tables = Recording.read(folder).tables
        self.assertEqual(set(tables), {"events", "ramps", "steps", "holds", "sessions"})
        events = tables["events"]
        self.assertEqual((events["text"][0], events["mono_ns"][0], events["step"][0]), ('a "b", c\nd', 2**53 + 1, -1))
        self.assertTrue(np.isnan(events["value"][0]))
        self.assertEqual((len(tables["ramps"]), tables["ramps"].units["velocity_mm_s"]), (0, "mm/s"))
        for name, said in (("steps", "steps.csv:3: `t_start_s` is \"x\"; a number"), ("holds", "holds.csv:3: 1 cells where"),
                           ("sessions", "sessions.csv:1: the header")):
            with self.assertRaises(BadInput) as caught:
                tables[name]
            self.assertIn(said, str(caught.exception))
        self.assertFalse("setpoints" in tables)
        with self.assertRaisesRegex(KeyError, "no table setpoints; it has: ramps, holds, steps, events, sessions"):
            tables["setpoints"]
        with self.assertRaisesRegex(KeyError, "no column speed; the table has: step, "):
            tables["ramps"]["speed"]
        with self.assertRaisesRegex(KeyError, "no table ramps; it has none; isorig export writes ramps, holds"):
            self.made().tables["ramps"]

    def test_faults_name_file_and_line(self) -> None:
        head = "t_s,position_mm,force_N\n"
        for frame, line, text in [
            (head + "0,0,0\n1,x,0\n", 3, "`position_mm` is \"x\"; a finite number is needed"),
            (head + "0,0,0\n1,nan,0\n", 3, "`position_mm` is \"nan\"; a finite number is needed"),
            (head + "0,0,0\n1,1_0,0\n", 3, "finite number"),
            (head + "0,0,0\n1,0\n", 3, "2 cells where the header has 3"),
            (head + "0,0,0\n2,0,0\n1,0,0\n", 4, "time goes from 2 s to 1 s"),
            (head + "0,0,0\n1,1e5,0\n", 3, "`position_mm` is 100000; it lies between"),
            (head + "0,0,0\n1,0,4", 3, "may have been cut"),
            (head, 2, "no rows"),
            ("", 1, "the file is empty"),
            ("t_s,position_mm\n0,0\n", 1, "column `force_N` is missing"),
            ("t_s,force_N,position_mm\n0,0,0\n1,1,1\n", 1, "it has to begin with `t_s,position_mm,force_N`"),
            ("t_s,a,position_mm,force_N\n0,0,0,0\n", 1, "it has to begin with"),
            (head + "0,0,0\n\n", 3, "1 cells"),
        ]:
            folder = self.folder(frame)
            said = self.refused(folder)
            self.assertIn(f"frame.csv:{line}: ", said, frame)
            self.assertIn(text, said)

    def test_metadata_is_checked(self) -> None:
        frame = "t_s,position_mm,force_N\n0,0,0\n1,1,1\n"
        for toml, text in [("format = 'isorig-recording/2'\n", "this reads"), ("a = \n", "recording.toml:1:"),
                           (TOML.replace("90.0", "'90'"), "a number is needed"), (TOML.replace("rest_length_mm", "pressurized_rest_length_mm"), "stated without `rest_length_mm`"),
                           (TOML + "units = 'in, lbf'\n", "`units`"), (TOML + "output = 'forse'\n", "`output` is 'forse'"), (TOML.replace("90.0", "-3"), "lies between")]:
            self.assertIn(text, self.refused(self.folder(frame, toml)))
        self.assertIn("no such folder", self.refused(Path("/nonexistent")))

    def test_a_mark_of_windows_before_recording_toml_is_no_fault(self) -> None:
        folder = self.folder("t_s,position_mm,force_N\n0,0,0\n1,1,1\n", "\ufeff" + TOML)
        self.assertEqual(Recording.read(folder).name, "s")

    def test_whole_numbers_are_not_rounded(self) -> None:
        cells = [("1000000001", "9007199254740993", "1", "", "9223372036854775808"), ("1000000003", "9007199254740995", "2", "3", "1")]
        folder = self.folder("t_s,position_mm,force_N,mono_ns,a,b,c,d\n" + "".join(
            f"{k},0,{k}," + ",".join(row) + "\n" for k, row in enumerate(cells)))
        further = Recording.read(folder).further
        self.assertEqual(further["a"].tolist(), [2**53 + 1, 2**53 + 3])  # as doubles both would be even
        self.assertEqual({name: column.dtype.kind for name, column in further.items()},
                         {"mono_ns": "i", "a": "i", "b": "f", "c": "f", "d": "f"})

    def test_what_has_no_length_has_no_strain(self) -> None:
        frame = "t_s,position_mm,force_N\n0,0,0\n1,1,1\n"
        recording = Recording.read(self.folder(frame, TOML.replace("rest_length_mm = 90.0\n", "")))
        self.assertIsNone(recording.specimen.rest_length_mm)
        with self.assertRaisesRegex(BadInput, "no rest_length_mm"):
            recording.specimen.strain(recording.position_mm)
        recording.write(Path(self.enterContext(tempfile.TemporaryDirectory())) / "again")

    def test_other_outputs_are_read_and_written(self) -> None:
        rows = "".join(f"{k},{k * k}\n" for k in range(1, 30))
        folder = self.folder("", 'format = "isorig-recording/1"\nspecimen = "s"\noutput = "pressure"\n', "t_s,pressure_psi\n" + rows)
        (folder / "frame.csv").unlink()
        recording = Recording.read(folder)
        assert recording.pressure_psi is not None
        self.assertEqual((recording.output, len(recording.t_s), len(recording.pressure_psi)), ("pressure", 0, 29))
        again = folder / "again"
        recording.write(again)
        self.assertEqual(sorted(each.name for each in again.iterdir()), ["pressure.csv", "recording.toml"])
        np.testing.assert_array_equal(np.asarray(Recording.read(again).pressure_psi), recording.pressure_psi)
        with self.assertRaisesRegex(BadInput, "the output of this recording is the pressure"):
            Model.nominal("slse1").predict(recording)

    def test_lengths_in_metres_are_doubted_in_the_words_of_the_terminal(self) -> None:
        rows = "".join(f"{0.01 * k:.2f},{1e-6 * k:.7f},{0.1 * k:.1f}\n" for k in range(400))
        folder = self.folder("t_s,position_mm,force_N\n" + rows)
        said = self.refused(folder)
        self.assertIn("is one of the two in another unit?", said)
        self.assertEqual(isorig("fv", folder, "--out", folder / "fv", code=3).stderr.strip(), said)
        (folder / "recording.toml").write_text(TOML + 'units = "s, mm, N, psi"\n')
        Recording.read(folder)

    def test_every_cut_is_refused_or_of_whole_rows(self) -> None:
        whole = "t_s,position_mm,force_N\n0.0,0.25,1.5\n0.5,1.25,2.5\n1.0,2.25,3.7\n"
        folder = self.folder(whole)
        expected = Recording.read(folder).force_N
        for length in range(len(whole)):
            (folder / "frame.csv").write_text(whole[:length])
            try:
                read = Recording.read(folder).force_N
            except BadInput:
                continue
            self.assertTrue(whole[length - 1] == "\n" or whole[length] == "\n", whole[:length])
            np.testing.assert_array_equal(read, expected[: len(read)])

    def test_what_is_written_reads_back_and_the_terminal_takes_it(self) -> None:
        made = Made()
        recording = Recording.read(made.recording)
        out = made.folder / "written"
        recording.write(out)
        for name in ("frame.csv", "pressure.csv"):
            there = np.genfromtxt(out / name, delimiter=",", skip_header=1)
            np.testing.assert_array_equal(there, np.genfromtxt(made.recording / name, delimiter=",", skip_header=1))
        (made.folder / "m.toml").write_text(Model.nominal("slse1").toml)
        isorig("predict", out, "--model", made.folder / "m.toml", "--out", made.folder / "p.csv")
        np.testing.assert_array_equal(Recording.read(out).strain, recording.strain)


    def made(self, **changed: object) -> Recording:
        values: "dict[str, object]" = dict(t_s=[0.0, 1.0, 2.0], position_mm=[0.0, 1.0, 2.0], force_N=[0.0, 1.5, 2.5],
                                           pressure_t_s=[0.0, 1.0], pressure_psi=[5.0, 5.0], name="s")
        return Recording(Specimen(90.0), **{**values, **changed})

    def test_nothing_is_written_that_could_not_be_read(self) -> None:
        folder = Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, folder)
        self.made().write(folder)
        before = {file.name: file.read_bytes() for file in folder.iterdir()}
        self.assertEqual(set(before), {"recording.toml", "frame.csv", "pressure.csv"})
        shorter = self.made()
        shorter.force_N = shorter.force_N[:2]
        nowhere = self.made(name=3)
        for wrong, said in [
            (self.made(force_N=[0.0, np.nan, 1.0]), "row 1 (counted from 0): `force_N` is nan"),
            (self.made(position_mm=[0.0, 1.0, 2e4]), "row 2 (counted from 0): `position_mm` is 20000"),
            (self.made(t_s=[0.0, 1.0, 1.0]), "time goes from 1 s to 1 s"),
            (self.made(pressure_t_s=[0.0, np.inf]), "row 1 (counted from 0): `t_s` is inf"),
            (self.made(t_s=[], position_mm=[], force_N=[], pressure_t_s=None, pressure_psi=None), "there are no rows"),
            (self.made(further={"a": np.array([1.0, 2.0])}), "a has 2 rows"),
            (self.made(pressure_further={"b": np.array([1.0])}), "b has 1 rows"),
            (self.made(further={"t_s": np.zeros(3)}), "'t_s' is no further column"),
            (self.made(further={"note": np.array(["x", "y", "z"])}), "'note' is no further column"),
            (self.made(metadata={"a": None}), "`a` is None"), (self.made(metadata={"units": "in"}), "`units`"),
            (self.made(metadata={"a": {"b": [2**70]}}), "`a.b` is"),
            (shorter, "force_N has 2 rows where 3 are needed"), (nowhere, "`specimen`"),
        ]:
            with self.assertRaises(BadInput, msg=said) as caught:
                wrong.write(folder)
            self.assertIn(said, str(caught.exception))
            self.assertEqual({file.name: file.read_bytes() for file in folder.iterdir()}, before)
        self.made(pressure_t_s=None, pressure_psi=None).write(folder)
        self.assertFalse((folder / "pressure.csv").exists())

    def test_nothing_of_another_recording_stays(self) -> None:
        folder = Path(self.enterContext(tempfile.TemporaryDirectory()))
        (folder / "ramps.csv").write_text("step\n1\n")
        self.made().write(folder)
        self.assertTrue((folder / "ramps.csv").exists())  # without a recording.toml it was of no recording
        read = Recording.read(folder)
        read.force_N = read.force_N + 1.0
        read.write(folder)
        self.assertEqual(list(Recording.read(folder).tables), ["ramps"])  # of this very recording
        for name in ("ramps", "holds", "steps", "setpoints", "events", "sessions"):
            (folder / f"{name}.csv").write_text("step\n1\n")
        (folder / "notes.txt").write_text("somebody's\n")
        self.made().write(folder)
        self.assertEqual(sorted(file.name for file in folder.iterdir()), ["frame.csv", "notes.txt", "pressure.csv", "recording.toml"])

    def test_a_write_that_fails_leaves_what_was_there(self) -> None:
        folder = Path(self.enterContext(tempfile.TemporaryDirectory()))
        self.made().write(folder)
        before = {file.name: file.read_bytes() for file in folder.iterdir()}
        (folder / "pressure.csv.new").mkdir()  # it cannot be written aside
        with self.assertRaises(OSError):
            self.made(name="other", force_N=[1.0, 2.0, 3.0]).write(folder)
        (folder / "pressure.csv.new").rmdir()
        self.assertEqual({file.name: file.read_bytes() for file in folder.iterdir()}, before)

    def test_further_values_and_keys_read_back(self) -> None:
        folder = Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, folder)
        ns = np.array([2**53 + 1, 2**53 + 3, 2**53 + 5])
        metadata = {"units": "s, mm, N, psi", "two words": "a\t\"b\"\n\x7f", "empty": {}, "numbers": [1, 2.5, -3.0], "truth": True,
                    "import": {"notes": ["x"], "source": [{"file": "a.csv", "column": [{"field": "force"}]}, {"file": "b"}]},
                    "versions": {"is.orig": "1", "inline": [[1], [2]]}, "mixed": [{"a": 1}, 2]}
        self.made(further={"x_C": np.array([1.0, np.nan, 3.0]), "mono_ns": ns}, metadata=metadata).write(folder)
        self.assertEqual((folder / "frame.csv").read_text().splitlines()[2], f"1.0,1.0,1.5,,{ns[1]}")
        read = Recording.read(folder)
        self.assertEqual({key: value for key, value in read.metadata.items() if key in metadata}, metadata)
        np.testing.assert_array_equal(read.further["x_C"], [1.0, np.nan, 3.0])
        (folder / "m.toml").write_text(Model.nominal("slse1").toml)
        isorig("predict", folder, "--model", folder / "m.toml", "--out", folder / "p.csv")  # the terminal reads it too
        again = Recording.read(folder)
        np.testing.assert_array_equal(again.further["mono_ns"], ns)  # as doubles all would be even
        again.write(folder / "again")
        self.assertEqual((folder / "again/frame.csv").read_text(), (folder / "frame.csv").read_text())
        self.assertEqual((folder / "again/recording.toml").read_text(), (folder / "recording.toml").read_text())


class Runs(unittest.TestCase):
    @classmethod
    def setUpClass(cls) -> None:
        cls.made = Made()

    def copied(self) -> Path:
        to = Path(tempfile.mkdtemp()) / self.made.run.name
        self.addCleanup(shutil.rmtree, to.parent)
        shutil.copytree(self.made.run, to)
        return to

    def test_sessions_are_those_of_the_export(self) -> None:
        run = Run(self.made.run)
        self.assertEqual((run.state, run.complaints), ("whole", ()))
        sessions = run.sessions()
        self.assertEqual([s.repetition for s in sessions], [1, 2])
        for session in sessions:
            exported = Recording.read(next((self.made.folder / "recordings").glob(f"rep-{session.repetition}_*")))
            here = session.recording()
            # An export may round times to 1 ns, and readings to a twentieth of the device's smallest step.
            for name in ("t_s", "pressure_t_s"):
                np.testing.assert_allclose(getattr(here, name), getattr(exported, name), rtol=0, atol=0.51e-9, err_msg=name)
            for name in ("position_mm", "force_N", "pressure_psi"):
                steps = np.abs(np.diff(getattr(here, name)))
                np.testing.assert_allclose(getattr(here, name), getattr(exported, name), rtol=0,
                                           atol=np.median(steps[steps > 0]) / 40, err_msg=name)
            self.assertEqual(here.specimen, exported.specimen)
            self.assertTrue(session.complete)
            self.assertIn("step", [event.code for event in session.events])
            frame = session.frame
            self.assertTrue(frame.averaged.any() and not frame.averaged.all())
            for name in frame.values:
                self.assertTrue((frame.least[name] <= frame.values[name]).all() and (frame.values[name] <= frame.most[name]).all())
            self.assertTrue((frame.samples[~frame.averaged] == 1).all() and (frame.bound_ns >= 0).all())

    #: Half of the last decimal that an export writes of a column (docs/formats/recording.md; daemon/export/streams.cpp).
    ROUNDED = {"t_s": 0.5e-9, "t_start_s": 0.5e-9, "t_end_s": 0.5e-9, "bound_ns": 0.5, "repeatability_ns": 0.5, "device_us": 0.05,
               "sequence": 0.05, "temperature_C": 0.5e-2, "setpoint_psi": 0.5e-5, "target_mm": 0.5e-6,
               "velocity_mm_s": 0.5e-6, "value": 0.5e-12, "threshold": 0.5e-12}

    def same(self, there: np.ndarray, here: np.ndarray, name: str, rounded: float) -> None:
        if there.dtype.kind == "f":
            # The nearest double to a decimal, and a difference of doubles.
            rounding = 4 * np.finfo(float).eps * np.nanmax(np.abs(there), initial=0)
            np.testing.assert_allclose(here, there, rtol=0, atol=rounded + rounding, err_msg=name)
        else:
            np.testing.assert_array_equal(here, there, name)

    def compare(self, session: Session, exported: Recording) -> None:
        here = session.recording()
        # The last decimal is worth at most 0.105 of the device's smallest step (daemon/export/table.cpp).
        reading = {name: 0.0525 * np.median(steps[steps > 0]) for name in ("position_mm", "force_N", "pressure_psi")
                   if len(steps := np.abs(np.diff(getattr(here, name))))}
        for stream in ("further", "pressure_further"):
            there, columns = getattr(exported, stream), getattr(here, stream)
            self.assertEqual(list(columns), list(there), stream)
            for name, values in there.items():
                extreme = reading.get(name.replace("_min", "").replace("_max", ""), 0)
                self.same(values, columns[name].astype(values.dtype), f"{stream}.{name}", self.ROUNDED.get(name, extreme))
        self.assertEqual(set(here.tables), set(exported.tables) - {"sessions"})
        for table in here.tables:
            there, columns = exported.tables[table], here.tables[table]
            self.assertEqual((list(columns.columns), columns.units), (list(there.columns), there.units), table)
            self.assertGreater(len(columns), 0)
            for name, values in there.columns.items():
                self.same(values, columns[name], f"{table}.{name}", self.ROUNDED.get(name, 0.5e-9))

    def test_columns_and_tables_are_those_of_the_export(self) -> None:
        for session in Run(self.made.run).sessions():
            self.compare(session, Recording.read(next((self.made.folder / "recordings").glob(f"rep-{session.repetition}_*"))))

    def test_without_its_protocol_steps_are_what_the_controller_said(self) -> None:
        def forget(message: Any) -> None:
            if isinstance(message, run_header_t):
                message.texts = [each for each in message.texts if each.name != "protocol.toml"]
                message.text_count = len(message.texts)
        channels = ("ISORIG_FRAME", "ISORIG_FRAME_AVERAGE", "ISORIG_PRESSURE", "ISORIG_PRESSURE_AVERAGE", "ISORIG_STATE", "ISORIG_EVENT")
        run = self.attempts(("a", 90.0, 5.0, channels), change=forget)
        session, = run.sessions()
        self.assertIsNone(session.plan)
        self.assertEqual(session.end_mono_ns, 0)
        isorig("export", run.path, "--out", run.path.parent / "export")
        self.compare(session, Recording.read(next((run.path.parent / "export").glob("rep-1_*"))))

    def test_stale_words_and_attempts_without_the_frame_are_there_when_asked_for(self) -> None:
        def spoil(message: Any) -> None:
            if isinstance(message, pressure_batch_t):
                message.status = bytes([2, 3]) + bytes(message.status[2:])
        frame, gauge = ("ISORIG_FRAME", "ISORIG_PRESSURE", "ISORIG_PRESSURE_AVERAGE"), ("ISORIG_EVENT", "ISORIG_PRESSURE")
        run = self.attempts(("a", 90.0, 5.0, frame), ("b", 91.0, 5.0, gauge), change=spoil)
        session, = run.sessions()
        self.assertEqual(session.attempt, 1)
        self.assertTrue((session.pressure.status == 0).all() and set(session.unmeasured.status) == {2, 3})
        self.assertEqual(session.not_measured, len(session.unmeasured))
        told = json.loads(isorig("export", run.path, "--out", run.path.parent / "export", "--json").stdout)["recordings"][0]
        self.assertEqual((told["not_measured"], told["pressure_rows"]), (session.not_measured, len(session.pressure)))
        every = run.sessions(every_attempt=True)
        self.assertEqual([(each.attempt, len(each.frame) > 0) for each in every], [(1, True), (2, False)])
        batches = [event.decode() for event in run.messages("ISORIG_PRESSURE")]
        averages = [event.decode() for event in run.messages("ISORIG_PRESSURE_AVERAGE")]
        self.assertEqual(sum(int(each.pressure.samples.sum()) + each.not_measured for each in every),
                         sum(m.count for m in batches) + sum(sum(m.samples) for m in averages))

    def test_a_written_session_says_what_the_export_says(self) -> None:
        run = self.copied()
        shutil.copy(self.made.run.parent / "catalogue.sqlite", run.parent)
        isorig("export", run, "--out", run.parent / "export")
        for session in Run(run).sessions():
            exported = next((run.parent / "export").glob(f"rep-{session.repetition}_*"))
            session.recording().write(run.parent / "written" / exported.name)
            there, here = (tomllib.loads((folder / exported.name / "recording.toml").read_text())
                           for folder in (run.parent / "export", run.parent / "written"))
            self.assertEqual(there["outcome"], "done")
            self.assertEqual(set(here), set(there))
            for key, value in there.items():
                if key not in ("steps", "events"):
                    self.assertEqual(here[key], value, key)
                    continue
                self.assertGreater(len(value), 0)
                for row, other in zip(here[key], value, strict=True):
                    self.assertAlmostEqual(row.pop("t_s"), other.pop("t_s"), delta=1e-12)  # both round one product
                    self.assertEqual(row, other)

    def test_severities_and_hidden_marks_are_written_as_by_the_export(self) -> None:
        session = Run(self.made.run).sessions()[0]
        session.events = [Event(0, 0, severity, "a", "x\n\u202e", 0.0, np.nan) for severity in range(5)]
        events = session.recording().metadata["events"]
        self.assertEqual([event["severity"] for event in events], ["info", "warning", "program stop", "safe state", "?"])
        self.assertEqual((events[0]["text"], set(events[0])), ("x\\n\\u202e", {"t_s", "severity", "code", "text"}))

    def test_a_small_stroke_that_was_written_is_not_doubted(self) -> None:
        session = Run(self.made.run).sessions()[0]
        session.frame.values["position_mm"][:] *= 1e-3
        folder = Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, folder)
        session.recording().write(folder / "small")
        (folder / "m.toml").write_text(Model.nominal("slse1").toml)
        isorig("predict", folder / "small", "--model", folder / "m.toml", "--out", folder / "p.csv")

    def test_an_interrupted_run_is_said_to_be_one(self) -> None:
        run = self.copied()
        shutil.copy(self.made.run.parent / "catalogue.sqlite", run.parent)
        (run / "segment-0002.lcm").unlink()
        isorig("export", run, "--out", run.parent / "export", code=7)
        read = Run(run)
        there = tomllib.loads(next((run.parent / "export").glob("*/recording.toml")).read_text())
        self.assertEqual((there["recording_state"], there["recording_complaints"]), (read.state, list(read.complaints)))
        here = read.sessions()[0].recording().metadata
        self.assertEqual((here["recording_state"], here["complete"]), (read.state, there["complete"]))
        self.assertIn("the catalogue has the run as done", "".join(read.complaints))

    def test_every_sample_is_there_once(self) -> None:
        shown = isorig("show", self.made.run).stdout
        counted = sum(int(s.frame.samples.sum()) for s in Run(self.made.run).sessions())
        full, averaged = (int(n) for n in __import__("re").search(r"frame +(\d+) samples in full, (\d+)", shown).groups())
        self.assertEqual(counted, full + averaged)

    def attempts(self, *attempts: "tuple[str, float, float, tuple[str, ...]]", change: "Callable[[Any], None]" = lambda _: None) -> Run:
        """A log with an attempt at the run for each specimen, rest length, planned pressure and streams; of the first
        session, which only an attempt with ISORIG_SESSION ends. `change` is given every message that is written. It has no
        checksums, as a log of lcm-logger."""
        events = list(Run(self.made.run).messages())
        first = Run(self.made.run).header.sessions[0].session
        data, number = b"", 0
        for attempt, (specimen, rest_mm, pressure_psi, channels) in enumerate(attempts, 1):
            header = Run(self.made.run).header
            header.attempt, header.specimen, header.rest_length_mm = attempt, specimen, rest_mm
            header.sessions[0].pressure_psi = pressure_psi
            change(header)
            for event in [None, *events]:
                if event is not None:
                    if event.channel not in channels:
                        continue
                    message = event.decode()
                    if (message.session.session if event.channel == "ISORIG_SESSION" else message.session) != first:
                        continue
                    change(message)
                name, body = (b"ISORIG_HEADER", header.encode()) if event is None else (event.channel.encode(), message.encode())
                data += struct.pack(">4sqqii", b"\xed\xa1\xda\x01", number, 0, len(name), len(body)) + name + body
                number += 1
        file = Path(tempfile.mkdtemp()) / "segment-0001.lcm"
        self.addCleanup(shutil.rmtree, file.parent)
        file.write_bytes(data)
        return Run(file)

    def test_a_session_is_of_the_header_of_its_attempt(self) -> None:
        frame, end = ("ISORIG_FRAME", "ISORIG_PRESSURE"), ("ISORIG_FRAME", "ISORIG_SESSION")
        a, b, empty = ("a", 90.0, 5.0), ("b", 91.0, np.nan), ("c", 92.0, 7.0)
        for attempts, attempt, specimen, nominal_psi in [
            ([(*a, frame), (*b, frame)], 2, ("b", 91.0), None),
            ([(*a, end), (*b, frame)], 1, ("a", 90.0), 5.0),  # the earlier one alone is complete
            ([(*a, frame), (*b, frame), (*empty, ("ISORIG_EVENT", "ISORIG_PRESSURE"))], 2, ("b", 91.0), None),
            ([(*a, frame), (*empty, ("ISORIG_SESSION",))], 1, ("a", 90.0), 5.0),  # ended without a row
        ]:
            session, = self.attempts(*attempts).sessions()
            self.assertEqual((session.attempt, session.name, session.specimen.rest_length_mm), (attempt, *specimen))
            self.assertEqual(session.specimen.nominal_pressure_psi, nominal_psi)
            self.assertGreater(len(session.recording().t_s), 0)
        self.assertEqual(self.attempts((*a, ("ISORIG_EVENT", "ISORIG_PRESSURE"))).sessions(), [])

    def test_inputs_versions_and_what_it_is_called(self) -> None:
        run = Run(self.made.run)
        self.assertIn("isorig-protocol/1", run.inputs["protocol.toml"])
        self.assertIn("isorig", run.versions)
        self.assertTrue(run.about)

    def test_damage_is_said_as_the_terminal_says_it(self) -> None:
        run = self.copied()
        segment = run / "segment-0001.lcm"
        data = bytearray(segment.read_bytes())
        data[len(data) // 2] ^= 4
        segment.write_bytes(data)
        read = Run(run)
        self.assertEqual(read.state, "damaged")
        done = isorig("show", run, code=7)
        shown = done.stdout + done.stderr
        for complaint in read.complaints:
            self.assertIn(complaint, shown)
        before = sum(len(s.frame) for s in Run(self.made.run).sessions())
        after = sum(len(s.frame) for s in read.sessions())
        self.assertTrue(before - 100 < after <= before, (before, after))

    def test_a_cut_log_gives_its_whole_events(self) -> None:
        data = (self.made.run / "segment-0002.lcm").read_bytes()
        file = Path(tempfile.mkdtemp()) / "cut.lcm"
        self.addCleanup(shutil.rmtree, file.parent)
        file.write_bytes(data)
        whole = list(read_log(file))
        self.assertEqual(whole[0].channel, "ISORIG_HEADER")
        for length in range(len(data) - 400, len(data), 7):
            file.write_bytes(data[:length])
            self.assertEqual(list(read_log(file)), whole[: len(list(read_log(file)))])

    def test_a_segment_without_a_whole_message_gives_nothing(self) -> None:
        def holed(segment: Path) -> bytes:
            """A wrong byte in each message, as a power cut leaves zeros that nobody has recorded."""
            data, at = bytearray(segment.read_bytes()), 0
            while at < len(data):
                channel, body = struct.unpack_from(">ii", data, at + 20)
                at += 28 + channel + body
                data[at - 5] ^= 0x55
            return bytes(data)

        run = self.copied()
        first, second = run / "segment-0001.lcm", run / "segment-0002.lcm"
        whole = list(read_log(first))
        second.write_bytes(holed(second))
        read = Run(run)
        self.assertEqual(list(read.messages()), whole)
        self.assertNotEqual(read.state, "whole")
        # One damaged message in front does not make a log of a time without checksums of the others.
        only = holed(first)
        data = bytearray(first.read_bytes())
        data[data.find(b"ISORIG_HEADER") + 40] ^= 1
        first.write_bytes(data)
        self.assertEqual(list(read_log(first)), whole[1:])
        # An only segment that no other speaks for, with its header and without.
        for bytes_left in (only, bytes(512) + only[512:]):
            for segment in run.glob("segment-*.lcm"):
                segment.unlink()
            first.write_bytes(bytes_left)
            with self.assertRaises(BadInput) as caught:
                Run(run)
            self.assertIn("no header of a run", str(caught.exception))

    def test_what_is_no_run(self) -> None:
        for path in ("/nonexistent", str(self.made.recording)):
            with self.assertRaises(BadInput) as caught:
                Run(path)
            self.assertIn("not a run", str(caught.exception))


class Diagnoses(unittest.TestCase):
    def test_wrong_files_are_named(self) -> None:
        folder = Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, folder)
        for text, said in [("{", "diagnosis.json:1:"), ("[]", "this reads"), ('{"format": "isorig-diagnosis/1"}', "`verdict`"),
                           (json.dumps({"format": "isorig-diagnosis/1", "verdict": "consistent", "missing": [{}]}), "docs/diagnosis.md")]:
            (folder / "diagnosis.json").write_text(text)
            with self.assertRaises(BadInput) as caught:
                Diagnosis.read(folder)
            self.assertIn(said, str(caught.exception))


if __name__ == "__main__":
    unittest.main()

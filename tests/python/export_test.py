"""HDF5 exports, where this isorig writes them, and the files that are none."""

import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import h5py
import numpy as np

from isorig import BadInput, Export, Recording
from made import Made, isorig


class Exports(unittest.TestCase):
    @unittest.skipUnless("hdf5" in isorig("export", "--help").stdout, "isorig export has no --format hdf5")
    def test_a_session_is_its_recording_and_its_tables(self) -> None:
        made = Made("vma-short")
        isorig("export", made.run, "--format", "hdf5", "--out", made.folder / "hdf5")
        export = Export(next((made.folder / "hdf5").glob("*.h5")))
        folders = sorted((made.folder / "recordings").iterdir())
        self.assertEqual(list(export.names), [folder.name for folder in folders])
        self.assertIn("isorig-protocol/1", export.inputs["protocol.toml"])
        for folder in folders:
            written, read = Recording.read(folder), export.recording(folder.name)
            self.assertEqual((written.specimen, written.name), (read.specimen, read.name))
            for name in ("t_s", "position_mm", "force_N", "pressure_t_s", "pressure_psi"):
                np.testing.assert_array_equal(getattr(written, name), getattr(read, name), name)
            self.assertEqual(set(written.further), set(read.further))
            for name, values in written.further.items():
                np.testing.assert_array_equal(values, read.further[name], name)
            self.assertEqual(read.metadata["units"], "s, mm, N, psi")
            self.assertEqual(read.further["mono_ns"].dtype, np.int64)
            read.write(made.folder / "again" / folder.name)
            self.assertEqual(Recording.read(made.folder / "again" / folder.name).metadata["units"], "s, mm, N, psi")
            ramps = export.table(folder.name, "ramps")
            self.assertGreater(len(ramps), 0)
            self.assertEqual(ramps.units["velocity_mm_s"], "mm/s")
            self.assertIn("mark", list(export.table(folder.name, "events")["code"]))
            self.assertEqual(set(written.tables), {"ramps", "holds", "steps", "setpoints", "events", "sessions"})
            self.assertEqual(set(read.tables), set(written.tables))
            for name, table in written.tables.items():
                self.assertEqual(table.units, read.tables[name].units, name)
                for column, values in table.columns.items():
                    np.testing.assert_array_equal(values, read.tables[name][column], f"{name}.{column}")
        with self.assertRaises(BadInput) as caught:
            export.table(folders[0].name, "strokes")
        self.assertIn("has no table strokes; it has: ", str(caught.exception))
        with self.assertRaises(BadInput):
            export.recording("rep-9_99-psi")

    def test_what_is_no_export(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            text, other = Path(folder) / "text.h5", Path(folder) / "other.h5"
            text.write_text("hello")
            with h5py.File(other, "w") as file:
                file.attrs["format"] = "isorig-export/9"
            for path, said in ((text, "this is no HDF5 file"), (other, "this reads \"isorig-export/1\""), (Path(folder) / "x.h5", "no such file")):
                with self.assertRaises(BadInput) as caught:
                    Export(path)
                self.assertIn(said, str(caught.exception))

    def test_without_h5py_it_says_what_to_install(self) -> None:
        done = subprocess.run([sys.executable, "-c", "import sys; sys.modules['h5py'] = None\nimport isorig\nisorig.Export('x.h5')"],
                              capture_output=True, text=True)
        self.assertIn("IsorigError: reading HDF5 needs h5py, which is not installed: apt-get install python3-h5py", done.stderr)


if __name__ == "__main__":
    unittest.main()

"""Reads the exports of a run with the readers that laboratories have: pandas, numpy, h5py, h5dump, Octave.

    read_exports.py CSV_FOLDER HDF5_FILE MAT_FOLDER

The CSV files and recording.toml are the reference; every column, every table and every attribute of the other two has to
say the same. Ends with an AssertionError where one does not.
"""

import math
import pathlib
import subprocess
import sys
import tempfile
import tomllib

import h5py
import numpy
import pandas

STREAMS = ("frame", "pressure", "setpoints")
TABLES = ("sessions", "steps", "ramps", "holds", "events")
FORMAT = "isorig-export/1"


def flattened(table, before=""):
    """recording.toml as attributes have it; its lists of tables are tables of the export."""
    out = {}
    for key, value in table.items():
        if isinstance(value, dict):
            out.update(flattened(value, before + key + "_"))
        elif isinstance(value, list):
            if value and isinstance(value[0], str):
                out[before + key] = "\n".join(value)
        else:
            out[before + key] = int(value) if isinstance(value, bool) else value
    return out


def same(a, b):
    if isinstance(a, float) and isinstance(b, float) and math.isnan(a):
        return math.isnan(b)
    return a == b


def check_columns(csv, group, where):
    assert list(csv.columns) == [c for c in csv.columns if c in group], f"{where}: {sorted(group)}"
    assert len(group) == len(csv.columns), f"{where}: {sorted(group)}"
    for name in csv.columns:
        column = group[name]
        assert column.attrs["description"], f"{where}/{name} has no description"
        unit = column.attrs["unit"]
        # A name ends with its unit wherever it has one.
        written = unit.replace("mm/s", "mm_s").replace("1/s", "per_s").replace("degC", "C")
        assert unit == "" or name.endswith("_" + written), f"{where}/{name}: {unit}"
        values = column[:]
        if values.dtype.kind == "O":
            expected = csv[name].fillna("").astype(str).tolist()
            assert [v.decode() for v in values] == expected, f"{where}/{name}"
        else:
            assert numpy.array_equal(values.astype(float), csv[name].to_numpy(float), equal_nan=True), f"{where}/{name}"


def check_attributes(found, toml, where, beside):
    expected = flattened(toml)
    for dropped in ("format", "units"):
        expected.pop(dropped)
    for key, value in expected.items():
        assert key in found, f"{where}: attribute {key} is missing"
        got = found[key].item() if hasattr(found[key], "item") else found[key]
        assert same(got, value), f"{where}: {key} is {got!r}, not {value!r}"
    assert set(found) == set(expected) | beside, f"{where}: {set(found) ^ (set(expected) | beside)}"


def check_device(found, toml, stream, where):
    """Source and calibration of a stream and of its columns."""
    assert found["device"] == ("isorigd" if stream == "setpoints" else toml["versions"].get(stream, toml["rig"])), where


def check_hdf5(folder, group, toml):
    where = group.name
    check_attributes(dict(group.attrs), toml, where, set())
    for stream in STREAMS:
        # round_trip: pandas' own parser is off by a digit
        csv = pandas.read_csv(folder / f"{stream}.csv", float_precision="round_trip")
        check_columns(csv, group[stream], f"{where}/{stream}")
        assert group[stream].attrs["description"]
        check_device(group[stream].attrs, toml, stream, where)
    for column, channel in (("position_mm", "position"), ("force_N", "force"), ("force_max_N", "force")):
        attributes = group["frame"][column].attrs
        assert attributes["resolution"] > 0
        for key, value in toml["calibration"][channel].items():
            assert attributes["calibration_" + key] == value, f"{where}/frame/{column}: {key}"
    for table in TABLES:
        csv = pandas.read_csv(folder / f"{table}.csv", float_precision="round_trip")
        check_columns(csv, group[table], f"{where}/{table}")


def check_ramps(folder):
    """The table says where the samples move, and how fast."""
    frame = pandas.read_csv(folder / "frame.csv")
    ramps = pandas.read_csv(folder / "ramps.csv")
    assert len(ramps) > 0 and (ramps.complete == 1).all()
    fitted = 0
    for ramp in ramps.itertuples():
        duration_s = abs((ramp.to_mm - ramp.from_mm) / ramp.velocity_mm_s)
        if duration_s < 0.4:
            continue
        # The frame hears of a ramp some ms after its step began, and speeds up; 0.15 s covers both.
        begin_s = ramp.t_start_s + 0.15
        inside = frame[(frame.t_s > begin_s) & (frame.t_s < begin_s + 0.6 * duration_s)]
        fitted += 1
        assert len(inside) >= 4 and (inside.step == ramp.step).all()
        slope = numpy.polyfit(inside.t_s, inside.position_mm, 1)[0]
        assert abs(slope / ramp.velocity_mm_s - 1) < 0.05, f"{folder}: {slope} mm/s instead of {ramp.velocity_mm_s}"
    assert fitted > 0
    averaged = frame[frame.averaged == 1]
    assert len(averaged) > 0 and (averaged.samples > 1).all()
    assert (averaged.position_min_mm <= averaged.position_mm).all()
    assert (averaged.position_max_mm >= averaged.position_mm).all()
    full = frame[frame.averaged == 0]
    assert len(full) > 0 and (full.samples == 1).all() and full.force_min_N.isna().all()
    # numpy alone, as a newcomer does it, and both clocks in step
    plain = numpy.genfromtxt(folder / "frame.csv", delimiter=",", names=True)
    assert numpy.array_equal(plain["force_N"], frame.force_N)
    assert numpy.allclose((frame.mono_ns - frame.mono_ns[0]) * 1e-9, frame.t_s - frame.t_s[0], atol=1e-9, rtol=0)


def check_mat(folder, file, toml):
    script = pathlib.Path(__file__).with_name("read_export.m")
    with tempfile.TemporaryDirectory() as scratch:
        told = pathlib.Path(scratch) / "told.txt"
        run = subprocess.run(["octave-cli", "--norc", script, file, folder, told], capture_output=True, text=True)
        assert run.returncode == 0, run.stderr
        lines = dict(line.split("\t", 1) for line in told.read_text().splitlines())
    expected = flattened(toml)
    expected.pop("units")
    expected["format"] = FORMAT
    for key, value in expected.items():
        got = lines.pop(f"recording.{key}")
        assert same(type(value)(got), value), f"{file}: {key} is {got}, not {value}"
    assert not [k for k in lines if k.startswith("recording.")], lines
    for stream in STREAMS:
        check_device({"device": lines[f"info.{stream}.device"]}, toml, stream, file)
        for name in pandas.read_csv(folder / f"{stream}.csv", nrows=1).columns:
            assert lines[f"info.{stream}.columns.{name}.description"]
            assert f"info.{stream}.columns.{name}.unit" in lines
    assert lines["info.frame.columns.force_N.unit"] == "N"
    for key, value in toml["calibration"]["pressure"].items():
        assert same(type(value)(lines[f"info.pressure.columns.pressure_psi.calibration_{key}"]), value)
    for table in TABLES:
        csv = pandas.read_csv(folder / f"{table}.csv", float_precision="round_trip")
        for name in csv.columns:
            for i, value in enumerate(csv[name].tolist(), 1):
                got = lines.get(f"{table}.{name}.{i}")
                if isinstance(value, str):
                    assert got == value, f"{file}: {table}.{name}.{i}: {got!r}, not {value!r}"
                elif got != "":
                    assert same(float(got), float(value)), f"{file}: {table}.{name}.{i}: {got}, not {value}"


def main(csv, hdf5, mat):
    folders = sorted(pathlib.Path(csv).iterdir())
    assert folders
    dump = subprocess.run(["h5dump", "-A", hdf5], capture_output=True, text=True)
    assert dump.returncode == 0, dump.stderr
    with h5py.File(hdf5) as file:
        assert file.attrs["format"] == FORMAT
        assert [n.decode() for n in file["sessions/name"]] == [f.name for f in folders], "natural order"
        assert "isorig-protocol/1" in file["inputs"].attrs["protocol.toml"]
        for folder in folders:
            toml = tomllib.loads((folder / "recording.toml").read_text())
            assert toml["format"] == "isorig-recording/1"
            assert file.attrs["run"] == toml["run"]
            check_hdf5(folder, file[folder.name], toml)
            check_ramps(folder)
            check_mat(folder, pathlib.Path(mat) / f"{folder.name}.mat", toml)
            assert f'GROUP "{folder.name}"' in dump.stdout
    for word in ('ATTRIBUTE "calibration_scale"', 'DATASET "position_mm"', '(0): "mm"'):
        assert word in dump.stdout, word


main(*sys.argv[1:])

"""Row of bench/run: how the processor time of a diagnosis grows with its rows, its recordings and what is missing."""
from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from measure import PLOTS, Figure, NotMeasured, python, run

if TYPE_CHECKING:
    from rows import Bench

PICTURE = "diagnosis-growth.svg"
SEED, CASES = 20261201, 72
ROWS = (3_750, 7_500, 15_000, 30_000, 60_000, 120_000)
RECORDINGS = (1, 2, 4, 8)
KINDS = (("null", "nothing"), ("single", "one effect"), ("pair", "two effects"), ("out_of_catalogue", "without a name"))
USUAL_ROWS = 30_000
EACH = 3  # cases behind a point


def study_of(bench: Bench) -> tuple[Path, dict[str, list[Path]]]:
    """A study, and by category its cases with enough readings, the longest first."""
    study = bench.results / "growth-study"
    run(bench.bin / "isorig-proof", "generate", "--laws", "foreign", "--seed", SEED, "--cases", CASES, "--out", study)
    cases: dict[str, list[tuple[int, Path]]] = {}
    for label in json.loads((study / "sealed/labels.json").read_text())["cases"]:
        folder = study / label["case"]
        rows = len((folder / "train/frame.csv").read_text().splitlines()) - 1
        if rows >= USUAL_ROWS:
            cases.setdefault(label["category"], []).append((rows, folder))
    return study, {kind: [folder for _, folder in sorted(found, reverse=True)] for kind, found in cases.items()}


def pieces(case: Path, rows: int, recordings: int, to: Path) -> list[Path]:
    """The case's training recording, every so many readings left out so that about `rows` stay, cut into equal numbers of rows."""
    shutil.rmtree(to, ignore_errors=True)
    head, *frame = (case / "train/frame.csv").read_text().splitlines()
    pressure_head, *pressure = (case / "train/pressure.csv").read_text().splitlines()
    if len(frame) < rows:
        raise NotMeasured(f"{case.name} has {len(frame):,} readings, and {rows:,} are asked for")
    frame = [frame[i * len(frame) // rows] for i in range(rows)]

    def t_s(line: str) -> float:
        return float(line.partition(",")[0])

    folders = []
    for k in range(recordings):
        mine = frame[k * rows // recordings:(k + 1) * rows // recordings]
        begin_s, end_s = t_s(mine[0]), t_s(mine[-1])
        folder = to / f"{k + 1}"
        folder.mkdir(parents=True)
        air = [line for line in pressure if begin_s - 1.0 <= t_s(line) <= end_s + 1.0]
        (folder / "frame.csv").write_text("\n".join([head, *mine]) + "\n")
        (folder / "pressure.csv").write_text("\n".join([pressure_head, *air]) + "\n")
        shutil.copy(case / "train/recording.toml", folder)
        folders.append(folder)
    return folders


def nominal_of(study: Path, case: Path) -> str:
    labels = json.loads((study / "sealed/labels.json").read_text())["cases"]
    return str(next(label["nominal"] for label in labels if label["case"] == case.name))


def cpu_s(bench: Bench, study: Path, case: Path, rows: int, recordings: int) -> float:
    work = bench.results / "growth"
    folders = pieces(case, rows, recordings, work / "recordings")
    return run(bench.bin / "isorig", "diagnose", *folders, "--model", nominal_of(study, case), "--out", work / "out",
               "--threads", 1, "--no-report").cpu_s


def growth(bench: Bench) -> list[Figure]:
    draws = python("matplotlib", "python3-matplotlib")
    study, cases = study_of(bench)
    for kind, said in KINDS:
        if len(cases.get(kind, [])) < EACH:
            raise NotMeasured(f"of {CASES} cases only {len(cases.get(kind, []))} with {said} missing have {USUAL_ROWS:,} readings")
    single = cases["single"][:EACH]
    by_rows = [[cpu_s(bench, study, case, rows, 1) for case in single] for rows in ROWS]
    by_recordings = [[cpu_s(bench, study, case, USUAL_ROWS, n) for case in single] for n in RECORDINGS]
    by_kind = [[cpu_s(bench, study, case, USUAL_ROWS, 1) for case in cases[kind][:EACH]] for kind, _ in KINDS]
    panels = [{"x": "readings of one recording", "marks": ROWS, "to_scale": True, "cpu_s": by_rows},
              {"x": f"{USUAL_ROWS:,} readings in so many recordings", "marks": RECORDINGS, "to_scale": True, "cpu_s": by_recordings},
              {"x": f"missing, {USUAL_ROWS:,} readings", "marks": [said for _, said in KINDS], "to_scale": False, "cpu_s": by_kind}]
    told = bench.results / "growth-panels.json"
    told.write_text(json.dumps(panels))
    run(draws, PLOTS / "growth.py", told, bench.results / PICTURE)
    return ([Figure(f"{rows:,} readings, one effect missing", "s", values) for rows, values in zip(ROWS, by_rows)]
            + [Figure(f"{USUAL_ROWS:,} readings in {n} recordings, one effect missing", "s", values)
               for n, values in zip(RECORDINGS[1:], by_recordings[1:])]
            + [Figure(f"{USUAL_ROWS:,} readings, {said} missing", "s", values)
               for (_, said), values in zip((KINDS[0], *KINDS[2:]), (by_kind[0], *by_kind[2:]))])

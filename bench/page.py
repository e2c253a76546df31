"""docs/performance.md from the raw numbers of bench/run."""
from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from measure import Figure, spread

if TYPE_CHECKING:
    from rows import Row

HEAD = """# Performance, side by side

Made by `bench/run`: isorig and what people use for the same work, measured in turn on one machine. A cell states the median and, in
brackets, the least and the greatest of its repetitions. A ratio is isorig over the other, pair by pair: below 1 is better where a time, an
age or a size is compared, above 1 where a rate is. Raw numbers: `build/performance/`. `bench/run --list` says what each row does,
`bench/run ROW` measures one again.
"""


def number(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def cell(values: list[float]) -> str:
    middle, least, most = (number(v) for v in spread(values))
    return middle if least == most else f"{middle} [{least}, {most}]"


def line(figure: Figure) -> str:
    """One figure in one line, for the terminal."""
    text = f"{figure.what}: {cell(figure.ours)} {figure.unit}"
    if figure.beside:
        text += f"; {figure.peer}: {cell(figure.beside)}; ratio {cell(figure.ratio())}"
    return text + (f"; target {figure.target}: {'met' if figure.met else 'missed'}" if figure.target else "")


def sections(page: Path) -> dict[str, str]:
    """The sections of a page as it stands, by their headings."""
    if not page.is_file():
        return {}
    parts = page.read_text().split("\n## ")[1:]
    return {heading: body.strip("\n") for heading, _, body in (part.partition("\n") for part in parts)}


def write_page(path: Path, results: Path, rows: list[Row]) -> None:
    """Writes the rows measured in this build folder; a row that was measured elsewhere keeps the section it has on the page."""
    text = [HEAD]
    before = sections(path)
    for row in rows:
        file = results / f"{row.name}.json"
        heading = f"{row.what[0].upper()}{row.what[1:]}"
        text.append(f"\n## {heading}\n")
        if not file.is_file() and heading in before:
            text.append(before[heading] + "\n")
            continue
        if not file.is_file():
            text.append(f"Not measured yet: `bench/run {row.name}`.\n")
            if row.limit:
                text.append(row.limit + "\n")
            continue
        told = json.loads(file.read_text())
        at = told["machine"]
        figures = [Figure(**f) for f in told["figures"]]
        if told["not_measured"]:
            text.append(f"Not measured: {told['not_measured']}\n")
        else:
            text.append("| what | isorig | beside | ratio | target |\n|---|---|---|---|---|")
            for f in figures:
                beside = f"{f.peer}: {cell(f.beside)}" if f.beside else ""
                target = f"{f.target}: **{'met' if f.met else 'missed'}**" if f.target else ""
                text.append(f"| {f.what}{'; ' + f.note if f.note else ''} | {cell(f.ours)} {f.unit} | {beside} | "
                            f"{cell(f.ratio()) if f.beside else ''} | {target} |")
            text.append("")
            if row.picture:
                if results.resolve() != path.parent.resolve():
                    shutil.copy(results / row.picture, path.parent)
                text.append(f"![{heading}]({row.picture})\n")
        if row.limit:
            text.append(row.limit + "\n")
        text.append(f"{told['date']}, {at['commit']}, {at['cores']} cores of {at['cpu']}, Linux {at['kernel']}; load "
                    f"{told['load']:.1f}, {told['steal_percent']:.1f} % stolen by the hypervisor.\n")
    path.write_text("\n".join(text).replace("\n\n\n", "\n\n"))

"""growth.py PANELS.json OUT.svg: processor time against what it grows with, a panel each; dots are cases, the line their median."""
import json
import statistics
import sys

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plot  # noqa: E402

with open(sys.argv[1]) as f:
    panels = json.load(f)
# Equal numbers give an equal file.
plot.rcParams.update({"svg.hashsalt": "isorig", "svg.fonttype": "none", "font.size": 9})
figure, axes = plot.subplots(1, len(panels), figsize=(9.5, 2.9), sharey=True, layout="constrained")
for axis, panel in zip(axes, panels):
    marks, values = panel["marks"], panel["cpu_s"]
    at = marks if panel["to_scale"] else list(range(len(marks)))
    for x, cases in zip(at, values):
        axis.plot([x] * len(cases), cases, "o", color="#9db4c8", markersize=3.5)
    axis.plot(at, [statistics.median(cases) for cases in values], "-o", color="#1f4e79", markersize=5)
    axis.set_yscale("log")
    if panel["to_scale"]:
        axis.set_xscale("log")
    axis.minorticks_off()
    axis.set_xticks(at, [f"{m:,}" if panel["to_scale"] else m for m in marks], rotation=30, ha="right")
    axis.set_xlabel(panel["x"])
    axis.grid(True, alpha=0.3)
most_s = max(max(cases) for panel in panels for cases in panel["cpu_s"])
least_s = min(min(cases) for panel in panels for cases in panel["cpu_s"])
marks_s = [m * 10.0**k for k in range(-3, 5) for m in (1, 2, 5) if least_s / 2.0 <= m * 10.0**k <= most_s * 2.0]
axes[0].set_yticks(marks_s, [f"{m:g}" for m in marks_s])
axes[0].set_ylabel("processor time, s")
figure.savefig(sys.argv[2], format="svg", metadata={"Date": None})

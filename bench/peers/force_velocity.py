"""The 48 force-velocity fits of bench_fits with scipy's Levenberg-Marquardt, from one start, without intervals.

Usage: force_velocity.py FOLDER; reads points.f64 and points.sums.f64, prints one JSON object: milliseconds for all 48,
and in how many of them each side's sum of squares is the smaller by more than 1e-6 of it.
"""
import json
import sys
import time
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

folder = Path(sys.argv[1])
points = np.fromfile(folder / "points.f64").reshape(-1, 5)
ours = np.fromfile(folder / "points.sums.f64")
curves = [points[points[:, 0] == i] for i in range(len(ours))]


def residuals(logarithms, rate_per_s, force, initial_strain, step):
    kappa, gamma_per_s = np.exp(logarithms)
    u = gamma_per_s * step / np.abs(rate_per_s)
    return 1.0 + np.sign(rate_per_s) * step / initial_strain * (1.0 - kappa * np.expm1(-u) / u) - force


begin = time.perf_counter()
sums = np.array([2.0 * least_squares(residuals, np.log([0.5, 0.2]), args=tuple(c[:, 1:].T), method="lm").cost
                 for c in curves])
ms = 1e3 * (time.perf_counter() - begin)
print(json.dumps({"ms": ms, "ours_lower": int(np.sum(ours < sums * (1 - 1e-6))),
                  "peer_lower": int(np.sum(sums < ours * (1 - 1e-6))), "curves": len(ours)}))

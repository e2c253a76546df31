"""Two standard linear solids to 400 000 samples: variable projection in numpy, and scipy on all five parameters.

Usage: series.py FOLDER; reads series.{t,x,F}.f64 of bench_fits, prints one JSON object a method.
"""
import json
import sys
import time
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

folder = Path(sys.argv[1])
t_s, x_mm, force_N = (np.fromfile(folder / f"series.{name}.f64") for name in ("t", "x", "F"))
dt_s = t_s[1] - t_s[0]
steps_mm = np.diff(x_mm, prepend=x_mm[0])


def arm(gamma_per_s):
    """Elongation of the arm's spring: exact for a motion that is linear between two samples."""
    z = gamma_per_s * dt_s
    return lfilter([-np.expm1(-z) / z], [1.0, -np.exp(-z)], steps_mm)


def columns(gammas):
    return np.column_stack([np.ones_like(x_mm), x_mm, *(arm(g) for g in gammas)])


def projected(logarithms):
    a = columns(np.exp(logarithms))
    return a @ np.linalg.lstsq(a, force_N, rcond=None)[0] - force_N


def told(name, begin, logarithms, residual):
    print(json.dumps({"method": name, "ms": 1e3 * (time.perf_counter() - begin),
                      "gamma_per_s": sorted(np.exp(logarithms), reverse=True), "rms_N": float(np.sqrt(np.mean(residual**2)))}))


begin = time.perf_counter()
fit = least_squares(projected, np.log([1.0, 0.1]), method="lm")
told("numpy variable projection", begin, fit.x, fit.fun)

begin = time.perf_counter()
fit = least_squares(lambda q: columns(np.exp(q[4:])) @ q[:4] - force_N, [0.0, 1.0, 1.0, 1.0, *np.log([1.0, 0.1])])
told("scipy on all parameters", begin, fit.x[4:], fit.fun)

"""A sheathed actuator's two standard linear solids, stepped by what people use today: scipy's lsim and solve_ivp.

Usage: stepping.py [TICKS]; prints one JSON object with samples per second of each. Parameters as in bench/stepping.cpp:
one pressure, a triangle of 2 mm at 2 mm/s, 1 kHz.
"""
import json
import sys
import time

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import lsim

ticks = int(float(sys.argv[1])) if len(sys.argv) > 1 else 400_000
DT_S = 1e-3
K1_N, K2_N, GAMMA_PER_S = np.array([150.0, 20.0]), np.array([90.0, 12.0]), np.array([0.2, 0.25])
t_s = DT_S * np.arange(ticks)
strain = 0.1 + 2.0 * np.abs(np.mod(t_s, 2.0) - 1.0) / 80.0

begin = time.perf_counter()
# The arm's strain: dz/dt = de/dt - gamma z. With w = z - e: dw/dt = -gamma w - gamma e, so the input is e itself.
_, force, _ = lsim((np.diag(-GAMMA_PER_S), -GAMMA_PER_S[:, None], K2_N[None, :], [[K2_N.sum() + K1_N.sum()]]), strain,
                   t_s, X0=-np.full(2, strain[0]))
lsim_per_s = ticks / (time.perf_counter() - begin)

few = min(ticks, 20_000)
rate_per_s = np.gradient(strain[:few], DT_S)
begin = time.perf_counter()
solution = solve_ivp(lambda t, z: np.interp(t, t_s[:few], rate_per_s) - GAMMA_PER_S * z, (0.0, t_s[few - 1]),
                     np.zeros(2), t_eval=t_s[:few], max_step=0.01, rtol=1e-6)
solve_ivp_per_s = few / (time.perf_counter() - begin)
print(json.dumps({"lsim_per_s": lsim_per_s, "solve_ivp_per_s": solve_ivp_per_s}))

"""A model refitted in a notebook: the numbers of a standard linear solid, by scipy, to a recording's force."""
import numpy as np
from scipy.optimize import least_squares
import isorig

recording = isorig.Recording.read("out/recordings/rep-1_10-psi")
drive = isorig.Drive(recording)  # motion and pressure, reconstructed once
model = isorig.Model.nominal("slse1")
names = ["spring.stiffness_N_mm", "maxwell.stiffness_N_mm", "maxwell.time_constant_s", "constant.force_N"]
settled = recording.t_s > 20.0  # s: after the filling, of which the model knows nothing


def residual_N(values):
    for name, value in zip(names, values):
        model[name] = value
    return (model.predict(drive).force_N - recording.force_N)[settled]


fit = least_squares(residual_N, [1.0, 1.0, 3.0, 0.0], bounds=([0, 0, 0.05, -10], [10, 10, 100, 10]), x_scale=[1, 1, 3, 1])
for name, value in zip(names, fit.x):
    print(f"{name:28} {value:.4g}")
print(f"rms {np.sqrt(np.mean(fit.fun ** 2)):.4f} N")
with open("refitted.toml", "w") as file:  # isorig predict takes it, and the simulated rig
    file.write(model.toml)

"""Ten lines to a force-velocity plot: the force at the end of every move of a recording, over its velocity."""
import matplotlib.pyplot as plt
import numpy as np
import isorig

recording = isorig.Recording.read("out/recordings/rep-1_10-psi")
t = np.arange(recording.t_s[0], recording.t_s[-1], 0.01)  # s, even
rate_mm_s = np.gradient(np.interp(t, recording.t_s, recording.position_mm), t)
force_N = np.interp(t, recording.t_s, recording.force_N)
moving = np.abs(rate_mm_s) > 0.3  # mm/s: above what noise makes of 10 ms
moves = np.flatnonzero(np.diff(moving.astype(int), prepend=0, append=0)).reshape(-1, 2)
velocity_mm_s = np.array([np.median(rate_mm_s[begin:end]) for begin, end in moves])
plt.plot(-velocity_mm_s, force_N[moves[:, 1] - 1], "o")
plt.xlabel("shortening velocity (mm/s)")
plt.ylabel("force at the end of the move (N)")
plt.savefig("force_velocity.svg")

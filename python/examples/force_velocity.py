"""Ten lines to a force-velocity plot: the force at the end of every ramp of a recording, over the ramp's velocity."""
import matplotlib.pyplot as plt
import numpy as np
import isorig

recording = isorig.Recording.read("out/recordings/rep-1_10-psi")
ramps = recording.tables["ramps"]
force_N = []
for start_s, end_s in zip(ramps["t_start_s"], ramps["t_end_s"]):
    rows = np.flatnonzero((recording.t_s >= start_s) & (recording.t_s < end_s))
    left_mm = np.abs(recording.position_mm[rows] - recording.position_mm[rows[-1]])  # it stands before the step ends
    force_N.append(recording.force_N[rows[np.argmax(left_mm < 0.01 * left_mm[0])]])
plt.plot(-ramps["velocity_mm_s"], force_N, "o")
plt.xlabel("shortening velocity (mm/s)")
plt.ylabel("force at the end of the ramp (N)")
plt.savefig("force_velocity.svg")

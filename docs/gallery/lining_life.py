# # Squeal over the life of a lining
#
# A lining of 10 mm is worn down to 3 mm. The thickness of a layer is a scalar of the scene like a
# friction coefficient: one brake, prepared once, has samples of any thickness in its range.
#
# ![Squeal frequencies, and share of samples that squeal, over the thickness](lining_life.png)
#
# The matrices of a thickness are exact, the reduced model is interpolated over the range. Every
# point takes the equilibrium and the complex modes of one sample of rough contact.

# +
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from brake_fenicsx import prepare

HERE = Path(globals().get("__file__", "notebook")).resolve().parent
SCENE = HERE.parents[1] / "scripts" / "scenes" / "disc_brake_demo.toml"
LINING, SQUEAL = "parts.pad.lining", -1e-3
SETS = [
    "samples.approaches=['multi-scale']",
    "stability.verify=0",
    "stability.band=['0 Hz', '12 kHz']",
    "micro.laws=20",
    "micro.scans=0",
]
model = prepare(SCENE, SETS, parameters={LINING: (3e-3, 10e-3)})
thickness, samples = np.linspace(3e-3, 10e-3, 15), 12
modes = [[model.modes({LINING: h}, sample=k) for k in range(samples)] for h in thickness]
# -

# Every squeal mode of every sample, and the share of the samples that squeal in two bands:

# +
figure, (above, below) = plt.subplots(2, sharex=True, figsize=(6.4, 6.0), layout="constrained")
share = np.zeros((2, thickness.size))
for i, (h, of_samples) in enumerate(zip(thickness, modes, strict=True)):
    for found in of_samples:
        squeal = found.frequency[found.damping < SQUEAL]
        above.plot(np.full(squeal.size, 1e3 * h), squeal / 1e3, "o", color="C3", ms=3, alpha=0.3)
        share[:, i] += np.array([(squeal < 8e3).any(), (squeal >= 8e3).any()]) / samples
below.plot(1e3 * thickness, share[0], "o-", label="below 8 kHz")
below.plot(1e3 * thickness, share[1], "s-", label="8 to 12 kHz")
above.set(ylabel="squeal frequency [kHz]")
below.set(
    xlabel="thickness of the lining [mm]", ylabel="share of samples that squeal", ylim=(0, 1.05)
)
below.legend()
figure.savefig("lining_life.png", dpi=120)
# -

# A brake that is meshed with a lining of 6 mm, other cells and all, against this one:

other = prepare(SCENE, [*SETS, "parts.pad.lining='6 mm'"])
here, there = (np.sort(m.frequency) for m in (model.modes({LINING: 6e-3}), other.modes()))
away = np.abs(here - there).max() / there.max()
print(f"{here.size} and {there.size} modes; frequencies within {1e2 * away:.2f} % of 12 kHz")
assert away < 0.01

# # Flutter of a block
#
# A block is pressed on a plate that slides below it. Without friction no mode grows. With rising
# friction the frequencies of two modes approach each other until they merge (mode lock-in).
# Beyond the merging one of the two grows, and its growth rises like a square root.
#
# ![Frequency and damping of the modes over the friction coefficient](flutter.png)
#
# The scene is the smallest one with friction, with a stiffer contact law and a narrower band.
# `Model.sweep` computes the braking equilibrium and the complex modes at every value of the
# friction coefficient, follows each mode, and finds the merging between the values.

# +
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from brake_fenicsx import prepare

HERE = Path(globals().get("__file__", "notebook")).resolve().parent
SCENE = HERE.parents[1] / "scripts" / "scenes" / "block_on_plate.toml"
model = prepare(
    SCENE,
    [
        "contact.block_plate.law={ p0 = '10 MPa', u0 = '0.1 um' }",
        "stability.band=['0 Hz', '18 kHz']",
        "stability.method=reduced",
        "stability.threshold=1e-3",
    ],
)
found = model.sweep("contact.block_plate.friction", np.linspace(0.0, 0.8, 81))
onset = next(event for event in found.events if event.kind == "onset of squeal")
merging = [e for e in found.events if e.kind == "merging" and e.x <= onset.x][-1]
print(f"two modes merge at a friction coefficient of {merging.x:.4f},")
print(f"at {merging.s.imag / (2e3 * np.pi):.3f} kHz")
# -

# `found.frequency` and `found.damping` have one row for each mode and one column for each value.
# Damping is -2 alpha / |omega|, negative where a mode grows.

# +
figure, axes = plt.subplots(2, 1, sharex=True, figsize=(6.4, 5.2), layout="constrained")
for branch, (frequency, damping) in enumerate(zip(found.frequency, found.damping, strict=True)):
    pair = {"color": "tab:red", "zorder": 3} if branch in merging.branches else {"color": "0.7"}
    axes[0].plot(found.values, frequency / 1e3, **pair)
    axes[1].plot(found.values, damping, **pair)
for axis in axes:
    axis.axvline(merging.x, color="k", lw=0.8, ls=":")
axes[0].set(ylabel="frequency [kHz]")
axes[1].set(xlabel="friction coefficient [-]", ylabel="damping -2 alpha / |omega| [-]")
figure.savefig("flutter.png", dpi=120)
# -

# The friction coefficient at which the modes merge; the mesh of another version of gmsh moves it
# by less than 0.02.

assert abs(merging.x - 0.40) < 0.02

# # Lock-in map over friction and pressure
#
# The stiffness of rough contact rises with the pressure. Which friction coefficient makes two
# modes merge depends therefore on the brake pressure. A map over both shows where a brake
# squeals.
#
# ![Lowest damping over friction coefficient and pressure](lock_in_map.png)
#
# The scene is prepared once: mesh, matrices, reduced model. Every point of the map then computes
# the braking equilibrium and the complex modes within milliseconds. Merging points themselves are
# found by `Model.sweep` (flutter of a block) and by `[sweep]` in a scene.

# +
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from brake_fenicsx import prepare

HERE = Path(globals().get("__file__", "notebook")).resolve().parent
SCENE = HERE.parents[1] / "scripts" / "scenes" / "block_on_plate.toml"
FRICTION, LOAD = "contact.block_plate.friction", 'loads."block.top".pressure'
model = prepare(
    SCENE,
    [
        "contact.block_plate.law={ p0 = '10 MPa', u0 = '0.5 um' }",
        "stability.band=['0 Hz', '18 kHz']",
        "stability.method=reduced",
        "stability.threshold=1e-3",
    ],
)
friction, pressure = np.linspace(0.0, 0.8, 41), np.linspace(2e5, 2e6, 19)
lowest = np.array(
    [[model.modes({FRICTION: mu, LOAD: p}).damping.min() for mu in friction] for p in pressure]
)
# -

# Cells of the map: the lowest damping -2 alpha / |omega| of all modes. Squeal is what lies below
# -1e-3.

# +
figure, axis = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
image = axis.pcolormesh(friction, pressure / 1e5, -lowest, cmap="Reds", shading="nearest")
axis.contour(friction, pressure / 1e5, -lowest, [1e-3], colors="k", linewidths=1)
axis.set(xlabel="friction coefficient [-]", ylabel="pressure on the block [bar]")
figure.colorbar(image, label="growth 2 alpha / |omega| of the least damped mode [-]")
figure.savefig("lock_in_map.png", dpi=120)
# -

# The friction coefficient at which squeal begins, at the lowest and at the highest pressure:

onset = [friction[row < -1e-3].min(initial=np.inf) for row in (lowest[0], lowest[-1])]
print(f"squeal begins at {onset[0]:.2f} at 2 bar and at {onset[1]:.2f} at 20 bar")
assert abs(onset[1] - 0.42) < 0.03 and onset[0] > onset[1] + 0.1

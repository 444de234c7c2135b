# # Error budget of a probability
#
# How much does a probability of squeal depend on the mesh, the reduced model, the number of
# samples, or on how the surface is described? The budget runs the scene and its refinements, one
# at a time and with the same random numbers where that is possible.
#
# ![Change of the probability by every setting of the computation](error_budget.png)
#
# The block squeals in about half of its rough samples at this friction coefficient, where a
# probability is most sensitive. `brake-fenicsx budget` writes the same table, a picture and a
# page.

# +
from pathlib import Path

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from brake_fenicsx.extras.variants.budget import run_budget

HERE = Path(globals().get("__file__", "notebook")).resolve().parent
SCENE = HERE.parents[1] / "scripts" / "scenes" / "squealing_block.toml"
run_budget(
    SCENE,
    MPI.COMM_WORLD,
    "error_budget-results",
    [
        "stages=['surface', 'equilibrium', 'stability', 'uncertainty']",
        "contact.block_plate.friction=0.45",
        "samples.n=40",
    ],
)
budget = pd.read_csv("error_budget-results/budget.csv").replace({np.nan: None})
table = budget.to_dict("records")
rows = [row for row in table if row["status"] == "run" and row["family"] == "any"]
# -

# Change of the probability that any mode squeals, with its 95 % interval. Variants with the
# samples of the scene have narrow intervals; another mesh of the contact face draws other
# samples.

# +
figure, axis = plt.subplots(figsize=(7.2, 4.2), layout="constrained")
for place, row in enumerate(rows):
    low, high = row["change"] - row["change_low"], row["change_high"] - row["change"]
    colour = "tab:blue" if row["paired"] == "yes" else "0.5"
    axis.errorbar(row["change"], place, xerr=[[low], [high]], fmt="o", capsize=4, color=colour)
axis.axvline(0, color="k", lw=0.8)
axis.set_yticks(range(len(rows)), [f"{row['knob']}: {row['change_made']}" for row in rows])
axis.invert_yaxis()
axis.set(xlabel="change of the probability of squeal [-]; blue: same samples")
figure.savefig("error_budget.png", dpi=120)
# -

# The error of the reduced model, as the change of the frequency of a family by a hundred times
# stricter tolerance:

biases = [
    abs(row["frequency_bias_hz"]) / row["frequency_hz"]
    for row in table
    if row["variant"] == "reduction-1" and row["frequency_bias_hz"] is not None
]
print(f"{len(rows)} settings; reduced model: frequencies change by {max(biases):.0e}")
assert max(biases) < 1e-5

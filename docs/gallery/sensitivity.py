# # Sensitivity of the squeal to random inputs
#
# Friction, the lining's stiffness across its face and the pressure are random. Saltelli's design
# gives the share of the variance of the largest growth rate that each of them explains by itself
# (first order) and with all interactions (total).
#
# ![Sensitivity indices of three inputs](sensitivity.png)
#
# The inputs are written in the scene, by the dotted key of the value that is random. `run` writes
# `sensitivity.csv`.

# +
from pathlib import Path

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from brake_fenicsx import run

HERE = Path(globals().get("__file__", "notebook")).resolve().parent
SCENE = HERE.parents[1] / "scripts" / "scenes" / "block_on_plate.toml"
run(
    SCENE,
    MPI.COMM_WORLD,
    "sensitivity-results",
    [
        "stages=['equilibrium', 'stability', 'uncertainty']",
        "contact.block_plate.law={ p0 = '10 MPa', u0 = '0.5 um' }",
        "parts.block.size='10 mm'",
        "parts.plate.size='14 mm'",
        "stability.band=['0 Hz', '18 kHz']",
        "stability.method=reduced",
        "stability.threshold=1e-3",
        "samples.n=320",
        "samples.design=saltelli",
        "samples.random.'contact.block_plate.friction'={ law = 'uniform', min = 0.4, max = 0.6 }",
        "samples.random.'materials.lining.E_3'={ law = 'uniform', spread = 0.2 }",
        "samples.random.'loads.block.top.pressure'={ law='uniform', min='4 bar', max='8 bar' }",
    ],
)
table = pd.read_csv("sensitivity-results/sensitivity.csv").to_dict("records")
rows = [row for row in table if row["where"] == "0-18000" and row["outcome"] == "growth"]
# -

# Both indices with their 95 % intervals, for the whole band:

# +
figure, axis = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
place = np.arange(len(rows))
for shift, index in ((-0.2, "first"), (0.2, "total")):
    value, low, high = (
        np.array([row[index + end] for row in rows]) for end in ("", "_low", "_high")
    )
    axis.bar(place + shift, value, 0.38, yerr=[value - low, high - value], capsize=4, label=index)
axis.set_xticks(place, [row["input"].rpartition(".")[2] for row in rows])
axis.set(ylabel="share of the variance of the growth [-]")
axis.legend(title="index")
figure.savefig("sensitivity.png", dpi=120)
# -

# The first-order index of the lining's stiffness:

(stiffness,) = (row["first"] for row in rows if row["input"] == "materials.lining.E_3")
print(f"first-order index of the lining's stiffness: {stiffness:.2f}")
assert 0.6 < stiffness < 1.0

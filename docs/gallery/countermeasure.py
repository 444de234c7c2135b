# # A countermeasure and its verification
#
# The block squeals in every rough sample. Which change stops it? A scene names the numbers that
# may change and how far; the program ranks them by their first-order effect, finds the smallest
# change of each that is enough, and verifies it by a run of all samples.
#
# ![Share of squealing samples before and after each countermeasure](countermeasure.png)
#
# The samples differ in their critical gaps, drawn from a normal height distribution.

# +
from pathlib import Path

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from brake_fenicsx.extras.variants.countermeasures import find_countermeasures

HERE = Path(globals().get("__file__", "notebook")).resolve().parent
SCENE = HERE.parents[1] / "scripts" / "scenes" / "squealing_block.toml"
find_countermeasures(
    SCENE,
    MPI.COMM_WORLD,
    "countermeasure-results",
    ["samples.n=60", "stages=['surface', 'equilibrium', 'stability', 'uncertainty']"],  # no pages
)
table = pd.read_csv("countermeasure-results/countermeasures.csv").replace({np.nan: None})
rows = table.to_dict("records")
for row in rows:
    print(row["key"], row["value_scene"], "->", row["smallest_value"], row["note"] or "")
# -

# Share of the samples in which the worst family squeals, with 90 % intervals. Where no value is
# enough, the share is that at the farthest acceptable value.

# +
figure, axis = plt.subplots(figsize=(7.2, 3.4), layout="constrained")
for place, row in enumerate(rows):
    low, high = (
        row["share_after"] - row["share_after_low"],
        row["share_after_high"] - row["share_after"],
    )
    found = row["verified"] == "yes"
    axis.errorbar(
        row["share_after"],
        place,
        xerr=[[low], [high]],
        fmt="o",
        capsize=4,
        color="tab:green" if found else "tab:red",
    )
axis.axvline(rows[0]["share_before"], color="k", ls=":", label="before")
reached = [row["smallest_value"] or row["value_to"] for row in rows]
names = [
    f"{row['key']}\n{row['value_scene']:g} to {x:g} {row['unit'] or ''}"
    for row, x in zip(rows, reached, strict=True)
]
axis.set_yticks(range(len(rows)), names)
axis.invert_yaxis()
axis.set(xlabel="share of the samples that squeal [-]", xlim=(-0.03, 1.03))
axis.legend()
figure.savefig("countermeasure.png", dpi=120)
# -

# The largest friction coefficient with which the block is silent in at least 95 % of all samples,
# with a confidence of 95 %:

(friction,) = (row["smallest_value"] for row in rows if row["key"].endswith("friction"))
print(f"friction coefficient {friction:.3f}")
assert abs(friction - 0.423) < 0.03

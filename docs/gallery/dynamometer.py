# # Beside a dynamometer
#
# A matrix of stops says which of them squealed. How good is a prediction, and from which damping on
# is squeal heard? Here the stops are **synthetic**: no brake was measured. They are drawn from the
# model itself, with a known threshold of damping and with noise, so that the answers are known.
#
# ![Share of squeal over pressure and temperature, predicted and "measured"](dynamometer.png)
#
# 24 states of the block on a plate: pressures, temperatures and both directions of sliding. With
# the temperature friction falls and the lining softens. Each state has ten stops.

# +
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pandas as pd

from brake_fenicsx import run
from brake_fenicsx.extras.dynamometer.page import blocks, draw_matrix
from brake_fenicsx.results.run import read_run

HERE = Path(globals().get("__file__", "notebook")).resolve().parent
WORK = Path.cwd()
SCENE = HERE.parents[1] / "scripts" / "scenes" / "squealing_block.toml"
FRICTION, LINING = "contact.block_plate.friction", "materials.lining.C33 [GPa]"
T = "temperature [degC]"
axes = [[2, 5, 10, 20], [50, 150, 250], ["forward", "reverse"]]
states = pd.MultiIndex.from_product(axes, names=["pressure [bar]", T, "direction"])
states.to_frame(index=False).assign(stops=10).to_csv("matrix.csv", index=False)
pd.DataFrame({T: [50, 250], FRICTION: [0.55, 0.4], LINING: [2.27, 2.0]}).to_csv(
    "hot.csv", index=False
)
TRUE = 0.02  # the threshold with which the stops are drawn


def computed(threshold, events=""):
    """Results with a threshold; the samples are those that are there."""
    files = f"matrix='{WORK}/matrix.csv', tables=['{WORK}/hot.csv']"
    stages = "stages=['surface', 'equilibrium', 'stability', 'uncertainty']"
    given = [stages, f"states={{ {files}{events} }}", f"stability.threshold={threshold}"]
    run(SCENE, MPI.COMM_WORLD, "dynamometer-results", given)
    return read_run("dynamometer-results")


model = pd.DataFrame(computed(TRUE).extras["states"])
# -

# Each stop squeals with the share of its state; the frequency scatters by 50 Hz. One stop of thirty
# squeals by chance at any frequency: the noise of a real test.

# +
rng = np.random.default_rng(1)
loud = model[(model.family != "all") & (model.squeal_samples > 0)]
rows = []
for state in range(1, len(states) + 1):
    own = loud[loud.state == state]
    for stop in range(10):
        heard = own[rng.random(len(own)) < own.share]
        rows += [(state, stop, f) for f in heard.frequency_hz + rng.normal(0, 50, len(heard))]
        rows += [(state, stop, rng.uniform(1e3, 18e3))] * int(rng.random() < 1 / 30)
events = pd.DataFrame(rows, columns=["state", "stop", "frequency [Hz]"])
events.to_csv("events.csv", index=False)
result = computed(0.001, f", events='{WORK}/events.csv', tolerance='300 Hz'")
print(blocks(result)[0].text.partition(" The same")[0])
scores = pd.DataFrame(result.extras["states_scores"]).set_index("family")
print(scores[["events", "hits", "misses", "false_alarms", "brier", "roc_area"]].to_string())
draw_matrix(result).savefig("dynamometer.png", dpi=110)
# -

# The scene's threshold of 0.001 counts any growth as squeal, and warns too often. What fits best
# is close to the one with which the stops were drawn:

every = scores.loc["all"]
best, low, high = every.threshold, every.threshold_low, every.threshold_high
print(f"best threshold {best:.4f} (95 %: {low:.4f} to {high:.4f}), true {TRUE}")
assert low < TRUE < high

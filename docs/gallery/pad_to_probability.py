# # From pad to probability
#
# Three pads of one batch are hung on a thread and tapped. Their resonances give the constants of
# the lining, with scatter and correlation; these go into 300 samples of a brake, beside 300 with
# the constants of a catalogue, known to 20 %. How much of the uncertainty was ignorance of the
# lining?
#
# ![Lining stiffness and probability of squeal](pad_to_probability.png)
#
# No pads were tapped for this page: the peaks are computed from three linings that differ by 2 %
# and are 8 % softer than the catalogue's, with errors of 0.3 %.

# +
import tomllib
from pathlib import Path

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from brake_fenicsx import run
from brake_fenicsx.extras.measured.identify import identify
from brake_fenicsx.extras.measured.part_modes import part_modes
from brake_fenicsx.scene import read_scene

HERE = Path(globals().get("__file__", "notebook")).resolve().parent
SCENES = HERE.parents[1] / "scripts" / "scenes"
CATALOGUE = {"C11": 5.94, "C12": 0.76, "C13": 0.98, "C33": 2.27, "C44": 1.18}  # [GPa]

rng = np.random.default_rng(2)
lines = ["specimen,frequency_hz"]
for pad in (1, 2, 3):
    factors = {name: 0.92 * np.exp(0.02 * rng.standard_normal()) for name in CATALOGUE}
    changes = [f"materials.lining.{n}='{CATALOGUE[n] * x} GPa'" for n, x in factors.items()]
    scene = read_scene(SCENES / "lining_pad.toml", changes)
    exact = part_modes(scene, "pad", np.zeros((1, 3)), 20e3).frequency
    peaks = exact * np.exp(0.003 * rng.standard_normal(exact.size))
    lines += [f"pad {pad},{f:.1f}" for f in np.sort(peaks)]
Path("peaks.csv").write_text("\n".join(lines) + "\n")
# -

# The same as `brake-fenicsx identify lining_pad.toml --peaks peaks.csv --prior 20 --error 0.3`:

# +
print(identify(SCENES / "lining_pad.toml", "peaks.csv", prior=0.2, error=0.003, directory="pads"))
identified = tomllib.loads(Path("pads/random.toml").read_text())["samples"]["random"]
# -

# Two studies of a block of this lining that squeals, in perfect contact with random materials:


# +
def inline(table):
    """A table as one value of TOML."""
    pairs = (f"'{k}' = {inline(v) if isinstance(v, dict) else repr(v)}" for k, v in table.items())
    return "{ " + ", ".join(pairs) + " }"


catalogue = {
    f"materials.lining.{name}": {"law": "uniform", "min": f"{0.8 * x} GPa", "max": f"{1.2 * x} GPa"}
    for name, x in CATALOGUE.items()
}
probability, stiffness = {}, {}
for name, laws in (("catalogue", catalogue), ("identified", identified)):
    run(
        SCENES / "squealing_block.toml",
        MPI.COMM_WORLD,
        name,
        ["countermeasures=[]", "samples.n=300", "samples.approaches=['parametric']",
         "samples.parametric={ design = 'random' }",
         *(f"samples.random.'{key}'={inline(law)}" for key, law in laws.items())],
    )  # fmt: skip
    band = pd.read_csv(f"{name}/probabilities.csv").iloc[0]
    probability[name] = [band[key] for key in ("probability", "low", "high")]
    stiffness[name] = pd.read_csv(f"{name}/samples.csv")["materials.lining.C33"] / 1e9
    print(f"{name}: probability of squeal {probability[name][0]:.2f}")
# -

# +
figure, (left, right) = plt.subplots(1, 2, figsize=(7.2, 3.2), layout="constrained")
for name, values in stiffness.items():
    left.hist(values, 30, alpha=0.6, label=name, density=True)
left.set(xlabel="C33 of the lining [GPa]", ylabel="density [1/GPa]")
left.legend()
for place, (value, low, high) in enumerate(probability.values()):
    right.bar(place, value, 0.5, yerr=[[value - low], [high - value]], capsize=4)
right.set_xticks([0, 1], list(probability))
right.set(ylabel="probability of squeal [-]", ylim=(0, 1))
figure.savefig("pad_to_probability.png", dpi=110)
# -

# Squeal of this brake was a matter of ignorance of the lining: the catalogue leaves it open, the
# pads, softer than the catalogue's, do not. C12 is as unknown as before, which the table says, and
# does not matter here. Scatter of the stiffness across the face, identified over catalogue:

ratio = np.std(stiffness["identified"]) / np.std(stiffness["catalogue"])
print(f"scatter of C33: {ratio:.2f} of the catalogue's")
assert probability["catalogue"][0] < 0.75 and probability["identified"][0] > 0.8 and ratio < 0.8

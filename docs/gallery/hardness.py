# # Hardness of the lining
#
# Elastic summits of a rough surface carry more than any lining can bear. With a hardness a point
# yields at that pressure. The law then has two stiffnesses: that of loading, which the braking
# equilibrium follows, and that of small vibrations, which the complex modes take, because
# unloading is elastic.
#
# ![Stiffness over pressure with and without a hardness](hardness.png)
#
# The same four artificial surfaces are pressed three times: elastic, and with hardnesses of 400
# and 200 MPa.

# +
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from brake_fenicsx.micro import LawRecipe, LawSettings, law_library, plane_strain_modulus
from brake_fenicsx.surface import characterise, read_topography

HERE = Path(globals().get("__file__", "notebook")).resolve().parent
scan = read_topography(HERE.parents[1] / "scripts" / "scenes" / "pad_scan.npz")
stats = characterise(scan)
settings = LawSettings(plane_strain_modulus(1983.3e6, 0.4054))
recipe = LawRecipe(stats.spectrum, stats.hdf, settings, shape=(256, 256))
pressure = np.geomspace(2e4, 5e6, 40)


def stiffness(hardness):
    """Median loading stiffness and vibration stiffness [Pa/m] at the pressures."""
    pressed = replace(recipe, settings=replace(settings, hardness=hardness))
    laws = [law.steps for law in law_library(pressed, 4, seed=1)]
    both = [
        [np.exp(np.interp(np.log(pressure), np.log(s.p), np.log(k))) for k in (s.k, s.v)]
        for s in laws
    ]
    return np.median(both, axis=0)


found = {hardness: stiffness(hardness) for hardness in (None, 400e6, 200e6)}
# -

# +
figure, axis = plt.subplots(figsize=(6.4, 4.2), layout="constrained")
for colour, (hardness, (loading, vibration)) in enumerate(found.items()):
    name = "elastic" if hardness is None else f"{hardness / 1e6:.0f} MPa"
    axis.loglog(pressure / 1e6, vibration, color=f"C{colour}", label=name)
    if hardness is not None:
        axis.loglog(pressure / 1e6, loading, color=f"C{colour}", ls="--", lw=1)
axis.set(xlabel="mean pressure [MPa]", ylabel="contact stiffness [Pa/m]")
axis.legend(title="full: small vibrations, dashed: loading")
figure.savefig("hardness.png", dpi=120)
# -

# How many times stiffer small vibrations are with a hardness of 200 MPa than in elastic contact,
# at 0.2 MPa:

at = np.abs(pressure - 0.2e6).argmin()
ratio = found[200e6][1][at] / found[None][1][at]
print(f"{ratio:.1f} times stiffer")
assert 1.5 < ratio < 5

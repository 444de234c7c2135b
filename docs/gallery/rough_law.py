# # From a scan to the law of rough contact
#
# The scan of a pad gives a height distribution and a power spectrum. Artificial surfaces with
# both are pressed by a rigid plane; each gives one pressure-gap law. The laws of several surfaces
# show the scatter between contact patches.
#
# ![Spectrum of the scan, one artificial surface, and laws of six surfaces](rough_law.png)
#
# The scan in `scripts/scenes` is synthetic, with the statistics that the paper prints. The
# contact is elastic.

# +
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
laws = law_library(recipe, 6, seed=1)
print(f"S_q {1e6 * stats.S_q:.1f} um, skewness {stats.S_sk:.2f}, kurtosis {stats.S_ku:.2f}")
# -

# Stiffness of every law at a mean pressure of 0.2 MPa, a usual pressure of braking:

# +
PRESSURE = 0.2e6
stiffness = []
for p, k, count in zip(laws.p, laws.k, laws.count, strict=True):
    stiffness.append(np.exp(np.interp(np.log(PRESSURE), np.log(p[:count]), np.log(k[:count]))))
print(f"stiffness at 0.2 MPa: {min(stiffness):.2g} to {max(stiffness):.2g} Pa/m")

figure, axes = plt.subplots(1, 3, figsize=(11, 3.6), layout="constrained")
psd = stats.psd
axes[0].loglog(psd.q, psd.C, ".", ms=3, color="0.5", label="scan")
axes[0].loglog(psd.q, stats.spectrum(psd.q), color="tab:red", label="fit, Eq. (17)")
axes[0].loglog(psd.q, stats.spectrum(psd.q), color="k", lw=0.8, label="artificial surfaces")
axes[0].set(xlabel="wave number [rad/m]", ylabel="radial power spectrum [m$^4$]")
axes[0].legend()
surface = recipe.surface(1, 0)
image = axes[1].imshow(1e6 * surface.heights.T, extent=[0, 2.825, 0, 2.825], origin="lower")
axes[1].set(xlabel="x [mm]", ylabel="y [mm]", title="heights [um]")
figure.colorbar(image, ax=axes[1])
for d, p, count in zip(laws.d, laws.p, laws.count, strict=True):
    axes[2].semilogy(1e6 * d[:count], p[:count] / 1e6)
axes[2].axhline(PRESSURE / 1e6, color="k", lw=0.8, ls=":")
axes[2].set(xlabel="separation of the mean planes [um]", ylabel="mean pressure [MPa]")
figure.savefig("rough_law.png", dpi=110)
# -

# The median stiffness of the six patches:

print(f"median {np.median(stiffness):.3g} Pa/m")
assert 1.5e10 < np.median(stiffness) < 4e10

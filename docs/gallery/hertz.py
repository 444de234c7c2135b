# # Hertz contact of a cylinder
#
# A steel cylinder is pressed on a flat steel base. Hertz's pressure over the half-width a is p0
# sqrt(1 - x^2 / a^2) with p0 = a E* / (2 R). Contact elements are means over curved facets.
#
# ![Contact pressure of a cylinder against Hertz's](hertz.png)
#
# The scene holds a slice in plane strain. Every constraint of symmetry is a line of `[supports]`,
# and the load is chosen for a half-width of 1.5 mm.

# +
from pathlib import Path

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np

from brake_fenicsx import assemble
from brake_fenicsx.macro import equilibrium
from brake_fenicsx.micro import linear_law

E, NU, R, A = 210e9, 0.3, 50e-3, 1.5e-3
E_STAR = E / (2 * (1 - NU**2))
P0 = A * E_STAR / (2 * R)
Path("hertz.toml").write_text(f"""
stages = ["equilibrium"]

[mesh]
cells = "hexahedra"
order = 2                     # curved facets

[parts.cylinder]
builder = "hertz_cylinder"
radius = "50 mm"
slice = "0.5 mm"              # of the plane problem
elements = 1
fine = "0.1 mm"
material = "steel"

[parts.base]
builder = "hertz_slab"
depth = "50 mm"
slice = "0.5 mm"
fine = "0.12 mm"
material = "steel"

[materials.steel]
model = "isotropic"
E = "210 GPa"
nu = 0.3
rho = "7800 kg/m^3"

[contact.line]
faces = ["cylinder.contact", "base.contact"]
law = {{ linear = "1e17 Pa/m" }}

[supports]
"base.bottom" = ["x", "z"]
"base.symmetry_x" = ["x"]
"base.sides" = ["y"]
"cylinder.symmetry_x" = ["x"]
"cylinder.sides" = ["y"]

[loads]
"cylinder.top" = {{ pressure = "{np.pi * A * P0 / 4 / R} Pa" }}

[motion]
direction = [0, 1, 0]
""")
brake = assemble("hertz.toml", MPI.COMM_SELF)
state = equilibrium(brake, linear_law(1e17), g_cr=0.0, mu=0.0)
# -

# Pressures of the contact elements, and Hertz's:

# +
figure, axis = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
fine = np.linspace(0, A, 200)
axis.plot(1e3 * fine, 1e-6 * P0 * np.sqrt(1 - (fine / A) ** 2), color="0.6", lw=3, label="Hertz")
axis.plot(1e3 * brake.points[:, 0], 1e-6 * state.p, "k.", ms=4, label="contact elements")
axis.set(xlabel="distance from the middle [mm]", ylabel="pressure [MPa]")
axis.legend()
figure.savefig("hertz.png", dpi=120)
# -

# The largest pressure, relative to Hertz's:

print(f"{brake.N.shape[1]} dofs; largest pressure over p0: {state.p.max() / P0:.5f}")
assert abs(state.p.max() / P0 - 1) < 1e-3

# # Hertz contact of a cylinder
#
# A steel cylinder is pressed on a flat steel base. Hertz's pressure over the half-width a is p0
# sqrt(1 - x^2 / a^2) with p0 = a E* / (2 R). Contact elements are means over curved facets.
#
# ![Contact pressure of a cylinder against Hertz's](hertz.png)
#
# The mesh is drawn here by gmsh: half of both profiles, swept into one layer of curved hexahedra in
# plane strain. Every constraint of symmetry is a line of `[supports]`, and the load is chosen for a
# half-width of 1.5 mm.

# +
from pathlib import Path

from mpi4py import MPI

import gmsh
import matplotlib.pyplot as plt
import numpy as np

from brake_fenicsx import assemble
from brake_fenicsx.macro import equilibrium
from brake_fenicsx.micro import linear_law

E, NU, R, A = 210e9, 0.3, 50e-3, 1.5e-3
E_STAR = E / (2 * (1 - NU**2))
P0 = A * E_STAR / (2 * R)
C, FINE, SLICE = 2e-3, 0.1e-3, 0.5e-3  # half-width of the meshed contact, size of its cells [m]


def body(name, corners, arc):
    """Half of a profile, its contact first and then anticlockwise or clockwise, swept along y."""
    occ = gmsh.model.occ
    at = [occ.addPoint(x, 0, z, FINE if i < 2 else 50 * FINE) for i, (x, z) in enumerate(corners)]
    ends = [*zip(at, at[1:] + at[:1], strict=True)]
    curves = [occ.addLine(*pair) for pair in ends[2 if arc else 0 :]]
    if arc:
        curves = [*(occ.addCircleArc(a, at[-1], b) for a, b in ends[:2]), *curves]
    profile = occ.addPlaneSurface([occ.addCurveLoop(curves)])
    swept = occ.extrude([(2, profile)], 0, SLICE, 0, [1], recombine=True)
    occ.synchronize()
    sides = [tag for _, tag in swept[2:]]
    groups = {"contact": sides[:1], "far": sides[-2:-1], "symmetry": sides[-1:]}
    for face, tags in (groups | {"ends": [profile, swept[0][1]]}).items():
        number = gmsh.model.addPhysicalGroup(2, tags)
        gmsh.model.setPhysicalName(2, number, f"{name} {face}")
    number = gmsh.model.addPhysicalGroup(3, [swept[1][1]])
    gmsh.model.setPhysicalName(3, number, name)


gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
rise = R - (R**2 - C**2) ** 0.5
body("cylinder", [(0, 0), (C, rise), (R, R), (0, R)], arc=True)
body("base", [(0, 0), (C, 0), (R, 0), (R, -R), (0, -R)], arc=False)
gmsh.option.setNumber("Mesh.RecombineAll", 1)
gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 3)
gmsh.model.mesh.generate(3)
gmsh.model.mesh.setOrder(2)
gmsh.write("hertz.msh")
gmsh.finalize()

Path("hertz.toml").write_text(f"""
stages = ["equilibrium"]

[mesh]
file = "hertz.msh"
unit = "m"
order = 2                     # curved facets

[mesh.groups]
cylinder = "cylinder.body"
base = "base.body"
"cylinder contact" = "cylinder.contact"
"cylinder far" = "cylinder.top"
"cylinder symmetry" = "cylinder.symmetry"
"cylinder ends" = "cylinder.ends"
"base contact" = "base.contact"
"base far" = "base.bottom"
"base symmetry" = "base.symmetry"
"base ends" = "base.ends"

[parts]
cylinder = {{ material = "steel" }}
base = {{ material = "steel" }}

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
"base.symmetry" = ["x"]
"base.ends" = ["y"]
"cylinder.symmetry" = ["x"]
"cylinder.ends" = ["y"]

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

# # A deck of Abaqus
#
# A mesh of another program needs its unit, and names for the parts and faces of its sets. This
# deck holds a rotor and two pads; the pads' linings and back plates share their nodes, pads and
# rotor do not.
#
# ![Mesh of the deck, coloured by layer](own_deck.png)
#
# `scripts/example_inputs.py` writes the deck; the walk-through "My own scan, my own mesh" goes on
# to squeal.

# +
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
from PIL import Image

from brake_fenicsx import assemble
from brake_fenicsx.report.render import render_mesh

HERE = Path(globals().get("__file__", "notebook")).resolve().parent
SCRIPT = HERE.parents[1] / "scripts" / "example_inputs.py"
subprocess.run([sys.executable, str(SCRIPT), "."], check=True)
Path("deck.toml").write_text("""
stages = ["equilibrium"]

[mesh]
file = "my_brake.inp"
unit = "mm"                     # no default: a factor of 1000 must not slip through

[mesh.groups]                   # set of the deck = "part.layer" or "part.face"
ROTOR = "disc.body"
LINING = "pad.lining"
BACKPLATE = "pad.plate"
ROTOR_FACE = "disc.friction"
PAD_FACE = "pad.friction"
PISTON = "pad.piston"
SIDES = "pad.ends"
CLAMP = "disc.bore"

[parts.disc]
material = "iron"

[parts.pad]
material = { lining = "lining", plate = "steel" }
axis = "0 deg"

[materials.iron]
model = "isotropic"
E = "125 GPa"
nu = 0.24
rho = "7200 kg/m^3"

[materials.steel]
model = "isotropic"
E = "207 GPa"
nu = 0.28
rho = "7820 kg/m^3"

[materials.lining]
model = "transversely-isotropic"
C11 = "5.94 GPa"
C12 = "0.76 GPa"
C13 = "0.98 GPa"
C33 = "2.27 GPa"
C44 = "1.18 GPa"
rho = "2510 kg/m^3"

[contact.pad_disc]
faces = ["pad.friction", "disc.friction"]
law = { linear = "2e13 Pa/m" }
friction = 0.5

[supports]
"disc.bore" = "clamped"
"pad.ends" = ["x", "y"]

[loads]
"pad.piston" = { pressure = "2 bar" }

[motion]
axis = "z"
""")
brake = assemble("deck.toml", MPI.COMM_SELF)
# -

# The picture, with a colour for each layer:

# +
tags = brake.mesh.cell_tags
layer = np.zeros(tags.indices.max() + 1, dtype=int)
layer[tags.indices] = tags.values
names = {tag: name for name, tag in brake.mesh.layers.items()}
title = f"{brake.N.shape[1]} free dofs, {len(brake.w)} contact elements"
render_mesh("own_deck.png", brake.elastic.free.V, layer, names, title)
picture = Image.open("own_deck.png")
picture.thumbnail((1000, 800))
picture.quantize(128).save("own_deck.png")
# -

# Two pads of 80 mm by 45 mm lie on the rotor with all of their faces:

print(f"area in contact {1e6 * brake.w.sum():.1f} mm^2")
assert abs(1e6 * brake.w.sum() - 7200) < 0.1

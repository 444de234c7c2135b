# # Vented disc with hat
#
# The builder `disc` makes plain and vented discs with or without a hat. This one has 24 vanes and
# is clamped at its bolt holes. The picture shows a bending mode with two nodal diameters; the
# modes of a real brake's disc are compared with a modal test by `brake-fenicsx correlate`.
#
# ![Mode of a vented disc](vented_disc.png)
#
# Shapes and sizes are those that a scene writes under `[parts.disc]`.

# +
from mpi4py import MPI

import numpy as np
from PIL import Image

from brake_fenicsx.geometry import disc
from brake_fenicsx.macro.elasticity import assemble_elastic
from brake_fenicsx.macro.material import Material, isotropic
from brake_fenicsx.meshing.brake_mesh import build_mesh
from brake_fenicsx.report.render import render_mode
from brake_fenicsx.stability import complex_modes

shape = disc.Disc(vanes=24, hat=40e-3, size=16e-3)
mesh = build_mesh({"disc": (disc, shape)}, MPI.COMM_SELF)
iron = Material(isotropic(125e9, 0.24), 7200.0)
body = assemble_elastic(mesh, {"disc.body": iron}, {"disc.bolts": ["x", "y", "z"]})
modes = complex_modes(body.M, None, body.K, (0.0, 1600.0))
print(f"{body.K.shape[0]} dofs, {len(modes)} modes: {np.round(modes.frequency, 1)} Hz")
# -

# A mode with m nodal diameters has a counterpart of nearly the same frequency, turned by a
# quarter of its wave. The motion along the axis at the friction faces tells m, as the largest
# Fourier coefficient around the disc.

# +
x = body.free.V.tabulate_dof_coordinates()
outside = np.hypot(x[:, 0], x[:, 1]) > 0.12
angle = np.arctan2(x[outside, 1], x[outside, 0])


def diameters(vector):
    """Number of nodal diameters of a mode."""
    u = body.free.expand(vector.real)[2::3][outside]
    return int(np.argmax([abs(np.sum(u * np.exp(1j * m * angle))) for m in range(8)]))


orders = [diameters(vector) for vector in modes.right.T]
print("nodal diameters:", orders)
pair = modes.frequency[np.flatnonzero(np.array(orders) == 2)[:2]]
mode = orders.index(2)
render_mode(
    "vented_disc.png",
    body.free.V,
    body.free.expand(modes.right[:, mode].real),
    f"{pair[0]:.0f} Hz, two nodal diameters",
)
picture = Image.open("vented_disc.png")
picture.thumbnail((1000, 800))
picture.quantize(128).save("vented_disc.png")
# -

# Frequencies of the two modes with two nodal diameters:

print(f"{pair[0]:.1f} and {pair[1]:.1f} Hz")
assert abs(pair[0] / 1508 - 1) < 0.03 and pair[1] - pair[0] < 0.01 * pair[0]

# # Doublets of a disc, split by its rotation
#
# A wave with m periods around a disc has two modes of equal frequency. In the frame of the pads
# the disc turns: the wave that runs with the rotation becomes faster and the one that runs
# against it slower. Their frequencies differ by 2 m Omega in rad/s.
#
# ![Frequencies of a clamped disc over its speed](disc_doublets.png)
#
# The disc is thin, clamped at its bore, and meshed by swept hexahedra, which keep the double
# modes double. The gyroscopic matrix is linear in the speed. The frequencies without rotation
# serve as the reference: omega = +- m Omega + sqrt(omega_0^2 + (m Omega)^2).

# +
from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np

from brake_fenicsx.geometry import disc
from brake_fenicsx.macro.contact_forces import Rotation
from brake_fenicsx.macro.elasticity import assemble_elastic
from brake_fenicsx.macro.material import Material, isotropic
from brake_fenicsx.meshing.brake_mesh import build_mesh
from brake_fenicsx.meshing.gmsh_mesh import MeshSettings
from brake_fenicsx.stability import complex_modes
from brake_fenicsx.stability.damping_matrices import gyroscopic

IRON = Material(isotropic(125e9, 0.24), 7200.0)
shape = disc.Disc(radius=0.144, bore=0.075, thickness=2e-3, size=14e-3)
mesh = build_mesh({"disc": (disc, shape)}, MPI.COMM_SELF, MeshSettings(cells="hexahedra"))
body = assemble_elastic(mesh, {"disc.body": IRON}, {"disc.bore": ["x", "y", "z"]})
G = gyroscopic(mesh, body.free, {"disc.body": IRON.rho}, Rotation(1.0))

# Modes at several speeds [Hz].
BAND, speeds = (0.0, 600.0), np.array([0.0, 25.0, 50.0, 75.0, 100.0])
found = [complex_modes(body.M, v * G if v else None, body.K, BAND).frequency for v in speeds]
# -

# At rest the modes come in the order m = 0, 1, 1, 2, 2, 3, 3. The split of a doublet at a speed
# is the distance of the two modes nearest to its closed form.

# +
figure, axis = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
worst = 0.0
for m, rest in enumerate(found[0][[0, 1, 3, 5]]):
    middle = np.hypot(rest, m * speeds / (2 * np.pi))
    lines = [middle + sign * m * speeds / (2 * np.pi) for sign in (1, -1)]
    for line in lines:
        axis.plot(speeds, line, color=f"C{m}", lw=1, label=f"m = {m}" if line is lines[0] else None)
    for i in range(1 if m else speeds.size, speeds.size):
        along, against = (found[i][np.abs(found[i] - line[i]).argmin()] for line in lines)
        worst = max(worst, abs(2 * np.pi * (along - against) / (2 * m * speeds[i]) - 1))
for speed, frequency in zip(speeds, found, strict=True):
    axis.plot(np.full(frequency.size, speed), frequency, "k.", ms=5)
axis.set(xlabel="speed of the disc [rad/s]", ylabel="frequency [Hz]", ylim=(240, 460))
axis.legend(title="lines: closed form", loc="upper left")
figure.savefig("disc_doublets.png", dpi=120)
# -

# The largest deviation of a split from 2 m Omega. In-plane inertia, which the closed form leaves
# out, adds a little.

print(f"at rest {np.round(found[0], 1)} Hz")
print(f"splits differ from 2 m Omega by {100 * worst:.2f} % at most")
assert worst < 0.01

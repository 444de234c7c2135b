"""Motion of faces, and the sound that they radiate as parts of a rigid baffle.

Every node is a small piston with its share of the area; faces that look the same way radiate
together (Rayleigh's integral). Of velocities v of sources in a baffle at omega = k c,

    P = rho omega^2 / (4 pi c)  sum_ij A_i A_j Re(v_i v_j*) sin(k r_ij) / (k r_ij)

(Elliott and Johnson, J. Acoust. Soc. Am. 94, 1993, doi:10.1121/1.407490). A real disc has no
baffle, and air passes around its rim: an estimate, too loud at low frequencies.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from brake_fenicsx.arguments import Array, Complex, Ints
from brake_fenicsx.macro.elasticity import FreeDofs
from brake_fenicsx.macro.faces import gather_face
from brake_fenicsx.meshing.brake_mesh import Mesh

DENSITY, SOUND = 1.204, 343.2  # of air at 20 C [kg/m^3], [m/s]
REFERENCE = 1e-12  # sound power of 0 dB [W]
# From sound power to the level at 1 m in the open, 20 uPa: a sphere of 4 pi m^2.
AT_ONE_METRE = -11.0
# Harmonics whose velocity is less than this share of the largest are left out.
QUIET = 1e-3


@dataclass(frozen=True, slots=True)
class Nodes:
    """Nodes of some faces.

    Attributes:
        columns: free number of each displacement, -1 where held, shape (nodes, 3).
        place: positions [m], shape (nodes, 3).
        area: outward area of each node [m^2], shape (nodes, 3).
    """

    columns: Ints
    place: Array
    area: Array

    def displacement(self, u: Complex) -> Complex:
        """Of vectors on the free dofs, shape (dofs, n) to (nodes, 3, n)."""
        return np.where((self.columns >= 0)[..., None], u[self.columns], 0.0)

    def power(self, velocity: Complex, omega: float) -> float:
        """Sound power [W] of one frequency.

        Args:
            velocity: amplitudes [m/s], shape (nodes, 3).
            omega: angular frequency [rad/s].
        """
        flow, total = np.einsum("nc,nc->n", velocity, self.area), 0.0
        left = np.ones(flow.size, bool)
        while left.any():
            side = left & (self.area @ self.area[np.argmax(left)] > 0)
            side[np.argmax(left)] = True
            left &= ~side
            x, v = self.place[side], flow[side]
            apart = np.linalg.norm(x[:, None] - x[None], axis=2)
            kernel = np.sinc(omega / SOUND / np.pi * apart)
            total += float((v.conj() @ kernel @ v).real)
        return DENSITY * omega**2 / (4 * np.pi * SOUND) * total


def nodes_of(mesh: Mesh, free: FreeDofs, faces: Sequence[str]) -> Nodes:
    """The nodes of some faces, each once.

    Args:
        mesh: the tagged mesh.
        free: numbering of the free dofs.
        faces: their names, "part.face".
    """
    columns, place, area, number = [], [], [], []
    for face in map(lambda name: gather_face(mesh, free, name), faces):
        corner = face.corners
        across = np.cross(corner[:, 1] - corner[:, 0], corner[:, -1] - corner[:, 0])
        if face.element.corners == 4:
            across = np.cross(corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1])
        size = 0.5 * np.linalg.norm(across, axis=1)
        share = size[:, None] * face.element.tributary
        area.append((share[..., None] * face.normal[:, None]).reshape(-1, 3))
        columns.append(face.columns.reshape(-1, 3))
        place.append(face.nodes.reshape(-1, 3))
        number.append(face.number.ravel())
    _, first, each = np.unique(np.concatenate(number), return_index=True, return_inverse=True)
    total = np.zeros((first.size, 3))
    np.add.at(total, each, np.concatenate(area))
    return Nodes(np.concatenate(columns)[first], np.concatenate(place)[first], total)


def sound_power(nodes: Nodes, u: Complex, omega: float) -> float:
    """Sound power of a periodic vibration [W].

    Args:
        nodes: of the faces that radiate.
        u: displacements on the free dofs of the mean and each harmonic [m], shape (dofs, n + 1).
        omega: angular frequency of the first [rad/s].
    """
    velocity = nodes.displacement(u) * (1j * omega * np.arange(u.shape[1]))
    size = np.abs(velocity).max(axis=(0, 1), initial=0.0)
    loud = np.flatnonzero(size > QUIET * size.max())
    return sum(nodes.power(velocity[..., n], n * omega) for n in loud)


def decibels(power: float) -> float:
    """Level of a sound power, re 1 pW [dB]; nan of silence."""
    return float(10 * np.log10(power / REFERENCE)) if power > 0 else float("nan")

"""Nodal diameters of a rotor: its motion at the rim as a Fourier series over the angle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

RIM = 0.9  # nodes beyond this share of the largest radius make the rim
WIDEST = np.pi / 6  # gap between neighbouring angles [rad] beyond which there is no ring
DIRECTIONS = ("out of plane", "in plane, radial", "in plane, tangential")


@dataclass(frozen=True, slots=True)
class NodalPattern:
    """The strongest harmonic of a rotor's motion.

    Attributes:
        diameters: its order: the number of nodal diameters.
        direction: "out of plane", "in plane, radial" or "in plane, tangential".
        share: share of the harmonic in the squared displacements of the rim [-].
    """

    diameters: int
    direction: str
    share: float


def nodal_pattern(points: NDArray, u: NDArray, most: int = 12) -> NodalPattern | None:
    """Strongest harmonic of the motion of a rotor's rim, by least squares over its nodes.

    Args:
        points: nodes of the rotor [m], shape (n, 3); its axis is z.
        u: displacements of these nodes, real or complex, shape (n, 3).
        most: highest order.

    Returns:
        The harmonic; None where the nodes form no closed ring or none of them moves.
    """
    radius = np.hypot(points[:, 0], points[:, 1])
    rim = radius >= RIM * radius.max(initial=0.0)
    angle = np.arctan2(points[rim, 1], points[rim, 0])
    around = np.unique(angle.round(6))
    if around.size < 8 or np.diff(around, append=around[0] + 2 * np.pi).max() > WIDEST:
        return None
    orders = np.arange(min(most, around.size // 4) + 1)
    phase = np.outer(angle, orders)
    basis = np.hstack([np.cos(phase), np.sin(phase[:, 1:])])
    across = np.cos(angle), np.sin(angle)
    x, y, z = u[rim].T
    motion = np.column_stack([z, across[0] * x + across[1] * y, across[0] * y - across[1] * x])
    whole = float(np.sum(np.abs(motion) ** 2))
    if whole == 0.0:
        return None
    found = np.linalg.lstsq(basis, motion, rcond=None)[0]
    cosines, sines = found[: orders.size], found[orders.size :]
    pieces = np.empty((orders.size, 3))
    for n in orders:
        own = np.outer(basis[:, n], cosines[n])
        if n:
            own = own + np.outer(basis[:, orders.size + n - 1], sines[n - 1])
        pieces[n] = np.sum(np.abs(own) ** 2, axis=0)
    n, j = np.unravel_index(int(pieces.argmax()), pieces.shape)
    return NodalPattern(int(n), DIRECTIONS[j], min(float(pieces[n, j]) / whole, 1.0))

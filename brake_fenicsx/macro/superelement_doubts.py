"""What is unlikely of a body given by its matrices: its mass, and the order of its nodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .superelement import Superelement

Array = NDArray[np.float64]

# Mass over the volume of the box around the nodes [kg/m^3]. Thin brackets fill some per cent of it;
# the box of a few nodes that were kept may be far smaller than the body. A wrong unit changes the
# number by 1e3 or 1e9.
LIKELY = (10.0, 1e6)

# |K r| over |K| |r|, the largest of all rows: below the first, round-off of a text file, a motion
# is free; above the second, rounded coordinates do not explain it.
FREE, STRAINED = 1e-4, 2e-2


def doubts(body: Superelement) -> list[str]:
    """Sentences on what is unlikely.

    A body that shifts freely turns freely too, if each row of its stiffness belongs to the node at
    whose place it is put.

    Args:
        body: its matrices in SI units, stiffness in full.
    """
    found = []
    lost = np.count_nonzero(np.all(body.rows < 0, axis=1))
    if lost and body.unknown:
        found.append(
            f"{lost} nodes of the table have no displacement in the matrices, and {body.unknown}"
            " nodes of the matrices are not in the table; compare their numbers"
        )
    shifts = _shifts(body)
    mass = float(np.einsum("ic,ic->", shifts, body.M @ shifts)) / 3
    box = np.ptp(body.points, axis=0)
    volume = float(box.prod())
    if volume > 0 and not LIKELY[0] <= mass / volume <= LIKELY[1]:
        x, y, z = 1e3 * box
        found.append(
            f"a mass of {mass:.3g} kg in a box of {x:.3g} x {y:.3g} x {z:.3g} mm; correct units, or"
            " the unit of the table of nodes"
        )
    whole = np.count_nonzero(body.rows >= 0) == body.K.shape[0]
    if whole and _strain(body, shifts) < FREE and _strain(body, _turns(body)) > STRAINED:
        found.append(
            "it shifts freely, but turning strains it; correct the order of the table of nodes,"
            " which is that of the rows where the matrices name no nodes, or their coordinates"
        )
    return found


def _shifts(body: Superelement) -> Array:
    """Displacement by one along x, y and z, shape (coordinates, 3)."""
    out = np.zeros((body.K.shape[0], 3))
    for c in range(3):
        rows = body.rows[:, c]
        out[rows[rows >= 0], c] = 1.0
    return out


def _turns(body: Superelement) -> Array:
    """Rotation by one about the axes through the mean place, shape (coordinates, 3)."""
    out = np.zeros((body.K.shape[0], 3))
    from_centre = body.points - body.points.mean(axis=0)
    for axis, unit in enumerate(np.eye(3)):
        there = body.rows >= 0
        out[body.rows[there], axis] = np.cross(unit, from_centre)[there]
    return out


def _strain(body: Superelement, motion: Array) -> float:
    """Largest force over the sum of its terms' sizes."""
    force, sizes = np.abs(body.K @ motion), np.abs(body.K) @ np.abs(motion)
    return float(np.divide(force, sizes, out=np.zeros_like(force), where=sizes > 0).max())

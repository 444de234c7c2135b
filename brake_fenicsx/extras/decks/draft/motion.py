"""Which part of a first scene moves, and how."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.scene.units import quantity_text

from .faces import FileParts
from .statements import axis_key

Array = NDArray[np.float64]

# Two sides of a round part differ by this share at most.
ROUND = 0.02


def moving_part(bodies: FileParts, touching: Iterable[str], stiffness: Mapping[str, float]) -> str:
    """The part with the largest faces in contact, of equal ones the stiffer: the disc.

    Args:
        bodies: all parts.
        touching: faces in contact.
        stiffness: part -> modulus.
    """
    area: dict[str, float] = defaultdict(float)
    for face in touching:
        area[face.partition(".")[0]] += bodies.faces[face].areas.sum()
    return max(area, key=lambda part: (round(area[part], 9), stiffness[part]))


def proposed_motion(
    bodies: FileParts, part: str, touching: Iterable[str]
) -> tuple[dict[str, Any], str]:
    """Keys of [motion]: about the middle of a round part, or along the long side of another one.

    Args:
        bodies: all parts.
        part: the one that moves.
        touching: faces in contact.
    """
    own = [bodies.faces[face] for face in touching if face.startswith(f"{part}.")]
    vectors = np.concatenate([face.vector for face in own])
    weights = np.linalg.norm(vectors, axis=1)
    _, axes = np.linalg.eigh(vectors.T @ (vectors / weights[:, None]))
    whole, n = bodies.boundary[part], axes[:, 2]
    sides = np.ptp(whole.centre @ axes[:, :2], axis=0)
    if np.ptp(sides) > ROUND * sides.max():
        along = axes[:, int(np.argmax(sides))]
        return {"direction": _vector(along)}, f"proposed: the long side of {part}"
    keys: dict[str, Any] = {"axis": axis_key(_vector(n))}
    middle = np.average(whole.centre, axis=0, weights=whole.areas)
    if np.linalg.norm(middle - (middle @ n) * n) > ROUND * sides.max():
        keys["point"] = [quantity_text(float(x), "m") for x in middle]
    return keys | {"speed": "5 rad/s"}, f"proposed: across the contact faces of {part}"


def _vector(x: Array) -> list[float]:
    """A direction with rounded components, the largest one 1."""
    x = np.round(x / x[np.argmax(np.abs(x))], 3)
    return [float(v) + 0.0 for v in x]

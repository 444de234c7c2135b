"""Brake disc: a plain annulus about the z axis, centred at z = 0."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .part import Part, faces_where, flat_at


@dataclass(frozen=True, slots=True)
class Disc:
    """Parameters of the disc.

    Attributes:
        radius: outer radius [m].
        bore: radius of the inner cylinder, where it is clamped [m].
        thickness: thickness [m].
        size: mesh size [m].
    """

    radius: float = field(default=144e-3, metadata={"unit": "m"})
    bore: float = field(default=75e-3, metadata={"unit": "m"})
    thickness: float = field(default=20e-3, metadata={"unit": "m"})
    size: float = field(default=12e-3, metadata={"unit": "m"})


def build(occ: Any, disc: Disc) -> Part:
    """Add the disc to the current gmsh model.

    Args:
        occ: gmsh's OpenCASCADE kernel.
        disc: its parameters.

    Returns:
        Layer ``body``; faces ``friction`` (both sides), ``bore``, ``rim``.
    """
    if not 0 < disc.bore < disc.radius:
        raise ValueError(f"bore {disc.bore} m must lie between 0 and radius {disc.radius} m")
    z = -disc.thickness / 2
    outer = occ.addCylinder(0, 0, z, 0, 0, disc.thickness, disc.radius)
    inner = occ.addCylinder(0, 0, z, 0, 0, disc.thickness, disc.bore)
    ring, _ = occ.cut([(3, outer)], [(3, inner)])
    occ.synchronize()
    body = [tag for _, tag in ring]

    def cylinder(r: float) -> Callable[[np.ndarray, np.ndarray], bool]:
        return lambda low, high: bool(
            high[2] - low[2] > 0.5 * disc.thickness and np.isclose(high[0], r, rtol=1e-3)
        )

    return Part(
        volumes={"body": body},
        faces={
            "friction": faces_where(body, flat_at(z)) + faces_where(body, flat_at(-z)),
            "bore": faces_where(body, cylinder(disc.bore)),
            "rim": faces_where(body, cylinder(disc.radius)),
        },
        sizes={"body": disc.size},
    )

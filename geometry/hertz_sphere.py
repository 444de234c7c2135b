"""Sphere of a Hertz contact: one eighth, above the plane z = 0, cut at x = 0 and y = 0."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .hertz import away_from_spot, round_profile
from .part import PartEntities, revolved_quarter


@dataclass(frozen=True, slots=True)
class Sphere:
    """Parameters of the sphere.

    Attributes:
        radius: radius [m].
        contact: radius of the named contact face and of the finest mesh [m].
        fine: mesh size there [m].
        size: largest mesh size [m].
        growth: growth of the size with the distance from the contact.
    """

    radius: float = field(default=50e-3, metadata={"unit": "m"})
    contact: float = field(default=2e-3, metadata={"unit": "m"})
    fine: float = field(default=0.1e-3, metadata={"unit": "m"})
    size: float = field(default=10e-3, metadata={"unit": "m"})
    growth: float = field(default=0.4, metadata={"unit": ""})


def build(occ: Any, sphere: Sphere) -> PartEntities:
    """Add the eighth of a sphere, its lowest point at the origin, to the current gmsh model.

    Args:
        occ: gmsh's OpenCASCADE kernel.
        sphere: its parameters.

    Returns:
        Layer ``body``; faces ``contact``, ``free`` (the rest of the sphere), ``top`` (z = radius),
        ``symmetry_x`` (x = 0) and ``symmetry_y`` (y = 0).
    """
    surface, _ = round_profile(occ, sphere.radius, sphere.contact)
    R = sphere.radius
    rise = R - np.sqrt(R**2 - sphere.contact**2)
    body, faces = revolved_quarter(
        occ, surface, {"contact": (0, rise), "free": (rise, R), "top": (R, R)}
    )
    return PartEntities(
        volumes={"body": body},
        faces=faces,
        sizes={"body": sphere.size},
        fine=((sphere.fine, away_from_spot(sphere.contact)),),
        growth=sphere.growth,
    )

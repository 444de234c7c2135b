"""Flat base of a Hertz contact with a sphere: a quarter of a cylinder below z = 0."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .hertz import away_from_spot, flat_profile
from .part import PartEntities, revolved_quarter


@dataclass(frozen=True, slots=True)
class Base:
    """Parameters of the base.

    Attributes:
        radius: outer radius [m].
        depth: extent along z [m].
        contact: radius of the named contact face and of the finest mesh [m].
        fine: mesh size there [m].
        size: largest mesh size [m].
        growth: growth of the size with the distance from the contact.
    """

    radius: float = field(default=50e-3, metadata={"unit": "m"})
    depth: float = field(default=50e-3, metadata={"unit": "m"})
    contact: float = field(default=2.2e-3, metadata={"unit": "m"})
    fine: float = field(default=0.12e-3, metadata={"unit": "m"})
    size: float = field(default=10e-3, metadata={"unit": "m"})
    growth: float = field(default=0.4, metadata={"unit": ""})


def build(occ: Any, base: Base) -> PartEntities:
    """Add the quarter base to the current gmsh model.

    Args:
        occ: gmsh's OpenCASCADE kernel.
        base: its parameters.

    Returns:
        Layer ``body``; faces ``contact``, ``free`` (the rest of the upper face), ``far``
        (the cylinder), ``bottom``, ``symmetry_x`` (x = 0) and ``symmetry_y`` (y = 0).
    """
    surface, _ = flat_profile(occ, base.radius, base.depth, base.contact)
    body, faces = revolved_quarter(
        occ,
        surface,
        {"contact": (0, 0), "free": (0, 0), "far": (-base.depth, 0), "bottom": 2 * (-base.depth,)},
        {"contact": base.contact},
    )
    return PartEntities(
        volumes={"body": body},
        faces=faces,
        sizes={"body": base.size},
        fine=((base.fine, away_from_spot(base.contact)),),
        growth=base.growth,
    )

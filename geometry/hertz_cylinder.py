"""Cylinder of a Hertz line contact: a slice of its lower half x > 0, lying along y above z = 0."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .hertz import away_from_line, round_profile
from .part import Slab, Swept, SweptFace


@dataclass(frozen=True, slots=True)
class Cylinder:
    """Parameters of the slice; hold its faces ``sides`` along y for plane strain.

    Attributes:
        radius: radius [m].
        slice: extent along y [m].
        contact: half-width of the named contact face and of the finest mesh [m].
        fine: mesh size there [m].
        size: largest mesh size [m].
        growth: growth of the size with the distance from the contact.
        elements: number of elements along y.
    """

    radius: float = field(default=50e-3, metadata={"unit": "m"})
    slice: float = field(default=0.5e-3, metadata={"unit": "m"})
    contact: float = field(default=2e-3, metadata={"unit": "m"})
    fine: float = field(default=0.1e-3, metadata={"unit": "m"})
    size: float = field(default=10e-3, metadata={"unit": "m"})
    growth: float = field(default=0.25, metadata={"unit": ""})
    elements: int = 1


def sweep(occ: Any, cylinder: Cylinder) -> Swept:
    """Add the profile to the current gmsh model; the lowest line lies at the origin.

    Args:
        occ: gmsh's OpenCASCADE kernel.
        cylinder: its parameters.

    Returns:
        Layer ``body``; faces ``contact``, ``free`` (the rest of the cylinder), ``top``,
        ``symmetry_x`` (x = 0) and ``sides`` (both ends of the slice).
    """
    surface, curves = round_profile(occ, cylinder.radius, cylinder.contact)
    occ.synchronize()
    return Swept(
        regions={"all": [surface]},
        curves={name: [tag] for name, tag in curves.items()},
        slabs=(Slab("body", -cylinder.slice, 0.0, cylinder.elements, ("all",)),),
        faces={
            "contact": (SweptFace(0, "side", ("contact",)),),
            "free": (SweptFace(0, "side", ("free",)),),
            "top": (SweptFace(0, "side", ("top",)),),
            "symmetry_x": (SweptFace(0, "side", ("axis",)),),
            "sides": (SweptFace(0, "low", ("all",)), SweptFace(0, "high", ("all",))),
        },
        size=cylinder.size,
        fine=((cylinder.fine, away_from_line(cylinder.contact)),),
        growth=cylinder.growth,
        upright=True,
    )

"""Flat base of a Hertz line contact: a slice of its half x > 0, below z = 0."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .hertz import away_from_line, flat_profile
from .part import Slab, Swept, SweptFace


@dataclass(frozen=True, slots=True)
class Plate:
    """Parameters of the slice; hold its faces ``sides`` along y for plane strain.

    Attributes:
        width: extent along x [m].
        depth: extent along z [m].
        slice: extent along y [m].
        contact: half-width of the named contact face and of the finest mesh [m].
        fine: mesh size there [m].
        size: largest mesh size [m].
        growth: growth of the size with the distance from the contact.
        elements: number of elements along y.
    """

    width: float = field(default=50e-3, metadata={"unit": "m"})
    depth: float = field(default=50e-3, metadata={"unit": "m"})
    slice: float = field(default=0.5e-3, metadata={"unit": "m"})
    contact: float = field(default=2.2e-3, metadata={"unit": "m"})
    fine: float = field(default=0.12e-3, metadata={"unit": "m"})
    size: float = field(default=10e-3, metadata={"unit": "m"})
    growth: float = field(default=0.25, metadata={"unit": ""})
    elements: int = 1


def sweep(occ: Any, plate: Plate) -> Swept:
    """Add the profile to the current gmsh model.

    Args:
        occ: gmsh's OpenCASCADE kernel.
        plate: its parameters.

    Returns:
        Layer ``body``; faces ``contact``, ``free`` (the rest of the upper face), ``far``,
        ``bottom``, ``symmetry_x`` (x = 0) and ``sides`` (both ends of the slice).
    """
    surface, curves = flat_profile(occ, plate.width, plate.depth, plate.contact)
    occ.synchronize()
    names = {"symmetry_x": "axis"} | {n: n for n in ("contact", "free", "far", "bottom")}
    return Swept(
        regions={"all": [surface]},
        curves={name: [tag] for name, tag in curves.items()},
        slabs=(Slab("body", -plate.slice, 0.0, plate.elements, ("all",)),),
        faces={
            **{face: (SweptFace(0, "side", (curve,)),) for face, curve in names.items()},
            "sides": (SweptFace(0, "low", ("all",)), SweptFace(0, "high", ("all",))),
        },
        size=plate.size,
        fine=((plate.fine, away_from_line(plate.contact)),),
        growth=plate.growth,
        upright=True,
    )

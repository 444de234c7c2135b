"""Box aligned with x, y, z: block and plate of the smallest scene with friction."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .part import PartEntities, Slab, Swept, SweptFace, element_count, faces_where, flat_at


@dataclass(frozen=True, slots=True)
class Block:
    """Parameters of a box.

    Attributes:
        length: extent along x [m].
        width: extent along y [m].
        height: extent along z [m].
        z: height of the lower face [m].
        size: mesh size [m].
    """

    length: float = field(default=40e-3, metadata={"unit": "m"})
    width: float = field(default=20e-3, metadata={"unit": "m"})
    height: float = field(default=20e-3, metadata={"unit": "m"})
    z: float = field(default=0.0, metadata={"unit": "m", "sign": "any"})
    size: float = field(default=5e-3, metadata={"unit": "m"})


def thicknesses(block: Block) -> dict[str, tuple[str, ...]]:
    """Lengths that are thicknesses of layers."""
    return {"height": ("body",)}


def widths(block: Block) -> tuple[str, ...]:
    """Lengths that move nodes at right angles to z."""
    return "length", "width"


def sideways(block: Block, name: str, points: np.ndarray) -> np.ndarray:
    """Movement of points of the box along x and y per length: in proportion, shape (n, 2)."""
    return points[:, :2] * np.eye(2)[widths(block).index(name)] / getattr(block, name)


def build(occ: Any, block: Block) -> PartEntities:
    """Add a box centred about the z axis to the current gmsh model.

    Args:
        occ: gmsh's OpenCASCADE kernel.
        block: its parameters.

    Returns:
        Layer ``body``; faces ``bottom``, ``top`` and ``sides``.
    """
    corner = (-block.length / 2, -block.width / 2, block.z)
    body = [occ.addBox(*corner, block.length, block.width, block.height)]
    occ.synchronize()
    return PartEntities(
        volumes={"body": body},
        faces={
            "bottom": faces_where(body, flat_at(block.z)),
            "top": faces_where(body, flat_at(block.z + block.height)),
            "sides": faces_where(
                body, lambda low, high: bool(high[2] - low[2] > 0.5 * block.height)
            ),
        },
        sizes={"body": block.size},
    )


def sweep(occ: Any, block: Block) -> Swept:
    """Add the box's footprint to the current gmsh model, with the same names as ``build``.

    Args:
        occ: gmsh's OpenCASCADE kernel.
        block: its parameters.
    """
    import gmsh

    face = occ.addRectangle(-block.length / 2, -block.width / 2, 0, block.length, block.width)
    occ.synchronize()
    around = [tag for _, tag in gmsh.model.getBoundary([(2, face)], oriented=False)]
    n = element_count(block.height, block.size)
    return Swept(
        regions={"all": [face]},
        curves={"around": around},
        slabs=(Slab("body", block.z, block.z + block.height, n, ("all",)),),
        faces={
            "bottom": (SweptFace(0, "low", ("all",)),),
            "top": (SweptFace(0, "high", ("all",)),),
            "sides": (SweptFace(0, "side", ("around",)),),
        },
        size=block.size,
    )

"""Parts swept along z: a plane mesh of the footprint, lifted level by level.

Quadrilaterals become hexahedra; triangles become prisms, each cut into three tetrahedra along
diagonals that neighbours share.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from brake_fenicsx.arguments import Array, Ints

from .rawmesh import CORNERS, MIDDLES, RawMesh, orientation, turned, without_unused_nodes

# Nodes of a plane element -> its corners and order.
PLANE = {3: (3, 1), 6: (3, 2), 4: (4, 1), 9: (4, 2)}
# A prism of triangle 0 1 2 below and 3 4 5 above; every diagonal leaves the lower of two numbers.
_TETRAHEDRA = ((0, 1, 2, 5), (0, 1, 4, 5), (0, 3, 4, 5))
# Corners of a hexahedron as (corner of the quadrilateral, 0 below or 1 above).
_HEXAHEDRON = tuple((i, level) for level in (0, 1) for i in range(4))


@dataclass(frozen=True, slots=True)
class Footprint:
    """A plane mesh.

    Attributes:
        points: positions [m], shape (nodes, 2).
        cells: region name -> nodes of its triangles or quadrilaterals.
        lines: curve name -> nodes of its line elements.
    """

    points: Array
    cells: dict[str, Ints]
    lines: dict[str, Ints]


def sweep(plane: Footprint, swept: Any, part: str) -> RawMesh:
    """Lift a plane mesh.

    Args:
        plane: the footprint's mesh.
        swept: slabs and faces, see ``geometry.part.Swept``.
        part: name of the part.

    Returns:
        Hexahedra over quadrilaterals, tetrahedra over triangles.
    """
    levels = _levels(swept.slabs)
    n, (sides, order) = len(plane.points), PLANE[next(iter(plane.cells.values())).shape[1]]
    cells, tags, spans = [], [], []
    for slab in swept.slabs:
        flat = np.concatenate([plane.cells[r] for r in slab.regions])
        step = _steps(levels, slab, order)
        spans.append(step)
        for low in step[:-1:order]:
            lift = lifted(flat, n, int(low))
            cells.append(lift)
            tags.append(np.full(len(lift), 1 + swept.layers.index(slab.layer)))
    middles = 0.5 * (levels[1:] + levels[:-1])
    z = np.sort(np.concatenate([levels, middles])) if order == 2 else levels
    points = np.column_stack([np.tile(plane.points, (z.size, 1)), np.repeat(z, n)])
    facets, facet_tags = [], []
    for tag, places in enumerate(swept.faces.values(), 1):
        for place in places:
            found = _face(plane, place, spans[place.slab], n)
            facets.append(found)
            facet_tags.append(np.full(len(found), tag))
    x, shape = _placed(points, swept), "hexahedron" if sides == 4 else "tetrahedron"
    inner = np.concatenate(cells), np.concatenate(tags)
    outer = np.concatenate(facets), np.concatenate(facet_tags)
    layers = {f"{part}.{name}": i for i, name in enumerate(swept.layers, 1)}
    faces = {f"{part}.{name}": i for i, name in enumerate(swept.faces, 1)}
    mesh = RawMesh(x, shape, *inner, *outer, layers, faces)
    mesh = without_unused_nodes(mesh)
    return turned(mesh, orientation(mesh) < 0)


def _placed(points: Array, swept: Any) -> Array:
    """Points in the frame of the scene."""
    if swept.upright:
        return np.column_stack([points[:, 0], -points[:, 2], points[:, 1]])
    return points * np.array([1.0, 1.0, -1.0 if swept.below else 1.0])


def _levels(slabs: Sequence[Any]) -> Array:
    """Heights of all element boundaries, each once [m]."""
    z = np.sort(np.concatenate([np.linspace(s.low, s.high, s.elements + 1) for s in slabs]))
    tiny = 1e-9 * (z[-1] - z[0])
    return np.asarray(z[np.concatenate([[True], np.diff(z) > tiny])])


def _steps(levels: Array, slab: Any, order: int) -> Ints:
    """Numbers of a slab's levels, middles between them included for order 2."""
    first, last = (int(np.abs(levels - z).argmin()) for z in (slab.low, slab.high))
    return np.arange(order * first, order * last + 1)


def lifted(flat: Ints, n: int, low: int) -> Ints:
    """Cells over plane elements between level ``low`` and the next; a level has ``n`` nodes."""
    sides, order = PLANE[flat.shape[1]]
    if sides == 4:
        return _cells(flat, _HEXAHEDRON, "hexahedron", n, low)
    # Corners in the order of their numbers, so that neighbours choose the same diagonals.
    turn = np.argsort(flat[:, :3], axis=1)
    corner = np.take_along_axis(flat[:, :3], turn, axis=1)
    if order == 2:
        # Column of the middle between two corners.
        middle = np.array([[0, 3, 5], [3, 0, 4], [5, 4, 0]])[turn, turn[:, [1, 2, 0]]]
        corner = np.hstack([corner, np.take_along_axis(flat, middle, axis=1)])
    prism = [(i, level) for level in (0, 1) for i in range(3)]
    kinds = [tuple(prism[i] for i in four) for four in _TETRAHEDRA]
    return np.concatenate([_cells(corner, k, "tetrahedron", n, low) for k in kinds])


def _cells(flat: Ints, corners: Sequence[tuple[int, int]], shape: str, n: int, low: int) -> Ints:
    """Nodes of cells whose corners are (corner of the plane element, 0 below or 1 above)."""
    k, order = PLANE[flat.shape[1]]
    columns = []
    for group in [[i] for i in range(CORNERS[shape])] + [*MIDDLES[shape]] * (order == 2):
        plane = sorted({corners[i][0] for i in group})
        height = sum(corners[i][1] for i in group) * order // len(group)
        columns.append(flat[:, _plane_node(plane, k)] + (low + height) * n)
    return np.stack(columns, axis=1)


def _plane_node(corners: list[int], k: int) -> int:
    """Local node of a plane element in the middle of some corners."""
    if len(corners) == 1:
        return corners[0]
    if len(corners) > 2:
        return 2 * k
    a, b = corners
    return k + (a if b == a + 1 else k - 1)


def _face(plane: Footprint, place: Any, steps: Ints, n: int) -> Ints:
    """Corner nodes of the facets at one place."""
    sides, order = PLANE[next(iter(plane.cells.values())).shape[1]]
    if place.side != "side":
        level = int(steps[0] if place.side == "low" else steps[-1])
        flat = np.concatenate([plane.cells[r] for r in place.of])
        return np.asarray(flat[:, :sides] + level * n)
    lines = np.sort(np.concatenate([plane.lines[c] for c in place.of])[:, :2], axis=1)
    facets = []
    for low, high in pairwise(steps[::order]):
        (a, b), (c, d) = (lines + low * n).T, (lines + high * n).T
        cut = [[a, b, d, c]] if sides == 4 else [[a, b, d], [a, c, d]]
        facets += [np.column_stack(columns) for columns in cut]
    return np.concatenate(facets)

"""Parts swept along z: a plane mesh of the footprint, lifted level by level.

Quadrilaterals become hexahedra; triangles become prisms, each cut into three tetrahedra along
diagonals that neighbours share.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .rawmesh import CORNERS, EDGES, FACETS, RawMesh, turned, without_unused_nodes

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

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
        order: order of the geometry.
    """

    points: Array
    cells: dict[str, Ints]
    lines: dict[str, Ints]
    order: int


def footprint(model: Any, swept: Any, order: int) -> Footprint:
    """The plane mesh of the current gmsh model, by the names of a swept part.

    Args:
        model: ``gmsh.model``, meshed in two dimensions.
        swept: the part, see ``geometry.part.Swept``.
        order: order of the geometry.
    """
    tags, x, _ = model.mesh.getNodes()
    number = np.full(int(tags.max()) + 1, -1, dtype=np.int64)
    number[tags.astype(np.int64)] = np.arange(tags.size)

    def elements(dim: int, entities: Sequence[int]) -> Ints:
        found = []
        for entity in entities:
            kinds, _, nodes = model.mesh.getElements(dim, entity)
            if len(kinds) != 1:
                raise ValueError("triangles are left in a mesh of quadrilaterals")
            count = model.mesh.getElementProperties(kinds[0])[3]
            found.append(number[nodes[0].astype(np.int64)].reshape(-1, count))
        return np.concatenate(found)

    return Footprint(
        x.reshape(-1, 3)[:, :2],
        {name: elements(2, tags) for name, tags in swept.regions.items()},
        {name: elements(1, tags) for name, tags in swept.curves.items()},
        order,
    )


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
    n, order = len(plane.points), plane.order
    names = list(dict.fromkeys(slab.layer for slab in swept.slabs))
    cells, tags, spans = [], [], []
    for slab in swept.slabs:
        flat = np.concatenate([plane.cells[r] for r in slab.regions])
        step = _steps(levels, slab, order)
        spans.append(step)
        for low in step[:-1:order]:
            lift = lifted(flat, order, n, int(low))
            cells.append(lift)
            tags.append(np.full(len(lift), 1 + names.index(slab.layer)))
    z = _with_middles(levels) if order == 2 else levels
    points = np.column_stack([np.tile(plane.points, (z.size, 1)), np.repeat(z, n)])
    facets, facet_tags = [], []
    for tag, places in enumerate(swept.faces.values(), 1):
        for place in places:
            found = _face(plane, place, spans[place.slab], n)
            facets.append(found)
            facet_tags.append(np.full(len(found), tag))
    kind = "hexahedron" if _is_quadrilateral(flat, order) else "tetrahedron"
    mesh = RawMesh(
        _placed(points, swept), kind, np.concatenate(cells), np.concatenate(tags),
        np.concatenate(facets), np.concatenate(facet_tags),
        {f"{part}.{name}": i for i, name in enumerate(names, 1)},
        {f"{part}.{name}": i for i, name in enumerate(swept.faces, 1)},
    )  # fmt: skip
    mesh = without_unused_nodes(mesh)
    from .quality import orientation

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


def _with_middles(levels: Array) -> Array:
    z = np.empty(2 * levels.size - 1)
    z[::2], z[1::2] = levels, 0.5 * (levels[1:] + levels[:-1])
    return z


def _steps(levels: Array, slab: Any, order: int) -> Ints:
    """Numbers of a slab's levels, middles between them included for order 2."""
    first, last = (int(np.abs(levels - z).argmin()) for z in (slab.low, slab.high))
    return np.arange(order * first, order * last + 1)


def _is_quadrilateral(flat: Ints, order: int) -> bool:
    return bool(flat.shape[1] == (4 if order == 1 else 9))


def lifted(flat: Ints, order: int, n: int, low: int) -> Ints:
    """Cells over plane elements between level ``low`` and the next."""
    if _is_quadrilateral(flat, order):
        return _cells(flat, _HEXAHEDRON, "hexahedron", order, n, low)
    # Corners in the order of their numbers, so that neighbours choose the same diagonals.
    turn = np.argsort(flat[:, :3], axis=1)
    corner = np.take_along_axis(flat[:, :3], turn, axis=1)
    if order == 2:
        # Column of the middle between two corners.
        middle = np.array([[0, 3, 5], [3, 0, 4], [5, 4, 0]])[turn, turn[:, [1, 2, 0]]]
        corner = np.hstack([corner, np.take_along_axis(flat, middle, axis=1)])
    prism = [(i, level) for level in (0, 1) for i in range(3)]
    kinds = [tuple(prism[i] for i in four) for four in _TETRAHEDRA]
    return np.concatenate([_cells(corner, k, "tetrahedron", order, n, low) for k in kinds])


def _cells(
    flat: Ints, corners: Sequence[tuple[int, int]], shape: str, order: int, n: int, low: int
) -> Ints:
    """Nodes of cells whose corners are (corner of the plane element, 0 below or 1 above)."""
    k = 3 if shape == "tetrahedron" else 4
    sets: list[tuple[int, ...]] = [(i,) for i in range(CORNERS[shape])]
    if order == 2:
        sets += EDGES[shape]
        if shape == "hexahedron":
            sets += [*FACETS[shape], tuple(range(8))]
    columns = []
    for group in sets:
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
    if place.side != "side":
        level = int(steps[0] if place.side == "low" else steps[-1])
        flat = np.concatenate([plane.cells[r] for r in place.of])
        return np.asarray(flat[:, : _corner_count(flat, plane.order)] + level * n)
    lines = np.concatenate([plane.lines[c] for c in place.of])[:, :2]
    quads = _is_quadrilateral(next(iter(plane.cells.values())), plane.order)
    facets = []
    for low, high in pairwise(steps[:: plane.order]):
        p, q = (np.sort(lines, axis=1) + h * n for h in (low, high))
        if quads:
            facets.append(np.column_stack([p[:, 0], p[:, 1], q[:, 1], q[:, 0]]))
        else:
            facets += [
                np.column_stack([p[:, 0], p[:, 1], q[:, 1]]),
                np.column_stack([p[:, 0], q[:, 0], q[:, 1]]),
            ]
    return np.concatenate(facets)


def _corner_count(flat: Ints, order: int) -> int:
    return 4 if _is_quadrilateral(flat, order) else 3

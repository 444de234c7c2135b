"""Shells of a deck as one surface: its normals, and what no layer of solids can be made of."""

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from brake_fenicsx.arguments import Array, Ints
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.decks.abaqus_scope import find
from brake_fenicsx.meshing.filemesh import FileMesh, corners_of, listed
from brake_fenicsx.meshing.rawmesh import CORNERS, EDGES, FACETS, facet_keys

# Two shells that meet are at most this angle apart [rad]; rims and corners have 90 degrees.
FOLD = np.radians(110.0)
# A facet of a lifted surface has this share of the shell's area at least.
LEFT = 0.05
# Normals that differ by less than the root of this are one.
SAME = 1e-6


class ShellSection(NamedTuple):
    """A shell section.

    Attributes:
        group: set of its shells.
        layers: thickness, in the file's unit, and material of each layer, from SNEG to SPOS.
        offset: of the reference surface from the middle along the normal, in the file's unit.
        said: its place and first line, for messages.
    """

    group: str
    layers: list[tuple[float, str]]
    offset: float
    said: str

    @property
    def sets(self) -> list[str]:
        """Set of the cells of each layer."""
        if len(self.layers) == 1:
            return [self.group]
        return [f"{self.group}.{k}" for k in range(1, len(self.layers) + 1)]

    @property
    def levels(self) -> tuple[float, ...]:
        """Boundaries of the layers from the reference surface, 0 where one is near."""
        z = np.cumsum([0.0, *(t for t, _ in self.layers)])
        z -= 0.5 * z[-1] + self.offset
        return tuple(listed(np.where(np.abs(z) < 1e-9 * np.ptp(z), 0.0, z)))


class ShellSurface(NamedTuple):
    """All shells of the sections as triangles or quadrilaterals.

    Attributes:
        points: those of the file, and middles of edges and faces behind.
        flat: nodes of each facet in gmsh's order: corners, middles, and of quadrilaterals the
            centre; shape (facets, 6 or 9).
        section: number of the section of each.
        parts: key of a shell, by its corners -> its facets, two of a quadrilateral that is cut.
        start: key of a shell -> its first corner and the next, whose order tells SPOS from SNEG.
    """

    points: Array
    flat: Ints
    section: Ints
    parts: dict[int, list[int]]
    start: dict[int, tuple[int, int]]

    @property
    def corners(self) -> Ints:
        """Corner nodes of each facet."""
        return self.flat[:, : self.flat.shape[1] // 2]

    def place(self, node: int) -> str:
        """Where a node is, for messages."""
        return f"near ({', '.join(f'{v:.4g}' for v in self.points[node])})"


def shell_surface(found: FileMesh, sections: Sequence[ShellSection]) -> ShellSurface:
    """Shells of the sections, cut into triangles in a file of tetrahedra."""
    owner: dict[int, int] = {}
    for i, one in enumerate(sections):
        name = find(found.facet_groups, one.group)
        if name is None:
            raise SceneError(f"{one.said}: no shell of 3, 4, 6 or 8 nodes is in this set")
        owner |= dict.fromkeys(listed(facet_keys(found.facet_groups[name])), i)
    sides, points = CORNERS[found.shape] // 2 + (found.shape == "tetrahedron"), [found.points]
    curved = found.cells.shape[1] > CORNERS[found.shape]
    table, section = list[Ints](), list[int]()
    parts, start = defaultdict[int, list[int]](list), dict[int, tuple[int, int]]()
    for rows in found.shells.values():
        corner = np.array([*map(corners_of, rows)])
        n, every = corner.shape[1], listed(facet_keys(corner))
        own = [j for j, key in enumerate(every) if key in owner and key not in start]
        keys, rows = [every[j] for j in own], rows[own]
        if own and n < sides:
            raise SceneError(f"""{sections[owner[keys[0]]].said}: {len(own)} of its shells are
                triangles, while other elements have faces of 4 corners; mesh them as
                quadrilaterals""")
        second = curved and rows.shape[1] > n
        middle = rows[:, n:] if second else np.full((len(own), n), -1)
        centre = np.full(len(own), -1)
        if n == 4 and second:
            centre = sum(map(len, points)) + np.arange(len(own))
            points.append(_centres(found.points[rows]))
        whole = np.column_stack([rows[:, :n], middle, centre])
        cuts = [[0, 1, 2, 4, 5, 8], [0, 2, 3, 8, 6, 7]] if n > sides else [[*range(2 * sides)]]
        for cut in cuts:
            for j, key in enumerate(keys):
                parts[key].append(len(section) + j)
            section += [owner[key] for key in keys]
            table.append(whole[:, cut])
        start |= dict(zip(keys, map(tuple, listed(rows[:, :2])), strict=True))
    flat, x = np.concatenate(table), np.concatenate(points)
    return ShellSurface(*_complete(found, x, flat), np.array(section), parts, start)


def _complete(found: FileMesh, points: Array, flat: Ints) -> tuple[Array, Ints]:
    """Points and facets with the middle nodes that they do not have, -1, and centres."""
    n, base, theirs = flat.shape[1] // 2, len(points), np.zeros(0, np.int64)
    code = np.array([base, 1])
    mine = (np.sort(_edges(flat[:, :n]), axis=2) @ code).reshape(-1)
    first, edges = CORNERS[found.shape], np.array(EDGES[found.shape])
    if found.cells.shape[1] > first:
        theirs = (np.sort(found.cells[:, edges], axis=2) @ code).reshape(-1)
    every, number = np.unique(np.append(theirs, mine), return_inverse=True)
    middle, number = np.full(every.size, -1), number.reshape(-1)
    if theirs.size:
        # What shares an edge with a solid shares its middle node.
        own = found.cells[:, first : first + len(edges)]
        middle[number[: theirs.size]] = own.reshape(-1)
    number, given = number[theirs.size :], flat[:, n:].reshape(-1)
    middle[number[given >= 0]] = given[given >= 0]
    new = np.unique(number[middle[number] < 0])
    middle[new] = base + np.arange(new.size)
    ends = np.stack(np.divmod(every[new], base), axis=1)
    points = np.concatenate([points, points[ends].mean(axis=1)])
    flat = np.column_stack([flat[:, :n], middle[number].reshape(-1, n)])
    if n == 4:
        points, whole = np.append(points, _centres(points[flat]), axis=0), len(points)
        flat = np.column_stack([flat, whole + np.arange(len(flat))])
    return points, flat


def _centres(x: Array) -> Array:
    """Centres of quadrilaterals of 8 nodes."""
    return np.asarray(0.5 * x[:, 4:].sum(axis=1) - 0.25 * x[:, :4].sum(axis=1))


def _edges(corners: Ints) -> Ints:
    """Both ends of the edges of facets, in their order, shape (facets, edges, 2)."""
    return np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)


def check_edges(surface: ShellSurface, sections: Sequence[ShellSection]) -> None:
    """Refuse branches, normals that disagree, and layers that do not meet."""
    pairs = _edges(surface.corners)
    directed, which = pairs.reshape(-1, 2), np.repeat(surface.section, pairs.shape[1])
    for rows, most, said in (
        (np.sort(directed, axis=1), 2, "more than two shells meet at an edge; mesh this branch as"
         " solids"),
        (directed, 1, "the normals of two neighbours are opposed; reverse the nodes of one"),
    ):  # fmt: skip
        _, first, count = np.unique(rows, axis=0, return_index=True, return_counts=True)
        for at in first[count > most][:1]:
            raise SceneError(f"{sections[which[at]].said}: {surface.place(rows[at, 0])} {said}")
    kinds = [*dict.fromkeys(one.levels for one in sections)]
    kind = np.array([kinds.index(one.levels) for one in sections])
    last = np.full(len(surface.points), -1)
    for nodes in surface.corners.T:
        last[nodes] = surface.section
    other = kind[last[surface.corners]] != kind[surface.section][:, None]
    for facet, corner in np.argwhere(other)[:1]:
        node = surface.corners[facet, corner]
        a, b = sections[surface.section[facet]], sections[last[node]]
        raise SceneError(f"""{a.said}: {surface.place(node)} it meets {b.said}, of another thickness
            or offset; give both the same, or mesh one of them as solids""")


def shared_nodes(
    found: FileMesh, surface: ShellSurface, sections: Sequence[ShellSection]
) -> set[int]:
    """Nodes that shells share with solids, on whose outside the layers must lie."""
    corners, table = surface.corners, found.cells[:, np.array(FACETS[found.shape])]
    keys, cell, count = np.unique(
        facet_keys(table.reshape(-1, table.shape[2])), return_index=True, return_counts=True
    )
    own = facet_keys(corners)
    on = np.isin(own, keys[count == 1])
    shared = np.intersect1d(surface.flat, found.cells)
    stray = np.isin(corners, np.setdiff1d(shared, surface.flat[on])).any(axis=1)
    inside = np.isin(own, keys[count == 2])
    x = surface.points[corners]
    out = np.zeros(len(own))
    if on.any():
        behind = cell[np.searchsorted(keys, own[on])] // table.shape[1]
        away = x[on].mean(axis=1) - found.points[found.cells[behind]].mean(axis=1)
        out[on] = np.einsum("ij,ij->i", away, np.cross(x[on, 1] - x[on, 0], x[on, -1] - x[on, 0]))
    for i, one in enumerate(sections):
        z, mine = one.levels, surface.section == i
        right = np.where(out > 0, z[0] == 0.0, z[-1] == 0.0)
        side = "SNEG" if (out[mine & on] > 0).all() else "SPOS"
        for wrong, said in (
            (inside, "shells lie between two solids; separate these, or mesh the layer as solids"),
            (stray, "shells share nodes, but no whole face, with solids; tie them as a layer, or"
             " mesh them as solids"),
            (on & ~right, "the layer would lie within the solid that its nodes are on; write"
             f" OFFSET={side}"),
        ):  # fmt: skip
            for facet in np.flatnonzero(wrong & mine)[:1]:
                raise SceneError(f"{one.said}: {surface.place(corners[facet, 0])} {said}")
    return {*listed(shared)}


def _normals(x: Array) -> Array:
    """Normals at the corners of facets, of the size of their area [unit^2].

    Args:
        x: their nodes, middles of edges included, shape (facets, 6 or 9, 3).
    """
    n = x.shape[1] // 2
    corner, ahead = x[:, :n], x[:, n : 2 * n]
    after, before = np.roll(corner, -1, axis=1), np.roll(corner, 1, axis=1)
    along = 4 * ahead - 3 * corner - after
    back = 4 * np.roll(ahead, 1, axis=1) - 3 * corner - before
    return np.asarray(np.cross(along, back), dtype=np.float64)


def directions(surface: ShellSurface, sections: Sequence[ShellSection]) -> Array:
    """How far each node moves for a unit of thickness, shape (nodes, 3).

    Raises:
        SceneError: shells are folded too sharply for their thickness, or are flat.
    """
    flat = surface.flat
    whole = _normals(surface.points[flat])
    size = np.linalg.norm(whole, axis=2, keepdims=True)
    unit = whole / np.where(size > 0.0, size, 1.0)
    # A middle has the mean normal of both ends of its edge, and a centre that of all corners.
    every = [unit, unit + np.roll(unit, -1, axis=1), unit.sum(axis=1, keepdims=True)]
    normal = np.concatenate(every, axis=1)[:, : flat.shape[1]].reshape(-1, 3)
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), SAME)
    nodes = flat.reshape(-1)
    used, number = np.unique(nodes, return_inverse=True)
    A, b = np.zeros((used.size, 3, 3)), np.zeros((used.size, 3))
    np.add.at(A, number, normal[:, :, None] * normal[:, None, :])
    np.add.at(b, number, normal)
    d = np.zeros_like(surface.points)
    d[used] = np.einsum("ijk,ik->ij", np.linalg.pinv(A, SAME, hermitian=True), b)
    cosine = np.einsum("ij,ij->i", normal, d[nodes]) / np.linalg.norm(d[nodes], axis=1)
    sharp = np.flatnonzero(~(cosine > np.cos(0.5 * FOLD))) // flat.shape[1]
    for end in (0, -1):
        height = np.array([one.levels[end] for one in sections])[surface.section]
        x = surface.points[flat] + height[:, None, None] * d[flat]
        left = np.einsum("ijk,ijk->ij", _normals(x), unit) / np.where(size > 0, size, 1.0)[..., 0]
        sharp = np.append(sharp, np.flatnonzero((left < LEFT).any(axis=1)))
    for facet in sharp[:1]:
        raise SceneError(f"""{sections[surface.section[facet]].said}:
            {surface.place(flat[facet, 0])} shells are folded too sharply for their thickness, or
            have no area; mesh them as solids""")
    return d

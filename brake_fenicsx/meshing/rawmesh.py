"""A mesh as plain arrays, on one process, and the shape of its cells.

Builders and mesh files both end here; orientation, quality and splitting are checked here: how flat
cells are, how skew, and whether they are turned inside out. Nodes of a cell stand in gmsh's order:
corners, middles of edges, and for 27-node hexahedra middles of faces and the centre. What a mesh
file holds beside its mesh is named, so that nothing is lost.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from brake_fenicsx.arguments import Array, Index, Ints, Mask

CORNERS = {"tetrahedron": 4, "hexahedron": 8}
EDGES = {
    "tetrahedron": ((0, 1), (1, 2), (0, 2), (0, 3), (2, 3), (1, 3)),
    "hexahedron": (
        (0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3),
        (2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7),
    ),
}  # fmt: skip
FACETS = {
    "tetrahedron": ((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2)),
    "hexahedron": (
        (0, 1, 2, 3), (0, 1, 5, 4), (0, 3, 7, 4), (1, 2, 6, 5), (2, 3, 7, 6), (4, 5, 6, 7),
    ),
}  # fmt: skip
# Corners around each node that follows those of a second-order cell -> place of the node.
MIDDLES = {
    shape: {frozenset(some): CORNERS[shape] + k for k, some in enumerate(sets)}
    for shape, sets in {
        "tetrahedron": EDGES["tetrahedron"],
        "hexahedron": (*EDGES["hexahedron"], *FACETS["hexahedron"], range(8)),
    }.items()
}
# Corner i of the reflected cell is this corner of the cell.
_REFLECTED = {"tetrahedron": (1, 0, 2, 3), "hexahedron": (4, 5, 6, 7, 0, 1, 2, 3)}

# Neighbours of each corner of a hexahedron, right-handed.
_NEIGHBOURS = np.array(
    [[1, 3, 4], [2, 0, 5], [3, 1, 6], [0, 2, 7], [7, 5, 0], [4, 6, 1], [5, 7, 2], [6, 4, 3]]
)
# Corners of the reference cells, in [0, 1]^3.
_CORNERS = {
    "tetrahedron": np.vstack([np.zeros(3), np.eye(3)]),
    "hexahedron": np.array(
        [[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    ),
}


class Stated(NamedTuple):
    """A joint, support or load of a deck.

    Attributes:
        section: of a scene, in which it belongs.
        said: what it is.
        faces: faces of the scene that lie on each of its surfaces.
    """

    section: str
    said: str
    faces: tuple[frozenset[str], ...]


@dataclass(frozen=True, slots=True)
class Unread:
    """What a mesh file holds beside its mesh.

    Attributes:
        changing: lines on elements and keywords that are not read, one for each file.
        stated: what `init` would write, with the file.
    """

    changing: tuple[str, ...] = ()
    stated: tuple[tuple[str, Stated], ...] = ()


@dataclass(frozen=True, slots=True)
class RawMesh:
    """Cells of one kind with named layers and faces.

    Attributes:
        points: positions [m], shape (nodes, 3).
        shape: "tetrahedron" or "hexahedron".
        cells: nodes of each cell, shape (cells, 4, 10, 8 or 27).
        cell_tag: tag of each cell, by ``layers``.
        facets: corner nodes of each named facet, shape (facets, 3 or 4).
        facet_tag: tag of each facet, by ``faces``.
        layers: "part.layer" -> tag.
        faces: "part.face" -> tag.
        unread: what its file holds beside, which is not read.
    """

    points: Array
    shape: str
    cells: Ints
    cell_tag: Ints
    facets: Ints
    facet_tag: Ints
    layers: dict[str, int]
    faces: dict[str, int]
    unread: Unread = field(default_factory=Unread)

    @property
    def order(self) -> int:
        """Order of the geometry: 1 or 2."""
        return 1 if self.cells.shape[1] == CORNERS[self.shape] else 2

    @property
    def corners(self) -> Ints:
        """Corner nodes of each cell."""
        return self.cells[:, : CORNERS[self.shape]]

    def part(self, name: str) -> Mask:
        """Which cells belong to a part."""
        tags = [tag for layer, tag in self.layers.items() if layer.partition(".")[0] == name]
        return np.isin(self.cell_tag, tags)

    def parts(self) -> list[str]:
        """Names of the parts, in the order of their layers."""
        return list(dict.fromkeys(layer.partition(".")[0] for layer in self.layers))


def permuted(shape: str, order: int, corner: Sequence[int]) -> Ints:
    """Positions of a cell's nodes once its corners are permuted.

    Args:
        shape: kind of cell.
        order: order of the geometry.
        corner: new corner i is old corner ``corner[i]``.

    Returns:
        Indices p: new node i is old node p[i].
    """
    middle = MIDDLES[shape] if order == 2 else {}
    return np.array([*corner, *(middle[frozenset(corner[i] for i in some)] for some in middle)])


def turned(mesh: RawMesh, which: Mask) -> RawMesh:
    """The mesh with some cells' nodes in the opposite orientation; the bodies stay as they are."""
    cells = mesh.cells.copy()
    cells[which] = cells[which][:, permuted(mesh.shape, mesh.order, _REFLECTED[mesh.shape])]
    return replace(mesh, cells=cells)


def with_mirror_image(mesh: RawMesh) -> RawMesh:
    """The mesh and its exact mirror image at z = 0, under the same names."""
    image = turned(mesh, np.ones(len(mesh.cells), dtype=bool))
    image = replace(image, points=mesh.points * np.array([1.0, 1.0, -1.0]))
    return joined([mesh, image])


def joined(meshes: Sequence[RawMesh]) -> RawMesh:
    """Several meshes as one, sharing no node; equal names become one layer or face.

    Args:
        meshes: meshes of the same kind and order.

    Returns:
        The nodes, cells and facets of all, in this order.
    """
    layers: dict[str, int] = {}
    faces: dict[str, int] = {}
    cells, facets, cell_tag, facet_tag = [], [], [], []
    start = 0
    for mesh in meshes:
        cells.append(mesh.cells + start)
        facets.append(mesh.facets + start)
        cell_tag.append(_retagged(mesh.cell_tag, mesh.layers, layers))
        facet_tag.append(_retagged(mesh.facet_tag, mesh.faces, faces))
        start += len(mesh.points)
    x, inner = np.concatenate([m.points for m in meshes]), (cells, cell_tag, facets, facet_tag)
    a, b, c, d = map(np.concatenate, inner)
    unread = (sum((getattr(m.unread, f.name) for m in meshes), ()) for f in fields(Unread))
    return RawMesh(x, meshes[0].shape, a, b, c, d, layers, faces, Unread(*unread))


def _retagged(tag: Ints, names: dict[str, int], table: dict[str, int]) -> Ints:
    """Tags of one mesh in a common table, which grows."""
    new = np.zeros(max(names.values(), default=0) + 1, dtype=np.int64)
    for name, old in names.items():
        new[old] = table.setdefault(name, len(table) + 1)
    return np.asarray(new[tag])


def without_unused_nodes(mesh: RawMesh) -> RawMesh:
    """The mesh without nodes of no cell; the order of the rest is kept."""
    used = np.zeros(len(mesh.points), dtype=bool)
    used[mesh.cells] = True
    number = np.cumsum(used) - 1
    return replace(
        mesh, points=mesh.points[used], cells=number[mesh.cells], facets=number[mesh.facets]
    )


def body_of_points(cells: Ints, size: int) -> Index:
    """Number of the body of each point: cells that share a point belong together.

    Args:
        cells: points of each cell, shape (cells, n).
        size: how many points there are.
    """
    first = np.repeat(cells[:, 0], cells.shape[1])
    links = sp.coo_matrix((np.ones(first.size), (first, cells.ravel())), (size, size))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.intp)


def facet_keys(corners: Ints) -> NDArray[np.uint64]:
    """One number for each set of corner nodes, shape (..., 3 or 4) to (...).

    Three corners name a facet, of a quadrilateral too. Up to 2.6 million nodes fit.

    Raises:
        ValueError: there are more nodes.
    """
    base = np.uint64(2_642_245)
    if corners.size and corners.max() >= base:
        raise ValueError(f"a mesh may have {base} nodes at most")
    c = np.sort(corners, axis=-1).astype(np.uint64)
    return np.asarray((c[..., 0] * base + c[..., 1]) * base + c[..., 2])


def cell_facets(mesh: RawMesh) -> Ints:
    """Corner nodes of every facet of the cells, shape (cells, facets of a cell, corners)."""
    return np.asarray(mesh.cells[:, np.array(FACETS[mesh.shape])])


def boundary(mesh: RawMesh, part: str) -> tuple[Ints, Ints]:
    """Corner nodes of a part's boundary facets, shape (facets, corners), and the cell of each."""
    own = np.flatnonzero(mesh.part(part))
    facets = mesh.cells[own][:, np.array(FACETS[mesh.shape])]
    cells, facets = np.repeat(own, facets.shape[1]), facets.reshape(-1, facets.shape[2])
    _, first, count = np.unique(facet_keys(facets), return_index=True, return_counts=True)
    outside = np.sort(first[count == 1])
    return facets[outside], cells[outside]


def exterior_facets(mesh: RawMesh, part: str) -> Ints:
    """Corner nodes of a part's boundary facets, shape (facets, corners)."""
    return boundary(mesh, part)[0]


def facet_nodes(mesh: RawMesh) -> Ints:
    """All nodes of the named facets in gmsh's order: corners, middles of edges, centre.

    Raises:
        ValueError: a named facet belongs to no cell.
    """
    if mesh.order == 1:
        return mesh.facets
    all_facets = cell_facets(mesh)
    per_cell = all_facets.shape[1]
    keys = facet_keys(all_facets).reshape(-1)
    order = np.argsort(keys)
    at = np.searchsorted(keys, facet_keys(mesh.facets), sorter=order)
    found = order[np.minimum(at, keys.size - 1)]
    if np.any(keys[found] != facet_keys(mesh.facets)):
        raise ValueError("a named facet belongs to no cell")
    table = np.array([facet_nodes_of_cell(mesh.shape, f) for f in FACETS[mesh.shape]])
    return np.asarray(mesh.cells[(found // per_cell)[:, None], table[found % per_cell]])


def facet_nodes_of_cell(shape: str, facet: Sequence[int]) -> list[int]:
    """Local nodes of a facet of a second-order cell: corners, middles of edges, centre."""
    pairs = zip(facet, (*facet[1:], facet[0]), strict=True)
    centre = (facet,) if shape == "hexahedron" else ()
    return [*facet, *(MIDDLES[shape][frozenset(some)] for some in (*pairs, *centre))]


@dataclass(frozen=True, slots=True)
class Quality:
    """Worst cells of a mesh.

    Attributes:
        worst: the smallest measure: 3 r / R of tetrahedra (inscribed to circumscribed radius, 1 if
            regular), scaled Jacobian of hexahedra (1 for a box).
        cell: number of that cell.
        dihedral: smallest angle between two faces of a cell [rad].
        distortion: smallest Jacobian inside a curved cell, relative to the cell's largest; 1 where
            all cells are straight-sided.
    """

    worst: float
    cell: int
    dihedral: float
    distortion: float = 1.0


def quality(mesh: RawMesh) -> Quality:
    """Measures of a mesh; cells must be oriented, see ``orientation``."""
    x = mesh.points[mesh.corners]
    if mesh.shape == "tetrahedron":
        measure, angle = radius_ratio(x), dihedral(x)
    else:
        measure = corner_jacobians(x).min(axis=1)
        three = x[:, np.concatenate([np.arange(8)[:, None], _NEIGHBOURS], axis=1)]
        angle = dihedral(three.reshape(-1, 4, 3), at_first=True)
    worst = int(np.argmin(measure))
    distortion = 1.0
    if mesh.order == 2:
        J = jacobians(mesh)
        distortion = float((J.min(axis=1) / np.abs(J).max(axis=1)).min())
    return Quality(float(measure[worst]), worst, float(angle.min()), distortion)


def orientation(mesh: RawMesh) -> Ints:
    """+1 for cells of positive volume, -1 for cells turned as a whole, 0 for twisted or flat ones.

    Returns:
        Shape (cells,).
    """
    x = mesh.points[mesh.corners]
    if mesh.shape == "tetrahedron":
        # Of the three edges at the first corner.
        size = np.prod(np.linalg.norm(x[:, 1:4] - x[:, :1], axis=2), axis=1)
        j = _volume6(x)[:, None] / np.where(size > 0, size, 1.0)[:, None]
    else:
        j = corner_jacobians(x)
    tiny = 1e-10
    return np.where((j > tiny).all(axis=1), 1, np.where((j < -tiny).all(axis=1), -1, 0))


def _volume6(x: Array) -> Array:
    a, b, c = (x[:, i] - x[:, 0] for i in (1, 2, 3))
    return np.asarray(np.einsum("ij,ij->i", a, np.cross(b, c)))


def radius_ratio(x: Array) -> Array:
    """3 r / R of tetrahedra: 1 if regular, 0 if flat.

    Args:
        x: corners [m], shape (cells, 4, 3).
    """
    a, b, c = (x[:, i] - x[:, 0] for i in (1, 2, 3))
    volume6 = np.abs(_volume6(x))
    area = 0.5 * sum(
        np.linalg.norm(np.cross(p, q), axis=1) for p, q in ((a, b), (b, c), (c, a), (b - a, c - a))
    )
    top = (
        np.cross(b, c) * np.sum(a * a, axis=1)[:, None]
        + np.cross(c, a) * np.sum(b * b, axis=1)[:, None]
        + np.cross(a, b) * np.sum(c * c, axis=1)[:, None]
    )
    # r = V6 / (2 A), R = |top| / (2 V6).
    return np.asarray(3 * volume6**2 / (area * np.linalg.norm(top, axis=1)))


def dihedral(x: Array, at_first: bool = False) -> Array:
    """Smallest angle [rad] between two faces of each tetrahedron.

    Args:
        x: corners [m], shape (cells, 4, 3).
        at_first: look only at the three faces that meet at the first corner.

    Returns:
        Shape (cells,).
    """
    faces = ((0, 1, 2), (0, 2, 3), (0, 3, 1)) + (() if at_first else ((1, 3, 2),))
    n = np.stack([np.cross(x[:, b] - x[:, a], x[:, c] - x[:, a]) for a, b, c in faces], axis=1)
    n /= np.maximum(np.linalg.norm(n, axis=2), 1e-300)[:, :, None]
    i, j = np.triu_indices(len(faces), 1)
    cos = -np.einsum("cki,cki->ck", n[:, i], n[:, j])
    return np.asarray(np.arccos(np.clip(cos, -1, 1)).min(axis=1))


def corner_jacobians(x: Array) -> Array:
    """Scaled Jacobians of hexahedra at their corners.

    Args:
        x: corners [m], shape (cells, 8, 3).

    Returns:
        Triple products of the unit edges, shape (cells, 8).
    """
    e = x[:, _NEIGHBOURS] - x[:, :, None]
    e = e / np.maximum(np.linalg.norm(e, axis=3), 1e-300)[..., None]
    return np.asarray(np.einsum("cki,cki->ck", e[:, :, 0], np.cross(e[:, :, 1], e[:, :, 2])))


def jacobians(mesh: RawMesh) -> Array:
    """Jacobian determinants [m^3] of second-order cells at their nodes, shape (cells, nodes)."""
    x = mesh.points[mesh.cells]
    return np.asarray(np.linalg.det(np.einsum("cni,pnj->cpij", x, _gradients(mesh.shape))))


def determinants(mesh: RawMesh) -> Array:
    """Jacobian determinants at the nodes of second-order cells, at the corners of others [m^3].

    Up to a factor for each kind of cell; shape (cells, points).
    """
    if mesh.order == 2:
        return jacobians(mesh)
    x = mesh.points[mesh.corners]
    if mesh.shape == "tetrahedron":
        return _volume6(x)[:, None]
    e = x[:, _NEIGHBOURS] - x[:, :, None]
    return np.asarray(np.einsum("cki,cki->ck", e[:, :, 0], np.cross(e[:, :, 1], e[:, :, 2])))


def volumes(mesh: RawMesh) -> Array:
    """Volumes of the cells [m^3], shape (cells,); of curved ones by a rule of third order."""
    x = mesh.points[mesh.corners]
    if mesh.shape == "tetrahedron":
        if mesh.order == 1:
            return _volume6(x) / 6
        # Integrals of the ten shape functions.
        return np.asarray(jacobians(mesh) @ np.repeat([-1 / 120, 1 / 30], [4, 6]))
    if mesh.order == 1:
        middles = [x[:, [*some]].mean(axis=1, keepdims=True) for some in MIDDLES[mesh.shape]]
        x = np.concatenate([x, *middles], axis=1)
        J = np.linalg.det(np.einsum("cni,pnj->cpij", x, _gradients(mesh.shape)))
    else:
        J = jacobians(mesh)
    # Simpson's rule along each direction.
    return np.asarray(J @ (np.repeat([1, 4, 16, 64], [8, 12, 6, 1]) / 216))


def _gradients(shape: str) -> Array:
    """Gradients of the second-order shape functions at their nodes, shape (node, function, 3)."""
    corner = _CORNERS[shape]
    at = np.vstack([corner, *(corner[[*some]].mean(axis=0) for some in MIDDLES[shape])])
    most = 2 if shape == "tetrahedron" else 6
    powers = np.array([p for p in product(range(3), repeat=3) if sum(p) <= most])
    value = np.prod(at[:, None] ** powers, axis=2)
    lower = np.maximum(powers - np.eye(3, dtype=int)[:, None], 0)
    slope = powers.T[:, None] * np.prod(at[:, None] ** lower[:, None], axis=3)
    return np.asarray(np.einsum("kpm,mf->pfk", slope, np.linalg.inv(value)))

"""A named face of the mesh: facets with the nodes of the displacement, and where normals meet it.

The order of the facets and of their corners comes from the mesh generator's node numbers, so that
nothing depends on how DOLFINx numbers them. Facets are isoparametric in the displacement's nodes,
which holds geometries of the same or of a lower degree exactly.

Reference facets have shape functions of degree one and two. Nodes: corners in cyclic order, then
(degree two) middles of edges, then the centre of a quadrilateral. A triangle's edge a lies opposite
to corner a, a quadrilateral's runs from a on. Reference coordinates (x, y): corners (0,0), (1,0),
(0,1) or (0,0), (1,0), (1,1), (0,1).

The ray along a normal meets facets of degree two exactly.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from brake_fenicsx import compat
from brake_fenicsx.arguments import Array, Index, Ints, Mask
from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.meshing.brake_mesh import Mesh
from brake_fenicsx.meshing.rawmesh import body_of_points

from .elasticity import FreeDofs, face_tag

# Reference coordinates of a point inside a facet, up to this.
EDGE = 1e-8


@dataclass(frozen=True, slots=True)
class FacetElement:
    """Lagrange facet.

    Attributes:
        corners: 3 or 4.
        degree: 1 or 2.
    """

    corners: int
    degree: int

    @property
    def nodes(self) -> Array:
        """Reference positions of the nodes, shape (nodes, 2)."""
        if self.corners == 3:
            corner = np.array([[0.0, 0], [1, 0], [0, 1]])
            middle = np.array([[0.5, 0.5], [0, 0.5], [0.5, 0]])
        else:
            corner = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
            middle = np.array([[0.5, 0], [1, 0.5], [0.5, 1], [0, 0.5], [0.5, 0.5]])
        return corner if self.degree == 1 else np.vstack([corner, middle])

    @property
    def triangles(self) -> list[tuple[int, int, int]]:
        """Corners of the triangles that a facet is cut into."""
        return [(0, 1, 2)] if self.corners == 3 else [(0, 1, 2), (0, 2, 3)]

    @property
    def tributary(self) -> Array:
        """Share of each node in the area, the facet halved along every edge, shape (nodes,)."""
        if self.corners == 3:
            share = [1 / 3] * 3 if self.degree == 1 else [1 / 12] * 3 + [1 / 4] * 3
        else:
            share = [1 / 4] * 4 if self.degree == 1 else [1 / 16] * 4 + [1 / 8] * 4 + [1 / 4]
        return np.array(share)

    def shape(self, x: Array) -> Array:
        """Shape functions at reference points x, shape (..., 2); returns (..., nodes)."""
        return self._values(x)[0]

    def gradient(self, x: Array) -> Array:
        """Derivatives of the shape functions, shape (..., nodes, 2)."""
        return self._values(x)[1]

    def outside(self, x: Array) -> Array:
        """How far reference points lie outside, 0 inside; shape (..., 2) to (...)."""
        lowest = np.minimum(x[..., 0], x[..., 1])
        if self.corners == 3:
            lowest = np.minimum(lowest, 1 - x[..., 0] - x[..., 1])
        else:
            lowest = np.minimum(lowest, 1 - np.maximum(x[..., 0], x[..., 1]))
        return np.maximum(-lowest, 0.0)

    def _values(self, x: Array) -> tuple[Array, Array]:
        return self._triangle(x) if self.corners == 3 else self._quadrilateral(x)

    def _triangle(self, x: Array) -> tuple[Array, Array]:
        L = np.stack([1 - x[..., 0] - x[..., 1], x[..., 0], x[..., 1]], axis=-1)
        dL = np.array([[-1.0, -1.0], [1, 0], [0, 1]])
        if self.degree == 1:
            return L, np.broadcast_to(dL, (*x.shape[:-1], 3, 2))
        a, b = np.array([1, 0, 0]), np.array([2, 2, 1])
        value = np.concatenate([L * (2 * L - 1), 4 * L[..., a] * L[..., b]], axis=-1)
        corner = (4 * L - 1)[..., None] * dL
        edge = 4 * (L[..., a, None] * dL[b] + L[..., b, None] * dL[a])
        return value, np.concatenate([corner, edge], axis=-2)

    def _quadrilateral(self, x: Array) -> tuple[Array, Array]:
        f, df = zip(*(_line(x[..., c], self.degree) for c in (0, 1)), strict=True)
        place = np.rint(self.degree * self.nodes).astype(int)
        i, j = place[:, 0], place[:, 1]
        value = f[0][..., i] * f[1][..., j]
        slope = np.stack([df[0][..., i] * f[1][..., j], f[0][..., i] * df[1][..., j]], axis=-1)
        return value, slope


def _line(t: Array, degree: int) -> tuple[Array, Array]:
    """Lagrange functions on [0, 1] with equal spacing, and their derivatives; shape (..., n)."""
    one = np.ones_like(t)
    if degree == 1:
        return np.stack([1 - t, t], axis=-1), np.stack([-one, one], axis=-1)
    value = np.stack([(1 - t) * (1 - 2 * t), 4 * t * (1 - t), t * (2 * t - 1)], axis=-1)
    return value, np.stack([4 * t - 3, 4 - 8 * t, 4 * t - 1], axis=-1)


@dataclass(frozen=True, slots=True)
class Face:
    """Facets with the nodes of the displacement.

    Attributes:
        element: the reference facet.
        nodes: node positions [m], shape (facets, nodes, 3).
        normal: outward unit normals of the planes through the corners, shape (facets, 3).
        turn: +1 where the cross product of the reference directions points outward, else -1.
        columns: free number of each dof, -1 where held, shape (facets, nodes, 3).
        number: number of each node in the mesh, shape (facets, nodes).
        straight: whether the facet is plane with straight edges, shape (facets,).
    """

    element: FacetElement
    nodes: Array
    normal: Array
    turn: Array
    columns: Ints
    number: Ints
    straight: Mask

    @property
    def corners(self) -> Array:
        """Corners [m], shape (facets, corners, 3)."""
        return self.nodes[:, : self.element.corners]

    @property
    def centre(self) -> Array:
        """Means of the corners [m], shape (facets, 3)."""
        return np.asarray(self.corners.mean(axis=1))

    @property
    def radius(self) -> Array:
        """Largest distance of a node from the centre [m], shape (facets,)."""
        away = self.nodes - self.centre[:, None]
        return np.asarray(np.linalg.norm(away, axis=2).max(axis=1))

    def surface(self, facet: Ints, x: Array) -> tuple[Array, Array, Array]:
        """Positions, outward unit normals and area ratios at reference points of some facets.

        Args:
            facet: facets, shape (n,).
            x: reference points, shape (n, points, 2).

        Returns:
            Positions [m] and normals, shape (n, points, 3), and area per reference area [m^2].
        """
        position = np.einsum("fqa,fac->fqc", self.element.shape(x), self.nodes[facet])
        tangent = np.einsum("fqad,fac->fqdc", self.element.gradient(x), self.nodes[facet])
        cross = np.cross(tangent[:, :, 0], tangent[:, :, 1]) * self.turn[facet][:, None, None]
        ratio = np.linalg.norm(cross, axis=-1)
        return position, cross / ratio[..., None], ratio

    def everywhere(self, x: Array) -> tuple[Array, Array, Array]:
        """`surface` of all facets at the same local points, shape (points, 2)."""
        every = np.arange(len(self.nodes))
        return self.surface(every, np.broadcast_to(x, (every.size, *x.shape)))


def gather_face(mesh: Mesh, free: FreeDofs, face: str) -> Face:
    """Collect a named face.

    Args:
        mesh: the tagged mesh.
        free: numbering of the free dofs.
        face: name of the face.

    Returns:
        The face.
    """
    element = FacetElement(
        3 if compat.cell_name(mesh.domain) == "tetrahedron" else 4, compat.degree(free.V)
    )
    key, corners, inside, x, columns, number = _facets(mesh, free, face_tag(mesh, face, "contact"))
    order = np.lexsort(np.sort(key, axis=1).T[::-1])
    key, corners, inside = key[order], corners[order], inside[order]
    x, columns, number = x[order], columns[order], number[order]
    corners = np.take_along_axis(corners, _cyclic(key)[:, :, None], axis=1)
    place = _match(element, corners, x)
    x = np.take_along_axis(x, place[:, :, None], axis=1)
    columns = np.take_along_axis(columns, place[:, :, None], axis=1)
    number = np.take_along_axis(number, place, axis=1)
    ends = (corners[:, 1] - corners[:, 0], corners[:, -1] - corners[:, 0])
    if element.corners == 4:
        ends = (corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    cross = np.cross(*ends)
    length = np.linalg.norm(cross, axis=1)
    inward = np.einsum("ij,ij->i", cross, inside - corners.mean(axis=1)) > 0
    turn = np.where(inward, -1.0, 1.0)
    normal = turn[:, None] * cross / length[:, None]
    # Of the generator's corners alone where they say all: free of round-off.
    flat = np.einsum("na,fac->fnc", FacetElement(element.corners, 1).shape(element.nodes), corners)
    straight = _straight(flat - x, corners, normal)
    x = np.where(straight[:, None, None], flat, x)
    return Face(element, x, normal, turn, columns, number, straight)


def body_of_nodes(V: Any) -> Index:
    """Number of the body of each node, by the cells alone: joints join no bodies here.

    Args:
        V: vector function space of the displacement.
    """
    topology, size = V.mesh.topology, V.dofmap.index_map.size_local
    node = compat.cell_dofs(V, np.arange(topology.index_map(topology.dim).size_local))
    return body_of_points(node, size)


def faces_of_bodies(free: FreeDofs, face: Face) -> list[Face]:
    """The parts of a face that lie on one body each."""
    body = body_of_nodes(free.V)[face.number[:, 0]]
    names = ("nodes", "normal", "turn", "columns", "number", "straight")
    return [
        replace(face, **{name: getattr(face, name)[body == one] for name in names})
        for one in np.unique(body)
    ]


def _cyclic(key: Ints) -> Ints:
    """Cyclic order that starts at the smallest number and goes on to its smaller neighbour."""
    corners = key.shape[1]
    first = np.argmin(key, axis=1)[:, None]
    onward = (first + np.arange(corners)) % corners
    back = (first - np.arange(corners)) % corners
    following = np.take_along_axis(key, onward[:, [1, -1]], axis=1)
    return np.where(following[:, :1] < following[:, 1:], onward, back)


def _match(element: FacetElement, corners: Array, x: Array) -> Ints:
    """Which of the given nodes stands at each place of the reference facet."""
    linear = FacetElement(element.corners, 1)
    expected = np.einsum("na,fac->fnc", linear.shape(element.nodes), corners)
    distance = np.linalg.norm(expected[:, :, None] - x[:, None], axis=3)
    place: Ints = np.asarray(distance.argmin(axis=2))
    if np.any(np.sort(place, axis=1) != np.arange(len(element.nodes))):
        raise InaccurateResult("contact: a facet is too distorted to tell its nodes apart; refine")
    return place


def _straight(bent: Array, corners: Array, normal: Array) -> Mask:
    """Whether facets are plane with straight edges, to 1e-9 of their size."""
    size = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
    height = np.einsum("fac,fc->fa", corners - corners[:, :1], normal)
    away = np.maximum(np.linalg.norm(bent, axis=2).max(axis=1), np.abs(height).max(axis=1))
    return np.asarray(away < 1e-9 * size)


def _facets(mesh: Mesh, free: FreeDofs, tag: int) -> tuple[Ints, Array, Array, Array, Ints, Ints]:
    """Facets of a tag.

    Returns:
        Node numbers of the generator and corners, middle of the cell, and of each displacement
        node the position, the dof columns and the number.
    """
    domain = mesh.domain
    topology, dim = domain.topology, domain.topology.dim
    topology.create_connectivity(dim - 1, dim)
    topology.create_connectivity(dim, dim - 1)
    to_cell, to_facet = topology.connectivity(dim - 1, dim), topology.connectivity(dim, dim - 1)
    facets = mesh.facet_tags.find(tag)
    nodes, x = compat.geometry_dofs(domain), domain.geometry.x
    generator = np.asarray(domain.geometry.input_global_indices)
    columns, position = free.column.reshape(-1, 3), free.V.tabulate_dof_coordinates()
    layout = free.V.dofmap.dof_layout
    # Corners of a quadrilateral come in tensor order.
    ends = [f if len(f) == 3 else [f[0], f[1], f[3], f[2]] for f in compat.facet_vertices(domain)]
    closure = np.array([layout.entity_closure_dofs(dim - 1, i) for i in range(len(ends))])
    cells = np.array([to_cell.links(f)[0] for f in facets], dtype=np.int64)
    place = np.array(
        [np.flatnonzero(to_facet.links(c) == f)[0] for c, f in zip(cells, facets, strict=True)],
        dtype=np.int64,
    )
    corner = nodes[cells[:, None], np.array(ends)[place]]
    every = compat.cell_dofs(free.V, cells)
    dofs = np.take_along_axis(every, closure[place], axis=1)
    inside = x[nodes[cells]].mean(axis=1)
    numbers = dofs.astype(np.int64)
    return generator[corner], x[corner], inside, position[dofs], columns[dofs], numbers


def directions_across(n: Array) -> Array:
    """Unit vectors s and n x s perpendicular to each n, shape (..., 3) to (..., 2, 3)."""
    axis = np.eye(3)[np.argmin(np.abs(n), axis=-1)]
    first = np.cross(n, axis)
    first /= np.linalg.norm(first, axis=-1)[..., None]
    return np.stack([first, np.cross(n, first)], axis=-2)


def project(face: Face, facet: Ints, x: Array, n: Array, start: Array) -> tuple[Array, Array]:
    """Reference points at which rays meet given facets, by Newton's iteration.

    Args:
        face: the face.
        facet: a facet for each row, shape (rows,).
        x: origins of the rays [m], shape (rows, points, 3).
        n: unit directions, same shape.
        start: first guess, shape (rows, points, 2).

    Returns:
        Reference points, shape (rows, points, 2), which may lie outside the facet, and distances
        along n [m], shape (rows, points).
    """
    across = directions_across(n)
    nodes, local = face.nodes[facet], start.copy()
    for _ in range(30):
        away = np.einsum("fqa,fac->fqc", face.element.shape(local), nodes) - x
        tangent = np.einsum("fqad,fac->fqcd", face.element.gradient(local), nodes)
        J, r = across @ tangent, np.einsum("fqkc,fqc->fqk", across, away)
        det = J[..., 0, 0] * J[..., 1, 1] - J[..., 0, 1] * J[..., 1, 0]
        det = np.where(det == 0.0, np.inf, det)
        step = np.stack(
            [
                J[..., 1, 1] * r[..., 0] - J[..., 0, 1] * r[..., 1],
                J[..., 0, 0] * r[..., 1] - J[..., 1, 0] * r[..., 0],
            ],
            axis=-1,
        )
        # A ray that misses the facet by far needs no more than to stay outside.
        step = np.clip(step / det[..., None], -0.5, 0.5)
        local = np.clip(local - step, -1.0, 2.0)
        inside = face.element.outside(local) < 0.5
        if np.abs(step[inside]).max(initial=0.0) < 1e-13:
            break
    away = np.einsum("fqa,fac->fqc", face.element.shape(local), nodes) - x
    return local, np.asarray(np.einsum("fqc,fqc->fq", away, n))


def search(
    face: Face, x: Array, n: Array, point: Ints, facet: Ints
) -> tuple[Ints, Array, Array, Array]:
    """The facet of each point's candidates that its ray meets.

    Args:
        face: the face.
        x: points [m], shape (points, 3).
        n: unit directions of the rays, same shape.
        point: a point for each candidate, shape (candidates,).
        facet: the candidate.

    Returns:
        For each point its facet (-1: no candidate), reference points, shape (points, 2), distances
        [m], and how far outside the facet the ray passes, in reference coordinates.
    """
    middle = face.element.nodes[: face.element.corners].mean(axis=0)
    start = np.broadcast_to(middle, (point.size, 1, 2))
    local, gap = project(face, facet, x[point][:, None], n[point][:, None], start)
    local, gap = local[:, 0], gap[:, 0]
    outside = face.element.outside(local)
    # Of those met take the nearest, of those missed the least missed.
    miss = np.where(outside <= EDGE, 0.0, outside)
    order = np.lexsort([facet, np.abs(gap), miss, point])
    first = order[np.unique(point[order], return_index=True)[1]]
    found = np.full(len(x), -1, dtype=np.int64)
    where, distance, missed = np.zeros((len(x), 2)), np.zeros(len(x)), np.full(len(x), np.inf)
    hit = point[first]
    found[hit], where[hit], distance[hit] = facet[first], local[first], gap[first]
    missed[hit] = outside[first]
    return found, where, distance, missed

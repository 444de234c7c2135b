"""Faces that act on one another as wholes: glued by a stiff layer, or by their mean motions.

Of faces glued together, whose meshes need not match, the layer has the virtual work kappa times the
integral of jump(u) . jump(v) over the common part of the faces, with all three components of the
jump at the quadrature points of the clipped facets (``overlap``). It passes a uniform traction
sigma exactly, with the jump sigma / kappa.

A point x of the first face and its partner y on the second may lie a small distance apart. The jump
is that of u_1(x) and of u_2(y) carried to x by the rotation of the second face,

    jump(u) = u_1(x) - u_2(y) - omega x (x - y),     omega = (1 - n n' / 2) sum_a grad N_a x u_a,

n the normal of the second face at y and grad the gradient in its surface, so that no rigid motion
of both bodies strains the layer, curved faces or faces with a gap included. (For a rigid motion the
sum is 2 omega less its part in the surface.)

Springs between faces and inertia act on mean motions. The mean displacement is that over the area.
The mean rotation theta about the centroid is that of the rigid motion nearest to the displacement u
over the area,

    S theta = integral of r x u,     S = integral of (r.r 1 - r r'),

r from the centroid; both are exact where the face moves rigidly. One row each in x, y and z. A
face of several bodies, such as that of two pads, has a mean motion on each of them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import SceneError
from brake_fenicsx.meshing.brake_mesh import Mesh

from . import elasticity, integrals, material
from .faces import Face, gather_face
from .overlap import Overlap, facing_pairs, overlap, rule

# Stiffness of a layer that a scene gives none for: this multiple of E / h. See docs/meshes.md for
# what other values do.
STIFF = 1000.0

# Largest distance that is glued where a scene names none, over the side of a facet.
NEAR = 0.05

# Faces no further apart than this share of a facet touch: round-off.
TOUCHING = 1e-9

# Facets of the first face at once.
BATCH = 64


@dataclass(frozen=True, slots=True)
class GluedFaces:
    """Two glued faces.

    Attributes:
        K: stiffness of the layer [N/m] on the free dofs.
        stiffness: kappa [Pa/m].
        area: area that is glued [m^2].
        uncovered: area of the first face that is not [m^2].
        second: area of the second face [m^2].
        gap: largest distance that is glued [m].
    """

    K: sp.csr_matrix
    stiffness: float
    area: float
    uncovered: float
    second: float
    gap: float

    @property
    def areas(self) -> tuple[float, float]:
        """Areas of the two faces [m^2]."""
        return self.area + self.uncovered, self.second


def tied_faces(
    mesh: Mesh,
    free: elasticity.FreeDofs,
    faces: tuple[str, str],
    materials: Mapping[str, material.Material],
    stiffness: float | None = None,
    search: float | None = None,
) -> GluedFaces:
    """Glue the common part of two faces.

    Args:
        mesh: the tagged mesh.
        free: numbering of the free dofs.
        faces: names of the two faces.
        materials: layer name -> material in x, y, z axes.
        stiffness: kappa [Pa/m]; ``STIFF`` E / h if None: E the largest C_ii of the layers of both
            parts, h the smaller side of a facet of the two faces.
        search: largest distance that is glued [m]; ``NEAR`` times the larger side if None.

    Returns:
        The layer.

    Raises:
        SceneError: unknown face, or faces that nowhere lie that close to each other.
    """
    first, second = (gather_face(mesh, free, face) for face in faces)
    areas = [integrals.facet_areas(face) for face in (first, second)]
    sides = [float(np.sqrt(area.mean())) for area in areas]
    if stiffness is None:
        stiffness = STIFF * _stiffest(faces, materials) / min(sides)
    reach = NEAR * max(sides) if search is None else search
    pairs = facing_pairs(first, second, reach)
    # All partners of a facet together: a point may be handed from one to another.
    ends = np.searchsorted(pairs[:, 0], np.arange(0, len(areas[0]) + BATCH, BATCH))
    points = rule(first, second, 1, 24)
    K = sp.csr_matrix((free.size, free.size))
    area, gaps = 0.0, [np.inf, 0.0]
    for start, end in pairwise(ends):
        for o in overlap(first, second, pairs[start:end], points):
            away, counts = np.abs(o.gap), o.weight > 0
            near = counts & (away <= reach)
            gaps[0] = min(gaps[0], float(away[counts].min(initial=np.inf)))
            if near.any():
                area += float(o.weight[near].sum())
                gaps[1] = max(gaps[1], float(away[near].max()))
                K = K + _layer(first, second, o, np.where(near, stiffness, 0.0), free.size)
    if not area > 0:
        raise SceneError(_apart(faces, first, second, gaps[0], reach))
    return GluedFaces(
        K, stiffness, area, float(areas[0].sum()) - area, float(areas[1].sum()), gaps[1]
    )


def _stiffest(faces: tuple[str, str], materials: Mapping[str, material.Material]) -> float:
    """Largest C_ii [Pa] of the layers of the parts of two faces."""
    parts = {face.partition(".")[0] for face in faces}
    C = [m.C for name, m in materials.items() if name.partition(".")[0] in parts]
    return max(float(np.diag(c).max()) for c in C)


def _layer(first: Face, second: Face, o: Overlap, kappa: Array, size: int) -> sp.csr_matrix:
    """Stiffness [N/m] of some clipped triangles, kappa at each of their points."""
    columns = np.concatenate([first.columns[o.pad], second.columns[o.disc]], axis=1)
    shape = first.element.shape(o.on_pad)
    scale = np.sqrt(kappa * o.weight)[..., None]
    if np.abs(o.gap).max() < TOUCHING * first.radius.max():
        # Components of the jump apart, and one matrix for all three.
        J = scale * np.concatenate([shape, -second.element.shape(o.on_disc)], axis=2)
        values = np.repeat((np.swapaxes(J, 1, 2) @ J)[..., None], 3, axis=3)
    else:
        J = np.concatenate([shape[..., None, None] * np.eye(3), -_carried(second, o)], axis=2)
        # Rows: components at points; columns: components at nodes.
        J = np.swapaxes(scale[..., None, None] * J, 2, 3).reshape(len(J), -1, columns[0].size)
        values = np.swapaxes(J, 1, 2) @ J
        columns = columns.reshape(len(J), -1)
    i = np.broadcast_to(columns[:, :, None], values.shape)
    j = np.broadcast_to(columns[:, None], values.shape)
    free = (i >= 0) & (j >= 0)
    return sp.csr_matrix((values[free], (i[free], j[free])), shape=(size, size))


def _carried(face: Face, o: Overlap) -> Array:
    """Displacement of the second face carried to the points of the first one.

    Returns:
        What each node contributes, shape (triangles, points, nodes, 3, 3).
    """
    tangent = np.einsum("fqad,fac->fqcd", face.element.gradient(o.on_disc), face.nodes[o.disc])
    across = np.swapaxes(tangent, 2, 3) @ tangent
    # Columns of the pseudo-inverse are the contravariant base vectors.
    inverse = np.linalg.inv(across) @ np.swapaxes(tangent, 2, 3)
    gradient = face.element.gradient(o.on_disc) @ inverse
    _, n, _ = face.surface(o.disc, o.on_disc)
    turn = np.eye(3) - 0.5 * n[..., :, None] * n[..., None, :]
    # omega x (x - y) = -(x - y) x omega; x - y points along o.n.
    arm = -cross_matrix(o.gap[..., None] * o.n) @ turn
    shape = face.element.shape(o.on_disc)[..., None, None] * np.eye(3)
    return np.asarray(shape + arm[:, :, None] @ cross_matrix(gradient))


def cross_matrix(v: Array) -> Array:
    """Matrices of v x ., shape (..., 3) to (..., 3, 3)."""
    return np.asarray(np.cross(v[..., None, :], np.eye(3), axis=-1)).swapaxes(-1, -2)


def _apart(faces: tuple[str, str], first: Face, second: Face, gap: float, reach: float) -> str:
    """Why two faces have no common part, and the remedy."""
    if np.isfinite(gap):
        return (
            f"{faces[0]!r} and {faces[1]!r} lie {1e3 * gap:.3g} mm apart, and {1e3 * reach:.3g} mm"
            f' are glued at most; move a part, or write search = "{1.1e3 * gap:.3g} mm"'
        )
    nodes = cKDTree(second.nodes.reshape(-1, 3)).query(first.nodes.reshape(-1, 3))[0].min()
    return (
        f"{faces[0]!r} and {faces[1]!r} lie nowhere opposite to each other, their nearest nodes are"
        f' {1e3 * nodes:.3g} mm apart; name other faces, move a part, or write search = "1 mm"'
        " or the gap that is to be glued"
    )


# Nodes at most: all of them are coupled with each other.
MOST_NODES = 4000


def mean_displacement(face: Face, size: int) -> sp.csr_matrix:
    """Mean displacement of a face.

    Args:
        face: the face.
        size: number of free dofs.

    Returns:
        Shape (3, size) [-].
    """
    area, _, shape = _points(face)
    share = area @ shape / area.sum()
    return _rows(face, share[..., None, None] * np.eye(3), size)


def mean_of_nodes(J: sp.csr_matrix) -> sp.csr_matrix:
    """Mean displacement of a set of nodes.

    Args:
        J: their displacements, node by node in x, y, z, shape (3 nodes, free dofs).

    Returns:
        Shape (3, free dofs) [-].
    """
    nodes = J.shape[0] // 3
    return (sp.kron(np.full((1, nodes), 1 / nodes), sp.identity(3)) @ J).tocsr()


def mean_rotation(face: Face, size: int) -> sp.csr_matrix:
    """Mean rotation of a face about its centroid, small: rotation vector over displacement.

    Args:
        face: the face.
        size: number of free dofs.

    Returns:
        Shape (3, size) [1/m].
    """
    area, r, shape = _points(face)
    square = np.einsum("fq,fqc,fqd->cd", area, r, r)
    S = np.trace(square) * np.eye(3) - square
    moment = np.einsum("fq,qm,fqc->fmc", area, shape, r)
    return _rows(face, np.linalg.solve(S, cross_matrix(moment)), size)


def check_size(faces: list[Face]) -> None:
    """Refuse faces whose mean motions would fill the matrix.

    Raises:
        SceneError: their number of nodes, the limit and the remedy.
    """
    nodes = sum(np.unique(face.number).size for face in faces)
    if nodes > MOST_NODES:
        raise SceneError(f"""{nodes} nodes of these faces, of which a mean motion couples each with
            all others; up to {MOST_NODES} can be: name a smaller face, or larger cells""")


def _points(face: Face) -> tuple[Array, Array, Array]:
    """Areas [m^2], distances from the centroid [m] and shape functions at points of every facet."""
    x, w = integrals.facet_rule(face.element.corners)
    where, _, ratio = face.everywhere(x)
    area = ratio * w
    centre = np.einsum("fq,fqc->c", area, where) / area.sum()
    return area, where - centre, face.element.shape(x)


def _rows(face: Face, values: Array, size: int) -> sp.csr_matrix:
    """Sum over the nodes of matrices times their displacements; held dofs have none."""
    columns = np.broadcast_to(face.columns[:, :, None], values.shape)
    rows = np.broadcast_to(np.arange(3)[:, None], values.shape)
    free = (columns >= 0) & (values != 0)
    return sp.csr_matrix((values[free], (rows[free], columns[free])), shape=(3, size))

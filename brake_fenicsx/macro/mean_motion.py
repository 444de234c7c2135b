"""Mean displacement and mean rotation of a face: what springs between faces and inertia act on.

The mean displacement is that over the area. The mean rotation theta about the centroid is that of
the rigid motion nearest to the displacement u over the area,

    S theta = integral of r x u,     S = integral of (r.r 1 - r r'),

r from the centroid; both are exact where the face moves rigidly. One row each in x, y and z. A
face of several bodies, such as that of two pads, has a mean motion on each of them.
"""

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import SceneError

from .faces import Face
from .integrals import facet_rule
from .tie import cross_matrix

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
        raise SceneError(
            f"{nodes} nodes of these faces, of which a mean motion couples each with all others;"
            f" up to {MOST_NODES} can be: name a smaller face, or larger cells"
        )


def _points(face: Face) -> tuple[Array, Array, Array]:
    """Areas [m^2], distances from the centroid [m] and shape functions at points of every facet."""
    x, w = facet_rule(face.element.corners)
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

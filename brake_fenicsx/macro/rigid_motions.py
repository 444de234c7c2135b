"""Rigid motions of bodies, and the equations that hold them.

Every body has six rigid motions, three translations and three rotations about its centre, scaled
by its size. A motion q of all bodies is free where no support, no stress, spring or tie and no
closed contact resists it,

    R_held q = 0,     K R q = 0,     N R q = 0,

R the displacements of the motions and R_held those of held dofs. Each row of K R is compared with
the sum of the magnitudes of its terms and then scaled to 1, so that a soft spring counts as much as
a stiff one. Bodies given by matrices of few digits resist rigid motions by their round-off.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from .elasticity import FreeDofs
from .faces import body_of_nodes

Array = NDArray[np.float64]
Index = NDArray[np.intp]

# Singular values below which a motion counts as free.
FREE = 1e-5


class RigidMotions(NamedTuple):
    """Rigid motions of all bodies.

    Attributes:
        held: motions at held dofs, shape (held dofs, 6 bodies).
        R: motions on the free dofs, shape (free dofs, 6 bodies).
        centre: of each body [m], shape (bodies, 3).
        size: largest distance of a node from the centre [m], shape (bodies,).
    """

    held: sp.csr_matrix
    R: sp.csr_matrix
    centre: Array
    size: Array


def rigid_motions(free: FreeDofs) -> RigidMotions:
    """Rigid motions of the bodies of the mesh, and after them of those given by matrices."""
    x, of_node = free.V.tabulate_dof_coordinates(), body_of_nodes(free.V)
    place = np.vstack([np.repeat(x, 3, axis=0), free.places[:, :3]])
    direction = np.concatenate([np.tile(np.arange(3), len(x)), free.places[:, 3].astype(int)])
    given = free.places[:, 4].astype(np.intp) + of_node.max() + 1
    body = np.concatenate([np.repeat(of_node, 3), given])
    count, n = int(body.max()) + 1, np.arange(len(body))
    mean = sp.csr_matrix((np.ones(n.size), (body, n)), (count, n.size))
    centre = mean @ place / np.maximum(np.bincount(body, minlength=count), 1)[:, None]
    away = place - centre[body]
    size = np.zeros(count)
    np.maximum.at(size, body, np.linalg.norm(away, axis=1))
    size[size == 0] = 1.0
    # omega x r has along direction c the component omega . (r x e_c).
    along = np.vstack([np.eye(3), np.zeros(3)])[direction]
    values = np.hstack([along, np.cross(away / size[body][:, None], along)])
    places = np.repeat(n, 6), columns_of(body)
    motions = sp.csr_matrix((values.ravel(), places), (n.size, 6 * count))
    numbered = np.concatenate([free.local, np.arange(free.column.size, n.size)])
    return RigidMotions(motions[np.flatnonzero(free.column < 0)], motions[numbered], centre, size)


def acting(A: sp.csr_matrix, R: sp.csr_matrix, round_off: float) -> sp.csr_matrix:
    """Rows of A R that are more than round-off of their terms, each scaled to 1."""
    terms = np.asarray(abs(A).sum(axis=1)).ravel()
    rows = (sp.diags(1 / np.where(terms > 0, terms, 1.0)) @ A @ R).tocsr()
    rows.data[np.abs(rows.data) < round_off] = 0.0
    rows.eliminate_zeros()
    rows = rows[np.diff(rows.indptr) > 0]
    return sp.diags(1 / abs(rows).max(axis=1).toarray().ravel()) @ rows


def groups(A: sp.csr_matrix) -> Index:
    """Number of the group of each body: those on which one row acts belong together."""
    acts = (abs(A) @ sp.kron(sp.identity(A.shape[1] // 6), np.ones((6, 1)))).tocsr()
    return np.asarray(connected_components(acts.T @ acts, directed=False)[1], dtype=np.intp)


def members(numbers: Index) -> list[Index]:
    """Places of each group."""
    return [np.flatnonzero(numbers == one) for one in np.unique(numbers)]


def columns_of(bodies: Index) -> Index:
    """Numbers of the motions of some bodies."""
    return (6 * bodies[:, None] + np.arange(6)).ravel()


def constraints(A: sp.csr_matrix, columns: Index) -> Array:
    """Some columns of A as a small matrix of the same products."""
    own = A[:, columns]
    return np.asarray(np.linalg.qr(own[np.diff(own.indptr) > 0].toarray(), mode="r"))


def null_space(A: Array) -> Array:
    """Unit vectors that A maps to nothing, as columns."""
    _, values, right = np.linalg.svd(A)
    return right[np.count_nonzero(values > FREE) :].T


def as_one(bodies: RigidMotions, group: Index, chosen: Index) -> Array:
    """Motions of all bodies of a group for the six of some of them as one, shape (6 n, 6)."""
    of = group[chosen]
    away = bodies.centre[of] - bodies.centre[of].mean(axis=0)
    size = float((np.linalg.norm(away, axis=1) + bodies.size[of]).max())
    E = np.zeros((len(group), 6, 6))
    E[chosen, :3, :3] = np.eye(3)
    E[chosen, :3, 3:] = np.cross(np.eye(3), away[:, None] / size).swapaxes(1, 2)  # e_c x r
    E[chosen, 3:, 3:] = (bodies.size[of] / size)[:, None, None] * np.eye(3)
    return E.reshape(-1, 6)

"""Rigid motions of the bodies that nothing holds: they make the stiffness singular.

Every body has six rigid motions, three translations and three rotations about the middle of all
bodies, scaled by their size. A motion q of all bodies is free where no support, no stress, spring
or tie and no closed contact resists it,

    R_held q = 0,     K R q = 0,     N R q = 0,

R the displacements of the motions and R_held those of held dofs. Each row of K R and of N R is
compared with the sum of the magnitudes of its terms and then scaled to 1, so that a soft spring
counts as much as a stiff one. Contact counts along its normal alone, as in the stiffness of the
equilibrium. Bodies given by matrices of few digits resist rigid motions by their round-off, and are
not named.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import block_diag
from scipy.optimize import nnls
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from brake_fenicsx import compat
from brake_fenicsx.arguments import Array, Index

from . import elasticity, faces

# Names of the parts of each body.
Names = list[tuple[str, ...]]
# Parts that move, and how -> how many times.
Motions = Counter[tuple[tuple[str, ...], str]]

# Round-off of rows of K R and of N R over the sums of their magnitudes.
ROUND_OFF = 1e-12, 1e-7
# Singular values below which a motion counts as free, and distances at which one is named already.
FREE, SAME = 1e-5, 1e-3
# Nodes of two pieces closer than this share of the size of their part coincide.
COINCIDENT = 1e-5
# Share of the loads that no contact force balances.
UNBALANCED = 1e-3


@dataclass(frozen=True, slots=True)
class FreeMotions:
    """What nothing holds.

    Attributes:
        motions: parts that move freely, and how -> how many times.
        pieces: part in several pieces with coincident nodes -> what is said of it.
        unpressed: bodies that contact alone holds in some directions, and that the loads do not
            press on it, a line each.
    """

    motions: Motions
    pieces: dict[str, str]
    unpressed: list[str]


def free_motions(ops: Any, given: Iterable[str]) -> FreeMotions:
    """Rigid motions that nothing holds.

    Args:
        ops: anything with ``elastic``, ``mesh``, ``N`` and ``f`` of a brake, the sizes of its
            loads, ``pressed`` [N], and the displacements of its supports, ``lift``.
        given: names of the parts that are given by matrices.
    """
    held, R = _rigid_motions(ops.elastic.free)
    joints = sp.vstack([held, _resisted(ops.elastic.K, R, ROUND_OFF[0])]).tocsr()
    every = sp.vstack([joints, _resisted(ops.N, R, ROUND_OFF[1])]).tocsr()
    joined, touching = _connected(joints), _connected(every)
    sets = [*np.arange(len(joined))[:, None], *_sets(joined), *_sets(touching)]
    names, pieces = _names_and_pieces(ops, given, joined)
    moved = sp.vstack([held, R]).tocsc()
    each = (_null_space(_triangle(moved[:, i : i + 6])) for i in range(0, moved.shape[1], 6))
    motions = _named_motions(_triangle(every), block_diag(*each), sets, names)
    if motions:
        return FreeMotions(motions, pieces, [])
    return FreeMotions(motions, pieces, _unpressed(ops, R, _triangle(joints), joined, names))


def _rigid_motions(free: elasticity.FreeDofs) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Six motions of each body of the mesh, and after them of those given by matrices.

    Returns:
        Displacements of held dofs, shape (held dofs, 6 bodies), and of free ones.
    """
    x, body = free.V.tabulate_dof_coordinates(), faces.body_of_nodes(free.V)
    given = free.places[:, 4].astype(np.intp) + body.max() + 1
    place = np.concatenate([np.repeat(x, 3, axis=0), free.places[:, :3]])
    direction = np.concatenate([np.tile(np.arange(3), len(x)), free.places[:, 3].astype(np.intp)])
    columns = 6 * np.concatenate([np.repeat(body, 3), given])[:, None] + np.arange(6)
    away = place - (place.min(axis=0) + place.max(axis=0)) / 2
    # omega x r has along direction c the component omega . (r x e_c); direction 3 is none.
    along = np.eye(4, 3)[direction]
    values = np.hstack([along, np.cross(away / np.linalg.norm(away, axis=1).max(), along)])
    rows = np.repeat(np.arange(len(place)), 6)
    motions = sp.csr_matrix((values.ravel(), (rows, columns.ravel())))
    numbered = np.concatenate([free.local, np.arange(free.column.size, len(place))])
    return motions[np.flatnonzero(free.column < 0)], motions[numbered]


def _resisted(A: sp.csr_matrix, R: sp.csr_matrix, limit: float) -> sp.csr_matrix:
    """Rows of A R that are more than round-off, each scaled to 1."""
    terms = np.asarray(abs(A).sum(axis=1)).ravel()
    forces = (sp.diags(1 / np.where(terms > 0, terms, 1.0)) @ (A @ R)).tocsr()
    forces.data[np.abs(forces.data) < limit] = 0.0
    forces.eliminate_zeros()
    size = abs(forces).max(axis=1).toarray().ravel()
    return (sp.diags(1 / np.where(size > 0, size, 1.0)) @ forces).tocsr()


def _triangle(A: sp.csr_matrix) -> Array:
    """A small matrix of the same products A' A."""
    rows = A.tocsr()
    return np.asarray(np.linalg.qr(rows[np.diff(rows.indptr) > 0].toarray(), mode="r"))


def _null_space(A: Array) -> Array:
    """Unit vectors that A maps to nothing, as columns."""
    _, values, right = np.linalg.svd(A)
    return right[np.count_nonzero(values > FREE) :].T


def _connected(A: sp.csr_matrix) -> Index:
    """Number of the group of each body: those on which one row acts belong together."""
    acts = (abs(A) @ sp.kron(sp.identity(A.shape[1] // 6), np.ones((6, 1)))).tocsr()
    return np.asarray(connected_components(acts.T @ acts, directed=False)[1], dtype=np.intp)


def _sets(group: Index) -> list[Index]:
    """Bodies of each group."""
    return [np.flatnonzero(group == number) for number in range(group.max() + 1)]


def _named_motions(A: Array, known: Array, sets: list[Index], names: Names) -> Motions:
    """Free motions of each set of bodies as one, less those of the sets before.

    Args:
        A: what resists, shape (any, 6 bodies).
        known: motions that move nothing: bodies given by matrices may have few coordinates.
        sets: bodies alone, those that are joined, those that touch.
        names: of the parts.
    """
    motions: Motions = Counter()
    for bodies in sets:
        E = np.kron(np.isin(np.arange(len(names)), bodies)[:, None], np.eye(6))
        Q = _null_space(A @ E)
        new, weights = _beyond(E @ Q, known)
        if new.size:
            known = np.hstack([known, new])
            motions[_parts(names, bodies), _directions(Q @ weights)] += 1
    rest, _ = _beyond(_null_space(A), known)
    if rest.size:
        who = np.flatnonzero(np.abs(rest).reshape(len(names), -1).max(axis=1) > SAME)
        motions[_parts(names, who), f"move against each other in {rest.shape[1]} ways"] += 1
    return motions


def _beyond(V: Array, known: Array) -> tuple[Array, Array]:
    """Unit vectors that some motions add to known ones, and their weights in them, as columns."""
    left, values, right = np.linalg.svd(V - known @ (known.T @ V), full_matrices=False)
    return left[:, values > SAME], right[values > SAME].T


def _directions(Q: Array) -> str:
    """Directions of some motions of one body, shape (6, number)."""
    turning, values, right = np.linalg.svd(Q[3:])
    rank = np.count_nonzero(values > SAME)
    spaces = {"move along": (Q @ right[rank:].T)[:3], "turn about": turning[:, :rank]}
    axes = {word: _axes(space) for word, space in spaces.items() if space.size}
    return " and ".join(
        f"{word} {', '.join(names[:-1])}{' and ' * (len(names) > 1)}{names[-1]}"
        for word, names in axes.items()
    )


def _axes(space: Array) -> list[str]:
    """x, y and z in a space of directions, and components of what else spans it."""
    inside = np.linalg.norm(space, axis=1) > 1 - SAME**2
    left, values, _ = np.linalg.svd(np.where(inside[:, None], 0.0, space), full_matrices=False)
    names = [name for name, there in zip("xyz", inside, strict=True) if there]
    for v in left[:, values > 0.5].T:
        upward = np.round(v * np.sign(v[np.abs(v) > SAME][0]), 3) + 0.0
        names.append(f"({', '.join(f'{c:.3g}' for c in upward)})")
    return names


def _parts(names: Names, bodies: Iterable[int]) -> tuple[str, ...]:
    """Parts of some bodies."""
    return tuple(dict.fromkeys(name for body in bodies for name in names[body]))


def _names_and_pieces(
    brake: Any, given: Iterable[str], joined: Index
) -> tuple[Names, dict[str, str]]:
    """Parts of each body, several where they share nodes; and parts in pieces that nothing joins.

    Returns:
        The names, and of each part in pieces with nodes in the same places what is said of it.
    """
    V, mesh = brake.elastic.free.V, brake.mesh
    cells = np.arange(mesh.domain.topology.index_map(mesh.domain.topology.dim).size_local)
    body = faces.body_of_nodes(V)[compat.cell_dofs(V, cells)[:, 0]]
    nodes, x = compat.geometry_dofs(mesh.domain), mesh.domain.geometry.x
    names: Names = [()] * (body.max() + 1)
    pieces = {}
    for part, sides in mesh.extents.items():
        members = mesh.cells_of(part)
        each = {int(b): members[body[members] == b] for b in np.unique(body[members])}
        for b in each:
            names[b] += (part,)
        trees = {b: cKDTree(x[np.unique(nodes[its])]) for b, its in each.items()}
        reach = COINCIDENT * max(sides)
        apart = [(a, b) for a, b in combinations(each, 2) if joined[a] != joined[b]]
        if pairs := sum(trees[a].count_neighbors(trees[b], reach) for a, b in apart):
            pieces[part] = f"part {part}: {len(each)} pieces, {pairs} coincident node pairs"
    return [*names, *((name,) for name in given)][: len(joined)], pieces


def _unpressed(
    brake: Any, R: sp.csr_matrix, joints: Array, joined: Index, names: Names
) -> list[str]:
    """Bodies that contact alone holds in some directions, and that the loads do not press on it.

    Forces P >= 0 of the contact elements, without friction, that balance the loads on the free
    motions Q of the joined bodies, Q' R' (f + N' P) = 0; a displacement of supports presses too.
    """
    sets = _sets(joined)
    columns = [(6 * bodies[:, None] + np.arange(6)).ravel() for bodies in sets]
    spaces = [R[:, bodies] @ _null_space(joints[:, bodies]) for bodies in columns]
    gaps, loads = [brake.N @ Q for Q in spaces], [Q.T @ brake.f for Q in spaces]
    if brake.lift is not None or not sum(map(len, loads)):
        return []
    P = nnls(np.hstack(gaps).T, -np.concatenate(loads))[0]
    lines = []
    for bodies, gap, load in zip(sets, gaps, loads, strict=True):
        unbalanced = np.linalg.norm(gap.T @ P + load) >= UNBALANCED * brake.pressed
        # Without a gap that opens it moves nothing: a body of few coordinates.
        if not gap.any() or (P @ np.abs(gap).sum(axis=1) > 0 and not unbalanced):
            continue
        why = "pushed away from it" if unbalanced else "not pressed on it"
        lines.append(
            f"part {' and '.join(_parts(names, bodies))}: held by contact alone in some directions,"
            f" and {why} by the loads; correct the loads, or write supports, ties or springs"
        )
    return lines

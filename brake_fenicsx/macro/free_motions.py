"""Rigid motions of the bodies that nothing holds: they make the stiffness singular.

Every body has six rigid motions, three translations and three rotations about its centre, scaled
by its size. A motion q of all bodies is free where no support, no stress, spring or tie and no
closed contact resists it,

    R_held q = 0,     K R q = 0,     N R q = 0,

R the displacements of the motions and R_held those of held dofs. Each row of K R is compared with
the sum of the magnitudes of its terms and then scaled to 1, so that a soft spring counts as much as
a stiff one. Contact counts along its normal alone, as in the stiffness of the equilibrium. Bodies
given by matrices of few digits resist rigid motions by their round-off, and are not named.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from brake_fenicsx import compat
from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene import Scene

from .brake import Brake
from .elasticity import FreeDofs
from .faces import body_of_nodes
from .parts import file_parts

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Motion = tuple[tuple[str, ...], str]

# Round-off of a row of K R over the sum of its magnitudes, and of a row of N R.
ROUND_OFF = 1e-12, 1e-7
# Singular values and distances from a space below which a motion counts as free, or as named.
FREE, SAME = 1e-5, 1e-3
# Nodes of two pieces closer than this share of the size of their part coincide.
COINCIDENT = 1e-5
# Share of the loads that no contact force balances.
UNBALANCED = 1e-3
# Keywords of mesh files that join or hold parts.
JOINING = ("*TIE", "*COUPLING", "*BOUNDARY")


@dataclass(frozen=True, slots=True)
class _Bodies:
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

    @property
    def moved(self) -> sp.csr_matrix:
        """Products of the displacements of two motions, shape (6 bodies, 6 bodies)."""
        return (self.held.T @ self.held + self.R.T @ self.R).tocsr()


def check_free_motions(scene: Scene, brake: Brake) -> list[str]:
    """Refuse parts that move freely.

    Args:
        scene: the scene.
        brake: its operators.

    Returns:
        Parts in several pieces with coincident nodes, and bodies that rest on contact unpressed.

    Raises:
        SceneError: the parts, the directions and the remedy.
    """
    bodies = _rigid_motions(brake.elastic.free)
    names = _names(scene, brake, len(bodies.size))
    joints = sp.vstack([bodies.held, _resisted(brake.elastic.K, bodies.R)]).tocsr()
    A = sp.vstack([joints, _without_round_off(brake.N @ bodies.R, ROUND_OFF[1])]).tocsr()
    joined, touching = _groups(joints), _groups(A)
    motions: Counter[Motion] = Counter()
    for number in range(touching.max() + 1):
        group = np.flatnonzero(touching == number)
        motions.update(_free_in_group(A, bodies, group, joined, names))
    pieces = _pieces(brake, joined)
    if motions:
        raise SceneError(f"{scene.file}: {_refusal(scene, brake, motions, pieces)}")
    return [
        *(f"{said}; merge them in the mesh" for said in pieces.values()),
        *_unpressed(brake, bodies, joints, joined, names),
    ]


def _unpressed(
    brake: Brake, bodies: _Bodies, joints: sp.csr_matrix, joined: Index, names: list[list[str]]
) -> list[str]:
    """Bodies that contact alone holds in some directions, and that the loads do not press on it.

    Forces P >= 0 of the contact elements, without friction, that balance the loads on the free
    motions Q of the joined bodies, Q' R' (f + N' P) = 0; a displacement of supports presses too.
    """
    if brake.lift is not None:
        return []
    numbers, spaces = range(joined.max() + 1), []
    for number in numbers:
        columns = (6 * np.flatnonzero(joined == number)[:, None] + np.arange(6)).ravel()
        free = _null_space(_constraints(joints, columns))
        space = np.zeros((6 * len(joined), free.shape[1]))
        space[columns] = free
        spaces.append(space)
    gaps = [(brake.N @ bodies.R) @ space for space in spaces]
    loads = [space.T @ (bodies.R.T @ brake.f) for space in spaces]
    if not sum(map(len, loads)):
        return []
    P = nnls(np.hstack(gaps).T, -np.concatenate(loads))[0]
    lines = []
    for number, gap, load in zip(numbers, gaps, loads, strict=True):
        left = np.linalg.norm(gap.T @ P + load)
        pressed = P @ np.abs(gap).sum(axis=1)
        # Without a gap that opens it moves nothing: a body of few coordinates.
        if not gap.any() or (pressed > 0 and left < UNBALANCED * brake.pressed):
            continue
        why = "pushed away from it" if left >= UNBALANCED * brake.pressed else "not pressed on it"
        listed = " and ".join(_parts(names, np.flatnonzero(joined == number)))
        lines.append(
            f"part {listed}: held by contact alone in some directions, and {why} by the loads;"
            " correct the loads, or write supports, ties or springs"
        )
    return lines


def _refusal(
    scene: Scene, brake: Brake, motions: Counter[Motion], pieces: dict[str, str]
) -> str:  # fmt: skip
    """What moves freely, and the remedies."""
    said = []
    for (parts, how), count in motions.items():
        bodies = f"{count} pieces of part" if count > 1 else "parts" if len(parts) > 1 else "part"
        together = " together" if len(parts) > 1 else ""
        said.append(f"{bodies} {' and '.join(parts)}{together}: free to {how}")
    free = {name for parts, _ in motions for name in parts}
    said += [f"{text}: merge them in the mesh" for name, text in pieces.items() if name in free]
    unread = " ".join(brake.mesh.unread.changing)
    lost = [word for word in JOINING if word in unread]
    if lost and (of_file := [name for name in file_parts(scene) if name in free]):
        said.append(
            f"{scene.mesh.file}, the mesh of {' and '.join(of_file)}, has {' and '.join(lost)},"
            " which is not read"
        )
    return (
        f"{'; '.join(said)}. Hold them by supports, ties or springs; contact holds along its"
        " normal alone"
    )


def _rigid_motions(free: FreeDofs) -> _Bodies:
    """Rigid motions of the bodies of the mesh, and after them of those given by matrices."""
    x, body = free.V.tabulate_dof_coordinates(), body_of_nodes(free.V)
    matrices = free.places[:, 4].astype(np.intp) + body.max() + 1
    place = np.concatenate([np.repeat(x, 3, axis=0), free.places[:, :3]])
    direction = np.concatenate([np.tile(np.arange(3.0), len(x)), free.places[:, 3]])
    body = np.concatenate([np.repeat(body, 3), matrices])
    count = int(body.max()) + 1
    number = np.maximum(np.bincount(body, minlength=count), 1)
    centre = np.array([np.bincount(body, place[:, c], count) for c in range(3)]).T / number[:, None]
    away = place - centre[body]
    size = np.zeros(count)
    np.maximum.at(size, body, np.linalg.norm(away, axis=1))
    size[size == 0] = 1.0
    # omega x r has along direction c the component omega . (r x e_c).
    along = np.vstack([np.eye(3), np.zeros(3)])[direction.astype(int)]
    values = np.hstack([along, np.cross(away / size[body][:, None], along)])
    columns = 6 * body[:, None] + np.arange(6)
    rows = np.repeat(np.arange(len(body)), 6)
    motions = sp.csr_matrix((values.ravel(), (rows, columns.ravel())), (len(body), 6 * count))
    numbered = np.concatenate([free.local, np.arange(free.column.size, len(body))])
    return _Bodies(motions[np.flatnonzero(free.column < 0)], motions[numbered], centre, size)


def _resisted(K: sp.csr_matrix, R: sp.csr_matrix) -> sp.csr_matrix:
    """Rows of K R that are more than round-off, each scaled to 1."""
    forces = (K @ R).tocsr()
    terms = np.asarray(abs(K).sum(axis=1)).ravel()
    forces = sp.diags(1 / np.where(terms > 0, terms, 1.0)) @ forces
    kept = _without_round_off(forces, ROUND_OFF[0])
    return (sp.diags(1 / abs(kept).max(axis=1).toarray().ravel()) @ kept).tocsr()


def _without_round_off(A: sp.csr_matrix, limit: float) -> sp.csr_matrix:
    """Rows with entries beyond a limit, the others left out."""
    A = A.tocsr()
    A.data[np.abs(A.data) < limit] = 0.0
    A.eliminate_zeros()
    return A[np.diff(A.indptr) > 0]


def _groups(A: sp.csr_matrix) -> Index:
    """Number of the group of each body: those on which one row acts belong together."""
    acts = (abs(A) @ sp.kron(sp.identity(A.shape[1] // 6), np.ones((6, 1)))).tocsr()
    return np.asarray(connected_components(acts.T @ acts, directed=False)[1], dtype=np.intp)


def _free_in_group(
    A: sp.csr_matrix, bodies: _Bodies, group: Index, joined: Index, names: list[list[str]]
) -> list[Motion]:
    """Free motions of bodies that touch: of each alone, of those that are joined, and of all.

    Returns:
        Names of the parts, and how they move.
    """
    columns = (6 * group[:, None] + np.arange(6)).ravel()
    own = _constraints(A, columns)
    dimension = _null_space(own).shape[1]
    each = [np.flatnonzero(joined[group] == number) for number in np.unique(joined[group])]
    every = np.arange(len(group))
    sets = [*every[:, None], *each, every]
    # Bodies given by matrices may have so few coordinates that some motions move none of them.
    named = _null_space(bodies.moved[columns][:, columns].toarray())
    motions = []
    for chosen in sets:
        if named.shape[1] == dimension:
            break
        E = _as_one(bodies, group, chosen)
        vectors, said = _directions(_null_space(own @ E), E, named)
        named = np.hstack([named, vectors])
        if said:
            motions.append((_parts(names, group[chosen]), said))
    if left := dimension - named.shape[1]:
        motions.append((_parts(names, group), f"move against each other in {left} ways"))
    return motions


def _parts(names: list[list[str]], bodies: Index) -> tuple[str, ...]:
    """Parts of some bodies."""
    return tuple(dict.fromkeys(name for body in bodies for name in names[body]))


def _constraints(A: sp.csr_matrix, columns: Index) -> Array:
    """Some columns of A as a small matrix of the same products."""
    own = A[:, columns]
    return np.asarray(np.linalg.qr(own[np.diff(own.indptr) > 0].toarray(), mode="r"))


def _null_space(A: Array) -> Array:
    """Unit vectors that A maps to nothing, as columns."""
    _, values, right = np.linalg.svd(A)
    return right[np.count_nonzero(values > FREE) :].T


def _as_one(bodies: _Bodies, group: Index, chosen: Index) -> Array:
    """Motions of all bodies of a group for the six of some of them as one, shape (6 n, 6)."""
    of = group[chosen]
    centre = bodies.centre[of].mean(axis=0)
    size = float((np.linalg.norm(bodies.centre[of] - centre, axis=1) + bodies.size[of]).max())
    E = np.zeros((len(group), 6, 6))
    E[chosen, :3, :3] = np.eye(3)
    # Columns: e_c x r.
    E[chosen, :3, 3:] = np.cross(np.eye(3), (bodies.centre[of] - centre)[:, None] / size).swapaxes(
        1, 2
    )
    E[chosen, 3:, 3:] = (bodies.size[of] / size)[:, None, None] * np.eye(3)
    return E.reshape(-1, 6)


def _directions(Q: Array, E: Array, named: Array) -> tuple[Array, str]:
    """Free motions of some bodies as one that are not named yet.

    Args:
        Q: the motions, shape (6, number).
        E: motions of the bodies of the group for the six, shape (6 bodies, 6).
        named: motions of the group that are named, shape (6 bodies, number).

    Returns:
        The new motions, as columns, and their directions as text.
    """
    turning, values, right = np.linalg.svd(Q[3:])
    rank = np.count_nonzero(values > SAME)
    along = (Q @ right[rank:].T)[:3]
    inverse = right[:rank].T @ (turning[:, :rank] / values[:rank]).T
    kinds = {"move along": (along, None), "turn about": (turning[:, :rank], Q @ inverse)}
    new: list[Array] = []
    said = []
    for word, (space, motion) in kinds.items():
        axes = []
        for axis in _axes(space):
            v = E @ (np.concatenate([axis, np.zeros(3)]) if motion is None else motion @ axis)
            v /= np.linalg.norm(v)
            known = np.linalg.qr(np.column_stack([named, *new]))[0] if named.size or new else None
            if known is None or np.linalg.norm(v - known @ (known.T @ v)) > SAME:
                new.append(v)
                axes.append(_label(axis))
        if axes:
            listed = ", ".join(axes[:-1]) + " and " * (len(axes) > 1) + axes[-1]
            said.append(f"{word} {listed}")
    return np.array(new).reshape(len(new), len(E)).T, " and ".join(said)


def _axes(space: Array) -> list[Array]:
    """Coordinate axes in a space of directions, and what else spans it."""
    axes = [e for e in np.eye(3) if np.linalg.norm(e - space @ (space.T @ e)) < SAME]
    rest = space - sum((np.outer(e, e @ space) for e in axes), np.zeros_like(space))
    left, values, _ = np.linalg.svd(rest, full_matrices=False)
    return [*axes, *left[:, values > 0.5].T]


def _label(axis: Array) -> str:
    """x, y, z or the components of a direction, the first of which is positive."""
    if np.isclose(axis.max(), 1.0):
        return "xyz"[int(axis.argmax())]
    first = axis[np.abs(axis) > SAME][0]
    return "(" + ", ".join(f"{c + 0.0:.3g}" for c in np.round(axis * np.sign(first), 3)) + ")"


def _cell_bodies(brake: Brake) -> tuple[Index, dict[str, Index]]:
    """Body of each cell, and the cells of each part."""
    V, mesh = brake.elastic.free.V, brake.mesh
    topology = mesh.domain.topology
    cells = np.arange(topology.index_map(topology.dim).size_local)
    parts: dict[str, list[Index]] = {}
    for layer, tag in mesh.layers.items():
        parts.setdefault(layer.partition(".")[0], []).append(mesh.cell_tags.find(tag))
    body = body_of_nodes(V)[compat.cell_dofs(V, cells)[:, 0]]
    return body, {name: np.concatenate(own) for name, own in parts.items()}


def _names(scene: Scene, brake: Brake, count: int) -> list[list[str]]:
    """The part or parts of each body; several where they share nodes."""
    body, parts = _cell_bodies(brake)
    every: list[list[str]] = [[] for _ in range(count)]
    for name, cells in parts.items():
        for one in np.unique(body[cells]):
            every[one].append(name)
    given = (name for name, part in scene.parts.items() if part.matrices is not None)
    for number, name in enumerate(given, int(body.max()) + 1):
        if number < count:
            every[number].append(name)
    return every


def _pieces(brake: Brake, joined: Index) -> dict[str, str]:
    """Parts in several pieces that no joint connects, with nodes in the same places."""
    body, parts = _cell_bodies(brake)
    domain = brake.mesh.domain
    nodes, said = compat.geometry_dofs(domain), {}
    for name, cells in parts.items():
        of = {one: np.unique(nodes[cells[body[cells] == one]]) for one in np.unique(body[cells])}
        reach = COINCIDENT * max(brake.mesh.extents[name])
        trees = {one: cKDTree(domain.geometry.x[own]) for one, own in of.items()}
        pairs = sum(
            trees[a].count_neighbors(trees[b], reach)
            for a, b in combinations(of, 2)
            if joined[a] != joined[b]
        )
        if pairs:
            said[name] = f"part {name}: {len(of)} pieces, {pairs} coincident node pairs"
    return said

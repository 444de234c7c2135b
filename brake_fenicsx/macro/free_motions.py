"""Bodies that nothing holds make the stiffness singular: their parts, their directions, the remedy.

Contact counts along its normal alone, as in the stiffness of the equilibrium. A free motion is
named of the smallest set of bodies that moves as one: a body, bodies that are joined, all that
touch. Bodies given by matrices of few digits are not named.
"""

from __future__ import annotations

from collections import Counter
from itertools import combinations

import numpy as np
import scipy.sparse as sp
from scipy.optimize import nnls
from scipy.spatial import cKDTree

from brake_fenicsx import compat
from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene import Scene

from . import rigid_motions as rigid
from .brake import Brake
from .faces import body_of_nodes
from .parts import file_parts
from .rigid_motions import Array, Index

# Round-off of a row of K R and of N R over the sum of the magnitudes of its terms.
ROUND_OFF = 1e-12, 1e-7
# Distance of a direction from a space below which it lies in it.
SAME = 1e-3
# Nodes of two pieces closer than this share of the size of their part coincide.
COINCIDENT = 1e-5
# Share of the loads that no contact force balances.
UNBALANCED = 1e-3
# Keywords of mesh files that join or hold parts.
JOINING = ("*TIE", "*COUPLING", "*BOUNDARY")


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
    bodies = rigid.rigid_motions(brake.elastic.free)
    cells = _cell_bodies(brake)
    names = _names(scene, *cells, len(bodies.size))
    joints = sp.vstack([bodies.held, rigid.acting(brake.elastic.K, bodies.R, ROUND_OFF[0])]).tocsr()
    A = sp.vstack([joints, rigid.acting(brake.N, bodies.R, ROUND_OFF[1])]).tocsr()
    joined = rigid.groups(joints)
    pieces = _pieces(brake, *cells, joined)
    motions: Counter[tuple[tuple[str, ...], str]] = Counter()
    for group in rigid.members(rigid.groups(A)):
        for chosen, how in _free_motions(A, bodies, group, joined[group]):
            motions[_parts(names, group[chosen]), how] += 1
    if motions:
        raise SceneError(f"{scene.file}: {_refusal(scene, brake, motions, pieces)}")
    merge = [f"{said}; merge them in the mesh" for said in pieces.values()]
    return merge + _unpressed(brake, bodies, joints, joined, names)


def _unpressed(
    brake: Brake, bodies: rigid.RigidMotions, joints: sp.csr_matrix, joined: Index,
    names: list[list[str]],
) -> list[str]:  # fmt: skip
    """Bodies that contact alone holds in some directions, and that the loads do not press on it.

    Forces P >= 0 of the contact elements, without friction, that balance the loads on the free
    motions Q of the joined bodies, Q' R' (f + N' P) = 0; a displacement of supports presses too.
    """
    gaps, loads = [], []
    every = rigid.members(joined)
    for group in every:
        columns = rigid.columns_of(group)
        motion = bodies.R[:, columns] @ rigid.null_space(rigid.constraints(joints, columns))
        gaps.append(brake.N @ motion)
        loads.append(motion.T @ brake.f)
    if brake.lift is not None or not sum(map(len, loads)):
        return []
    P = nnls(np.hstack(gaps).T, -np.concatenate(loads))[0]
    lines = []
    for group, gap, load in zip(every, gaps, loads, strict=True):
        lost = np.linalg.norm(gap.T @ P + load) >= UNBALANCED * brake.pressed
        # Without a gap that opens it moves nothing: a body of few coordinates.
        if gap.any() and (lost or not P @ np.abs(gap).sum(axis=1) > 0):
            lines.append(
                f"part {' and '.join(_parts(names, group))}: held by contact alone in some"
                f" directions, and {'pushed away from it' if lost else 'not pressed on it'} by the"
                " loads; correct the loads, or write supports, ties or springs"
            )
    return lines


def _refusal(
    scene: Scene, brake: Brake, motions: Counter[tuple[tuple[str, ...], str]],
    pieces: dict[str, str],
) -> str:  # fmt: skip
    """What moves freely, and the remedies."""
    said = []
    for (parts, how), count in motions.items():
        one, together = ("parts", " together") if len(parts) > 1 else ("part", "")
        bodies = f"{count} pieces of part" if count > 1 else one
        said.append(f"{bodies} {' and '.join(parts)}{together}: free to {how}")
    free = {name for parts, _ in motions for name in parts}
    said += [f"{text}: merge them in the mesh" for name, text in pieces.items() if name in free]
    lost = [word for word in JOINING if word in " ".join(brake.mesh.unread.changing)]
    if lost and (of_file := [name for name in file_parts(scene) if name in free]):
        said.append(
            f"{scene.mesh.file}, the mesh of {' and '.join(of_file)}, has {' and '.join(lost)},"
            " which is not read"
        )
    return (
        f"{'; '.join(said)}. Hold them by supports, ties or springs; contact holds along its"
        " normal alone"
    )


def _parts(names: list[list[str]], bodies: Index) -> tuple[str, ...]:
    """Parts of some bodies."""
    return tuple(dict.fromkeys(name for body in bodies for name in names[body]))


def _free_motions(
    A: sp.csr_matrix, bodies: rigid.RigidMotions, group: Index, joined: Index
) -> list[tuple[Index, str]]:
    """Free motions of bodies that touch: of each alone, of those that are joined, and of all.

    Returns:
        Which of the bodies, and how they move.
    """
    columns, every = rigid.columns_of(group), np.arange(len(group))
    own = rigid.constraints(A, columns)
    dimension = rigid.null_space(own).shape[1]
    # Bodies given by matrices may have so few coordinates that some motions move none of them.
    moved = sp.vstack([bodies.held[:, columns], bodies.R[:, columns]])
    named = rigid.null_space((moved.T @ moved).toarray())
    motions = []
    for chosen in [*every[:, None], *rigid.members(joined), every]:
        if named.shape[1] < dimension:
            E = rigid.as_one(bodies, group, chosen)
            said, named = _directions(rigid.null_space(own @ E), E, named)
            motions += [(chosen, said)] if said else []
    if left := dimension - named.shape[1]:
        motions.append((every, f"move against each other in {left} ways"))
    return motions


def _directions(Q: Array, E: Array, named: Array) -> tuple[str, Array]:
    """Directions of free motions of some bodies as one that are not named yet.

    Args:
        Q: the motions, shape (6, number).
        E: motions of the bodies of the group for the six, shape (6 bodies, 6).
        named: orthonormal motions of the group that are named, shape (6 bodies, number).

    Returns:
        The directions as text, and all motions that are named then.
    """
    turning, values, right = np.linalg.svd(Q[3:])
    rank = np.count_nonzero(values > SAME)
    shifts, turns = Q @ right[rank:].T, Q @ right[:rank].T / values[:rank]
    said = []
    for word, space, motion in (
        ("move along", shifts[:3], shifts), ("turn about", turning[:, :rank], turns)
    ):  # fmt: skip
        labels: list[str] = []
        for axis in _axes(space):
            v = E @ motion @ (space.T @ axis)
            new = v - named @ (named.T @ v)
            if (size := np.linalg.norm(new)) > SAME * np.linalg.norm(v):
                named = np.column_stack([named, new / size])
                labels.append(_label(axis))
        if labels:
            first = ", ".join(labels[:-1]) + " and " * (len(labels) > 1)
            said.append(f"{word} {first}{labels[-1]}")
    return " and ".join(said), named


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


def _names(
    scene: Scene, body: Index, parts: dict[str, Index], count: int
) -> list[list[str]]:  # fmt: skip
    """The part or parts of each body; several where they share nodes."""
    given = [name for name, part in scene.parts.items() if part.matrices is not None]
    every: list[list[str]] = [[] for _ in range(int(body.max()) + 1)] + [[name] for name in given]
    for name, cells in parts.items():
        for one in np.unique(body[cells]):
            every[one].append(name)
    return every[:count]


def _pieces(
    brake: Brake, body: Index, parts: dict[str, Index], joined: Index
) -> dict[str, str]:  # fmt: skip
    """Parts in several pieces that no joint connects, with nodes in the same places."""
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

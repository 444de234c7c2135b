"""Bodies given by their matrices beside those of the mesh: held, tied, sprung and weighted.

Nodes of a set that is tied to a face of the mesh follow the displacement of that face at their
places, exactly: they are eliminated, u_body = T u, and the body adds T' K T, T' M T and T' C T.
"""

import logging
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from brake_fenicsx.arguments import Array, Ints
from brake_fenicsx.build.bodies import added_to_face
from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.elasticity import COMPONENTS, Elastic, FreeDofs
from brake_fenicsx.macro.faces import Face, gather_face, search
from brake_fenicsx.meshing.brake_mesh import Mesh, extent
from brake_fenicsx.scene import Scene

from .superelement import Superelement, doubts, read_superelement, rigid_motions

logger = logging.getLogger(__name__)


# Largest distance between a node and the face it is tied to, where a scene names none, over the
# side of a facet; and how far outside a facet its foot may lie, in reference coordinates.
NEAR, OUTSIDE = 0.05, 1e-3


def with_superelements(scene: Scene, mesh: Mesh, elastic: Elastic) -> Elastic:
    """Add the bodies given by matrices to those of the mesh.

    Args:
        scene: the scene.
        mesh: mesh of the other bodies.
        elastic: the other bodies.

    Returns:
        All bodies: coordinates of those given by matrices that are neither held nor tied follow
        the free dofs of the mesh.

    Raises:
        SceneError: the file, key, value and remedy.
    """
    bodies: dict[str, tuple[Superelement, sp.csr_matrix, Ints]] = {}
    weighed: dict[str, tuple[float, tuple[float, ...]]] = {}
    size, found = elastic.free.size, list(elastic.doubts)
    for name, part in scene.parts.items():
        if part.matrices is None:
            continue
        where = f"parts.{name}.matrices."
        try:
            body, where = read_superelement(scene.file.parent, part.matrices), ""
            tied, kept = _eliminated(scene, name, body, mesh, elastic.free)
        except SceneError as error:
            raise SceneError(f"{scene.file}: {where}{error}") from None
        bodies[name] = body, tied, kept
        along = rigid_motions(body)[:, 0]
        weighed[name] = float(along @ body.M @ along), extent(body.points)
        logger.info(
            "body %s: %d coordinates, %d of them displacements of %d nodes, %d kept; mass %.4g kg",
            name, body.K.shape[0], np.count_nonzero(body.rows >= 0), len(body.points), kept.size,
            weighed[name][0],
        )  # fmt: skip
        found += [f"parts.{name}.matrices: {doubt}" for doubt in doubts(body)]
    total = size + sum(kept.size for _, _, kept in bodies.values())
    out, places, number = _padded(elastic, total), [], size
    for k, (name, (body, tied, kept)) in enumerate(bodies.items()):
        own = (np.ones(kept.size), (kept, number + np.arange(kept.size)))
        tied.resize(tied.shape[0], total)
        T = (tied + sp.csr_matrix(own, shape=tied.shape)).tocsr()
        places.append(_places(body, kept, k))
        number += kept.size
        out = _added(scene, name, body, T, out)
    free = replace(out.free, places=np.concatenate(places))
    return replace(out, free=free, doubts=tuple(found), bodies=weighed)


def _added(
    scene: Scene, name: str, body: Superelement, T: sp.csr_matrix, elastic: Elastic
) -> Elastic:
    """Add one body, and what a scene adds to its sets of nodes."""
    M = (T.T @ body.M @ T).tocsr()
    stiffness, mass, sets = elastic.K + T.T @ body.K @ T, elastic.M + M, dict(elastic.sets)
    damping = [elastic.C, None if body.C is None else T.T @ body.C @ T]
    for one, nodes in body.sets.items():
        face = f"{name}.{one}"
        rows = body.rows[nodes].reshape(-1)
        uses = [f'springs."{n}"' for n, s in scene.springs.items() if face in (s.faces or (n,))]
        uses += [f'{key}."{face}"' for key in ("masses", "loads") if face in getattr(scene, key)]
        if uses and np.any(rows < 0):
            raise SceneError(f"{scene.file}: {uses[0]}: {_lacking(body, nodes)}")
        J = sets[face] = T[np.maximum(rows, 0)]
        if face not in {*scene.springs, *scene.masses}:
            continue
        added = added_to_face(scene, face)
        if added.bedding.any() or (face in scene.masses and scene.masses[face].inertia):
            raise SceneError(f"""{scene.file}: {face!r} is a set of nodes and has no area: leave out
                stiffness_per_area and inertia""")
        each = sp.identity(nodes.size, format="csr") / nodes.size
        stiffness = stiffness + J.T @ sp.kron(each, added.stiffness) @ J
        mass = mass + added.mass * (J.T @ sp.kron(each, np.eye(3)) @ J)
        damping.append(J.T @ sp.kron(each, added.damping) @ J if added.damping.any() else None)
    C = sum(term for term in damping if term is not None)
    masses, C = {**elastic.masses, name: M}, C.tocsr() if sp.issparse(C) else None
    return replace(elastic, K=stiffness.tocsr(), M=mass.tocsr(), C=C, sets=sets, masses=masses)


def _lacking(
    body: Superelement, nodes: Ints, components: tuple[int, ...] | list[int] = (0, 1, 2)
) -> str:
    """What is said of a set with nodes that the matrices have no displacement of."""
    lost = nodes[np.any(body.rows[nodes][:, components] < 0, axis=1)]
    x, y, z = 1e3 * body.points[lost[0]]
    return (
        f"{lost.size} of the set's {nodes.size} nodes, that at ({x:.3g}, {y:.3g}, {z:.3g}) mm the"
        " first, have no displacement in the matrices; compare the numbers in the table of nodes"
        " with those in the matrices, or take these nodes out of the set"
    )


def _padded(elastic: Elastic, total: int) -> Elastic:
    """The bodies of the mesh on all coordinates."""
    matrices = {}
    for name in ("K", "M", "C"):
        A = getattr(elastic, name)
        if A is not None:
            A = A.copy()
            A.resize(total, total)
        matrices[name] = A
    return replace(elastic, **matrices, free=replace(elastic.free, size=total))


def _eliminated(
    scene: Scene, name: str, body: Superelement, mesh: Mesh, free: FreeDofs
) -> tuple[sp.csr_matrix, Ints]:
    """What ties and supports make of the coordinates of a body.

    Returns:
        The part of T that the mesh's dofs give, shape (coordinates, free dofs of the mesh), and
        the coordinates that are kept.
    """
    taken: dict[int, str] = {}
    tied = sp.csr_matrix((body.K.shape[0], free.size))

    def take(nodes: Ints, components: list[int], where: str) -> None:
        rows = body.rows[nodes][:, components].reshape(-1)
        if np.any(rows < 0):
            raise SceneError(f"{where}: {_lacking(body, nodes, components)}")
        for row in map(int, rows):
            if row in taken:
                raise SceneError(f"{where}: a node of the set is held by {taken[row]} already")
            taken[row] = where

    for face, held in scene.supports.items():
        part, _, one = face.partition(".")
        if part == name:
            take(body.sets[one], [COMPONENTS[c] for c in held], f'supports."{face}"')
    for key, tie in scene.ties.items():
        ends = [face for face in tie.faces if face.partition(".")[0] == name]
        if not ends:
            continue
        where = f"ties.{key}"
        (other,) = [face for face in tie.faces if face not in ends] or [""]
        if other not in mesh.faces:
            raise SceneError(f"""{where}.faces = {list(tie.faces)!r}: a set of nodes is tied to a
                face of the mesh; join two bodies given by matrices by springs""")
        if tie.stiffness is not None:
            raise SceneError(f"{where}.stiffness: nodes are tied exactly; leave it out")
        nodes = body.sets[ends[0].partition(".")[2]]
        take(nodes, [0, 1, 2], where)
        master = gather_face(mesh, free, other)
        columns, weights, distance = _feet(master, body.points[nodes])
        side = float(2 * master.radius.max())
        reach = NEAR * side if tie.search is None else tie.search
        if distance.max() > reach:
            i = int(distance.argmax())
            x, y, z = 1e3 * body.points[nodes[i]]
            raise SceneError(f"""{where}: node at ({x:.3g}, {y:.3g}, {z:.3g}) mm of {ends[0]!r} lies
                {1e3 * distance[i]:.3g} mm from {other!r}, {1e3 * reach:.3g} mm are allowed; correct
                the units or the place, or write search = "{1.1e3 * distance[i]:.3g} mm" """)
        rows = np.broadcast_to(body.rows[nodes][:, None], columns.shape)
        share = np.broadcast_to(weights[..., None], columns.shape)
        there = columns >= 0
        tied = tied + sp.csr_matrix((share[there], (rows[there], columns[there])), tied.shape)
    return tied, np.setdiff1d(np.arange(body.K.shape[0]), np.array([*taken], dtype=int))


def _feet(face: Face, x: Array) -> tuple[Ints, Array, Array]:
    """Where points lie on a face: dofs and shape functions there, and distances [m]."""
    tree = cKDTree(face.centre)
    count = min(12, len(face.centre))
    near = tree.query(x, count)[1].reshape(len(x), -1)
    point = np.repeat(np.arange(len(x)), near.shape[1])
    facet, local, gap, miss = search(face, x, face.normal[near[:, 0]], point, near.reshape(-1))
    distance = np.where(miss <= OUTSIDE, np.abs(gap), np.inf)
    lost = ~np.isfinite(distance)
    # No foot on the face: the distance from its nearest node.
    distance[lost] = cKDTree(face.nodes.reshape(-1, 3)).query(x[lost])[0] if lost.any() else 0.0
    shape = face.element.shape(local[:, None])[:, 0]
    return face.columns[facet], shape, distance


def _places(body: Superelement, kept: Ints, number: int) -> Array:
    """Place [m], direction (3: none) and number of the body of each coordinate, shape (kept, 5)."""
    out = np.empty((body.K.shape[0], 5))
    out[:] = [*body.points.mean(axis=0), 3, number]
    node, component = np.nonzero(body.rows >= 0)
    rows = body.rows[node, component]
    out[rows, :3], out[rows, 3] = body.points[node], component
    return out[kept]

"""Real modes of one body of a scene, and their shapes at points of its surface."""

from __future__ import annotations

from dataclasses import dataclass, replace

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from brake_fenicsx.errors import InaccurateResult, SceneError
from brake_fenicsx.macro.brake import assemble_bodies
from brake_fenicsx.macro.elasticity import Elastic, FreeDofs
from brake_fenicsx.macro.faces import Face, gather_face
from brake_fenicsx.macro.mesh import Mesh, raw_mesh, tagged_mesh
from brake_fenicsx.macro.meshing.groups import mesh_of_file
from brake_fenicsx.macro.meshing.rawmesh import (
    RawMesh,
    exterior_facets,
    facet_keys,
    without_unused_nodes,
)
from brake_fenicsx.macro.parts import file_parts, scene_parts
from brake_fenicsx.macro.projection import EDGE, project
from brake_fenicsx.scene import Scene
from brake_fenicsx.stability.eigensolvers.symmetric import shifted_factor, symmetric_modes

Array = NDArray[np.float64]

# Rigid-body modes lie below this share of the highest frequency.
RIGID = 1e-3


@dataclass(frozen=True, slots=True)
class PartModes:
    """Elastic modes of a body below a frequency, all of them by an inertia count.

    Attributes:
        frequency: ascending, shape (modes,) [Hz].
        shapes: M-orthonormal, shape (free dofs, modes).
        rigid: number of rigid-body modes, which are left out.
        mesh: mesh of the body.
        free: numbering of its free dofs.
    """

    frequency: Array
    shapes: Array
    rigid: int
    mesh: Mesh
    free: FreeDofs


def part_modes(
    scene: Scene, name: str, near: Array, highest: float, supported: bool = False
) -> PartModes:
    """Modes of a part by itself: without contact, ties and loads.

    Args:
        scene: the scene.
        name: the part; of one that has several bodies, as a pair of pads, the body at ``near``.
        near: points of the body [m], shape (points, 3).
        highest: end of the frequencies [Hz].
        supported: keep supports, springs and masses of the part's faces; free if not.

    Raises:
        SceneError: the part cannot be built.
        InaccurateResult: its stiffness is indefinite, or modes are missing.
    """
    mesh, elastic = part_body(scene, name, near, supported)
    where = f"{scene.file}: parts.{name}"
    frequency, shapes, rigid = elastic_modes(where, elastic.K, elastic.M, highest)
    return PartModes(frequency, shapes, rigid, mesh, elastic.free)


def part_body(
    scene: Scene, name: str, near: Array, supported: bool = False
) -> tuple[Mesh, Elastic]:
    """Mesh and matrices of a part by itself; see ``part_modes``."""
    try:
        raw = _body(_raw_mesh(scene, name), name, near)
        mesh = tagged_mesh(lambda: raw, MPI.COMM_SELF, scene.mesh)
    except SceneError as error:
        raise SceneError(f"{scene.file}: {error}") from None
    keep = set(mesh.faces) if supported else set()
    alone = replace(
        scene,
        parts={name: scene.parts[name]}, contact={}, ties={}, loads={},
        supports={face: held for face, held in scene.supports.items() if face in keep},
        masses={face: added for face, added in scene.masses.items() if face in keep},
        springs={n: s for n, s in scene.springs.items() if keep.issuperset(s.faces or [n])},
    )  # fmt: skip
    elastic = assemble_bodies(alone, mesh)
    M = elastic.M.copy()
    # The three components of a displacement share no mass: two thirds of the pattern.
    M.eliminate_zeros()
    return mesh, replace(elastic, M=M)


def elastic_modes(
    where: str, K: sp.csr_matrix, M: sp.csr_matrix, highest: float
) -> tuple[Array, Array, int]:
    """Elastic modes of a body below a frequency, counted by inertia.

    Args:
        where: what the body is, for a message.
        K: stiffness [N/m].
        M: mass [kg].
        highest: end of the frequencies [Hz].

    Returns:
        Frequencies [Hz], M-orthonormal shapes, and the number of rigid-body modes left out.

    Raises:
        InaccurateResult: its stiffness is indefinite, or modes are missing.
    """
    end = (2 * np.pi * highest) ** 2
    shifted = shifted_factor(K, M, end)
    if shifted is None:
        raise InaccurateResult(f"{where}: its stiffness is indefinite")
    found = symmetric_modes(K, M, *shifted, end)
    found.factor.destroy()
    frequency = np.sqrt(np.maximum(found.kappa, 0.0)) / (2 * np.pi)
    elastic = frequency > RIGID * highest
    return frequency[elastic], found.Phi[:, elastic], int(np.sum(~elastic))


def _raw_mesh(scene: Scene, name: str) -> RawMesh:
    """Mesh that holds a part: its own, or that of the file."""
    builders = scene_parts(scene)
    if name in builders:
        return raw_mesh({name: builders[name]}, scene.mesh)
    return mesh_of_file(scene.file.parent, scene.mesh, file_parts(scene))


def _body(mesh: RawMesh, name: str, near: Array) -> RawMesh:
    """The body of a part that points lie on; its unnamed boundary facets become a face too."""
    own = mesh.part(name)
    cells = mesh.corners[own]
    rows = np.repeat(np.arange(len(cells)), cells.shape[1])
    pattern = (np.ones(cells.size), (rows, cells.reshape(-1)))
    links = sp.csr_matrix(pattern, shape=(len(cells), len(mesh.points)))
    both = sp.bmat([[None, links], [links.T, None]])
    number = connected_components(both, directed=False)[1][: len(cells)]
    away = {
        i: KDTree(mesh.points[cells[number == i]].reshape(-1, 3)).query(near)[0].max()
        for i in np.unique(number)
    }
    chosen = np.flatnonzero(own)[number == min(away, key=lambda i: away[i])]
    layers = {n: tag for n, tag in mesh.layers.items() if n.partition(".")[0] == name}
    body = replace(
        mesh, cells=mesh.cells[chosen], cell_tag=mesh.cell_tag[chosen], layers=layers
    )  # fmt: skip
    outside = exterior_facets(body, name)
    kept = np.isin(facet_keys(mesh.facets), facet_keys(outside))
    unnamed = outside[~np.isin(facet_keys(outside), facet_keys(mesh.facets[kept]))]
    faces = {n: tag for n, tag in mesh.faces.items() if tag in mesh.facet_tag[kept]}
    last = 1 + max(mesh.faces.values(), default=0)
    if len(unnamed):
        faces[f"{name}.(unnamed)"] = last
    tags = np.concatenate([mesh.facet_tag[kept], np.full(len(unnamed), last)])
    facets = np.concatenate([mesh.facets[kept], unnamed])
    return without_unused_nodes(replace(body, facets=facets, facet_tag=tags, faces=faces))


def shapes_at(modes: PartModes, points: Array) -> tuple[Array, Array, Array]:
    """Shapes at the closest points of the body's surface.

    Args:
        modes: the modes.
        points: positions [m], shape (points, 3).

    Returns:
        Displacements, shape (points, 3, modes); distances to the surface [m], shape (points,);
        largest distance of a node of the facet there from its centre [m], likewise.
    """
    n, m = len(points), modes.shapes.shape[1]
    values, size = np.zeros((n, 3, m)), np.zeros(n)
    distance = np.full(n, np.inf)
    # The last row, which column -1 takes, is of held dofs.
    padded = np.vstack([modes.shapes, np.zeros((1, m))])
    for name in modes.mesh.faces:
        face = gather_face(modes.mesh, modes.free, name)
        facet, local = _closest(face, points)
        away = face.surface(facet, local[:, None])[0][:, 0] - points
        found = np.linalg.norm(away, axis=1)
        nearer = found < distance
        at = face.element.shape(local[nearer])
        columns = face.columns[facet[nearer]]
        values[nearer] = np.einsum("na,nacm->ncm", at, padded[columns])
        distance[nearer], size[nearer] = found[nearer], face.radius[facet[nearer]]
    return values, distance, size


def _closest(face: Face, points: Array) -> tuple[NDArray[np.int64], Array]:
    """Facet closest to each point, and the reference coordinates there.

    Of the triangles between the corners; on a curved or twisted facet the ray along its normal
    then leads from the point to the facet, unless it leaves it.
    """
    reference = np.array(face.element.triangles)
    corner = face.corners[:, reference].reshape(-1, 3, 3)
    centre, radius = face.centre, face.radius.max()
    tree = KDTree(centre)
    facet, local = np.zeros(len(points), dtype=np.int64), np.zeros((len(points), 2))
    for i, x in enumerate(points):
        near = np.array(tree.query_ball_point(x, (tree.query(x)[0] + 2 * radius) * (1 + 1e-9)))
        number = (near[:, None] * len(reference) + np.arange(len(reference))).reshape(-1)
        share = _shares(corner[number], x)
        away = np.einsum("na,nac->nc", share, corner[number]) - x
        best = int(np.argmin(np.einsum("nc,nc->n", away, away)))
        facet[i], of = divmod(int(number[best]), len(reference))
        local[i] = share[best] @ face.element.nodes[reference[of]]
    ray, start = face.normal[facet][:, None], local[:, None]
    met = project(face, facet, points[:, None], ray, start)[0][:, 0]
    inside = face.element.outside(met) <= EDGE
    return facet, np.where(inside[:, None], met, local)


def _shares(corner: Array, x: Array) -> Array:
    """Barycentric coordinates of the points of triangles that are closest to x, (triangles, 3)."""
    found = np.zeros((4, len(corner), 3))
    u, v, w = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0], x - corner[:, 0]
    uu, uv, vv, uw, vw = (
        np.einsum("nc,nc->n", a, b) for a, b in ((u, u), (u, v), (v, v), (u, w), (v, w))
    )
    area = uu * vv - uv * uv
    found[0, :, 1], found[0, :, 2] = (vv * uw - uv * vw) / area, (uu * vw - uv * uw) / area
    found[0, :, 0] = 1 - found[0, :, 1] - found[0, :, 2]
    for k, (a, b) in enumerate(((0, 1), (1, 2), (2, 0)), start=1):
        edge = corner[:, b] - corner[:, a]
        along = np.einsum("nc,nc->n", edge, x - corner[:, a]) / np.einsum("nc,nc->n", edge, edge)
        found[k, :, b] = np.clip(along, 0.0, 1.0)
        found[k, :, a] = 1 - found[k, :, b]
    away = np.linalg.norm(np.einsum("kna,nac->knc", found, corner) - x, axis=2)
    away[0, found[0].min(axis=1) < 0] = np.inf
    return np.asarray(found[np.argmin(away, axis=0), np.arange(len(corner))])

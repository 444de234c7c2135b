"""Real modes of one body of a scene, and their shapes at points of its surface."""

import brake_fenicsx.petsc_started  # noqa: F401

# isort: split

from dataclasses import dataclass, replace

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from dolfinx.mesh import exterior_facet_indices
from scipy.spatial import KDTree

from brake_fenicsx import compat
from brake_fenicsx.arguments import Array, Ints
from brake_fenicsx.build.bodies import assemble_bodies
from brake_fenicsx.build.scene_mesh import file_parts, grouped_file, mesh_settings, scene_parts
from brake_fenicsx.errors import InaccurateResult, SceneError
from brake_fenicsx.macro.elasticity import Elastic, FreeDofs
from brake_fenicsx.macro.faces import Face, gather_face
from brake_fenicsx.macro.projection import EDGE, project
from brake_fenicsx.meshing.brake_mesh import Mesh, raw_mesh, tagged_mesh
from brake_fenicsx.meshing.groups import mesh_of_file
from brake_fenicsx.meshing.rawmesh import (
    RawMesh,
    body_of_points,
    exterior_facets,
    facet_keys,
    without_unused_nodes,
)
from brake_fenicsx.scene import Scene
from brake_fenicsx.stability.eigensolvers.symmetric import shifted_factor, symmetric_modes

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
    mesh, elastic, _ = part_body(scene, name, near, supported)
    where = f"{scene.file}: parts.{name}"
    frequency, shapes, rigid = elastic_modes(where, elastic.K, elastic.M, highest)
    return PartModes(frequency, shapes, rigid, mesh, elastic.free)


def part_body(
    scene: Scene, name: str, near: Array, supported: bool = False
) -> tuple[Mesh, Elastic, Scene]:
    """Mesh and matrices of a part by itself, and the scene of it; see ``part_modes``."""
    try:
        raw = _body(_raw_mesh(scene, name), name, near)
        mesh = tagged_mesh(lambda: raw, MPI.COMM_SELF, mesh_settings(scene))
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
    return mesh, replace(elastic, M=M), alone


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
    shifted[0].destroy()
    frequency = np.sqrt(np.maximum(found.kappa, 0.0)) / (2 * np.pi)
    elastic = frequency > RIGID * highest
    return frequency[elastic], found.Phi[:, elastic], int(np.sum(~elastic))


def _raw_mesh(scene: Scene, name: str) -> RawMesh:
    """Mesh that holds a part: its own, or that of the file."""
    builders = scene_parts(scene)
    if name in builders:
        return raw_mesh({name: builders[name]}, mesh_settings(scene))
    return mesh_of_file(grouped_file(scene.file.parent, scene.mesh), file_parts(scene))


def _body(mesh: RawMesh, name: str, near: Array) -> RawMesh:
    """The body of a part that most points lie next to."""
    own = np.flatnonzero(mesh.part(name))
    cells = mesh.corners[own]
    body = body_of_points(cells, len(mesh.points))
    nodes = np.unique(cells)
    nearest = nodes[KDTree(mesh.points[nodes]).query(near)[1]]
    chosen = own[body[cells[:, 0]] == np.bincount(body[nearest]).argmax()]
    layers = {n: tag for n, tag in mesh.layers.items() if n.partition(".")[0] == name}
    alone = replace(mesh, cells=mesh.cells[chosen], cell_tag=mesh.cell_tag[chosen], layers=layers)
    kept = np.isin(facet_keys(mesh.facets), facet_keys(exterior_facets(alone, name)))
    tags = mesh.facet_tag[kept]
    faces = {n: tag for n, tag in mesh.faces.items() if tag in tags}
    return without_unused_nodes(
        replace(alone, facets=mesh.facets[kept], facet_tag=tags, faces=faces)
    )


def shapes_at(modes: PartModes, points: Array) -> tuple[Array, Array, Array]:
    """Shapes at the closest points of the body's surface.

    Args:
        modes: the modes.
        points: positions [m], shape (points, 3).

    Returns:
        Displacements, shape (points, 3, modes); distances to the surface [m], shape (points,);
        largest distance of a node of the facet there from its centre [m], likewise.
    """
    rows, distance, size = surface_rows(modes.mesh, modes.free, points)
    return (rows @ modes.shapes).reshape(len(points), 3, -1), distance, size


def surface_rows(mesh: Mesh, free: FreeDofs, points: Array) -> tuple[sp.csr_matrix, Array, Array]:
    """Displacements there, shape (3 points, dofs), and distances and sizes; see ``shapes_at``."""
    domain = mesh.domain
    domain.topology.create_connectivity(2, 3)
    tags = compat.meshtags(domain, 2, exterior_facet_indices(domain.topology), 1)
    whole = replace(mesh, facet_tags=tags, faces={"boundary": 1})
    face = gather_face(whole, free, "boundary")
    facet, local = _closest(face, points)
    shape, columns = face.element.shape(local), face.columns[facet]
    row = np.broadcast_to(np.arange(3 * len(points)).reshape(-1, 1, 3), columns.shape)
    value, held = np.broadcast_to(shape[:, :, None], columns.shape), columns < 0
    entries = value[~held], (row[~held], columns[~held])
    away = np.einsum("na,nac->nc", shape, face.nodes[facet]) - points
    rows = sp.csr_matrix(entries, (3 * len(points), free.size))
    return rows, np.linalg.norm(away, axis=1), face.radius[facet]


def _closest(face: Face, points: Array) -> tuple[Ints, Array]:
    """Facet closest to each point, and the reference coordinates there.

    Of the triangles between the corners; on a curved or twisted facet the ray along its normal
    then leads from the point to the facet, unless it leaves it.
    """
    reference = np.array(face.element.triangles)
    corner = face.corners[:, reference]
    tree, reach = KDTree(face.centre), 2 * face.radius.max()
    facet, local = np.zeros(len(points), dtype=np.int64), np.zeros((len(points), 2))
    for i, x in enumerate(points):
        near = np.array(tree.query_ball_point(x, (tree.query(x)[0] + reach) * (1 + 1e-9)))
        share = _shares(corner[near], x)
        away = np.linalg.norm(np.einsum("nta,ntac->ntc", share, corner[near]) - x, axis=2)
        best, of = np.unravel_index(np.argmin(away), away.shape)
        facet[i], local[i] = near[best], share[best, of] @ face.element.nodes[reference[of]]
    ray, start = face.normal[facet][:, None], local[:, None]
    met = project(face, facet, points[:, None], ray, start)[0][:, 0]
    inside = face.element.outside(met) <= EDGE
    return facet, np.where(inside[:, None], met, local)


def _shares(corner: Array, x: Array) -> Array:
    """Barycentric coordinates of the points of triangles closest to x, shape (..., 3) as corners.

    The foot of x in the plane, if it lies inside, or else the closest point of an edge.
    """
    edge = np.roll(corner, -1, axis=-2) - corner
    normal = np.cross(edge[..., 0, :], edge[..., 1, :])[..., None, :]
    # The triangle of x and an edge, over the whole one, is the share of the corner opposite.
    area = np.sum(np.cross(edge, x - corner) * normal, axis=-1) / np.sum(normal**2, axis=-1)
    inside = np.roll(area, -1, axis=-1)
    t = np.clip(np.sum(edge * (x - corner), axis=-1) / np.sum(edge**2, axis=-1), 0.0, 1.0)
    onto = (1 - t)[..., None] * np.eye(3) + t[..., None] * np.roll(np.eye(3), 1, axis=1)
    away = np.linalg.norm(onto @ corner - x, axis=-1).argmin(axis=-1)[..., None, None]
    on_edge = np.take_along_axis(onto, away, axis=-2)[..., 0, :]
    return np.where(inside.min(axis=-1, keepdims=True) >= 0, inside, on_edge)

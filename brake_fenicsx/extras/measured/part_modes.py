"""Real modes of one body of a scene, their shapes at points of its surface, and receptances there.

For receptances, (K - omega^2 M + i omega C) u = f, K complex with loss factors, is projected on a
few vectors for all frequencies: all real modes up to one beyond the band, rigid-body motions
included, and the static answers to the forces and at the points seen (residual vectors: MacNeal,
Comput. Struct. 1 (1971) 581). The equation is then solved as it stands where its residual is
largest. That tells the error; where it is too large, the solution joins the vectors.
"""

import brake_fenicsx.petsc_started  # noqa: F401

# isort: split

from dataclasses import dataclass, replace

from mpi4py import MPI

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from dolfinx.mesh import exterior_facet_indices
from scipy.spatial import KDTree

from brake_fenicsx import compat
from brake_fenicsx.arguments import Array, Complex, Ints
from brake_fenicsx.build.bodies import assemble_bodies
from brake_fenicsx.build.scene_mesh import file_parts, grouped_file, mesh_settings, scene_parts
from brake_fenicsx.errors import InaccurateResult, SceneError
from brake_fenicsx.macro.elasticity import Elastic, FreeDofs
from brake_fenicsx.macro.faces import EDGE, Face, gather_face, project
from brake_fenicsx.macro.solver import Factor
from brake_fenicsx.meshing import rawmesh
from brake_fenicsx.meshing.brake_mesh import Mesh, raw_mesh, tagged_mesh
from brake_fenicsx.meshing.groups import mesh_of_file
from brake_fenicsx.scene import Scene
from brake_fenicsx.stability.eigensolvers.symmetric import shifted_factor, symmetric_modes

# Rigid-body modes lie below this share of the highest frequency.
RIGID = 1e-3

# Modes reach this multiple of the band; vectors that others hold up to this share are left out.
BEYOND, SMALL = 1.5, 1e-7
# Error that is small enough, and the most solutions at full order.
ENOUGH, ROUNDS = 1e-4, 6


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


def _raw_mesh(scene: Scene, name: str) -> rawmesh.RawMesh:
    """Mesh that holds a part: its own, or that of the file."""
    builders = scene_parts(scene)
    if name in builders:
        return raw_mesh({name: builders[name]}, mesh_settings(scene))
    return mesh_of_file(grouped_file(scene.file.parent, scene.mesh), file_parts(scene))


def _body(mesh: rawmesh.RawMesh, name: str, near: Array) -> rawmesh.RawMesh:
    """The body of a part that most points lie next to."""
    own = np.flatnonzero(mesh.part(name))
    cells = mesh.corners[own]
    body = rawmesh.body_of_points(cells, len(mesh.points))
    nodes = np.unique(cells)
    nearest = nodes[KDTree(mesh.points[nodes]).query(near)[1]]
    chosen = own[body[cells[:, 0]] == np.bincount(body[nearest]).argmax()]
    layers = {n: tag for n, tag in mesh.layers.items() if n.partition(".")[0] == name}
    alone = replace(mesh, cells=mesh.cells[chosen], cell_tag=mesh.cell_tag[chosen], layers=layers)
    kept = np.isin(
        rawmesh.facet_keys(mesh.facets), rawmesh.facet_keys(rawmesh.exterior_facets(alone, name))
    )
    tags = mesh.facet_tag[kept]
    faces = {n: tag for n, tag in mesh.faces.items() if tag in tags}
    return rawmesh.without_unused_nodes(
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


@dataclass(frozen=True, slots=True)
class Receptances:
    """Displacement over force.

    Attributes:
        H: receptances [m/N], shape (frequencies, seen, forces).
        error: of the entry of H that is worst at the frequency below, over the largest modulus of
            that entry in the band.
        worst: frequency at which the residual was largest and full order was solved last [Hz].
        modes: number of modes projected on.
    """

    H: Complex
    error: float
    worst: float
    modes: int


@dataclass(frozen=True, slots=True)
class Damped:
    """A body with damping.

    Attributes:
        K: stiffness [N/m], symmetric; complex with loss factors.
        M: mass [kg].
        C: viscous damping [N s/m]; zero where there is none.
        W: M-orthonormal modes with damping ratios of their own, shape (dofs, modes).
        ratio: 2 zeta omega of each [1/s], shape (modes,).
    """

    K: sp.csr_matrix
    M: sp.csr_matrix
    C: sp.csr_matrix
    W: Array
    ratio: Array

    def answer(self, omega: float, forces: Array) -> Complex:
        """Displacements at full order to forces with the angular frequency omega [rad/s].

        In real numbers, [[A, -B], [-B, -A]] of the real and the imaginary part; symmetric if B is.
        """
        A, B = self.K.real - omega**2 * self.M, omega * self.C + self.K.imag
        both = sp.bmat([[A, -B], [-B, -A]]).tocsr()
        even = abs(B - B.T).max() <= 1e-12 * abs(B).max()
        factor = Factor(both, "brake_response_", symmetric=bool(even))
        MW = self.M @ self.W
        right = np.hstack([forces, MW])
        x = factor.solve(np.vstack([right, 0 * right]))
        factor.destroy()
        u = x[: len(right)] + 1j * x[len(right) :]
        u, Z = u[:, : forces.shape[1]], u[:, forces.shape[1] :]
        # (A + iB + i omega MW d W'M)^-1 by Woodbury's formula.
        d = 1j * omega * self.ratio[:, None]
        inner = np.eye(len(d)) + d * (MW.T @ Z)
        return np.asarray(u - Z @ np.linalg.solve(inner, d * (MW.T @ u)))


def real_modes(
    K: sp.csr_matrix, M: sp.csr_matrix, highest: float, forces: Array
) -> tuple[Array, Array, Array]:
    """All real modes below a frequency, counted, and static answers.

    Args:
        K: stiffness [N/m].
        M: mass [kg].
        highest: end of the modes [Hz].
        forces: shape (dofs, forces).

    Returns:
        M-orthonormal shapes with rigid-body modes, angular frequencies [rad/s], and the forces
        times the inverse of K - sigma M with a small negative shift.

    Raises:
        InaccurateResult: the stiffness is indefinite.
    """
    end = (2 * np.pi * highest) ** 2
    shifted = shifted_factor(K, M, end)
    if shifted is None:
        raise InaccurateResult("its stiffness is indefinite")
    found = symmetric_modes(K, M, *shifted, end)
    static = shifted[0].solve(forces)
    shifted[0].destroy()
    return found.Phi, np.sqrt(np.maximum(found.kappa, 0.0)), static


def receptances(
    body: Damped, modes: Array, static: Array, forces: Array, seen: sp.csr_matrix, frequency: Array
) -> Receptances:
    """Receptances on modes, static answers, and solutions at full order where these fall short.

    Args:
        body: the body.
        modes: real modes, shape (dofs, modes).
        static: static answers to the forces and at the points seen, shape (dofs, vectors).
        forces: shape (dofs, forces).
        seen: displacements that are measured, shape (seen, dofs).
        frequency: rising [Hz], shape (frequencies,).
    """
    omega, V = 2 * np.pi * frequency, _orthonormal(body.M, modes, static)
    error = np.inf
    for _ in range(ROUNDS):
        H, residual = _projected(body, V, forces, seen, omega)
        worst = int(np.argmax(residual))
        exact = body.answer(float(omega[worst]), forces)
        largest = np.maximum(np.abs(H).max(axis=0), 1e-300)
        error = float((np.abs(seen @ exact - H[worst]) / largest).max())
        if error <= ENOUGH:
            break
        V = _orthonormal(body.M, V, np.hstack([exact.real, exact.imag]))
    return Receptances(H, error, float(frequency[worst]), modes.shape[1])


def _orthonormal(M: sp.csr_matrix, V: Array, more: Array) -> Array:
    """M-orthonormal vectors with further ones, but for what they hold already."""
    size = np.sqrt(np.einsum("nm,nm->m", more, M @ more))
    more = more[:, size > 0] / size[size > 0]
    for _ in range(2):
        more = more - V @ (V.T @ (M @ more))
    values, turn = la.eigh(more.T @ (M @ more))
    kept = values > SMALL**2
    return np.hstack([V, (more @ turn[:, kept]) / np.sqrt(values[kept])])


def _projected(
    body: Damped, V: Array, forces: Array, seen: sp.csr_matrix, omega: Array
) -> tuple[Complex, Array]:
    """H on vectors V at every frequency, and its residual over the forces, shape (frequencies,)."""
    mass = body.M @ V
    modal = (body.M @ body.W) @ (body.ratio[:, None] * (body.W.T @ mass))
    images = [body.K @ V, mass, body.C @ V + modal]
    K, M, C = (V.T @ image for image in images)
    # The residual lies in the span of the forces and these images: its norm by their triangle.
    triangle = np.linalg.qr(np.hstack([forces, *images]), mode="r")
    inside, out = V.T @ forces, seen @ V
    H = np.empty((omega.size, out.shape[0], forces.shape[1]), complex)
    residual = np.empty(omega.size)
    for i, w in enumerate(omega):
        x = np.linalg.solve(K - w**2 * M + 1j * w * C, inside)
        H[i] = out @ x
        rest = np.vstack([np.eye(forces.shape[1]), -x, w**2 * x, -1j * w * x])
        residual[i] = np.linalg.norm(triangle @ rest)
    return H, residual / np.linalg.norm(forces)


def frac(test: Complex, model: Complex) -> float:
    """Frequency response assurance criterion, 1 for the same response but for a complex factor.

    Args:
        test: measured response, shape (frequencies,).
        model: computed one.

    Reference: W. Heylen and S. Lammens, Identification in Engineering Systems (Swansea, 1996) 48.
    """
    scale = np.vdot(test, test).real * np.vdot(model, model).real
    return float(abs(np.vdot(test, model)) ** 2 / scale) if scale > 0 else 0.0

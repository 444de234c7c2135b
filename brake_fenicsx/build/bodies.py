"""Bodies of a scene: parts with their supports, springs, masses and ties, and the loads on them.

Springs and masses act on single faces, springs also between two, a mass may have rotational
inertia; ties glue two faces.

Loads are a pressure, a force and a moment, or the displacement of a support. Pressures and forces
are dead: they do not turn with the face. A force F and a moment m about the centroid of the face
are spread as the traction whose virtual work is F . mean displacement + m . mean rotation
(``macro.tie``): uniform, and linear in x, y, z. A displacement g of held dofs, zero
elsewhere, gives u = u' + g and the load -K g on the free dofs.
"""

import logging
from collections.abc import Mapping
from dataclasses import replace
from itertools import product

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import SceneError, located
from brake_fenicsx.extensions import provided
from brake_fenicsx.macro import elasticity
from brake_fenicsx.macro import tie as glue
from brake_fenicsx.macro.elasticity import Elastic
from brake_fenicsx.macro.faces import Face, faces_of_bodies, gather_face
from brake_fenicsx.macro.integrals import facet_areas
from brake_fenicsx.macro.material import Material
from brake_fenicsx.macro.solver import with_interface
from brake_fenicsx.meshing.brake_mesh import Mesh
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.parts_section import Load

from .material_table import layer_materials

logger = logging.getLogger(__name__)
# Share of a face that its ties glue, below which it is said.
GLUED = 0.95

# Pressure of light braking [Pa].
USUAL = 1e5


def assemble_bodies(scene: Scene, mesh: Mesh) -> Elastic:
    """Assemble the bodies of a scene: supports, springs, masses, ties; no contact, no loads.

    Args:
        scene: the scene.
        mesh: its mesh.

    Raises:
        SceneError: a face, layer or material does not fit.
    """
    layers = layer_materials(scene, mesh.layers)
    supports = {f: list(held) for f, held in scene.supports.items() if not on_matrices(scene, f)}
    sprung = [name for name, spring in scene.springs.items() if spring.faces is None]
    named = [f for f in dict.fromkeys([*sprung, *scene.masses]) if not on_matrices(scene, f)]
    added = [added_to_face(scene, face) for face in named]
    elastic = elasticity.assemble_elastic(
        mesh, layers, supports, scene.mesh.degree, added, scene.mesh.mass == "lumped"
    )
    if any(part.matrices for part in scene.parts.values()):
        elastic = provided("bodies", "parts.NAME.matrices", "matrices")(scene, mesh, elastic)
    glued: dict[str, glue.GluedFaces] = {}
    for name, tie in scene.ties.items():
        if any(face in elastic.sets for face in tie.faces):
            continue
        with located(f"{scene.file}: ties.{name}"):
            glued[name] = _layer(scene, name, mesh, elastic, layers)
        elastic = replace(elastic, K=elastic.K + glued[name].K)
    elastic = replace(elastic, doubts=(*elastic.doubts, *_glued_in_part(scene, glued)))
    for name, spring in scene.springs.items():
        if spring.faces is not None:
            with located(f"{scene.file}: springs.{name}"):
                elastic = _sprung(scene, name, mesh, elastic)
    for name, mass in scene.masses.items():
        if mass.inertia is not None:
            with located(f'{scene.file}: masses."{name}"'):
                elastic = _inert(scene, name, mesh, elastic)
    return elastic


def on_matrices(scene: Scene, face: str) -> bool:
    """Whether a face is a set of nodes of a body given by matrices."""
    part = scene.parts.get(face.partition(".")[0])
    return part is not None and part.matrices is not None


def added_to_face(scene: Scene, face: str) -> elasticity.FaceAddition:
    """Springs, dashpots and mass that a scene adds to a face, in x, y, z axes."""
    spring, mass, turn = scene.springs.get(face), scene.masses.get(face), part_axes(scene, face)

    def turned(key: str) -> Array:
        return np.asarray(turn @ np.diag(getattr(spring, key, None) or np.zeros(3)) @ turn.T)

    total, bedding, damping = map(turned, ("stiffness", "stiffness_per_area", "damping"))
    return elasticity.FaceAddition(
        face, total, 0.0 if mass is None else mass.mass, bedding, damping
    )


def part_axes(scene: Scene, face: str) -> Array:
    """Axes 1, 2 and z of the part of a face as columns, shape (3, 3)."""
    part = scene.parts.get(face.partition(".")[0])
    angle = 0.0 if part is None else part.axis
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _layer(
    scene: Scene, name: str, mesh: Mesh, elastic: Elastic, materials: Mapping[str, Material]
) -> glue.GluedFaces:
    """The layer of a tie."""
    tie = scene.ties[name]
    faces = tie.faces[0], tie.faces[1]
    found = glue.tied_faces(mesh, elastic.free, faces, materials, tie.stiffness, tie.search)
    left = 1e6 * max(found.uncovered, 0.0)
    rest = f", {left:.4g} mm^2 of {faces[0]} not" if left > 1e-3 else ""
    logger.info(
        "tie %s: %.4g mm^2 glued%s; gap up to %.5g um; stiffness of the layer %.3g N/mm³",
        *(name, 1e6 * found.area, rest, round(1e6 * found.gap, 3), 1e-9 * found.stiffness),
    )
    return found


def _glued_in_part(scene: Scene, layers: Mapping[str, glue.GluedFaces]) -> list[str]:
    """Ties both faces of which are larger than what is glued of them, by these ties together."""
    whole: dict[str, float] = {}
    glued: dict[str, float] = {}
    for name, layer in layers.items():
        for face, area in zip(scene.ties[name].faces, layer.areas, strict=True):
            whole[face] = area
            glued[face] = glued.get(face, 0.0) + layer.area
    lines = []
    for name in layers:
        face = max(scene.ties[name].faces, key=lambda face: glued[face] / whole[face])
        if glued[face] < GLUED * whole[face]:
            lines.append(
                f"ties.{name}: {1e6 * glued[face]:.4g} of {1e6 * whole[face]:.4g} mm^2 of {face}"
                f" are glued; correct the place of the parts, the faces, or ties.{name}.search"
            )
    return lines


def _sprung(scene: Scene, name: str, mesh: Mesh, elastic: Elastic) -> Elastic:
    """Add springs and dashpots between the mean displacements of two faces, body by body."""
    spring, free = scene.springs[name], elastic.free
    ends = spring.faces or ()
    faces = {f: _on_bodies(mesh, elastic, f) for f in ends if f not in elastic.sets}
    glue.check_size([part for parts in faces.values() for part, _ in parts])
    means = {
        f: [(glue.mean_of_nodes(nodes), 1.0)] for f, nodes in elastic.sets.items() if f in ends
    }
    for face, parts in faces.items():
        means[face] = [(glue.mean_displacement(part, free.size), share) for part, share in parts]
    first, second = (means[face] for face in ends)
    if min(len(first), len(second)) > 1:
        raise SceneError(f"""faces = {list(ends)!r}: {len(first)} bodies have the first face and
            {len(second)} the second, and which of them the springs join is open; give each body a
            part of its own""")
    axes = sp.csr_matrix(part_axes(scene, ends[0]).T)
    for (one, share), (other, rest) in product(first, second):
        J = (axes @ (one - other)).tocsr()
        if spring.stiffness is not None:
            k = share * rest * np.array(spring.stiffness)
            elastic = replace(elastic, K=with_interface(elastic.K, J, k, J))
        if spring.damping is not None:
            C = sp.csr_matrix(elastic.K.shape) if elastic.C is None else elastic.C
            c = share * rest * np.array(spring.damping)
            elastic = replace(elastic, C=with_interface(C, J, c, J))
    return elastic


def _inert(scene: Scene, name: str, mesh: Mesh, elastic: Elastic) -> Elastic:
    """Add the moments of inertia on a face to the mass, to each body its share."""
    faces = _on_bodies(mesh, elastic, name)
    glue.check_size([face for face, _ in faces])
    turn = sp.csr_matrix(part_axes(scene, name).T)
    for face, share in faces:
        J = (turn @ glue.mean_rotation(face, elastic.free.size)).tocsr()
        inertia = share * np.array(scene.masses[name].inertia)
        elastic = replace(elastic, M=with_interface(elastic.M, J, inertia, J))
    return elastic


def _on_bodies(mesh: Mesh, elastic: Elastic, name: str) -> list[tuple[Face, float]]:
    """The parts of a face that lie on one body each, with their shares of its area."""
    faces = faces_of_bodies(elastic.free, gather_face(mesh, elastic.free, name))
    areas = np.array([facet_areas(face).sum() for face in faces])
    return [*zip(faces, areas / areas.sum(), strict=True)]


def load_vectors(scene: Scene, mesh: Mesh, elastic: Elastic) -> tuple[Array, Array]:
    """Loads of a scene, in the order of their names.

    Args:
        scene: the scene.
        mesh: its mesh.
        elastic: all bodies.

    Returns:
        Nodal forces, shape (free dofs, loads): of 1 Pa [N/Pa] for a pressure, of the whole [N] for
        a force with its moment or a displacement; and what the scene multiplies them by, the
        pressure or 1.

    Raises:
        SceneError: a set of nodes under a pressure or a moment.
    """
    vectors = [_vector(scene, mesh, elastic, face) for face in sorted(scene.loads)]
    sizes = [load.size for _, load in sorted(scene.loads.items())]
    return np.array(vectors).reshape(len(vectors), elastic.free.size).T, np.array(sizes)


def lift(mesh: Mesh, free: elasticity.FreeDofs, loads: Mapping[str, Load]) -> Array:
    """Prescribed displacements of some loads on the dofs of the mesh [m], by their faces."""
    g = np.zeros((free.column.size // 3, 3))
    for face, load in loads.items():
        for name, value in (load.displacement or {}).items():
            nodes = np.unique(gather_face(mesh, free, face).number)
            g[nodes, elasticity.COMPONENTS[name]] = value
    return g.reshape(-1)


def pressing(scene: Scene, mesh: Mesh, area: float) -> float:
    """Sum of the sizes of all forces of a scene's loads [N], or a usual one.

    Args:
        scene: the scene.
        mesh: its mesh.
        area: of the contact [m^2].
    """
    forces = 0.0
    for face, load in scene.loads.items():
        if load.pressure is not None:
            forces += load.pressure * elasticity.face_area(mesh, face)
        elif load.force is not None:
            forces += float(np.linalg.norm(load.force))
    # Displacements alone do not say: the springs that the bodies are condensed on take any value.
    return forces or USUAL * area


def _vector(scene: Scene, mesh: Mesh, elastic: Elastic, face: str) -> Array:
    load, free = scene.loads[face], elastic.free
    if load.pressure is not None:
        return elasticity.unit_loads(mesh, free, face)
    if load.displacement is not None:
        return _displaced(scene, mesh, elastic, face)
    axes, nodes = part_axes(scene, face), elastic.sets.get(face)
    given = None if nodes is not None else gather_face(mesh, free, face)
    f = np.zeros(free.size)
    if load.force is not None:
        mean = (
            glue.mean_of_nodes(nodes) if given is None else glue.mean_displacement(given, free.size)
        )
        f += mean.T @ (axes @ load.force)
    if load.moment is not None:
        if given is None:
            raise SceneError(f"""{scene.file}: loads."{face}".moment: a set of nodes has no
                rotation; write forces on sets that lie apart""")
        if len(faces_of_bodies(free, given)) > 1:
            raise SceneError(f"""{scene.file}: loads."{face}".moment: the face lies on several
                bodies; give each a part of its own, and a load on the face of each""")
        f += glue.mean_rotation(given, free.size).T @ (axes @ load.moment)
    return f


def _displaced(scene: Scene, mesh: Mesh, elastic: Elastic, face: str) -> Array:
    """Load [N] of the displacement of one support."""
    free = elastic.free
    g = lift(mesh, free, {face: scene.loads[face]})
    moved = np.flatnonzero(g.reshape(-1, 3).any(axis=1))
    coupled = {f"contact.{n}": c.faces for n, c in scene.contact.items()}
    coupled |= {f"ties.{n}": tie.faces for n, tie in scene.ties.items()}
    coupled |= {f"springs.{n}": s.faces or (n,) for n, s in scene.springs.items()}
    for where, faces in coupled.items():
        for other in faces:
            if other in mesh.faces and np.isin(gather_face(mesh, free, other).number, moved).any():
                raise SceneError(f"""{scene.file}: loads."{face}".displacement: moves nodes of
                    {other!r} too, on which {where} acts; move another face, or write a force""")
    materials = layer_materials(scene, mesh.layers)
    f = np.zeros(free.size)
    f[: free.local.size] = -elasticity.stiffness_action(mesh, free, materials, g)[free.local]
    return f

"""What acts on faces as a whole: ties, springs between two faces, and rotational inertia.

Mean displacement and mean rotation of a face: what springs between faces and inertia act on.

The mean displacement is that over the area. The mean rotation theta about the centroid is that of
the rigid motion nearest to the displacement u over the area,

    S theta = integral of r x u,     S = integral of (r.r 1 - r r'),

r from the centroid; both are exact where the face moves rigidly. One row each in x, y and z. A
face of several bodies, such as that of two pads, has a mean motion on each of them.

Springs, dashpots and masses that a scene adds to faces, in the axes of the faces' parts.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from itertools import product

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError
from brake_fenicsx.meshing.brake_mesh import Mesh
from brake_fenicsx.scene import Scene

from .elasticity import Elastic, FaceAddition
from .faces import Face, faces_of_bodies, gather_face
from .integrals import facet_areas, facet_rule
from .material import Material
from .solver import with_interface
from .tie import GluedFaces, cross_matrix, tied_faces

Array = NDArray[np.float64]
# Nodes at most: all of them are coupled with each other.
MOST_NODES = 4000
logger = logging.getLogger(__name__)
# Share of a face that its ties glue, below which it is said.
GLUED = 0.95


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


def joined_bodies(
    scene: Scene, mesh: Mesh, elastic: Elastic, materials: Mapping[str, Material]
) -> Elastic:
    """Add ties, springs between faces and inertia to the bodies of a scene.

    Args:
        scene: the scene.
        mesh: its mesh.
        elastic: the bodies.
        materials: layer name -> material in x, y, z axes.

    Returns:
        The bodies, joined.

    Raises:
        SceneError: faces that do not touch, or are too large.
    """
    layers: dict[str, GluedFaces] = {}
    for name, tie in scene.ties.items():
        if any(face in elastic.sets for face in tie.faces):
            continue
        try:
            layers[name] = _layer(scene, name, mesh, elastic, materials)
        except SceneError as error:
            raise SceneError(f"{scene.file}: ties.{name}: {error}") from None
        elastic = replace(elastic, K=elastic.K + layers[name].K)
    elastic = replace(elastic, doubts=(*elastic.doubts, *_glued_in_part(scene, layers)))
    for name, spring in scene.springs.items():
        if spring.faces is not None:
            try:
                elastic = _sprung(scene, name, mesh, elastic)
            except SceneError as error:
                raise SceneError(f"{scene.file}: springs.{name}: {error}") from None
    for name, added in scene.masses.items():
        if added.inertia is not None:
            try:
                elastic = _inert(scene, name, mesh, elastic)
            except SceneError as error:
                raise SceneError(f'{scene.file}: masses."{name}": {error}') from None
    return elastic


def _layer(
    scene: Scene, name: str, mesh: Mesh, elastic: Elastic, materials: Mapping[str, Material]
) -> GluedFaces:
    """The layer of a tie."""
    tie = scene.ties[name]
    faces = tie.faces[0], tie.faces[1]
    found = tied_faces(mesh, elastic.free, faces, materials, tie.stiffness, tie.search)
    logger.info(
        "tie %s: %.4g mm^2 glued, %.4g mm^2 of %s not; %.3g Pa/m, gap up to %.4f mm",
        name, 1e6 * found.area, 1e6 * max(found.uncovered, 0.0), faces[0], found.stiffness,
        1e3 * found.gap,
    )  # fmt: skip
    return found


def _glued_in_part(scene: Scene, layers: Mapping[str, GluedFaces]) -> list[str]:
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
    check_size([part for parts in faces.values() for part, _ in parts])
    means = {
        face: [(mean_displacement(part, free.size), share) for part, share in parts]
        for face, parts in faces.items()
    }
    means |= {f: [(mean_of_nodes(elastic.sets[f]), 1.0)] for f in ends if f in elastic.sets}
    first, second = (means[face] for face in ends)
    if min(len(first), len(second)) > 1:
        raise SceneError(
            f"faces = {list(ends)!r}: {len(first)} bodies have the first face and {len(second)} the"
            " second, and which of them the springs join is open; give each body a part of its own"
        )
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
    check_size([face for face, _ in faces])
    turn = sp.csr_matrix(part_axes(scene, name).T)
    for face, share in faces:
        J = (turn @ mean_rotation(face, elastic.free.size)).tocsr()
        inertia = share * np.array(scene.masses[name].inertia)
        elastic = replace(elastic, M=with_interface(elastic.M, J, inertia, J))
    return elastic


def _on_bodies(mesh: Mesh, elastic: Elastic, name: str) -> list[tuple[Face, float]]:
    """The parts of a face that lie on one body each, with their shares of its area."""
    faces = faces_of_bodies(elastic.free, gather_face(mesh, elastic.free, name))
    areas = np.array([facet_areas(face).sum() for face in faces])
    return [*zip(faces, areas / areas.sum(), strict=True)]


def added_to_face(scene: Scene, face: str) -> FaceAddition:
    """Springs, dashpots and mass that a scene adds to a face, in x, y, z axes."""
    spring, mass = scene.springs.get(face), scene.masses.get(face)
    turn, none = part_axes(scene, face), np.zeros(3)

    def turned(values: tuple[float, ...] | None) -> Array:
        return np.asarray(turn @ np.diag(none if values is None else values) @ turn.T)

    given = (
        (None, None, None)
        if spring is None
        else (spring.stiffness, spring.stiffness_per_area, spring.damping)
    )
    total, bedding, damping = map(turned, given)
    return FaceAddition(face, total, 0.0 if mass is None else mass.mass, bedding, damping)


def part_axes(scene: Scene, face: str) -> Array:
    """Axes 1, 2 and z of the part of a face as columns, shape (3, 3)."""
    part = scene.parts.get(face.partition(".")[0])
    angle = 0.0 if part is None else part.axis
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

"""Bodies of a scene: parts with their supports, springs, masses and ties.

Springs and masses act on single faces, springs also between two, a mass may have rotational
inertia; ties glue two faces.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from itertools import product

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError, located
from brake_fenicsx.extensions import provided
from brake_fenicsx.macro.elasticity import Elastic, FaceAddition, assemble_elastic
from brake_fenicsx.macro.faces import Face, faces_of_bodies, gather_face
from brake_fenicsx.macro.integrals import facet_areas
from brake_fenicsx.macro.material import Material
from brake_fenicsx.macro.mean_motion import (
    check_size,
    mean_displacement,
    mean_of_nodes,
    mean_rotation,
)
from brake_fenicsx.macro.solver import with_interface
from brake_fenicsx.macro.tie import GluedFaces, tied_faces
from brake_fenicsx.meshing.brake_mesh import Mesh
from brake_fenicsx.scene import Scene

from .material_table import layer_materials

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)
# Share of a face that its ties glue, below which it is said.
GLUED = 0.95


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
    elastic = assemble_elastic(
        mesh, layers, supports, scene.mesh.degree, added, scene.mesh.mass == "lumped"
    )
    if any(part.matrices for part in scene.parts.values()):
        elastic = provided("bodies", "parts.NAME.matrices", "matrices")(scene, mesh, elastic)
    return joined_bodies(scene, mesh, elastic, layers)


def on_matrices(scene: Scene, face: str) -> bool:
    """Whether a face is a set of nodes of a body given by matrices."""
    part = scene.parts.get(face.partition(".")[0])
    return part is not None and part.matrices is not None


def added_to_face(scene: Scene, face: str) -> FaceAddition:
    """Springs, dashpots and mass that a scene adds to a face, in x, y, z axes."""
    spring, mass, turn = scene.springs.get(face), scene.masses.get(face), part_axes(scene, face)

    def turned(key: str) -> Array:
        return np.asarray(turn @ np.diag(getattr(spring, key, None) or np.zeros(3)) @ turn.T)

    total, bedding, damping = map(turned, ("stiffness", "stiffness_per_area", "damping"))
    return FaceAddition(face, total, 0.0 if mass is None else mass.mass, bedding, damping)


def part_axes(scene: Scene, face: str) -> Array:
    """Axes 1, 2 and z of the part of a face as columns, shape (3, 3)."""
    part = scene.parts.get(face.partition(".")[0])
    angle = 0.0 if part is None else part.axis
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


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
        with located(f"{scene.file}: ties.{name}"):
            layers[name] = _layer(scene, name, mesh, elastic, materials)
        elastic = replace(elastic, K=elastic.K + layers[name].K)
    elastic = replace(elastic, doubts=(*elastic.doubts, *_glued_in_part(scene, layers)))
    for name, spring in scene.springs.items():
        if spring.faces is not None:
            with located(f"{scene.file}: springs.{name}"):
                elastic = _sprung(scene, name, mesh, elastic)
    for name, added in scene.masses.items():
        if added.inertia is not None:
            with located(f'{scene.file}: masses."{name}"'):
                elastic = _inert(scene, name, mesh, elastic)
    return elastic


def _layer(
    scene: Scene, name: str, mesh: Mesh, elastic: Elastic, materials: Mapping[str, Material]
) -> GluedFaces:
    """The layer of a tie."""
    tie = scene.ties[name]
    faces = tie.faces[0], tie.faces[1]
    found = tied_faces(mesh, elastic.free, faces, materials, tie.stiffness, tie.search)
    left = 1e6 * max(found.uncovered, 0.0)
    rest = f", {left:.4g} mm^2 of {faces[0]} not" if left > 1e-3 else ""
    logger.info(
        "tie %s: %.4g mm^2 glued%s; gap up to %.3g um; stiffness of the layer %.3g N/mm^3",
        *(name, 1e6 * found.area, rest, 1e6 * found.gap, 1e-9 * found.stiffness),
    )
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
    means = {f: [(mean_of_nodes(nodes), 1.0)] for f, nodes in elastic.sets.items() if f in ends}
    for face, parts in faces.items():
        means[face] = [(mean_displacement(part, free.size), share) for part, share in parts]
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

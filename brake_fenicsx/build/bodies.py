"""Bodies of a scene: parts with their supports, and springs and masses on single faces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.extensions import provided
from brake_fenicsx.macro.elasticity import Elastic, FaceAddition, assemble_elastic
from brake_fenicsx.meshing.brake_mesh import Mesh
from brake_fenicsx.scene import Scene

from .material_table import layer_materials

Array = NDArray[np.float64]


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
    inert = any(added.inertia for added in scene.masses.values())
    if scene.ties or inert or any(spring.faces for spring in scene.springs.values()):
        from .joints import joined_bodies

        elastic = joined_bodies(scene, mesh, elastic, layers)
    return elastic


def on_matrices(scene: Scene, face: str) -> bool:
    """Whether a face is a set of nodes of a body given by matrices."""
    part = scene.parts.get(face.partition(".")[0])
    return part is not None and part.matrices is not None


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

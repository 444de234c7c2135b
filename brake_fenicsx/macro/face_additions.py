"""Springs, dashpots and masses that a scene adds to faces, in the axes of the faces' parts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.scene import Scene

from .elasticity import FaceAddition

Array = NDArray[np.float64]


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

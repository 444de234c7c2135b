"""What a builder returns, and the few gmsh idioms the builders share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True, slots=True)
class Part:
    """Named gmsh entities of one part.

    Attributes:
        volumes: layer name -> gmsh volume tags.
        faces: face name -> gmsh surface tags.
        sizes: layer name -> mesh size [m].
    """

    volumes: dict[str, list[int]]
    faces: dict[str, list[int]]
    sizes: dict[str, float] = field(default_factory=dict)


def ring_sector(
    occ: Any, r_inner: float, r_outer: float, z: float, height: float, start: float, angle: float
) -> int:
    """Annular sector between two radii, extruded along z.

    Args:
        occ: gmsh's OpenCASCADE kernel.
        r_inner: inner radius [m].
        r_outer: outer radius [m].
        z: height of the lower face [m].
        height: extrusion, positive [m].
        start: angle of the first edge from x [rad].
        angle: opening angle [rad], below 2 pi.

    Returns:
        The volume's tag.
    """
    # Arcs of less than half a turn.
    arcs = int(np.ceil(angle / (0.9 * np.pi)))
    corner = {}
    for i, r in enumerate((r_inner, r_outer)):
        for j, a in enumerate(np.linspace(start, start + angle, arcs + 1)):
            corner[i, j] = occ.addPoint(r * np.cos(a), r * np.sin(a), z)
    centre = occ.addPoint(0, 0, z)
    inner = [occ.addCircleArc(corner[0, j], centre, corner[0, j + 1]) for j in range(arcs)]
    outer = [occ.addCircleArc(corner[1, j], centre, corner[1, j + 1]) for j in range(arcs)]
    side = [occ.addLine(corner[0, j], corner[1, j]) for j in (0, arcs)]
    wire = occ.addCurveLoop([*inner, side[1], *(-tag for tag in reversed(outer)), -side[0]])
    face = occ.addPlaneSurface([wire])
    occ.remove([(0, centre)])
    return int(next(tag for dim, tag in occ.extrude([(2, face)], 0, 0, height) if dim == 3))


def volumes_between(tags: list[int], z_low: float, z_high: float) -> list[int]:
    """Those of the volumes whose bounding box lies between two heights [m]."""
    import gmsh

    tol = 1e-6
    inside = []
    for tag in tags:
        box = gmsh.model.getBoundingBox(3, tag)
        if box[2] > z_low - tol and box[5] < z_high + tol:
            inside.append(tag)
    return inside


def faces_where(volumes: list[int], test: Callable[[np.ndarray, np.ndarray], bool]) -> list[int]:
    """Boundary faces of the volumes that satisfy a test.

    Args:
        volumes: volume tags; faces between two of them are left out.
        test: takes the lower and the upper corner [m], shape (3,), of a face's bounding box.

    Returns:
        The faces' tags, sorted.
    """
    import gmsh

    boundary = gmsh.model.getBoundary([(3, v) for v in volumes], combined=True, oriented=False)
    found = []
    for _, tag in boundary:
        box = np.array(gmsh.model.getBoundingBox(2, tag))
        if test(box[:3], box[3:]):
            found.append(int(tag))
    return sorted(found)


def flat_at(z: float) -> Callable[[np.ndarray, np.ndarray], bool]:
    """Test for ``faces_where``: the face lies in the plane at height z [m]."""
    return lambda low, high: bool(abs(low[2] - z) < 1e-6 and abs(high[2] - z) < 1e-6)

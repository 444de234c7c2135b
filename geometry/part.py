"""What a builder returns, and the few gmsh idioms the builders share."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True, slots=True)
class PartEntities:
    """Named gmsh entities of one part.

    Attributes:
        volumes: layer name -> gmsh volume tags.
        faces: face name -> gmsh surface tags.
        sizes: layer name -> mesh size [m].
        fine: places of finer mesh, as (size there [m], distance from there [m] as a gmsh expression
            in x, y, z); away from them the size grows.
        growth: how fast, size per distance; None leaves it to the mesh settings.
        mirror: the mesh is completed by its mirror image at z = 0.
    """

    volumes: dict[str, list[int]]
    faces: dict[str, list[int]]
    sizes: dict[str, float] = field(default_factory=dict)
    fine: tuple[tuple[float, str], ...] = ()
    growth: float | None = None
    mirror: bool = False

    @property
    def layers(self) -> list[str]:
        """Names of the layers."""
        return [*self.volumes]


@dataclass(frozen=True, slots=True)
class Slab:
    """A layer of a swept part.

    Attributes:
        layer: its name; slabs of one name are one layer.
        low: start of the sweep [m].
        high: its end [m].
        elements: number of elements along the sweep.
        regions: regions of the footprint that are swept.
    """

    layer: str
    low: float
    high: float
    elements: int
    regions: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class SweptFace:
    """A face of a swept part.

    Attributes:
        slab: number of the slab whose boundary it is.
        side: "low" or "high" end of the slab, or "side" along the sweep.
        of: regions of the footprint for an end, curves for a side.
    """

    slab: int
    side: str
    of: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Swept:
    """A part swept along z: a plane footprint and slabs; meshed with hexahedra or tetrahedra.

    Attributes:
        regions: region name -> gmsh surface tags in the plane z = 0.
        curves: curve name -> gmsh curve tags.
        slabs: from low to high, without gaps where they share regions.
        faces: face name -> where it is.
        size: mesh size of the footprint [m].
        fine: as for ``PartEntities``.
        growth: as for ``PartEntities``.
        mirror: as for ``PartEntities``.
        below: the part is the mirror image itself: below the plane z = 0.
        upright: the footprint stands in the x, z plane and is swept along -y.
    """

    regions: dict[str, list[int]]
    curves: dict[str, list[int]]
    slabs: tuple[Slab, ...]
    faces: dict[str, tuple[SweptFace, ...]]
    size: float
    fine: tuple[tuple[float, str], ...] = ()
    growth: float | None = None
    mirror: bool = False
    below: bool = False
    upright: bool = False

    @property
    def layers(self) -> list[str]:
        """Names of the layers."""
        return [*dict.fromkeys(slab.layer for slab in self.slabs)]


def element_count(length: float, size: float) -> int:
    """Number of elements of about a size [m] along a length [m]."""
    return max(1, round(length / size))


def ring_sector_face(
    occ: Any, r_inner: float, r_outer: float, z: float, start: float, angle: float
) -> int:
    """Plane annular sector between two radii.

    Args:
        occ: gmsh's OpenCASCADE kernel.
        r_inner: inner radius [m].
        r_outer: outer radius [m].
        z: height [m].
        start: angle of the first edge from x [rad].
        angle: opening angle [rad], below 2 pi.

    Returns:
        The surface's tag.
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
    return int(face)


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

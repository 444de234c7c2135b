"""Brake disc about the z axis, centred at z = 0: plain, vented, with or without a hat."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from . import part

Entities = list[tuple[int, int]]


@dataclass(frozen=True, slots=True)
class Disc:
    """Parameters of the disc.

    Attributes:
        radius: outer radius [m].
        bore: radius of the inner cylinder, where a plain disc is clamped [m].
        thickness: thickness [m].
        vanes: number of straight radial vanes between two cheeks; 0: a solid disc.
        vane_width: tangential width of a vane [m].
        cheek: thickness of each cheek of a vented disc [m].
        hat: height of the hat above the upper friction face [m]; 0: no hat.
        hat_wall: thickness of the wall of the hat, outside the bore [m].
        flange: thickness of the flange of the hat [m].
        hub: inner radius of the flange [m].
        bolts: number of bolt holes in the flange.
        bolt_circle: radius of the circle of bolt holes [m].
        bolt_diameter: diameter of the bolt holes [m].
        size: mesh size [m].
        face_size: finer mesh size at the friction faces [m]; it grows towards the inside.
    """

    radius: float = field(default=144e-3, metadata={"unit": "m"})
    bore: float = field(default=75e-3, metadata={"unit": "m"})
    thickness: float = field(default=20e-3, metadata={"unit": "m"})
    vanes: int = field(default=0, metadata={"unit": "", "sign": "zero"})
    vane_width: float = field(default=8e-3, metadata={"unit": "m"})
    cheek: float = field(default=7e-3, metadata={"unit": "m"})
    hat: float = field(default=0.0, metadata={"unit": "m", "sign": "zero"})
    hat_wall: float = field(default=8e-3, metadata={"unit": "m"})
    flange: float = field(default=8e-3, metadata={"unit": "m"})
    hub: float = field(default=32e-3, metadata={"unit": "m"})
    bolts: int = 5
    bolt_circle: float = field(default=54e-3, metadata={"unit": "m"})
    bolt_diameter: float = field(default=14e-3, metadata={"unit": "m"})
    size: float = field(default=12e-3, metadata={"unit": "m"})
    face_size: float | None = field(default=None, metadata={"unit": "m"})


def check(disc: Disc) -> None:
    """Refuse parameters that make no disc."""
    if not 0 < disc.bore < disc.radius:
        raise ValueError(f"bore {disc.bore} m must lie between 0 and radius {disc.radius} m")
    if disc.vanes and not 2 * disc.cheek < disc.thickness:
        raise ValueError(
            f"two cheeks of {disc.cheek} m leave no room for vanes in {disc.thickness} m"
        )
    if disc.vanes and not disc.vanes * disc.vane_width < 2 * np.pi * disc.bore:
        raise ValueError(f"{disc.vanes} vanes of {disc.vane_width} m do not fit around the bore")
    if disc.hat > 0:
        hole = disc.bolt_diameter / 2
        if not disc.bore + disc.hat_wall < disc.radius:
            raise ValueError(f"hat_wall {disc.hat_wall} m reaches beyond the radius")
        if not disc.flange < disc.hat:
            raise ValueError(f"flange {disc.flange} m must be thinner than the hat is high")
        if not disc.hub < disc.bolt_circle - hole < disc.bolt_circle + hole < disc.bore:
            raise ValueError(
                f"bolt holes at {disc.bolt_circle} m must lie between hub {disc.hub} m and bore"
                f" {disc.bore} m"
            )


def thicknesses(disc: Disc) -> dict[str, tuple[str, ...]]:
    """Lengths that are thicknesses of layers: that of a plain disc; with a hat or vanes none."""
    return {} if disc.hat > 0 or disc.vanes else {"thickness": ("body",)}


HEIGHTS = ("thickness", "cheek", "hat", "flange")


def levels(disc: Disc) -> list[float]:
    """Heights of all planes across z [m], rising, which the lengths of ``HEIGHTS`` move."""
    half, top = disc.thickness / 2, disc.thickness / 2 + disc.hat
    inner = [half - disc.cheek] if disc.vanes else []
    hat = [top - disc.flange, top] if disc.hat > 0 else []
    return sorted([*(side * z for z in (half, *inner) for side in (1, -1)), *hat])


def widths(disc: Disc) -> tuple[str, ...]:
    """Lengths that move nodes at right angles to z: of a plain disc; with a hat or vanes none."""
    return () if disc.hat > 0 or disc.vanes else ("bore", "radius")


def sideways(disc: Disc, name: str, points: np.ndarray) -> np.ndarray:
    """Movement of points along x and y per length: radial, in proportion, shape (n, 2)."""
    r = np.hypot(*points[:, :2].T)
    share = np.interp(r, [disc.bore, disc.radius], np.eye(2)[widths(disc).index(name)])
    return share[:, None] * points[:, :2] / r[:, None]


def build(occ: Any, disc: Disc) -> part.PartEntities:
    """Add the disc to the current gmsh model.

    Args:
        occ: gmsh's OpenCASCADE kernel.
        disc: its parameters.

    Returns:
        Layer ``body``; faces ``friction`` (both sides), ``bore``, ``rim`` and, with a hat,
        ``bolts`` (the holes' cylinders) and ``hub``.
    """
    check(disc)
    half = disc.thickness / 2
    channels = _channels(occ, disc) if disc.vanes else []
    ring = _tube(occ, disc.bore, disc.radius, -half, half)
    solids = list(occ.cut([ring], channels)[0]) if channels else [ring]
    if disc.hat > 0:
        solids += _hat(occ, disc)
    if len(solids) > 1:
        solids = occ.fuse(solids[:1], solids[1:])[0]
    occ.synchronize()
    body = [tag for _, tag in solids]
    faces = {
        "friction": part.faces_where(body, part.flat_at(-half))
        + part.faces_where(body, part.flat_at(half)),
        "bore": part.faces_where(body, _cylinder(disc.bore)),
        "rim": part.faces_where(body, _cylinder(disc.radius)),
    }
    if disc.hat > 0:
        faces["hub"] = part.faces_where(body, _cylinder(disc.hub))
        faces["bolts"] = part.faces_where(body, _hole(disc))
    fine = ((disc.face_size, f"abs({half!r}-abs(z))"),) if disc.face_size else ()
    return part.PartEntities({"body": body}, faces, {"body": disc.size}, fine=fine)


def _tube(occ: Any, inner: float, outer: float, low: float, high: float) -> tuple[int, int]:
    """Ring between two radii and two heights [m]."""
    whole, hole = (occ.addCylinder(0, 0, low, 0, 0, high - low, r) for r in (outer, inner))
    return 3, int(occ.cut([(3, whole)], [(3, hole)])[0][0][1])


def _channels(occ: Any, disc: Disc) -> Entities:
    """The channels between the vanes."""
    inner = disc.thickness / 2 - disc.cheek
    # The channels are drawn flat and extruded: many times faster than cuts between solids.
    vanes = []
    for angle in 2 * np.pi * np.arange(disc.vanes) / disc.vanes:
        low = -disc.vane_width / 2
        vane = occ.addRectangle(0, low, -inner, 1.1 * disc.radius, disc.vane_width)
        occ.rotate([(2, vane)], 0, 0, 0, 0, 0, 1, angle)
        vanes.append((2, vane))
    outer, hole = (occ.addDisk(0, 0, -inner, r, r) for r in (disc.radius, disc.bore))
    ring, _ = occ.cut([(2, outer)], [(2, hole)])
    open_faces, _ = occ.cut(ring, vanes)
    return [e for e in occ.extrude(open_faces, 0, 0, 2 * inner) if e[0] == 3]


def _hat(occ: Any, disc: Disc) -> Entities:
    """Wall and flange of the hat, with bolt holes."""
    low, high = disc.thickness / 2, disc.thickness / 2 + disc.hat
    wall = _tube(occ, disc.bore, disc.bore + disc.hat_wall, low, high)
    flange = _tube(occ, disc.hub, disc.bore + 0.5 * disc.hat_wall, high - disc.flange, high)
    holes = []
    for angle in 2 * np.pi * np.arange(disc.bolts) / disc.bolts:
        x, y = disc.bolt_circle * np.cos(angle), disc.bolt_circle * np.sin(angle)
        start = high - 1.5 * disc.flange
        holes.append(
            (3, occ.addCylinder(x, y, start, 0, 0, 2 * disc.flange, disc.bolt_diameter / 2))
        )
    return [wall, *occ.cut([flange], holes)[0]]


def _cylinder(r: float) -> Callable[[np.ndarray, np.ndarray], bool]:
    """Test for upright cylinders of a radius about the axis: their corners lie inside it."""

    def test(low: np.ndarray, high: np.ndarray) -> bool:
        return bool(high[2] - low[2] > 1e-6 and np.isclose(max(high[0], -low[0]), r, rtol=1e-3))

    return test


def _hole(disc: Disc) -> Callable[[np.ndarray, np.ndarray], bool]:
    """Test for the bolt holes' cylinders."""

    def test(low: np.ndarray, high: np.ndarray) -> bool:
        across, centre = high[:2] - low[:2], 0.5 * (high[:2] + low[:2])
        return bool(
            np.allclose(across, disc.bolt_diameter, rtol=1e-3)
            and np.isclose(np.hypot(*centre), disc.bolt_circle, rtol=1e-3)
        )

    return test


def sweep(occ: Any, disc: Disc) -> part.Swept:
    """Add the footprint of a plain disc to the current gmsh model, names as of ``build``.

    Args:
        occ: gmsh's OpenCASCADE kernel.
        disc: its parameters; hat and vanes are not swept.
    """
    check(disc)
    for name in ("hat", "vanes"):
        if getattr(disc, name):
            raise ValueError(
                f"a disc with {name} is not swept along z: write {name} = 0,"
                ' or cells = "tetrahedra"'
            )
    regions, curves = _quarters(occ, disc)
    half = disc.thickness / 2
    n = part.element_count(disc.thickness, disc.size)
    return part.Swept(
        regions={"all": regions},
        curves=curves,
        slabs=(part.Slab("body", -half, half, n, ("all",)),),
        faces={
            "friction": (part.SweptFace(0, "low", ("all",)), part.SweptFace(0, "high", ("all",))),
            "bore": (part.SweptFace(0, "side", ("bore",)),),
            "rim": (part.SweptFace(0, "side", ("rim",)),),
        },
        size=disc.size,
    )


def _quarters(occ: Any, disc: Disc) -> tuple[list[int], dict[str, list[int]]]:
    """Four quarters of the ring with regular cells, so that double modes stay double."""
    import gmsh

    quarters = [
        (2, part.ring_sector_face(occ, disc.bore, disc.radius, 0.0, start, np.pi / 2))
        for start in np.pi / 2 * np.arange(4)
    ]
    faces = [tag for _, tag in occ.fragment(quarters, [])[0]]
    occ.synchronize()
    mesh = gmsh.model.mesh
    across = part.element_count(disc.radius - disc.bore, disc.size)
    along = part.element_count(np.pi / 4 * (disc.radius + disc.bore), disc.size)
    curves: dict[str, list[int]] = {"bore": [], "rim": []}
    for _, tag in gmsh.model.getEntities(1):
        ends = gmsh.model.getBoundary([(1, tag)])
        r = [np.hypot(*gmsh.model.getValue(0, end, [])[:2]) for _, end in ends]
        arc = np.isclose(r[0], r[1], rtol=1e-6)
        if arc:
            curves["rim" if np.isclose(r[0], disc.radius, rtol=1e-6) else "bore"].append(tag)
        mesh.setTransfiniteCurve(tag, (along if arc else across) + 1)
    for face in faces:
        mesh.setTransfiniteSurface(face)
    return faces, curves

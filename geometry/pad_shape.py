"""Outlines of a pad seen along z: lining and plate, ears, piston circle, slot, chamfers."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .part import ring_sector_face

Entities = list[tuple[int, int]]


@dataclass(frozen=True, slots=True)
class Pad:
    """Parameters of the pad. Lengths in m, angles in rad.

    Attributes:
        side: "top", "bottom" or "both" sides of the disc.
        shape: of lining and plate: "sector" of a ring; "parallel" ends between the two arcs;
            "rectangle".
        z: height of the friction face above the disc's mid plane [m].
        r_inner: inner radius of lining and plate [m].
        r_outer: outer radius of lining and plate [m].
        angle: opening angle [rad].
        width: tangential extent of a pad with parallel ends [m]; the chord of ``angle`` at mid
            radius if not given.
        position: angle of the pad's middle from the x axis [rad].
        lining: thickness of the lining [m].
        plate: thickness of the back plate [m].
        shim: thickness of the shim [m]; 0: no shim is built; several values: one for each layer,
            from the plate outwards.
        shim_layers: number of equal layers of a shim of one thickness.
        ear_length: tangential length of an ear [m]; 0: no ears.
        ear_width: radial width of an ear [m].
        piston_diameter: diameter of the loaded circle on the outermost layer [m]; the part of the
            circle outside lining and plate is cut off.
        chamfer: tangential length of the chamfers at both ends of the lining [m]; 0: none.
        chamfer_depth: depth of the chamfers at the ends [m]; equal to ``chamfer`` if not given.
        slot: width of a radial slot in the middle of the lining [m]; 0: none.
        slot_depth: depth of the slot [m]; the whole lining if not given.
        size: mesh size of the lining's friction face [m].
        plate_size: mesh size of the plate [m].
        shim_size: mesh size of the shim [m]; the plate's if not given.
        mirror: the meshes of the two pads are exact mirror images.
    """

    side: str = "both"
    shape: str = "sector"
    z: float = field(default=10e-3, metadata={"unit": "m", "sign": "any"})
    r_inner: float = field(default=96e-3, metadata={"unit": "m"})
    r_outer: float = field(default=140e-3, metadata={"unit": "m"})
    angle: float = field(default=np.pi / 3, metadata={"unit": "rad"})
    width: float | None = field(default=None, metadata={"unit": "m"})
    position: float = field(default=np.pi / 2, metadata={"unit": "rad", "sign": "any"})
    lining: float = field(default=10e-3, metadata={"unit": "m"})
    plate: float = field(default=6e-3, metadata={"unit": "m"})
    shim: float | tuple[float, ...] = field(default=0.0, metadata={"unit": "m", "sign": "zero"})
    shim_layers: int = 1
    ear_length: float = field(default=10e-3, metadata={"unit": "m", "sign": "zero"})
    ear_width: float = field(default=16e-3, metadata={"unit": "m"})
    piston_diameter: float = field(default=54e-3, metadata={"unit": "m"})
    chamfer: float = field(default=0.0, metadata={"unit": "m", "sign": "zero"})
    chamfer_depth: float | None = field(default=None, metadata={"unit": "m"})
    slot: float = field(default=0.0, metadata={"unit": "m", "sign": "zero"})
    slot_depth: float | None = field(default=None, metadata={"unit": "m"})
    size: float = field(default=4.29e-3, metadata={"unit": "m"})
    plate_size: float = field(default=6e-3, metadata={"unit": "m"})
    shim_size: float | None = field(default=None, metadata={"unit": "m"})
    mirror: bool = True

    @property
    def axis(self) -> float:
        """Direction of the tangent at mid pad: angle from the x axis [rad]."""
        return self.position + np.pi / 2


def middle(pad: Pad) -> float:
    """Mid radius [m]."""
    return 0.5 * (pad.r_inner + pad.r_outer)


def width(pad: Pad) -> float:
    """Tangential extent of a pad with parallel ends [m]."""
    return 2 * middle(pad) * np.sin(pad.angle / 2) if pad.width is None else pad.width


def check(pad: Pad) -> None:
    """Refuse parameters that make no pad."""
    if pad.shape not in ("sector", "parallel", "rectangle"):
        raise ValueError(f"shape {pad.shape!r}: use sector, parallel or rectangle")
    if not pad.r_inner < pad.r_outer:
        raise ValueError(f"r_inner {pad.r_inner} m must be below r_outer {pad.r_outer} m")
    if pad.shape == "sector" and not pad.angle < 2 * np.pi:
        raise ValueError(f"angle {pad.angle} rad must be below a full turn")
    if pad.shape != "sector" and not width(pad) < 2 * pad.r_inner:
        raise ValueError(f"width {width(pad)} m must be below twice r_inner {pad.r_inner} m")
    if pad.shape == "sector" and pad.width is not None:
        raise ValueError('width has no meaning for shape "sector"; write angle')
    depth = pad.lining if pad.slot_depth is None else pad.slot_depth
    if depth > pad.lining:
        raise ValueError(f"slot_depth {depth} m is more than the lining {pad.lining} m")
    if pad.chamfer > 0 and chamfer_depth(pad) > pad.lining:
        raise ValueError(f"chamfer_depth {chamfer_depth(pad)} m is more than the lining")
    if pad.slot + 2 * pad.chamfer >= 0.8 * (
        width(pad) if pad.shape != "sector" else pad.angle * pad.r_inner
    ):
        raise ValueError(f"slot {pad.slot} m and chamfers {pad.chamfer} m leave no lining")


def chamfer_depth(pad: Pad) -> float:
    """Depth of a chamfer at the end of the lining [m]; 45 degrees if the scene names none."""
    return pad.chamfer if pad.chamfer_depth is None else pad.chamfer_depth


def half(pad: Pad, less: float) -> float:
    """Distance from mid pad to an end at the inner radius, from a line so much nearer [m]."""
    if pad.shape != "sector":
        return 0.5 * width(pad) - less
    return float(pad.r_inner * np.sin(pad.angle / 2 - np.arcsin(less / pad.r_inner)))


def outline(occ: Any, pad: Pad, z: float) -> int:
    """Plane surface of lining and plate at a height [m]."""
    if pad.shape == "sector":
        start = pad.position - pad.angle / 2
        return ring_sector_face(occ, pad.r_inner, pad.r_outer, z, start, pad.angle)
    half = 0.5 * width(pad)
    arcs = pad.shape == "parallel"
    x = [np.sqrt(r**2 - half**2) if arcs else r for r in (pad.r_inner, pad.r_outer)]
    at = [occ.addPoint(*p, z) for p in ((x[0], -half), (x[1], -half), (x[1], half), (x[0], half))]
    if arcs:
        centre = occ.addPoint(0, 0, z)
        curves = [
            occ.addLine(at[0], at[1]), occ.addCircleArc(at[1], centre, at[2]),
            occ.addLine(at[2], at[3]), occ.addCircleArc(at[3], centre, at[0]),
        ]  # fmt: skip
        occ.remove([(0, centre)])
    else:
        curves = [occ.addLine(at[i], at[(i + 1) % 4]) for i in range(4)]
    face = occ.addPlaneSurface([occ.addCurveLoop(curves)])
    occ.rotate([(2, face)], 0, 0, 0, 0, 0, 1, pad.position)
    return int(face)


def ends(pad: Pad) -> list[tuple[float, float, float]]:
    """Both ends: side (-1, 1), direction of its line [rad], the line's distance from z [m]."""
    if pad.shape == "sector":
        return [(e, pad.position + e * pad.angle / 2, 0.0) for e in (-1.0, 1.0)]
    return [(e, pad.position, e * 0.5 * width(pad)) for e in (-1.0, 1.0)]


def ear_tips(pad: Pad) -> list[np.ndarray]:
    """Centres of the ears' end faces in the plane [m]."""
    tips = []
    for end, a, offset in ends(pad):
        along, across = np.array([np.cos(a), np.sin(a)]), np.array([-np.sin(a), np.cos(a)])
        tips.append(middle(pad) * along + (offset + end * pad.ear_length) * across)
    return tips


def ears(occ: Any, pad: Pad, z: float, height: float = 0.0) -> Entities:
    """Ears at both ends at mid radius, overlapping the plate so that they fuse with it.

    Args:
        occ: gmsh's OpenCASCADE kernel.
        pad: its parameters.
        z: height of the lower face [m].
        height: of the blocks [m]; rectangles if 0.
    """
    overlap = 0.5 * pad.ear_width
    found = []
    for end, a, offset in ends(pad):
        y = offset - (overlap if end > 0 else pad.ear_length)
        place = middle(pad) - pad.ear_width / 2, y, z, pad.ear_width, pad.ear_length + overlap
        ear = (3, occ.addBox(*place, height)) if height else (2, occ.addRectangle(*place))
        occ.rotate([ear], 0, 0, 0, 0, 0, 1, a)
        found.append(ear)
    return found


def piston(occ: Any, pad: Pad, z: float) -> tuple[int, int]:
    """Circle of the piston at a height [m]."""
    r = middle(pad)
    x, y = r * np.cos(pad.position), r * np.sin(pad.position)
    return 2, occ.addDisk(x, y, z, pad.piston_diameter / 2, pad.piston_diameter / 2)


def piston_area(occ: Any, pad: Pad) -> float:
    """Area of the piston's circle that lies on the outline [m^2]."""
    on_pad, _ = occ.intersect([piston(occ, pad, 0.0)], [(2, outline(occ, pad, 0.0))])
    return float(sum(occ.getMass(2, tag) for _, tag in on_pad))


def slot_face(occ: Any, pad: Pad) -> tuple[int, int]:
    """Strip of the slot in the plane z = 0, along the radius at mid pad."""
    reach = 1.2 * pad.r_outer
    face = occ.addRectangle(0.5 * pad.r_inner, -pad.slot / 2, 0, reach, pad.slot)
    occ.rotate([(2, face)], 0, 0, 0, 0, 0, 1, pad.position)
    return 2, face


def cutters(occ: Any, pad: Pad) -> Entities:
    """Solids to be cut off the lining: slot and chamfers."""
    found = []
    if pad.slot > 0:
        depth = pad.lining if pad.slot_depth is None else pad.slot_depth
        box = occ.addBox(
            0.5 * pad.r_inner, -pad.slot / 2, pad.z - 0.1 * depth,
            1.2 * pad.r_outer, pad.slot, 1.1 * depth,
        )  # fmt: skip
        occ.rotate([(3, box)], 0, 0, 0, 0, 0, 1, pad.position)
        found.append((3, box))
    if pad.chamfer > 0:
        found += [_wedge(occ, pad, *end) for end in ends(pad)]
    return found


def _wedge(occ: Any, pad: Pad, end: float, a: float, offset: float) -> tuple[int, int]:
    """Wedge that takes a chamfer off one end, reaching beyond the lining on all sides."""
    slope = chamfer_depth(pad) / pad.chamfer
    more = 0.2 * pad.chamfer
    y = [-pad.chamfer - more, more, more]
    z = [-slope * more, slope * (pad.chamfer + more), -slope * more]
    x = 0.5 * pad.r_inner
    at = [occ.addPoint(x, offset + end * b, pad.z + h) for b, h in zip(y, z, strict=True)]
    face = occ.addPlaneSurface(
        [occ.addCurveLoop([occ.addLine(at[i], at[(i + 1) % 3]) for i in range(3)])]
    )
    solid = next(e for e in occ.extrude([(2, face)], 1.2 * pad.r_outer, 0, 0) if e[0] == 3)
    occ.rotate([solid], 0, 0, 0, 0, 0, 1, a)
    return 3, int(solid[1])

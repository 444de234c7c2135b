"""Brake pad: lining, back plate with ears, optional shims, stacked from the friction face."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .part import Part, faces_where, flat_at, ring_sector, volumes_between


@dataclass(frozen=True, slots=True)
class Pad:
    """Parameters of the pad. Lengths in m, angles in rad.

    Attributes:
        side: "top", "bottom" or "both" sides of the disc.
        z: height of the friction face above the disc's mid plane [m].
        r_inner: inner radius of lining and plate [m].
        r_outer: outer radius of lining and plate [m].
        angle: opening angle [rad].
        position: angle of the pad's middle from the x axis [rad].
        lining: thickness of the lining [m].
        plate: thickness of the back plate [m].
        shim: thickness of the shim [m]; 0: no shim is built.
        shim_layers: number of equal layers of the shim.
        ear_length: tangential length of an ear [m]; 0: no ears.
        ear_width: radial width of an ear [m].
        piston_diameter: diameter of the loaded circle on the outermost layer [m].
        size: mesh size of the lining's friction face [m].
        plate_size: mesh size of plate and shim [m].
        mirror: the meshes of the two pads are exact mirror images.
    """

    side: str = "both"
    z: float = field(default=10e-3, metadata={"unit": "m", "sign": "any"})
    r_inner: float = field(default=96e-3, metadata={"unit": "m"})
    r_outer: float = field(default=140e-3, metadata={"unit": "m"})
    angle: float = field(default=np.pi / 3, metadata={"unit": "rad"})
    position: float = field(default=np.pi / 2, metadata={"unit": "rad", "sign": "any"})
    lining: float = field(default=10e-3, metadata={"unit": "m"})
    plate: float = field(default=6e-3, metadata={"unit": "m"})
    shim: float = field(default=0.0, metadata={"unit": "m", "sign": "zero"})
    shim_layers: int = 1
    ear_length: float = field(default=10e-3, metadata={"unit": "m", "sign": "zero"})
    ear_width: float = field(default=16e-3, metadata={"unit": "m"})
    piston_diameter: float = field(default=54e-3, metadata={"unit": "m"})
    size: float = field(default=4.29e-3, metadata={"unit": "m"})
    plate_size: float = field(default=6e-3, metadata={"unit": "m"})
    mirror: bool = True

    @property
    def axis(self) -> float:
        """Direction of the tangent at mid pad: angle from the x axis [rad]."""
        return self.position + np.pi / 2


def build(occ: Any, pad: Pad) -> Part:
    """Add one pad, or two mirror images, to the current gmsh model.

    Args:
        occ: gmsh's OpenCASCADE kernel.
        pad: its parameters.

    Returns:
        Layers ``lining``, ``plate`` and, where asked for, ``shim``; faces ``friction``,
        ``ears`` (their end faces) and ``piston`` (the part of the circle that lies on the pad).
    """
    sides = {"top": [1.0], "bottom": [-1.0], "both": [1.0, -1.0]}.get(pad.side)
    if sides is None:
        raise ValueError(f"side {pad.side!r}: use top, bottom or both")
    mirror = pad.side == "both" and pad.mirror
    if mirror:
        sides = [1.0]
    volumes: dict[str, list[int]] = {}
    faces: dict[str, list[int]] = {"friction": [], "ears": [], "piston": []}
    for side in sides:
        layers, found = _one_pad(occ, pad, side)
        for name, tags in layers.items():
            volumes.setdefault(name, []).extend(tags)
        for name, tags in found.items():
            faces[name].extend(tags)
    sizes = {name: pad.size if name == "lining" else pad.plate_size for name in volumes}
    named = {name: tags for name, tags in faces.items() if tags}
    return Part(volumes, named, sizes, mirror=mirror)


def _one_pad(occ: Any, pad: Pad, side: float) -> tuple[dict[str, list[int]], dict[str, list[int]]]:
    """Build one pad on one side of the disc; side = +1 or -1."""
    start = pad.position - pad.angle / 2
    layers = [("lining", pad.lining), ("plate", pad.plate)]
    if pad.shim > 0:
        layers += [("shim", pad.shim / pad.shim_layers)] * pad.shim_layers
    heights = np.cumsum([pad.z] + [thickness for _, thickness in layers])
    solids = [
        (3, ring_sector(occ, pad.r_inner, pad.r_outer, z, h, start, pad.angle))
        for z, (_, h) in zip(heights, layers, strict=False)
    ]
    if pad.ear_length > 0:
        plate = [solids[1], *_ears(occ, pad, heights[1])]
        solids[1] = occ.fuse(plate[:1], plate[1:])[0][0]
    middle = 0.5 * (pad.r_inner + pad.r_outer)
    x, y = middle * np.cos(pad.position), middle * np.sin(pad.position)
    circle = occ.addDisk(x, y, heights[-1], pad.piston_diameter / 2, pad.piston_diameter / 2)
    # The circle may reach beyond the pad: only what lies on it is imprinted.
    outside = ring_sector(
        occ, pad.r_inner, pad.r_outer, heights[-2], heights[-1] - heights[-2], start, pad.angle
    )
    on_pad, _ = occ.intersect([(2, circle)], [(3, outside)])
    solids = [s for s in occ.fragment(solids, on_pad)[0] if s[0] == 3]
    if side < 0:
        occ.mirror(solids, 0, 0, 1, 0)
    occ.synchronize()
    tags = sorted({tag for _, tag in solids})
    volumes: dict[str, list[int]] = {}
    for (name, _), low, high in zip(layers, heights[:-1], heights[1:], strict=True):
        z_low, z_high = sorted((side * low, side * high))
        volumes.setdefault(name, []).extend(volumes_between(tags, z_low, z_high))
    return volumes, _faces(occ, pad, tags, side, heights)


def _ears(occ: Any, pad: Pad, z: float) -> list[tuple[int, int]]:
    """Blocks at both sector ends at mid radius, overlapping the plate so that they fuse."""
    middle = 0.5 * (pad.r_inner + pad.r_outer)
    overlap = 0.5 * pad.ear_width
    ears = []
    for end in (-1.0, 1.0):
        length = pad.ear_length + overlap
        y = -overlap if end > 0 else -pad.ear_length
        box = occ.addBox(middle - pad.ear_width / 2, y, z, pad.ear_width, length, pad.plate)
        occ.rotate([(3, box)], 0, 0, 0, 0, 0, 1, pad.position + end * pad.angle / 2)
        ears.append((3, box))
    return ears


def _faces(
    occ: Any, pad: Pad, tags: list[int], side: float, heights: np.ndarray
) -> dict[str, list[int]]:
    """Name the faces of one built pad."""
    middle = 0.5 * (pad.r_inner + pad.r_outer)
    centre = middle * np.array([np.cos(pad.position), np.sin(pad.position)])
    reach = pad.piston_diameter / 2 + 1e-6

    def on_piston(low: np.ndarray, high: np.ndarray) -> bool:
        near = np.all(low[:2] > centre - reach) and np.all(high[:2] < centre + reach)
        return bool(near and flat_at(side * heights[-1])(low, high))

    ends = []
    for end in (-1.0, 1.0):
        a = pad.position + end * pad.angle / 2
        tip = middle * np.array([np.cos(a), np.sin(a)])
        tip += end * pad.ear_length * np.array([-np.sin(a), np.cos(a)])
        for tag in faces_where(tags, lambda low, high: bool(high[2] - low[2] > 0.5 * pad.plate)):
            x, y, _ = occ.getCenterOfMass(2, tag)
            if pad.ear_length > 0 and np.hypot(x - tip[0], y - tip[1]) < 1e-6:
                ends.append(tag)
    return {
        "friction": faces_where(tags, flat_at(side * pad.z)),
        "ears": ends,
        "piston": faces_where(tags, on_piston),
    }

"""What a brake consists of, in the numbers that one compares with another model of it."""

from __future__ import annotations

from typing import Any

import numpy as np

from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.approaches import slides
from brake_fenicsx.scene.bodies_section import Motion

from .brake import Brake


def parts_of(scene: Scene, brake: Brake) -> dict[str, dict[str, Any]]:
    """Mass and extent of each part: {"mass_kg": .., "extent_mm": [x, y, z]}.

    Masses that the scene adds to faces are left out; the extent of a body given by matrices is that
    of its nodes.
    """
    mesh = brake.mesh
    mass = dict.fromkeys(mesh.extents, 0.0)
    for layer, volume in mesh.volumes.items():
        mass[layer.partition(".")[0]] += brake.materials[layer].rho * volume
    boxes = {n: (mass[n], box) for n, box in mesh.extents.items()} | brake.elastic.bodies
    return {
        name: {"mass_kg": boxes[name][0], "extent_mm": [1e3 * side for side in boxes[name][1]]}
        for name in scene.parts
        if name in boxes
    }


def interfaces_of(scene: Scene, brake: Brake) -> dict[str, dict[str, Any]]:
    """Area, number of elements, area without opposite face and gaps of each interface."""
    interfaces = {}
    for i, name in enumerate(scene.contact):
        elements = brake.contact.interface == i
        opposite, whole = brake.faced[name]
        interfaces[name] = {
            "area_mm2": _rounded(1e6 * brake.w[elements].sum()),
            "contact_elements": int(elements.sum()),
            "faces_nothing_mm2": _rounded(1e6 * (whole - opposite)),
            "gap_um": [_rounded(1e6 * end(brake.g0[elements])) for end in (np.min, np.max)],
        }
    return interfaces


def inventory_lines(
    scene: Scene, parts: dict[str, dict[str, Any]], interfaces: dict[str, dict[str, Any]]
) -> list[str]:
    """Parts and interfaces, as above, a line each."""
    lines = []
    for name, part in parts.items():
        sides = " x ".join(f"{side:.4g}" for side in part["extent_mm"])
        lines.append(f"part {name}: {part['mass_kg']:.4g} kg, {sides} mm")
    motion = scene.motion
    for name, one in interfaces.items():
        faces = scene.contact[name].faces
        pad, disc = (face.partition(".")[0] for face in faces)
        if not slides(scene, name):
            sliding = f"{disc!r} and {pad!r} stick"
        elif motion is None:
            sliding = f"{disc!r} under {pad!r}, no motion"
        elif motion.direction is not None:
            along = ", ".join(f"{x:g}" for x in motion.direction)
            sliding = f"{disc!r} slides over {pad!r} along ({along}) at {motion.speed or '1 m/s'}"
        else:
            speed = motion.speed or "1 rad/s"
            sliding = f"{disc!r} turns about {_axis(motion)} under {pad!r} at {speed}"
        low, high = one["gap_um"]
        lines.append(
            f"contact {name}: {sliding}; area {one['area_mm2']:.4g} mm^2,"
            f" {one['contact_elements']} elements; {one['faces_nothing_mm2']:.4g} mm^2 of"
            f" {faces[0]} have no opposite face; gap before the load {low:.4g} to {high:.4g} um"
        )
    return lines


def _axis(motion: Motion) -> str:
    """The axis of a rotation in words."""
    axis = motion.axis or "z"
    named = axis if isinstance(axis, str) else f"({', '.join(f'{a:g}' for a in axis)})"
    if motion.point is None:
        return named
    return f"{named} through ({', '.join(f'{1e3 * a:g}' for a in motion.point)}) mm"


def _rounded(value: float) -> float:
    """A number without its round-off, and no negative zero."""
    return round(float(value), 6) + 0.0

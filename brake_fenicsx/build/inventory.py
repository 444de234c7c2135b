"""What a brake consists of, in the numbers that one compares with another model of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.faces import Face, gather_face
from brake_fenicsx.macro.free_motions import FreeMotions, free_motions
from brake_fenicsx.macro.sliding_friction import Rotation
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.approaches import slides
from brake_fenicsx.scene.bodies_section import Motion

from .brake import Brake
from .contact_doubts import displacement_doubts, resolution_doubts
from .interfaces import scene_motion
from .material_table import layer_materials
from .part_builders import file_parts
from .stated import left_out

# Sections that join or hold parts.
JOINING = ("ties", "springs", "supports")
ALONE = 0.05  # share of a first face that faces nothing, from which it is said
APART = 10e-6  # m, smallest gap before the load from which it is said


def parts_of(scene: Scene, brake: Brake) -> dict[str, dict[str, Any]]:
    """Mass and extent of each part: {"mass_kg": .., "extent_mm": [x, y, z]}.

    Masses that the scene adds to faces are left out; the extent of a body given by matrices is that
    of its nodes.
    """
    mesh = brake.mesh
    layers = layer_materials(scene, mesh.layers)
    mass = dict.fromkeys(mesh.extents, 0.0)
    for layer, volume in mesh.volumes.items():
        mass[layer.partition(".")[0]] += layers[layer].rho * volume
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


def inventory_lines(scene: Scene, brake: Brake) -> list[str]:
    """Parts and interfaces, a line each."""
    lines = []
    for name, part in parts_of(scene, brake).items():
        sides = " x ".join(f"{side:.4g}" for side in part["extent_mm"])
        lines.append(f"part {name}: {part['mass_kg']:.4g} kg, {sides} mm")
    motion = scene.motion
    for name, one in interfaces_of(scene, brake).items():
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


def check_free_motions(scene: Scene, brake: Brake) -> list[str]:
    """Refuse parts that move freely.

    Args:
        scene: the scene.
        brake: its operators.

    Returns:
        Parts in several pieces with coincident nodes, and bodies that rest on contact unpressed.

    Raises:
        SceneError: the parts, the directions and the remedy.
    """
    given = [name for name, part in scene.parts.items() if part.matrices is not None]
    found = free_motions(brake, given)
    if found.motions:
        raise SceneError(f"{scene.file}: {_refusal(scene, brake, found)}")
    merge = [f"{text}; merge them in the mesh" for text in found.pieces.values()]
    return merge + found.unpressed


def _refusal(scene: Scene, brake: Brake, found: FreeMotions) -> str:
    """What moves freely, and the remedies."""
    sentences = []
    for (parts, how), count in found.motions.items():
        bodies = f"{count} pieces of part" if count > 1 else "parts" if len(parts) > 1 else "part"
        together = " together" if len(parts) > 1 else ""
        sentences.append(f"{bodies} {' and '.join(parts)}{together}: free to {how}")
    free = {name for parts, _ in found.motions for name in parts}
    sentences += [
        f"{text}: merge them in the mesh" for name, text in found.pieces.items() if name in free
    ]
    left = left_out(scene, brake.mesh.unread).values()
    lost = [one.said for stated in left for one in stated if one.section in JOINING]
    if lost and (of_file := [name for name in file_parts(scene) if name in free]):
        whose = f"{scene.mesh.file}, the mesh of {' and '.join(of_file)}"
        sentences.append(f"{whose}, has {' and '.join(lost)}, which the scene has not")
    return (
        f"{'; '.join(sentences)}. Hold them by supports, ties or springs; contact holds along its"
        " normal alone"
    )


def brake_doubts(scene: Scene, brake: Brake) -> list[str]:
    """What is doubtful of a brake: what is not read of its meshes, cells, places, joints, loads.

    Raises:
        SceneError: a part moves freely.
    """
    mesh = brake.mesh
    doubts = [*check_free_motions(scene, brake), *placement_doubts(scene, brake)]
    doubts += [*resolution_doubts(scene, mesh), *displacement_doubts(scene, mesh)]
    left = [
        f"{file}: not in the scene: {', '.join(one.said for one in stated)}; write them, or ignore"
        " this if you left them out"
        for file, stated in left_out(scene, mesh.unread).items()
    ]
    return [*mesh.unread.changing, *left, *brake.elastic.doubts, *doubts]


def placement_doubts(scene: Scene, brake: Brake) -> list[str]:
    """First faces partly without an opposite face; faces that are apart or overlap before the load.

    Distances within the accuracy of plane facets of curved faces are left out.
    """
    lines = []
    opposite: dict[str, dict[str, float]] = {}
    for name, table in scene.contact.items():
        first, second = table.faces
        opposite.setdefault(first, {})[second] = brake.faced[name][0]
    for first, each in opposite.items():
        named = [name for name, table in scene.contact.items() if table.faces[0] == first]
        whole = brake.faced[named[0]][1]
        alone = whole - sum(each.values())
        if alone > ALONE * whole:
            lines.append(
                f"contact.{', contact.'.join(named)}: {1e6 * alone:.4g} of {1e6 * whole:.4g} mm^2"
                f" of {first} have no opposite face; correct the place of the parts, or the faces"
            )
    lines += _axis_doubts(scene, brake)
    for i, (name, table) in enumerate(scene.contact.items()):
        g0 = brake.g0[brake.contact.interface == i]
        apart, overlap = float(g0.min()), -float(g0.max())
        if max(apart, overlap) <= APART:
            continue
        faces = (gather_face(brake.mesh, brake.elastic.free, face) for face in table.faces)
        if max(apart, overlap) > APART + sum(map(_rise, faces)):
            place = (
                f"are {1e3 * apart:.3f} mm apart"
                if apart > 0
                else f"overlap by {1e3 * overlap:.3f} mm"
            )
            lines.append(
                f"contact.{name}: the faces {place} before the load; correct the place of the parts"
            )
    return lines


def _axis_doubts(scene: Scene, brake: Brake) -> list[str]:
    """Interfaces that an axis of rotation passes through."""
    motion = None if scene.motion is None else scene_motion(scene)
    if not isinstance(motion, Rotation):
        return []
    lines = []
    for i, name in enumerate(scene.contact):
        sliding = (brake.contact.interface == i) & (brake.contact.speed > 0)
        arm = np.linalg.norm(motion.local(brake.points[sliding])[:, :2], axis=1)
        if np.any(arm**2 < brake.w[sliding]):
            lines.append(
                f"contact.{name}: the axis of the motion passes through the faces, which turn"
                " there on the spot; correct motion.axis or motion.point, or write"
                " motion.direction"
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


def _rise(face: Face) -> float:
    """Rise of an arc over a plane facet, from the angles to the facets beside it: a median [m]."""
    count = min(5, len(face.centre))
    if count < 2:
        return 0.0
    away, near = cKDTree(face.centre).query(face.centre, count)
    cosine = np.einsum("ikc,ic->ik", face.normal[near[:, 1:]], face.normal)
    curvature = (np.arccos(np.clip(cosine, -1.0, 1.0)) / away[:, 1:]).max(axis=1)
    return float(np.median(curvature * face.radius**2 / 2))

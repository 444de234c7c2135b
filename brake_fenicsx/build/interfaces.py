"""Interfaces of a scene: their contact elements, restricted to zones of their faces."""

from collections.abc import Mapping
from dataclasses import fields
from itertools import combinations

from mpi4py import MPI

import numpy as np

from brake_fenicsx.arguments import Array, Mask
from brake_fenicsx.errors import SceneError, located
from brake_fenicsx.macro import contact_forces, elasticity
from brake_fenicsx.macro.contact_elements import Contact, contact_elements, restricted
from brake_fenicsx.meshing.brake_mesh import Mesh
from brake_fenicsx.scene import Scene, contact_section, units
from brake_fenicsx.scene.scene import slides

TURN = 2 * np.pi


def scene_motion(scene: Scene) -> contact_forces.Motion:
    """How the disc moves; a scene without motion has no friction, any direction serves then."""
    motion = scene.motion
    if motion is None:
        return contact_forces.Rotation(1.0)
    if motion.direction is not None:
        return contact_forces.Translation(motion.direction, motion.rate)
    return contact_forces.Rotation(motion.rate, motion.turns_about, motion.point or (0.0, 0.0, 0.0))


def interface_elements(
    scene: Scene, name: str, mesh: Mesh, free: elasticity.FreeDofs, comm: MPI.Comm
) -> Contact:
    """Contact elements of an interface, regardless of its zone.

    Args:
        scene: the scene.
        name: of the interface.
        mesh: the mesh.
        free: numbering of the free dofs.
        comm: processes that share the integrals.

    Raises:
        SceneError: the faces do not lie opposite to each other.
    """
    table = scene.contact[name]
    faces, motion = (table.faces[0], table.faces[1]), None
    if slides(scene, name):
        motion = scene_motion(scene)
    with located(scene.file):
        return contact_elements(mesh, free, faces, motion, table.discretisation, table.search, comm)


def in_zone(zone: contact_section.Zone, points: Array) -> Mask:
    """Which points lie in a zone.

    Args:
        zone: ranges [low, high) of some coordinates.
        points: positions [m], shape (n, 3).
    """
    inside, coordinates = np.ones(len(points), dtype=bool), _coordinates(points)
    for name, (low, high) in _ranges(zone).items():
        away = coordinates[name] - low
        if name == "angle":
            away = away % TURN
            # Just below zero the remainder rounds to a whole turn.
            away[away >= TURN] = 0.0
        inside &= (away >= 0) & (away < high - low)
    return inside


def zone_of(contact: Contact, zone: contact_section.Zone, where: str) -> Contact:
    """The elements of an interface in a zone.

    Args:
        contact: all elements of its faces.
        zone: ranges of their centres.
        where: what names the interface in a message.

    Raises:
        SceneError: there is none.
    """
    kept = in_zone(zone, contact.points)
    if not kept.any():
        there, coordinates = [], _coordinates(contact.points)
        for name in _ranges(zone):
            x, unit = coordinates[name], "rad" if name == "angle" else "m"
            low, high = (units.quantity_text(float(v), unit) for v in (x.min(), x.max()))
            there.append(f"{name} {low} to {high}")
        raise SceneError(f"""{where}.zone: contains no centre of a contact element; they lie at
            {", ".join(there)}; widen the zone, or refine the mesh""")
    return restricted(contact, kept)


def check_apart(scene: Scene, found: Mapping[str, Contact]) -> None:
    """Refuse interfaces on the same faces that share contact elements.

    Args:
        scene: the scene.
        found: contact elements of each interface.

    Raises:
        SceneError: the names of both, and how many elements they share.
    """
    tables = scene.contact
    for one, two in combinations(tables, 2):
        if {*tables[one].faces} != {*tables[two].faces}:
            continue
        zone = tables[two].zone
        points = found[one].points
        shared = points.shape[0] if zone is None else int(in_zone(zone, points).sum())
        if shared:
            raise SceneError(f"""{scene.file}: contact.{one}.zone, contact.{two}.zone: {shared}
                contact elements of {tables[one].faces[0]!r} and {tables[one].faces[1]!r} belong to
                both; write zones that have no centre of an element in common""")


def uncovered(scene: Scene, found: Mapping[str, Contact]) -> float:
    """Area [m^2] of the first faces of all interfaces that none of them covers.

    Args:
        scene: the scene.
        found: contact elements of each interface.
    """
    free: dict[str, float] = {}
    for name, table in scene.contact.items():
        area, face = float(found[name].w.sum()), table.faces[0]
        # Of one interface alone the area of the face is what it covers and what it does not.
        free[face] = free.get(face, found[name].uncovered + area) - area
    return sum(free.values())


def _ranges(zone: contact_section.Zone) -> dict[str, tuple[float, float]]:
    """The ranges that a zone names."""
    named = {f.name: getattr(zone, f.name) for f in fields(zone)}
    return {name: (ends[0], ends[1]) for name, ends in named.items() if ends is not None}


def _coordinates(points: Array) -> dict[str, Array]:
    """Coordinates of points by their names in a zone [m or rad]."""
    x, y, z = points.T
    return {"radius": np.hypot(x, y), "angle": np.arctan2(y, x), "x": x, "y": y, "z": z}

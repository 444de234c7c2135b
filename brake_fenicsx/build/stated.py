"""Joints, supports and loads of a mesh file that a scene has not."""

from __future__ import annotations

from typing import Any

from brake_fenicsx.meshing.rawmesh import Stated, Unread
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.approaches import slides


def left_out(scene: Scene, unread: Unread) -> dict[str, list[Stated]]:
    """Those that no section of the scene has, by file."""
    lost: dict[str, list[Stated]] = {}
    for file, stated in unread.stated:
        if not _holds(scene, stated):
            lost.setdefault(file, []).append(stated)
    return lost


def _holds(scene: Scene, stated: Stated) -> bool:
    """Whether the scene has a joint between the same faces, or a table of all faces."""
    if len(stated.faces) == 2:
        # Faces in contact may be glued; those that are tied may stick, but not slide.
        stuck = [table for name, table in scene.contact.items() if not slides(scene, name)]
        entries: list[Any] = [*scene.ties.values(), *stuck]
        if stated.section != "ties":
            entries = [*getattr(scene, stated.section).values(), *scene.ties.values()]
        pairs = [{*(entry.faces or ())} for entry in entries]
        first, second = stated.faces
        return any({a, b} in pairs for a in first for b in second)
    names = {*getattr(scene, stated.section)}
    if stated.section == "springs":
        names |= {face for spring in scene.springs.values() for face in spring.faces or ()}
    return bool(stated.faces[0]) and stated.faces[0] <= names

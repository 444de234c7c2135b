"""The mesh file of a scene: its unit, and its nodes where the lengths of the scene have them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.morphing import EVEN
from brake_fenicsx.meshing.groups import GroupedFile, mesh_of_file
from brake_fenicsx.meshing.rawmesh import RawMesh
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.parts_section import MeshTable
from brake_fenicsx.scene.units import to_si

Array = NDArray[np.float64]


def grouped_file(folder: Path, table: MeshTable) -> GroupedFile:
    """The mesh file of a scene and its groups.

    Args:
        folder: of the scene.
        table: the section [mesh].

    Raises:
        SceneError: the unit is missing or is none of length.
    """
    if table.unit is None:
        raise SceneError('mesh.unit: missing; write the unit of the file\'s lengths, as "mm"')
    try:
        metres = to_si(f"1 {table.unit}", "m")
    except ValueError as error:
        raise SceneError(f"mesh.unit = {table.unit!r}: {error}") from None
    file, unit = str(table.file), table.unit
    groups = {name: t if isinstance(t, str) else [*t] for name, t in table.groups.items()}
    return GroupedFile(folder, file, unit, metres, table.extent, groups, table.split)


def velocity(scene: Scene, read: RawMesh, parts: list[str], key: str) -> Array:
    """Movement of the nodes of a mesh file per length [m/m], shape (nodes, 3).

    Args:
        scene: the scene.
        read: the mesh of ``mesh.file``.
        parts: names of the parts that are in it.
        key: "parts.PART.morph.NAME".

    Raises:
        SceneError: the displaced mesh is another one, the same, or moves other parts.
    """
    _, part, _, name = key.split(".", 3)
    morph, where = scene.parts[part].morph[name], f"{key}.displaced"
    file = grouped_file(scene.file.parent, scene.mesh)
    moved = mesh_of_file(file, parts, (morph.displaced, where))
    step = moved.points - read.points
    others = np.ones(len(step), dtype=bool)
    others[read.cells[read.part(part)]] = False
    size = float(np.abs(step).max())
    if not size > 0:
        raise SceneError(f"{where} = {morph.displaced!r}: no node is at another place")
    if np.abs(step[others]).max(initial=0.0) > EVEN * size:
        raise SceneError(
            f"{where} = {morph.displaced!r}: nodes of other parts than {part} are moved; leave"
            " them where they are in mesh.file"
        )
    return np.asarray(step / (morph.ends[1] - morph.ends[0]))


def file_mesh(scene: Scene, parts: list[str]) -> tuple[RawMesh, dict[str, Array]]:
    """Mesh of the mesh file, its nodes where the lengths of the scene have them.

    Args:
        scene: the scene.
        parts: names of the parts that are in it.

    Returns:
        The mesh, and the movement of its nodes under each length, "parts.PART.morph.NAME".
    """
    read = mesh_of_file(grouped_file(scene.file.parent, scene.mesh), parts)
    points, moves = read.points.copy(), {}
    for part in parts:
        for name, morph in scene.parts[part].morph.items():
            key = f"parts.{part}.morph.{name}"
            moves[key] = velocity(scene, read, parts, key)
            points += (morph.length - morph.ends[0]) * moves[key]
    return replace(read, points=points), moves

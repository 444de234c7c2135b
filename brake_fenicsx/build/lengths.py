"""Lengths of a scene that vary: thicknesses of layers, and lengths that move nodes of a mesh."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.morphing import Move, Moving, deformed_layers, moving, plain
from brake_fenicsx.macro.stretching import Stretch, check_layer
from brake_fenicsx.meshing.brake_mesh import Mesh
from brake_fenicsx.meshing.rawmesh import RawMesh
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.body_rules import faces_by_area
from brake_fenicsx.scene.parts_section import (
    FILE_LAYER,
    layers_of_thickness,
    length_key,
    morph_of,
    moved_planes,
    moved_sideways,
)
from brake_fenicsx.scene.scalars import written_value

from .mesh_files import file_mesh
from .part_builders import file_parts, mesh_settings

Array = NDArray[np.float64]
Shape = Stretch | Moving
Shapes = dict[tuple[str, ...], Shape]


def lengths_in(names: tuple[str, ...], shape: Shape, values: Mapping[str, float]) -> Array:
    """Lengths of a shape by the scalars that differ from the scene [m], shape (lengths,)."""
    return np.array([values.get(n, own) for n, own in zip(names, shape.usual, strict=True)])


def shapes_of(scene: Scene, mesh: Mesh, ranges: Mapping[str, tuple[float, float]]) -> Shapes:
    """What the lengths that vary do to the layers of their parts.

    Args:
        scene: the scene.
        mesh: its mesh.
        ranges: length, by its dotted key -> lowest and highest value [m].

    Raises:
        SceneError: a layer cannot be stretched by itself, or is folded; or a face in use changes.
    """
    files, moves = file_parts(scene), dict[str, Array | None]()
    groups: list[tuple[set[str], list[str]]] = []
    for name in ranges:
        part, key = length_key(name)
        v = moves[name] = movement(scene, plain(mesh), files, name)
        layers = {f"{part}.{layer}" for layer in layers_of_thickness(scene.parts[part], key)}
        if v is not None and not layers:
            layers = {*deformed_layers(mesh, v)}
        shared = [group for group in groups if group[0] & layers]
        groups = [group for group in groups if group not in shared]
        names = [other for group in shared for other in group[1]]
        groups.append((layers.union(*(group[0] for group in shared)), [*names, name]))
    found: Shapes = {}
    for layers, names in groups:
        part, key = length_key(names[0])
        faces, usual = faces_by_area(scene, part), [written_value(scene, name) for name in names]
        if len(names) == 1 and layers_of_thickness(scene.parts[part], key):
            for layer in layers:
                check_layer(mesh, layer, usual[0] if FILE_LAYER in names[0] else None, faces)
            found[names[0],] = Stretch(tuple(layers), np.array(usual))
            continue
        every = []
        for name, length in zip(names, usual, strict=True):
            if (v := moves[name]) is None:
                raise SceneError(
                    f"{', '.join(names)}: move the same layers, which {name} can only alone: leave"
                    " one as it is, or write the two as lengths of displaced meshes or of a builder"
                )
            every.append(Move(name, length, ranges[name], v))
        found[tuple(names)] = moving(mesh, mesh_settings(scene), every, faces)
    return found


def movement(scene: Scene, raw: RawMesh, files: list[str], name: str) -> Array | None:
    """Movement of all nodes per length [m/m], shape (nodes, 3); None of a layer of a mesh file.

    Args:
        scene: the scene.
        raw: its plain mesh.
        files: names of the parts that are in the mesh file.
        name: the length, by its dotted key.
    """
    part, key = length_key(name)
    v, planes = np.zeros_like(raw.points), moved_planes(scene.parts[part], key)
    sideways = moved_sideways(scene.parts[part], key)
    if planes or sideways:
        own = np.unique(raw.cells[raw.part(part)])
        if planes:
            v[own, 2] = np.interp(raw.points[own, 2], *planes)
        if sideways:
            v[own, :2] = sideways(raw.points[own])
        return v
    if morph_of(scene.parts[part], key) is None:
        return None
    step = file_mesh(scene, files)[1][name.removesuffix(".value")]
    # The nodes of the file come behind those of the builders.
    v[len(v) - len(step) :] = step
    return v

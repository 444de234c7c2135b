"""Meshes and imposed motions that are allowed and most probably not meant: a line each."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from brake_fenicsx.macro.material import Material, engineering_constants
from brake_fenicsx.meshing.brake_mesh import Mesh, extent
from brake_fenicsx.meshing.rawmesh import EDGES, RawMesh
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.units import quantity_text

from .material_table import layer_materials

# Nodes of a wavelength below which a mesh is too coarse for it.
NODES = 6.0

# Displacement of a face over the shortest side of its part, above which it is most probably wrong.
LARGE = 0.5


def resolution_doubts(scene: Scene, mesh: Mesh) -> Iterator[str]:
    """Parts whose shortest wave at the end of the band has too few nodes.

    That is the shear wave, or the bending wave of a plate of the layer's thickness where this is
    shorter. Layers of a part that are thinner than a sixth of the shear wave follow the stiffest.

    Args:
        scene: the scene.
        mesh: of its parts.
    """
    if scene.stability is None or "stability" not in scene.stages or mesh.raw is None:
        return
    end, raw = float(scene.stability.band[1]), mesh.raw
    materials = layer_materials(scene, mesh.layers)
    for part in raw.parts():
        own = [layer for layer in raw.layers if layer.partition(".")[0] == part]
        thick = {layer: _thickness(raw, layer) for layer in own}
        stiff = {n: engineering_constants(materials[n].C)["E_x"] * thick[n] ** 3 for n in own}
        worst: tuple[float, str, float, float] | None = None
        for layer in own:
            shear, bending = _waves(materials[layer], thick[layer], end)
            if layer != max(own, key=stiff.__getitem__) and thick[layer] < shear / NODES:
                continue
            wave, power = (bending, 2.0) if bending < shear else (shear, 1.0)
            nodes = wave / _spacing(raw, layer, scene.mesh.degree)
            if worst is None or nodes < worst[0]:
                worst = nodes, layer, wave, end * (nodes / NODES) ** power
        if worst is not None and worst[0] < NODES:
            nodes, layer, wave, reached = worst
            cell = quantity_text(float(f"{wave / NODES * scene.mesh.degree:.2g}"), "m")
            yield (
                f"parts.{part}: {nodes:.2g} nodes per wavelength ({1e3 * wave:.3g} mm in {layer})"
                f" at the end of stability.band, {end:g} Hz, fewer than {NODES:g}: take cells of"
                f" {cell} at most, or end the band at {float(f'{reached:.2g}'):g} Hz"
            )


def displacement_doubts(scene: Scene, mesh: Mesh) -> Iterator[str]:
    """Imposed displacements that are not small beside the part: the analysis is linear."""
    for face, load in sorted(scene.loads.items()):
        sides = mesh.extents.get(face.partition(".")[0])
        moved = max(map(abs, (load.displacement or {}).values()), default=0.0)
        if sides is not None and moved > LARGE * min(sides):
            yield (
                f'loads."{face}".displacement = {quantity_text(moved, "m")}: the shortest side of'
                f" the part is {quantity_text(min(sides), 'm')}, and the analysis holds for small"
                " displacements; correct the unit if it is wrong"
            )


def _waves(m: Material, thickness: float, frequency: float) -> tuple[float, float]:
    """Lengths of the shear wave and of the bending wave of a plate [m]."""
    stiffness, omega = engineering_constants(m.C), 2 * np.pi * frequency
    shear = min(stiffness[name] for name in ("G_yz", "G_xz", "G_xy"))
    plate = stiffness["E_x"] * thickness**2 / (12 * m.rho)
    wave_numbers = omega / np.sqrt(shear / m.rho), np.sqrt(omega) / plate**0.25
    return 2 * np.pi / float(wave_numbers[0]), 2 * np.pi / float(wave_numbers[1])


def _thickness(raw: RawMesh, layer: str) -> float:
    """Shortest side of the box around a layer, or around the largest of its bodies [m]."""
    cells = raw.cells[raw.cell_tag == raw.layers[layer]]
    nodes, own = np.unique(cells, return_inverse=True)
    own = own.reshape(cells.shape)
    pairs = np.repeat(own[:, 0], own.shape[1] - 1), own[:, 1:].ravel()
    joined = sp.coo_matrix((np.ones(pairs[0].size), pairs), (nodes.size, nodes.size))
    _, body = connected_components(joined, directed=False)
    largest = body == np.bincount(body).argmax()
    return min(extent(raw.points[nodes[largest]]))


def _spacing(raw: RawMesh, layer: str, degree: int) -> float:
    """Distance of nodes along the longer half of the edges of cells, their median [m]."""
    x = raw.points[raw.corners[raw.cell_tag == raw.layers[layer]]]
    first, second = np.array(EDGES[raw.shape]).T
    edges = np.sort(np.linalg.norm(x[:, first] - x[:, second], axis=2), axis=1)
    return float(np.median(edges[:, edges.shape[1] // 2 :].mean(axis=1))) / degree

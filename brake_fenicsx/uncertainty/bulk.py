"""Bodies whose stiffness or loads change from sample to sample.

K is linear in the C_ij of every material, and the loads in every pressure: matrices and vectors of
unit changes are assembled once, and a sample's are sums of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.macro.brake import Brake
from brake_fenicsx.macro.condensation import gathered, gathered_vector, petsc_matrix
from brake_fenicsx.macro.elasticity import affine_parts, unit_loads
from brake_fenicsx.macro.material import rotate_about_z
from brake_fenicsx.macro.material_sample import constants, varied_stiffness
from brake_fenicsx.macro.material_table import STIFFNESSES, layer_material, stiffness
from brake_fenicsx.macro.solver import local_rows
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene_samples import split_key

Array = NDArray[np.float64]

# Voigt places of the nine orthotropic stiffnesses.
PLACES = {name: (int(name[1]) - 1, int(name[2]) - 1) for name in STIFFNESSES["orthotropic"]}


@dataclass(frozen=True, slots=True)
class Bulk:
    """What changes in the bodies, by unit changes.

    Attributes:
        K: stiffness of the scene [N/m], shape (dofs, dofs).
        materials: material -> its stiffness in the scene [Pa], shape (6, 6).
        parts: (material, C_ij) -> stiffness of a unit change [N/m per Pa].
        pressures: face -> its pressure in the scene [Pa].
        loads: face -> loads of 1 Pa [N/Pa], shape (dofs,).
    """

    K: sp.csr_matrix
    materials: dict[str, Array]
    parts: dict[tuple[str, str], sp.csr_matrix]
    pressures: dict[str, float]
    loads: dict[str, Array]

    def stiffness(self, materials: Mapping[str, Array]) -> PETSc.Mat:
        """Stiffness of a sample [N/m], of this process alone.

        Args:
            materials: random material -> its stiffness in its own axes [Pa], shape (6, 6).
        """
        return petsc_matrix(self.K + self.change(materials))

    def change(self, materials: Mapping[str, Array]) -> sp.csr_matrix:
        """What a sample's materials add to the stiffness [N/m]."""
        total = sp.csr_matrix(self.K.shape)
        for (name, constant), part in self.parts.items():
            change = (materials[name] - self.materials[name])[PLACES[constant]]
            if change:
                total = total + change * part
        return total

    def added_loads(self, pressures: Mapping[str, float], like: Array) -> Array:
        """Loads of a sample beyond those of the scene [N], shape (dofs,)."""
        f = np.zeros_like(like)
        for face, pressure in pressures.items():
            f += (pressure - self.pressures[face]) * self.loads[face]
        return f


def assemble_bulk(scene: Scene, brake: Brake) -> Bulk:
    """Assemble the unit changes of the scene's random materials and loads; collective.

    Args:
        scene: the scene.
        brake: its operators.
    """
    by_material: dict[str, list[str]] = {}
    faces = []
    for section, table, last in map(split_key, scene.samples.random):
        if section == "materials":
            by_material.setdefault(table, []).append(last)
        elif section == "loads":
            faces.append(table)
    keys, directions = [], []
    for material, names in by_material.items():
        for constant in _moved(scene, material, names):
            keys.append((material, constant))
            directions.append(_unit_change(scene, brake, material, constant))
    mesh, free = brake.mesh, brake.elastic.free
    assembled = affine_parts(mesh, free, directions)
    parts = [local_rows(gathered(A)) for A in assembled]
    loads = {face: gathered_vector(unit_loads(mesh, free, face)) for face in faces}
    return Bulk(
        local_rows(gathered(brake.K)) if parts else sp.csr_matrix((0, 0)),
        {name: stiffness(scene.materials[name]) for name in by_material},
        dict(zip(keys, parts, strict=True)),
        {face: scene.loads[face].pressure for face in faces},
        loads,
    )


def _moved(scene: Scene, material: str, names: list[str]) -> list[str]:
    """Which C_ij the random constants of a material move."""
    table = scene.materials[material]
    C, usual = stiffness(table), constants(table)
    moved = np.zeros((6, 6), dtype=bool)
    for name in names:
        change = varied_stiffness(table, {name: usual[name] * 1.001 or 1e-3}) - C
        moved |= np.abs(change) > 1e-9 * np.abs(C).max()
    return [constant for constant, place in PLACES.items() if moved[place]]


def _unit_change(scene: Scene, brake: Brake, material: str, constant: str) -> dict[str, Array]:
    """Change of every layer's stiffness under one of a material's C_ij, in x, y, z axes."""
    unit = np.zeros((6, 6))
    i, j = PLACES[constant]
    unit[i, j] = unit[j, i] = 1.0
    changes = {}
    for layer in brake.mesh.layers:
        name, _, inner = layer.partition(".")
        if layer_material(scene.parts[name].material, inner) == material:
            angle = scene.parts[name].axis + scene.materials[material].axis
            changes[layer] = rotate_about_z(unit, angle)
    return changes

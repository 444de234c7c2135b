"""Stiffness, mass and damping of each layer by itself: what a mode owes to each of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.macro.brake import Brake, scene_motion
from brake_fenicsx.macro.elasticity import affine_parts
from brake_fenicsx.macro.friction import Rotation
from brake_fenicsx.macro.material_table import layer_material, layer_materials, scene_materials
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.damping import turning_parts
from brake_fenicsx.stability.damping import RAYLEIGH, gyroscopic, stiffness_share
from brake_fenicsx.stability.derivatives import bilinear
from brake_fenicsx.stability.modes import Complex

from .inputs import nominal_value
from .random_materials import RandomMaterials, unit_change
from .sampling import SPEED

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Layer:
    """One layer of a part.

    Attributes:
        material: name of its material.
        K: stiffness in the scene [N/m], shape (dofs, dofs).
        M: mass [kg].
        G: gyroscopic term [N s/m]; None where it does not turn.
        changes: C_ij of a random material -> stiffness of a unit change [N/m per Pa].
    """

    material: str
    K: sp.csr_matrix
    M: sp.csr_matrix
    G: sp.csr_matrix | None
    changes: dict[str, sp.csr_matrix]


@dataclass(frozen=True, slots=True)
class Layers:
    """All layers of a scene.

    Attributes:
        named: "part.layer" -> layer.
        scene: the scene.
        reference: frequency of the loss factors [rad/s]; None: that of each mode.
    """

    named: dict[str, Layer]
    scene: Scene
    reference: float | None

    def derivatives(
        self,
        changes: Mapping[tuple[str, str], float],
        values: Mapping[str, float],
        s: Complex,
        vectors: tuple[Complex, ...],
    ) -> dict[tuple[str, str], Complex]:
        """Derivatives of lambda to the stiffness, mass and loss factor of each layer.

        Args:
            changes: (material, C_ij) -> how much it differs from the scene's [Pa].
            values: scalars that differ from the scene, by dotted key, SI.
            s: eigenvalues lambda [1/s], shape (modes,).
            vectors: right and left ones, shape (dofs, modes), and psi^H P'(lambda) phi.

        Returns:
            (layer, "stiffness", "mass" or "loss factor") -> d lambda / d ln E, / d ln rho with the
            damping that follows them, and / d eta at the reference [1/s], shape (modes,).
        """
        out = {}
        alpha, faster = self._alpha(values), 1.0
        if SPEED in values:
            faster = values[SPEED] / nominal_value(self.scene, SPEED)
        frequency = np.abs(s.imag) if self.reference is None else self.reference
        for name, layer in self.named.items():
            K = layer.K
            for constant, A in layer.changes.items():
                K = K + changes.get((layer.material, constant), 0.0) * A
            stiffness, mass = bilinear(K, *vectors), s * bilinear(layer.M, *vectors)
            turning = 0.0 if layer.G is None else bilinear(layer.G, *vectors)
            share = stiffness_share(self.scene, layer.material, values)
            out[name, "stiffness"] = (1 + s * share) * stiffness
            out[name, "mass"] = (s + alpha) * mass + s * faster * turning
            out[name, "loss factor"] = s / frequency * stiffness
        return out

    def _alpha(self, values: Mapping[str, float]) -> float:
        """Rayleigh's factor of the mass [1/s]."""
        table = self.scene.stability.damping if self.scene.stability else None
        own = table.rayleigh[0] if table and table.rayleigh else 0.0
        return values.get(RAYLEIGH[0], own)


def scene_layers(
    scene: Scene,
    brake: Brake,
    masses: Mapping[str, sp.csr_matrix],
    materials: RandomMaterials | None,
) -> Layers:
    """Assemble the stiffness of every layer.

    Args:
        scene: the scene.
        brake: its operators.
        masses: mass of each layer [kg].
        materials: unit changes of random materials, if there are any.
    """
    mesh, free = brake.mesh, brake.elastic.free
    table = scene.stability.damping if scene.stability else None
    turns = set(turning_parts(scene)) if table and table.gyroscopic else set()
    motion, named = scene_motion(scene), {}

    def stiffness(C: Array, layer: str) -> sp.csr_matrix:
        (A,) = affine_parts(mesh, free, [{layer: C}])
        A.eliminate_zeros()
        return A

    random = [] if materials is None else list(materials.changes)
    for name, material in layer_materials(scene, scene_materials(scene), mesh.layers).items():
        part, _, inner = name.partition(".")
        own, G = layer_material(scene.parts[part].material, inner), None
        if part in turns and isinstance(motion, Rotation):
            G = gyroscopic(mesh, free, {name: material.rho}, motion)
        changes = {
            constant: stiffness(unit_change(scene, mesh, own, constant)[name], name)
            for other, constant in random
            if other == own
        }
        K = stiffness(material.C, name)
        named[name] = Layer(str(own), K, masses[name], G, changes)
    reference = table.reference if table and table.loss else None
    return Layers(named, scene, reference)

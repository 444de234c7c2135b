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
from brake_fenicsx.macro.material import Material
from brake_fenicsx.macro.material_table import layer_materials, scene_materials
from brake_fenicsx.macro.stretching import stretched
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.damping import turning_parts
from brake_fenicsx.stability.damping import gyroscopic, mass_share, stiffness_share
from brake_fenicsx.stability.derivatives import bilinear
from brake_fenicsx.stability.modes import Complex

from .changing_bodies import changed_materials, material_of, stretches
from .inputs import nominal_value
from .sampling import SPEED

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Layer:
    """One layer of a part.

    Attributes:
        material: name of its material.
        M: mass in the scene [kg], shape (dofs, dofs).
        G: gyroscopic term [N s/m]; None where it does not turn.
    """

    material: str
    M: sp.csr_matrix
    G: sp.csr_matrix | None


@dataclass(frozen=True, slots=True)
class Layers:
    """All layers of a scene.

    Attributes:
        named: "part.layer" -> layer.
        scene: the scene.
        brake: its operators.
        reference: frequency of the loss factors [rad/s]; None: that of each mode.
    """

    named: dict[str, Layer]
    scene: Scene
    brake: Brake
    reference: float | None

    def derivatives(
        self, values: Mapping[str, float], s: Complex, vectors: tuple[Complex, ...]
    ) -> dict[tuple[str, str], Complex]:
        """Derivatives of lambda to the stiffness, mass and loss factor of each layer.

        Args:
            values: scalars that differ from the scene, by dotted key, SI.
            s: eigenvalues lambda [1/s], shape (modes,).
            vectors: right and left ones, shape (dofs, modes), and psi^H P'(lambda) phi.

        Returns:
            (layer, "stiffness", "mass" or "loss factor") -> d lambda / d ln E, / d ln rho with the
            damping that follows them, and / d eta at the reference [1/s], shape (modes,).
        """
        out = {}
        alpha, faster = mass_share(self.scene, values), 1.0
        if SPEED in values:
            faster = values[SPEED] / nominal_value(self.scene, SPEED)
        frequency = np.abs(s.imag) if self.reference is None else self.reference
        stretch, materials = stretches(self.scene, values), self._materials(values)
        for name, layer in self.named.items():
            thicker = stretch.get(name, 1.0)
            K = self._stiffness(name, materials[name].C, thicker)
            stiffness, mass = bilinear(K, *vectors), s * thicker * bilinear(layer.M, *vectors)
            turning = 0.0 if layer.G is None else bilinear(layer.G, *vectors)
            share = stiffness_share(self.scene, layer.material, values)
            out[name, "stiffness"] = (1 + s * share) * stiffness
            out[name, "mass"] = (s + alpha) * mass + s * faster * thicker * turning
            out[name, "loss factor"] = s / frequency * stiffness
        return out

    def _materials(self, values: Mapping[str, float]) -> dict[str, Material]:
        """Material of each layer, in x, y, z."""
        own = scene_materials(self.scene)
        for name, C in changed_materials(self.scene, values).items():
            own[name] = Material(C, own[name].rho)
        return layer_materials(self.scene, own, self.named)

    def _stiffness(self, layer: str, C: Array, stretch: float) -> sp.csr_matrix:
        mesh = self.brake.mesh
        with stretched(mesh, stretch):
            (A,) = affine_parts(mesh, self.brake.elastic.free, [{layer: C}])
        A.eliminate_zeros()
        return A


def scene_layers(scene: Scene, brake: Brake, masses: Mapping[str, sp.csr_matrix]) -> Layers:
    """The layers of a scene.

    Args:
        scene: the scene.
        brake: its operators.
        masses: mass of each layer [kg].
    """
    mesh, free = brake.mesh, brake.elastic.free
    table = scene.damping
    turns = set(turning_parts(scene)) if table and table.gyroscopic else set()
    motion, named = scene_motion(scene), {}
    for name, material in layer_materials(scene, scene_materials(scene), mesh.layers).items():
        G = None
        if name.partition(".")[0] in turns and isinstance(motion, Rotation):
            G = gyroscopic(mesh, free, {name: material.rho}, motion)
        named[name] = Layer(material_of(scene, name), masses[name], G)
    return Layers(named, scene, brake, table.reference if table and table.loss else None)

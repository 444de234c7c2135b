"""Stiffness, mass and damping of each layer by itself: what a mode owes to each of them."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.build.brake import Brake
from brake_fenicsx.build.damping_terms import mass_share, stiffness_share
from brake_fenicsx.build.interfaces import scene_motion
from brake_fenicsx.build.material_table import layer_materials, nominal_value, scene_materials
from brake_fenicsx.macro.elasticity import affine_parts
from brake_fenicsx.macro.friction import Rotation
from brake_fenicsx.macro.layer_mass import layer_masses
from brake_fenicsx.macro.material import Material
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.approaches import turning_parts
from brake_fenicsx.scene.samples_section import split_key
from brake_fenicsx.scene.scalars import SPEED
from brake_fenicsx.stability.damping_matrices import gyroscopic
from brake_fenicsx.stability.derivatives import bilinear
from brake_fenicsx.stability.modes import Complex

from .changes import changed_materials
from .lengths import Shapes, lengths_in
from .material_table import material_of

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Layers:
    """All layers of a scene.

    Attributes:
        scene: the scene.
        brake: its operators.
        shapes: lengths that vary, by their dotted keys.
    """

    scene: Scene
    brake: Brake
    shapes: Shapes

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
        out, table = {}, self.scene.damping
        frequency = table.reference if table and table.loss else np.abs(s.imag)
        alpha, faster = mass_share(self.scene, values), 1.0
        if SPEED in values:
            faster = values[SPEED] / nominal_value(self.scene, SPEED)
        own = scene_materials(self.scene)
        for name, C in changed_materials(self.scene, values).items():
            own[name] = Material(C, own[name].rho)
        for key, rho in values.items():
            section, name, last = split_key(key)
            if section == "materials" and last == "rho":
                own[name] = Material(own[name].C, rho)
        for name, material in layer_materials(self.scene, own, self.brake.mesh.layers).items():
            stiffness, mass, turning = (
                0.0 if A is None else bilinear(A, *vectors)
                for A in self._matrices(name, material, values)
            )
            share = stiffness_share(self.scene, material_of(self.scene, name), values)
            out[name, "stiffness"] = (1 + s * share) * stiffness
            out[name, "mass"] = s * (s + alpha) * mass + s * faster * turning
            out[name, "loss factor"] = s / frequency * stiffness
        return out

    def _matrices(
        self, layer: str, material: Material, values: Mapping[str, float]
    ) -> tuple[sp.csr_matrix, sp.csr_matrix, sp.csr_matrix | None]:
        """Stiffness [N/m], mass [kg] and gyroscopic term [N s/m] of a layer, where it turns."""
        mesh, free, density = self.brake.mesh, self.brake.elastic.free, {layer: material.rho}
        turns, motion = turning_parts(self.scene), scene_motion(self.scene)
        with ExitStack() as lengths:
            for names, shape in self.shapes.items():
                if layer in shape.layers:
                    lengths.enter_context(shape.applied(mesh, lengths_in(names, shape, values)))
            (K,) = affine_parts(mesh, free, [{layer: material.C}])
            M = layer_masses(mesh, free, density, self.scene.mesh.mass == "lumped")[layer]
            G = None
            if layer.partition(".")[0] in turns and isinstance(motion, Rotation):
                G = gyroscopic(mesh, free, density, motion)
        K.eliminate_zeros()
        return K, M, G

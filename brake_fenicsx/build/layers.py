"""Stiffness, mass and damping of each layer by itself: what a mode owes to each of them."""

from __future__ import annotations

from contextlib import ExitStack

import scipy.sparse as sp

from brake_fenicsx.macro.elasticity import affine_parts, layer_masses
from brake_fenicsx.macro.material import Material
from brake_fenicsx.macro.sliding_friction import Rotation
from brake_fenicsx.scene.approaches import turning_parts
from brake_fenicsx.scene.scalars import SPEED
from brake_fenicsx.stability.damping_matrices import gyroscopic
from brake_fenicsx.stability.derivatives import bilinear
from brake_fenicsx.stability.modes import Complex

from .damping_terms import mass_share, stiffness_share
from .interfaces import scene_motion
from .lengths import lengths_in
from .material_table import layer_materials, material_of
from .parametric import BrakeAt


def layer_derivatives(
    brake: BrakeAt, s: Complex, vectors: tuple[Complex, ...]
) -> dict[tuple[str, str], Complex]:
    """Derivatives of lambda to the stiffness, mass and loss factor of each layer.

    Args:
        brake: of the sample.
        s: eigenvalues lambda [1/s], shape (modes,).
        vectors: right and left ones, shape (dofs, modes), and psi^H P'(lambda) phi.

    Returns:
        (layer, "stiffness", "mass" or "loss factor") -> d lambda / d ln E, / d ln rho with the
        damping that follows them, and / d eta at the reference [1/s], shape (modes,).
    """
    values, out = brake.values, dict[tuple[str, str], Complex]()
    scene, table = values.scene, values.scene.damping
    frequency = table.reference if table and table.loss else abs(s.imag)
    alpha, faster = mass_share(scene, values), values.ratio(SPEED)
    own = {
        name: Material(values.stiffness(name), t.rho * values.ratio(f"materials.{name}.rho"))
        for name, t in scene.materials.items()
    }
    for name, material in layer_materials(scene, brake.reference.mesh.layers, own).items():
        stiffness, mass, turning = (
            0.0 if A is None else bilinear(A, *vectors) for A in _matrices(brake, name, material)
        )
        share = stiffness_share(scene, material_of(scene, name), values)
        out[name, "stiffness"] = (1 + s * share) * stiffness
        out[name, "mass"] = s * (s + alpha) * mass + s * faster * turning
        out[name, "loss factor"] = s / frequency * stiffness
    return out


def _matrices(
    brake: BrakeAt, layer: str, material: Material
) -> tuple[sp.csr_matrix, sp.csr_matrix, sp.csr_matrix | None]:
    """Stiffness [N/m], mass [kg] and gyroscopic term [N s/m] of a layer, where it turns."""
    scene, mesh, free = brake.values.scene, brake.reference.mesh, brake.reference.elastic.free
    density, motion, changes = {layer: material.rho}, scene_motion(scene), brake.reference.changes
    with ExitStack() as lengths:
        for names, shape in changes.shapes.items() if changes else ():
            if layer in shape.layers:
                lengths.enter_context(shape.applied(mesh, lengths_in(names, shape, brake.values)))
        (K,) = affine_parts(mesh, free, [{layer: material.C}])
        M = layer_masses(mesh, free, density, scene.mesh.mass == "lumped")[layer]
        G = None
        if layer.partition(".")[0] in turning_parts(scene) and isinstance(motion, Rotation):
            G = gyroscopic(mesh, free, density, motion)
    K.eliminate_zeros()
    return K, M, G

"""A brake as a function of the scalars of its scene: ``brake.at(values)``.

What it gives is made once for a sample and passed on; matrices of bodies that change are summed
where they are asked for, which a sample of the reduced model does not. Matrices of each layer by
itself tell what a mode owes to it.
"""

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import Array, Complex
from brake_fenicsx.macro import contact_elements, contact_forces, elasticity
from brake_fenicsx.macro.material import Material
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.scalars import SPEED
from brake_fenicsx.stability.derivatives import bilinear

from .brake import Brake, layer_matrix
from .changes import ChangingBodies, assemble_changes
from .damping_terms import Terms, damping_terms, mass_share, stiffness_share, turning_density
from .lengths import lengths_in
from .material_table import layer_materials, material_of
from .values import Values


@dataclass(frozen=True, kw_only=True, repr=False)
class ParametricBrake(Brake):
    """Operators of a scene, and what its random and swept scalars change in them.

    Attributes:
        scene: the scene.
        changes: what they change in the bodies.
        terms: of the damping.
    """

    scene: Scene
    changes: ChangingBodies
    terms: Terms

    def at(self, values: Mapping[str, float]) -> "BrakeAt":
        """The brake of a sample.

        Args:
            values: scalars that differ from the scene, by dotted key, SI.
        """
        return BrakeAt(self, Values.of(self.scene, values))

    @cached_property
    def masses(self) -> dict[str, sp.csr_matrix]:
        """Mass of each layer, and of bodies given by matrices [kg], shape (dofs, dofs)."""
        return {name: self.layer_mass(name) for name in self.layers}

    @property
    def layers(self) -> list[str]:
        """Names of all layers, and of bodies given by matrices."""
        return list(self.materials | self.elastic.masses)

    def layer_mass(self, name: str) -> sp.csr_matrix:
        """Mass of one layer, or of a body given by matrices [kg], shape (dofs, dofs)."""
        if name in self.elastic.masses:
            return self.elastic.masses[name]
        density, lumped = {name: self.materials[name].rho}, self.scene.mesh.mass == "lumped"
        return elasticity.layer_masses(self.mesh, self.elastic.free, density, lumped)[name]

    @cached_property
    def central_mass(self) -> sp.csr_matrix:
        """Mass at the centre of the box [kg]: of the scene where nothing changes."""
        box = self.changes.box
        change = self.changes.change(box.values(np.zeros(len(box.names))), "M")
        return self.M if change is None else self.M + change


def parametric_brake(scene: Scene, brake: Brake) -> ParametricBrake:
    """Assemble what the random and swept scalars of a scene change.

    Args:
        scene: the scene.
        brake: its operators.

    Raises:
        SceneError: a range that the mesh does not stand, or a face in use that would change.
    """
    given = {f.name: getattr(brake, f.name) for f in fields(Brake)}
    terms = damping_terms(scene, brake) if "stability" in scene.stages else Terms()
    return ParametricBrake(
        **given, scene=scene, changes=assemble_changes(scene, brake), terms=terms
    )


class BrakeAt:
    """The brake of one sample.

    Attributes:
        reference: the brake of the scene.
        values: scalars that differ from the scene.
        own_bodies: whether stiffness or mass are not those of the scene.
    """

    def __init__(self, brake: ParametricBrake, values: Values):
        """See ``ParametricBrake.at``."""
        self.reference, self.values = brake, values
        self.own_bodies: bool = brake.changes.changed_by(values)

    @cached_property
    def contact(self) -> contact_elements.Contact:
        """Contact elements."""
        return self.reference.changes.contact.at(self.values)

    @property
    def pressures(self) -> Array:
        """Factors of the scene's unit loads: pressures [Pa], or 1, shape (loads,)."""
        return self.values.pressures

    @cached_property
    def point(self) -> Array:
        """Point of the box [-1, 1]^d of the reduced model, shape (d,)."""
        return self.reference.changes.box.point(self.values)

    @cached_property
    def stiffness_change(self) -> sp.csr_matrix | None:
        """K less that of the scene [N/m]; None where the bodies are those of the scene."""
        return self.reference.changes.change(self.values, "K") if self.own_bodies else None

    @property
    def K(self) -> sp.csr_matrix:
        """Elastic stiffness [N/m], shape (dofs, dofs)."""
        change = self.stiffness_change
        return self.reference.K if change is None else (self.reference.K + change).tocsr()

    @cached_property
    def M(self) -> sp.csr_matrix:
        """Mass [kg], likewise."""
        change = self.reference.changes.change(self.values, "M") if self.own_bodies else None
        return self.reference.M if change is None else (self.reference.M + change).tocsr()

    def C(self, friction: contact_forces.SlidingFriction, p: Array) -> sp.csr_matrix | None:
        """Damping at an equilibrium [N s/m], likewise; None where nothing damps the sample.

        Args:
            friction: of the contact elements.
            p: pressures [Pa], shape (elements,).
        """
        change = self.reference.changes.change(self.values, "C") if self.values else None
        return self.reference.terms.matrix(self.contact, friction, p, change)

    def rates(self, friction: contact_forces.SlidingFriction, p: Array) -> tuple[Array, Array]:
        """Factors of slip rates that the damping of the scene names; see there."""
        return friction.rates(p, self.reference.terms.turns, self.reference.terms.falls)


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
    scene, whole = brake.values.scene, brake.reference
    density, turns = {layer: material.rho}, layer in turning_density(scene, whole)
    with ExitStack() as lengths:
        for names, shape in whole.changes.shapes.items():
            if layer in shape.layers:
                own = lengths_in(names, shape, brake.values)
                lengths.enter_context(shape.applied(whole.mesh, own))
        K = layer_matrix(scene, whole, "K", {layer: material.C})
        M = layer_matrix(scene, whole, "M", density)
        G = layer_matrix(scene, whole, "C", density) if turns else None
    K.eliminate_zeros()
    return K, M, G

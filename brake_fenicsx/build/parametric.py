"""A brake as a function of the scalars of its scene: ``brake.at(values)``.

What it gives is made once for a sample and passed on; matrices of bodies that change are summed
where they are asked for, which a sample of the reduced model does not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.macro.contact_elements import Contact
from brake_fenicsx.macro.elasticity import layer_masses
from brake_fenicsx.macro.sliding_friction import SlidingFriction
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.scalars import changes_bodies

from .brake import Brake
from .changes import ChangingBodies, assemble_changes
from .damping_terms import Terms, damping_terms
from .values import Values

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ParametricBrake(Brake):
    """Operators of a scene, and what its random and swept scalars change in them.

    Attributes:
        scene: the scene.
        changes: of the bodies; None where no scalar enters their matrices.
        terms: of the damping; None without any.
    """

    scene: Scene
    changes: ChangingBodies | None
    terms: Terms | None

    def __repr__(self) -> str:
        """One line."""
        return Brake.__repr__(self)

    def at(self, values: Mapping[str, float]) -> BrakeAt:
        """The brake of a sample.

        Args:
            values: scalars that differ from the scene, by dotted key, SI.
        """
        return BrakeAt(self, Values.of(self.scene, values))

    @cached_property
    def masses(self) -> dict[str, sp.csr_matrix]:
        """Mass of each layer, and of bodies given by matrices [kg], shape (dofs, dofs)."""
        density = {name: m.rho for name, m in self.materials.items()}
        lumped = self.scene.mesh.mass == "lumped"
        found = layer_masses(self.mesh, self.elastic.free, density, lumped)
        return found | self.elastic.masses

    @cached_property
    def central_mass(self) -> sp.csr_matrix:
        """Mass at the centre of the box [kg]: of the scene where nothing changes."""
        if self.changes is None:
            return self.M
        box = self.changes.box
        return self.M + self.changes.change(box.values(np.zeros(len(box.names))), "M")


def parametric_brake(scene: Scene, brake: Brake) -> ParametricBrake:
    """Assemble what the random and swept scalars of a scene change.

    Args:
        scene: the scene.
        brake: its operators.

    Raises:
        SceneError: a range that the mesh does not stand, or a face in use that would change.
    """
    given = {f.name: getattr(brake, f.name) for f in fields(Brake)}
    changing = any(changes_bodies(scene, name) for name in scene.varied)
    return ParametricBrake(
        **given, scene=scene, changes=assemble_changes(scene, brake) if changing else None,
        terms=damping_terms(scene, brake) if "stability" in scene.stages else None,
    )  # fmt: skip


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
        self._changes = brake.changes
        self.own_bodies: bool = self._changes is not None and self._changes.changed_by(values)

    @cached_property
    def contact(self) -> Contact:
        """Contact elements."""
        return (
            self.reference.contact
            if self._changes is None
            else self._changes.contact.at(self.values)
        )

    @property
    def pressures(self) -> Array:
        """Factors of the scene's unit loads: pressures [Pa], or 1, shape (loads,)."""
        return self.values.pressures

    @cached_property
    def point(self) -> Array:
        """Point of the box [-1, 1]^d of the reduced model, shape (d,)."""
        return np.zeros(0) if self._changes is None else self._changes.box.point(self.values)

    @cached_property
    def stiffness_change(self) -> sp.csr_matrix | None:
        """K less that of the scene [N/m]; None where the bodies are those of the scene."""
        if self._changes is None or not self.own_bodies:
            return None
        return self._changes.change(self.values, "K")

    @property
    def K(self) -> sp.csr_matrix:
        """Elastic stiffness [N/m], shape (dofs, dofs)."""
        change = self.stiffness_change
        return self.reference.K if change is None else (self.reference.K + change).tocsr()

    @cached_property
    def M(self) -> sp.csr_matrix:
        """Mass [kg], likewise."""
        if self._changes is None or not self.own_bodies:
            return self.reference.M
        return (self.reference.M + self._changes.change(self.values, "M")).tocsr()

    def C(self, friction: SlidingFriction, p: Array) -> sp.csr_matrix | None:
        """Damping at an equilibrium [N s/m], likewise; None where nothing damps the sample.

        Args:
            friction: of the contact elements.
            p: pressures [Pa], shape (elements,).
        """
        if self.reference.terms is None:
            return None
        change = self._changes.change(self.values, "C") if self._changes and self.values else None
        return self.reference.terms.matrix(self.contact, friction, p, change)

    def rates(self, friction: SlidingFriction, p: Array) -> tuple[Array, Array]:
        """Factors of slip rates that the damping of the scene names; see there."""
        terms = self.reference.terms or Terms()
        return friction.rates(p, terms.turns, terms.falls)

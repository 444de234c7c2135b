"""Braking equilibria of samples: on the scene's bodies, or on bodies of their own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import NotConverged
from brake_fenicsx.log import logger
from brake_fenicsx.macro.condensation import compliance
from brake_fenicsx.macro.corrected import Bodies, corrected_equilibrium
from brake_fenicsx.macro.equilibrium import (
    Equilibrium,
    displacement,
    equilibrium,
    limit_of_friction,
)

from .models import Models

if TYPE_CHECKING:
    from .sampling import SampleInput

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Equilibria:
    """What the equilibria of all samples share.

    Attributes:
        models: the brake as its samples see it.
        steps: load steps, taken only if the full load at once does not converge.
    """

    models: Models
    steps: int

    def of(self, approach: str, sample: SampleInput, reduced: bool = False) -> Equilibrium:
        """Equilibrium of a sample.

        Args:
            approach: of the sample.
            sample: its inputs.
            reduced: whether the reduced model may give the compliance of bodies that change.

        Raises:
            NotConverged: neither the full load at once nor the scene's ramp converges.
        """
        for steps in sorted({1, self.steps}):
            try:
                return self._loaded(approach, sample, steps, reduced)
            except NotConverged as error:
                failed = error
        mu = sample.mu_equilibrium
        raise limit_of_friction(self._bodies(sample), sample.laws, mu, self.steps, failed)

    def displacement(self, approach: str, sample: SampleInput, data: dict[str, Any]) -> Array:
        """Displacement of a stored equilibrium [m], shape (dofs,).

        Args:
            approach: of the sample.
            sample: its inputs.
            data: what was stored of it.
        """
        if sample.materials:
            u = self.of(approach, sample).u
            if u is None:
                raise ValueError("an equilibrium of changed bodies without displacement")
            return u
        zero: tuple[Any, ...] = ((0,), 0.0, (), 0.0)
        eq = Equilibrium(
            data["g"], data["p"], data["k"], data["k_vibration"], data["mu_equilibrium"], *zero
        )
        bodies = self._bodies(sample)
        return displacement(bodies, eq, bodies.f)

    def _loaded(self, approach: str, sample: SampleInput, steps: int, reduced: bool) -> Equilibrium:
        """Equilibrium in equal load steps."""
        laws, mu, bodies = sample.laws, sample.mu_equilibrium, self._bodies(sample)
        materials = self.models.materials
        if materials is None or not sample.materials:
            return equilibrium(bodies, laws, mu, steps)
        if reduced:
            bodies = self._reduced_bodies(approach, sample, bodies)
            return equilibrium(bodies, laws, mu, steps)
        try:
            change = materials.change(sample.materials)
            return corrected_equilibrium(bodies, change, laws, mu, steps)
        except NotConverged:
            logger.info("the materials of a sample are far from the scene's: factored anew")
        b, K = self.models.brake, materials.stiffness(sample.materials)
        own = compliance(K, b.N, b.T, b.w, bodies.f, bodies.compliance.k0, MPI.COMM_SELF)
        bodies = replace(bodies, compliance=own)
        eq = equilibrium(bodies, laws, mu, steps)
        u = displacement(bodies, eq, bodies.f)
        own.factor.destroy()
        return replace(eq, u=u)

    def _reduced_bodies(self, approach: str, sample: SampleInput, bodies: Bodies) -> Bodies:
        """The bodies of a sample's own materials, from the reduced model."""
        models, c = self.models, bodies.compliance
        model = models.reduced[models.damped(approach)]
        NN, NT, gaps = model.static(models.parameter_point(sample.random), c.k0)
        faces = sorted(models.pressures)
        pressures = {**models.pressures, **sample.pressures}
        Nf = gaps @ np.array([pressures[face] for face in faces])
        return replace(bodies, compliance=replace(c, NN=NN, NT=NT, Nf=Nf))

    def _bodies(self, sample: SampleInput) -> Bodies:
        """The scene's bodies under the loads of a sample."""
        models = self.models
        b, c, f = models.brake, models.compliance, models.brake.f
        if models.materials is not None and sample.pressures:
            Nf = c.Nf
            for face, value in sample.pressures.items():
                Nf = Nf + (value - models.pressures[face]) * models.unit_gaps[face]
            c, f = replace(c, Nf=Nf), f + models.materials.added_loads(sample.pressures, f)
        return Bodies(b.N, b.T, b.w, b.g0, f, c)

"""Braking equilibria of samples: on the scene's bodies, or on bodies of their own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import NotConverged
from brake_fenicsx.folder.log import logger
from brake_fenicsx.macro.condensation import compliance, reference_factor
from brake_fenicsx.macro.equilibrium import (
    Equilibrium,
    displacement,
    equilibrium,
    raised_friction,
)
from brake_fenicsx.macro.equilibrium_change import BodyOperators, corrected_equilibrium
from brake_fenicsx.macro.solver import Factor

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
        tolerance: of Newton's iterations, see ``equilibrium``.
    """

    models: Models
    steps: int
    tolerance: float

    def of(
        self,
        approach: str,
        sample: SampleInput,
        reduced: bool = False,
        start: Array | None = None,
    ) -> Equilibrium:
        """Equilibrium of a sample.

        Args:
            approach: of the sample.
            sample: its inputs.
            reduced: whether the reduced model may give the compliance of bodies that change.
            start: gaps of an equilibrium nearby [m], to start from.

        Raises:
            NotConverged: neither the full load at once nor the scene's ramp converges, nor is
                there an equilibrium that can be followed from the one without friction.
        """
        laws, mu, changes = sample.laws, sample.mu_equilibrium, self.models.changes
        if changes is not None and self.models.has_own_bodies(sample) and not reduced:
            bodies = self._bodies(sample)
            still = self.models.contact(sample.random) is self.models.brake.contact
            if still and bodies.compliance.factor is not None:
                try:
                    change = changes.stiffness_change(sample.random)
                    return corrected_equilibrium(bodies, change, laws, mu, tolerance=self.tolerance)
                except NotConverged:
                    logger.info(
                        "the bodies of a sample are far from those of the scene: the matrices"
                        " are factored again"
                    )
        bodies = self.bodies(approach, sample, reduced)
        if start is not None:
            with suppress(NotConverged):
                return equilibrium(bodies, laws, mu, tolerance=self.tolerance, start=start)
        for steps in sorted({1, self.steps}):
            try:
                return equilibrium(bodies, laws, mu, steps, self.tolerance)
            except NotConverged as error:
                failed = error
        return raised_friction(bodies, laws, mu, failed, self.tolerance)

    def bodies(self, approach: str, sample: SampleInput, reduced: bool) -> BodyOperators:
        """The bodies of a sample under its loads; the arguments are those of ``of``."""
        bodies = self._bodies(sample)
        if not self.models.has_own_bodies(sample):
            return bodies
        if reduced:
            return self._reduced_bodies(approach, sample, bodies)
        return self._full_bodies(sample, bodies)

    def displacements(
        self, given: Sequence[tuple[SampleInput, Mapping[str, Any]]]
    ) -> Iterator[Array]:
        """Displacements of stored equilibria [m], shape (dofs,) each.

        Args:
            given: of each sample its inputs, and what was stored of it.
        """
        zero: tuple[Any, ...] = ((0,), 0.0, (), 0.0)
        shared = list[Factor]()
        for sample, data in given:
            eq = Equilibrium(
                data["g"], data["p"], data["k"], data["k_vibration"], data["mu_equilibrium"], *zero
            )
            bodies, own = self._bodies(sample), self.models.has_own_bodies(sample)
            c = bodies.compliance
            factor = None if own else c.factor or next(iter(shared), None)
            if factor is None:
                factor = reference_factor(self.models.stiffness(sample), bodies.N, bodies.w, c.k0)
                shared += [] if own else [factor]
            yield displacement(replace(bodies, compliance=replace(c, factor=factor)), eq, bodies.f)
            if own:
                factor.destroy()
        for factor in shared:
            factor.destroy()

    def _full_bodies(self, sample: SampleInput, bodies: BodyOperators) -> BodyOperators:
        """The own bodies of a sample, factored anew."""
        b, K = bodies, self.models.stiffness(sample)
        own = compliance(K, b.N, b.T, b.w, b.f, b.compliance.k0, MPI.COMM_SELF)
        if own.factor is not None:
            own.factor.destroy()
        return replace(bodies, compliance=replace(own, factor=None))

    def _reduced_bodies(
        self, approach: str, sample: SampleInput, bodies: BodyOperators
    ) -> BodyOperators:
        """The own bodies of a sample, from the reduced model."""
        models, c = self.models, bodies.compliance
        model = models.reduced[models.damped(approach)]
        NN, NT, gaps = model.static(models.parameter_point(sample.random), c.k0)
        Nf = gaps @ models.pressures(sample.pressures)
        return replace(bodies, compliance=replace(c, NN=NN, NT=NT, Nf=Nf))

    def _bodies(self, sample: SampleInput) -> BodyOperators:
        """The scene's bodies under the loads of a sample."""
        b = self.models.contact(sample.random)
        pressures = self.models.pressures(sample.pressures)
        f, c = self.models.unit_loads @ pressures, self.models.loaded(pressures)
        return BodyOperators(b.N, b.T, b.w, b.g0, f, c)

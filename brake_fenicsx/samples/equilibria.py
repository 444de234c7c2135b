"""Braking equilibria of samples: on the scene's bodies, or on bodies of their own."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from mpi4py import MPI

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import NotConverged
from brake_fenicsx.folder.log import logger
from brake_fenicsx.macro.condensation import compliance, reference_factor
from brake_fenicsx.macro.equilibrium import (
    BodyOperators,
    Equilibrium,
    corrected_equilibrium,
    displacement,
    equilibrium,
    raised_friction,
)
from brake_fenicsx.macro.solver import Factor
from brake_fenicsx.scene import Scene

from .models import Models
from .sampling import SampleInput


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

    @classmethod
    def of_scene(cls, scene: Scene, models: Models) -> "Equilibria":
        """With the load steps and the tolerance that a scene names."""
        steps = max((load.steps for load in scene.loads.values()), default=1)
        return cls(models, steps, scene.equilibrium.tolerance)

    def of(
        self, sample: SampleInput, reduced: bool = False, start: Array | None = None
    ) -> tuple[SampleInput, Equilibrium]:
        """Equilibrium of a sample, and the sample with laws that are known at its pressures.

        Args:
            sample: the sample.
            reduced: whether the reduced model may give the compliance of bodies that change.
            start: gaps of an equilibrium nearby [m], to start from.

        Raises:
            NotConverged: neither the full load at once nor the scene's ramp converges, nor is
                there an equilibrium that can be followed from the one without friction.
        """
        while True:
            found = self._with(sample, reduced, start)
            laws = sample.laws.up_to(found.p)
            if laws is sample.laws:
                return sample, found
            sample = replace(sample, laws=laws)

    def _with(self, sample: SampleInput, reduced: bool, start: Array | None) -> Equilibrium:
        """Equilibrium with the laws of a sample as they are; arguments and errors as above."""
        laws, mu = sample.laws, sample.friction.equilibrium
        change = None if reduced else sample.brake.stiffness_change
        if change is not None and sample.brake.contact is self.models.brake.contact:
            bodies = self._under_loads(sample)
            if bodies.compliance.factor is not None:
                try:
                    return corrected_equilibrium(bodies, change, laws, mu, tolerance=self.tolerance)
                except NotConverged:
                    logger.info(
                        "the bodies of a sample are far from those of the scene: the matrices"
                        " are factored again"
                    )
        bodies = self.bodies(sample, reduced)
        if start is not None:
            with suppress(NotConverged):
                return equilibrium(bodies, laws, mu, tolerance=self.tolerance, start=start)
        for steps in sorted({1, self.steps}):
            try:
                return equilibrium(bodies, laws, mu, steps, self.tolerance)
            except NotConverged as error:
                failed = error
        return raised_friction(bodies, laws, mu, failed, self.tolerance)

    def bodies(
        self, sample: SampleInput, reduced: bool, sizes: Array | None = None
    ) -> BodyOperators:
        """The bodies of a sample under its loads.

        Args:
            sample: the sample.
            reduced: see ``of``.
            sizes: of the loads, shape (loads,); those of the sample if None.
        """
        bodies = self._under_loads(sample, sizes)
        if not sample.brake.own_bodies:
            return bodies
        c = bodies.compliance
        if reduced:
            NN, NT, gaps = self.models.reduction.of(sample.approach).static(
                sample.brake.point, c.k0
            )
            sizes = sample.brake.pressures if sizes is None else sizes
            return replace(bodies, compliance=replace(c, NN=NN, NT=NT, Nf=gaps @ sizes))
        b = bodies
        own = compliance(sample.brake.K, b.N, b.T, b.w, b.f, c.k0, MPI.COMM_SELF)
        if own.factor is not None:
            own.factor.destroy()
        return replace(bodies, compliance=replace(own, factor=None))

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
            bodies, own = self._under_loads(sample), sample.brake.own_bodies
            c = bodies.compliance
            factor = None if own else c.factor or next(iter(shared), None)
            if factor is None:
                factor = reference_factor(sample.brake.K, bodies.N, bodies.w, c.k0)
                shared += [] if own else [factor]
            yield displacement(replace(bodies, compliance=replace(c, factor=factor)), eq, bodies.f)
            if own:
                factor.destroy()
        for factor in shared:
            factor.destroy()

    def _under_loads(self, sample: SampleInput, sizes: Array | None = None) -> BodyOperators:
        """The scene's bodies under the loads of a sample; arguments as above."""
        b, sizes = sample.brake.contact, sample.brake.pressures if sizes is None else sizes
        f = self.models.brake.unit_loads @ sizes
        return BodyOperators(b.N, b.T, b.w, b.g0, f, self.models.loads.times(sizes))

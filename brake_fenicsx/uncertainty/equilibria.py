"""Braking equilibria of samples: on the scene's bodies, or on bodies of their own."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import NotConverged
from brake_fenicsx.log import logger
from brake_fenicsx.macro.brake import Brake
from brake_fenicsx.macro.condensation import Compliance, compliance
from brake_fenicsx.macro.corrected import Bodies, corrected_equilibrium
from brake_fenicsx.macro.equilibrium import Condensed, Equilibrium, displacement, equilibrium
from brake_fenicsx.macro.friction import friction_traction

from .bulk import Bulk

if TYPE_CHECKING:
    from .changing import ChangingBodies
    from .sampling import SampleInput

Array = NDArray[np.float64]


@dataclass(slots=True)
class Equilibria:
    """What the equilibria of all samples share.

    Attributes:
        brake: operators of the scene.
        compliance: its bodies seen from the contact elements, under its loads.
        steps: load steps, taken only if the full load at once does not converge.
        bulk: unit changes of random materials and loads, if there are any.
        changing: the reduced model of bodies whose materials change, if there is one.
    """

    brake: Brake
    compliance: Compliance
    steps: int
    bulk: Bulk | None = None
    changing: ChangingBodies | None = None
    _gaps: dict[str, Array] = field(init=False)

    def __post_init__(self) -> None:
        """Gaps under a unit pressure on each face whose load is random."""
        loads = {} if self.bulk is None else self.bulk.loads
        factor, N = self.compliance.factor, self.brake.N
        self._gaps = {face: N @ factor.solve(f) for face, f in loads.items()}

    def of(self, sample: SampleInput, reduced: bool = False) -> Equilibrium:
        """Equilibrium of a sample.

        Args:
            sample: its inputs.
            reduced: whether the reduced model of changing bodies may serve.

        Raises:
            NotConverged: neither the full load at once nor the scene's ramp converges.
        """
        try:
            return self._loaded(sample, 1, reduced)
        except NotConverged:
            if self.steps == 1:
                raise
        return self._loaded(sample, self.steps, reduced)

    def displacement(self, sample: SampleInput, data: dict[str, Any]) -> Array:
        """Displacement of a stored equilibrium [m], shape (dofs,).

        Args:
            sample: inputs of the sample.
            data: what was stored of it.
        """
        if sample.materials:
            u = self.of(sample).u
            if u is None:
                raise ValueError("an equilibrium of changed bodies without displacement")
            return u
        zero: tuple[Any, ...] = ((0,), 0.0, (), 0.0)
        eq = Equilibrium(data["g"], data["p"], data["k"], data["mu_equilibrium"], *zero)
        bodies = self._bodies(sample)
        return displacement(bodies, eq, bodies.f)

    def _loaded(self, sample: SampleInput, steps: int, reduced: bool) -> Equilibrium:
        """Equilibrium in equal load steps."""
        laws, mu, bodies = sample.laws, sample.mu_equilibrium, self._bodies(sample)
        if self.bulk is None or not sample.materials:
            return equilibrium(bodies, laws, mu, steps)
        if reduced and self.changing is not None:
            c = bodies.compliance
            NN, NT, Nf = self.changing.compliance(sample.random, sample.pressures, c.k0)
            bodies = replace(bodies, compliance=replace(c, NN=NN, NT=NT, Nf=Nf))
            eq = equilibrium(bodies, laws, mu, steps)
            return replace(eq, doubt=_doubt(self.changing, sample, bodies, eq))
        try:
            change = self.bulk.change(sample.materials)
            return corrected_equilibrium(bodies, change, laws, mu, steps)
        except NotConverged:
            logger.info("the materials of a sample are far from the scene's: factored afresh")
        b, K = self.brake, self.bulk.stiffness(sample.materials)
        own = compliance(K, b.N, b.T, b.w, bodies.f, bodies.compliance.k0, MPI.COMM_SELF)
        bodies = replace(bodies, compliance=own)
        eq = equilibrium(bodies, laws, mu, steps)
        u = displacement(bodies, eq, bodies.f)
        own.factor.destroy()
        return replace(eq, u=u)

    def _bodies(self, sample: SampleInput) -> Bodies:
        """The scene's bodies under the loads of a sample."""
        b, c, f = self.brake, self.compliance, self.brake.f
        if self.bulk is not None and sample.pressures:
            Nf = c.Nf
            for face, value in sample.pressures.items():
                Nf = Nf + (value - self.bulk.pressures[face]) * self._gaps[face]
            c, f = replace(c, Nf=Nf), f + self.bulk.added_loads(sample.pressures, f)
        return Bodies(b.N, b.T, b.w, b.g0, f, c)


def _doubt(changing: ChangingBodies, sample: SampleInput, bodies: Bodies, eq: Equilibrium) -> Array:
    """Changes of the gaps [m] under the typical errors of interpolated bodies."""
    force = bodies.w * eq.p
    along = friction_traction(force, eq.mu)
    free = changing.compliance_doubt(sample.pressures, force, along).T
    return Condensed(bodies.compliance, bodies.w, bodies.g0, eq.mu).moved(eq.k, free).T

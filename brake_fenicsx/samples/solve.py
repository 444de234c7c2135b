"""One sample: its braking equilibrium, its complex modes, and what is kept of them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import Array, Complex, Index
from brake_fenicsx.errors import InaccurateResult, NotConverged
from brake_fenicsx.folder.log import logger, spared
from brake_fenicsx.macro.contact_forces import patch_forces, sliding
from brake_fenicsx.macro.equilibrium import (
    BodyOperators,
    Equilibrium,
    compliance,
    corrected_equilibrium,
    displacement,
    equilibrium,
    raised_friction,
    reference_factor,
)
from brake_fenicsx.macro.solver import Factor
from brake_fenicsx.scene import Scene
from brake_fenicsx.stability import Modes, complex_modes, contact_interface
from brake_fenicsx.stability.eigen import tangent
from brake_fenicsx.stability.modes import (
    damped_partners,
    energy_shares,
    flutter_partners,
    relative_errors,
)
from brake_fenicsx.stability.substructures import ContactLinearisation, ReducedModel
from brake_fenicsx.stability.substructures.parameter_line import Basis

from .models import Models
from .sampling import SampleInput

Arrays = dict[str, Any]


# Its name, and modes, their partners, and whether they are those of the reduced model -> what else
# is stored.
More = tuple[str, Callable[[Modes, Index, bool], Arrays]]


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


def modes_of_sample(
    models: Models,
    sample: SampleInput,
    eq: Equilibrium,
    by_reduction: bool,
    more: Sequence[More] = (),
    comm: MPI.Comm = MPI.COMM_SELF,
) -> Arrays:
    """Complex modes of a sample, as arrays to store.

    Args:
        models: what all samples share.
        sample: the sample.
        eq: its equilibrium.
        by_reduction: whether the reduced model gives its modes.
        more: what else is made of them; where that fails, the modes stand without it.
        comm: processes that share a sample at full order.
    """
    if not by_reduction:
        return _full(models, sample, eq, more, comm)
    settings = models.reduction.settings
    fall_back = settings.on_tolerance == "full order"
    try:
        modes = reduced_modes(models, sample, eq)
    except InaccurateResult as error:
        if not fall_back:
            raise
        logger.info("a sample at full order: %s", error)
        return _full(models, sample, eq, more)
    missed = _missed(modes, settings.tolerance)
    if missed and fall_back:
        given = missed, settings.tolerance
        logger.info("%d modes of a sample beyond the tolerance %.0e: full order", *given)
        return _full(models, sample, eq, more)
    # Kept modes of all bodies are orthonormal in the mass.
    one = sp.identity(len(modes.right), format="csr")
    mass = one if models.reduction.damped(sample.approach) else None
    return {
        **_stored(modes, settings.tolerance, mass, models.coordinates.grams, more, True),
        "coordinates": modes.right.astype(np.complex64),
    }


def reduced_modes(
    models: Models,
    sample: SampleInput,
    eq: Equilibrium,
    line: Basis | None = None,
    growing: bool = False,
) -> Modes:
    """Modes of a sample at its equilibrium by the reduced model.

    Args:
        models: what all samples share.
        sample: the sample.
        eq: its equilibrium.
        line: the sample at other values of a parameter.
        growing: whether modes that grow or may grow are enough.
    """
    contact = linearised(sample, eq.k_vibration, eq.p)
    model = models.reduction.of(sample.approach)
    given = sample.brake.point, contact, models.reduction.settings.zeta_max
    return model.modes(*given, growing) if line is None else line.modes(model, *given)


def full_modes(
    models: Models, sample: SampleInput, eq: Equilibrium, comm: MPI.Comm = MPI.COMM_SELF
) -> Modes:
    """The same at full order, vectors on all dofs; shared by two processes of a communicator."""
    brake, mu, settings = sample.brake, sample.friction.mu, models.reduction.settings
    b, k = brake.contact, eq.k_vibration
    friction = contact_interface(b.N, b.T, b.w * k, mu) if mu.any() else None
    K = tangent(brake.K, b.N, b.T, b.w, k, mu)
    C, zeta = brake.C(sample.friction, eq.p), settings.zeta_max
    band = settings.band[0], settings.band[1]
    return complex_modes(brake.M, C, K, band, zeta_max=zeta, friction=friction, comm=comm)


def linearised(sample: SampleInput, k: Array, p: Array) -> ContactLinearisation:
    """Contact and friction of a sample at its equilibrium.

    Args:
        sample: the sample.
        k: contact stiffness of small vibrations at equilibrium [Pa/m], shape (elements,).
        p: pressure at equilibrium [Pa], likewise.
    """
    friction = sample.friction
    return ContactLinearisation.of(k, friction.mu, *sample.brake.rates(friction, p))


def displacements(
    models: Models,
    modes: Sequence[tuple[SampleInput, Mapping[str, Any], Index]],
    comm: MPI.Comm,
    aside: int = 0,
    equilibria: Sequence[tuple[SampleInput, Mapping[str, Any]]] = (),
) -> list[tuple[Complex, Array]]:
    """Displacements of some unstable modes and of equilibria of stored samples; collective.

    Args:
        models: what all samples share.
        modes: of each sample its inputs, what was stored of it, and the numbers of the modes.
        comm: processes that share the work.
        aside: of these, the first so many do other work.
        equilibria: of each sample, for which ``by_bodies`` holds, its inputs and what was stored.

    Returns:
        Of each sample the displacements, shape (dofs, chosen), and their relative errors, shape
        (chosen,); likewise of each equilibrium [m], which has one.
    """
    out: dict[int, tuple[Complex, Array]] = {}
    for i, (*_, data, chosen) in enumerate(modes):
        if "vectors" in data:
            columns = [int(np.flatnonzero(data["vector_mode"] == mode)[0]) for mode in chosen]
            vectors = data["vectors"][:, columns].astype(complex)
            out[i] = vectors, np.zeros(len(columns))
    for model in models.reduction.models.values():
        left = (i for i in range(len(modes)) if i not in out)
        served = [i for i in left if models.reduction.of(modes[i][0].approach) is model]
        given = []
        for sample, data, chosen in (modes[i] for i in served):
            contact = linearised(sample, data["k_vibration"], data["p"])
            a = data["coordinates"][:, chosen].astype(complex)
            given.append((sample.brake.point, contact, data["s"][chosen], a))
        every = enumerate(equilibria, len(modes))
        resting = {i: e for i, e in every if models.reduction.of(e[0].approach) is model}
        loads = [_loads_at_rest(models, *e) for e in resting.values()]
        pushed = np.column_stack(loads) if loads else None
        found = model.displacements_of_samples(given, comm=comm, aside=aside, loads=pushed)
        out |= dict(zip(served, found, strict=False))
        for n, i in enumerate(resting):
            u = _with_free_motions(models, model, *resting[i], loads[n], found[-1][0][:, [n]])
            out[i] = u, found[-1][1][[n]]
    return [out[i] for i in range(len(modes) + len(equilibria))]


def by_bodies(models: Models, sample: SampleInput) -> bool:
    """Whether the displacement of an equilibrium follows from the bodies of its reduced model.

    Kept modes are modes of constant bodies alone.
    """
    reduction = models.reduction
    return (
        reduction.by_reduction[sample.approach]
        and not reduction.of(sample.approach).parameters.dimension
        and not sample.brake.own_bodies
    )


def _loads_at_rest(models: Models, sample: SampleInput, data: Mapping[str, Any]) -> Array:
    """Loads and contact forces of a stored equilibrium [N], shape (dofs,)."""
    b, p = sample.brake.contact, data["p"]
    traction = sliding(data["mu_equilibrium"], p)
    normal, along, _ = patch_forces(b.w, p, data["k"], traction).value
    f = models.brake.unit_loads @ sample.brake.pressures
    return np.asarray(f + b.N.T @ normal + b.T.T @ along)


def _with_free_motions(
    models: Models, model: ReducedModel, sample: SampleInput, data: Mapping[str, Any],
    f: Array, u: Complex,
) -> Complex:  # fmt: skip
    """A displacement of bodies at rest, with the free motions that their gaps tell.

    Those of the springs k0 of ``reference_factor``, under the forces f that they do not carry.
    """
    b = sample.brake.contact
    moves = model.flexibilities == 0
    free = model.kept_displacements(np.eye(moves.size)[:, moves])
    seen, k = b.N @ free, b.w * models.loads.bodies.k0
    rest = free.T @ f + seen.T @ (k * (data["g"] - b.g0 - (b.N @ u)[:, 0].real))
    moved = free @ np.linalg.solve(seen.T @ (k[:, None] * seen), rest)
    return np.asarray(u + moved[:, None])


def _full(
    models: Models, sample: SampleInput, eq: Equilibrium, more: Sequence[More] = (),
    comm: MPI.Comm = MPI.COMM_SELF,
) -> Arrays:  # fmt: skip
    """Modes at full order."""
    modes = full_modes(models, sample, eq, comm)
    mass = None if sample.brake.C(sample.friction, eq.p) is None else sample.brake.M
    grown = np.flatnonzero(np.array(modes.verdict, str) == "unstable")
    tolerance, masses = models.reduction.settings.tolerance, models.brake.masses
    out = _stored(modes, tolerance, mass, masses, more, False)
    out |= {"vectors": modes.right[:, grown].astype(np.complex64), "vector_mode": grown}
    coordinates = models.coordinates.of(modes.right)
    if coordinates is not None:
        out["coordinates"] = coordinates.astype(np.complex64)
    return out


def _stored(
    modes: Modes,
    tolerance: float,
    mass: sp.csr_matrix | None,
    masses: Mapping[str, Any],
    more: Sequence[More],
    by_reduction: bool,
) -> Arrays:
    """Arrays of the modes: with their flutter partners and the layers' shares of kinetic energy.

    Args:
        modes: the modes.
        tolerance: of their estimated errors.
        mass: in the coordinates of their vectors; None without damping.
        masses: of each layer, in these coordinates.
        more: what else is made of them; what fails is named in ``lost``.
        by_reduction: whether they are those of the reduced model.
    """
    partners = flutter_partners(modes.s)
    if mass is not None:
        unstable = np.array(modes.verdict, str) == "unstable"
        partners = damped_partners(modes.s, modes.right, mass, unstable)
    shares = energy_shares(masses, modes.right)
    out: Arrays = {n: getattr(modes, n) for n in ("s", "residual", "error", "condition", "damping")}
    out |= {"expected": modes.count.expected, "count_kind": modes.count.kind}
    out |= {"counted": modes.count.how, "verdict": np.array(modes.verdict, dtype=str)}
    out |= {"tolerance_missed": _missed(modes, tolerance), "stability_seconds": modes.seconds}
    out |= {"partner": partners, "layers": np.array(list(shares), dtype=str)}
    out["shares"] = np.array(list(shares.values())).reshape(len(shares), len(modes))
    lost: list[str] = []
    for name, make in more:
        made, missing = spared(name, partial(make, modes, partners, by_reduction))
        out |= made or {}
        lost += missing
    return out | ({"lost": "; ".join(lost)} if lost else {})


def _missed(modes: Modes, tolerance: float) -> int:
    """Modes whose estimated error is beyond the tolerance, rigid ones aside."""
    return int(np.sum(relative_errors(modes.s, modes.error) > tolerance))

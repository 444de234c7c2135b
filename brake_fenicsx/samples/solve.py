"""Complex modes of one sample, and what is kept of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.build.damping_terms import damping_of_sample, rates_of_sample
from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.folder.extras import spared
from brake_fenicsx.folder.log import logger
from brake_fenicsx.macro.equilibrium import Equilibrium
from brake_fenicsx.stability import Modes, complex_modes, contact_interface
from brake_fenicsx.stability.modes import relative_errors
from brake_fenicsx.stability.operators import tangent
from brake_fenicsx.stability.participation import damped_partners, energy_shares, flutter_partners
from brake_fenicsx.stability.substructures import ContactLinearisation

from .models import Models

if TYPE_CHECKING:
    from brake_fenicsx.stability.substructures.line import Basis

    from .sampling import SampleInput

Array = NDArray[np.float64]
Arrays = dict[str, Any]


# Its name, and modes, their partners, and whether they are those of the reduced model -> what else
# is stored.
More = tuple[str, Callable[[Modes, NDArray[np.intp], bool], Arrays]]


def modes_of_sample(
    models: Models,
    approach: str,
    sample: SampleInput,
    eq: Equilibrium,
    by_reduction: bool,
    more: Sequence[More] = (),
    comm: MPI.Comm = MPI.COMM_SELF,
) -> Arrays:
    """Complex modes of a sample, as arrays to store.

    Args:
        models: what all samples share.
        approach: of the sample.
        sample: its inputs.
        eq: its equilibrium.
        by_reduction: whether the reduced model gives its modes.
        more: what else is made of them; where that fails, the modes stand without it.
        comm: processes that share a sample at full order.
    """
    if not by_reduction:
        return _full(models, sample, eq, more, comm)
    settings = models.stability
    if settings is None:
        raise ValueError("a scene without [stability] has no modes")
    damped, fall_back = models.damped(approach), settings.on_tolerance == "full order"
    try:
        modes = reduced_modes(models, approach, sample, eq)
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
    unstable = np.array(modes.verdict, str) == "unstable"
    if damped:
        # Kept modes of all bodies are orthonormal in the mass.
        one = sp.identity(len(modes.right), format="csr")
        partners = damped_partners(modes.s, modes.right, one, unstable)
    else:
        partners = flutter_partners(modes.s)
    return {
        **_record(modes, settings.tolerance),
        **_composition(modes, energy_shares(models.grams, modes.right), partners),
        "coordinates": modes.right.astype(np.complex64),
        **_together(more, modes, partners, True),
    }


def reduced_modes(
    models: Models, approach: str, sample: SampleInput, eq: Equilibrium, line: Basis | None = None
) -> Modes:
    """Modes of a sample at its equilibrium by the reduced model; arguments as above.

    Args:
        models: what all samples share.
        approach: of the sample.
        sample: its inputs.
        eq: its equilibrium.
        line: the sample at other values of a parameter.
    """
    settings = models.stability
    zeta_max = 0.0 if settings is None else settings.zeta_max
    model, p = models.reduced[models.damped(approach)], models.parameter_point(sample.random)
    contact = linearised(models, approach, sample, eq.k_vibration, eq.p)
    return model.modes(p, contact, zeta_max, line)


def full_modes(
    models: Models, sample: SampleInput, eq: Equilibrium, comm: MPI.Comm = MPI.COMM_SELF
) -> Modes:
    """The same at full order, vectors on all dofs; shared by two processes of a communicator."""
    b, settings = models.contact(sample.random), models.stability
    if settings is None:
        raise ValueError("a scene without [stability] has no modes")
    C = sample_damping(models, sample, eq.p)
    friction = (
        contact_interface(b.N, b.T, b.w * eq.k_vibration, sample.mu) if sample.mu.any() else None
    )
    K = tangent(models.stiffness(sample), b.N, b.T, b.w, eq.k_vibration, sample.mu)
    band = settings.band[0], settings.band[1]
    M, zeta_max = models.mass(sample), settings.zeta_max
    return complex_modes(M, C, K, band, zeta_max=zeta_max, friction=friction, comm=comm)


def linearised(
    models: Models, approach: str, sample: SampleInput, k: Array, p: Array
) -> ContactLinearisation:
    """Contact and friction of a sample at its equilibrium.

    Args:
        models: what all samples share.
        approach: of the sample.
        sample: its inputs.
        k: contact stiffness of small vibrations at equilibrium [Pa/m], shape (elements,).
        p: pressure at equilibrium [Pa], likewise.
    """
    if models.terms is None or not models.damped(approach):
        return ContactLinearisation.of(k, sample.mu)
    rates = rates_of_sample(models.terms, p, sample.mu, sample.slope, sample.speed)
    return ContactLinearisation.of(k, sample.mu, *rates)


def displacements(
    models: Models,
    modes: Sequence[tuple[str, SampleInput, Mapping[str, Any], NDArray[np.intp]]],
    comm: MPI.Comm,
    aside: int = 0,
) -> list[tuple[NDArray[np.complex128], Array]]:
    """Displacements of some unstable modes of stored samples; collective.

    Args:
        models: what all samples share.
        modes: of each sample its approach, its inputs, what was stored of it, and the numbers of
            the modes.
        comm: processes that share the work.
        aside: of these, the first so many do other work.

    Returns:
        Of each sample the displacements, shape (dofs, chosen), and their relative errors, shape
        (chosen,).
    """
    out: dict[int, tuple[NDArray[np.complex128], Array]] = {}
    for i, (*_, data, chosen) in enumerate(modes):
        if "vectors" in data:
            columns = [int(np.flatnonzero(data["vector_mode"] == mode)[0]) for mode in chosen]
            vectors = data["vectors"][:, columns].astype(complex)
            out[i] = vectors, np.zeros(len(columns))
    for damped, model in models.reduced.items():
        served = [i for i, m in enumerate(modes) if i not in out and models.damped(m[0]) == damped]
        given = []
        for approach, sample, data, chosen in (modes[i] for i in served):
            contact = linearised(models, approach, sample, data["k_vibration"], data["p"])
            a = data["coordinates"][:, chosen].astype(complex)
            given.append((models.parameter_point(sample.random), contact, data["s"][chosen], a))
        found = model.displacements_of_samples(given, comm=comm, aside=aside)
        out |= dict(zip(served, found, strict=True))
    return [out[i] for i in range(len(modes))]


def sample_damping(models: Models, sample: SampleInput, p: Array) -> sp.csr_matrix | None:
    """Damping C [N s/m] of a sample, whole on this process; None where nothing damps it."""
    changes = models.changes
    change = changes.damping_change(sample.random) if changes and sample.random else None
    given = models.terms, models.contact(sample.random), p, sample.mu, sample.slope, sample.speed
    return damping_of_sample(*given, change)


def _full(
    models: Models, sample: SampleInput, eq: Equilibrium, more: Sequence[More] = (),
    comm: MPI.Comm = MPI.COMM_SELF,
) -> Arrays:  # fmt: skip
    """Modes at full order."""
    settings = models.stability
    if settings is None:
        raise ValueError("a scene without [stability] has no modes")
    modes = full_modes(models, sample, eq, comm)
    unstable = np.array(modes.verdict, str) == "unstable"
    if sample_damping(models, sample, eq.p) is None:
        partners = flutter_partners(modes.s)
    else:
        partners = damped_partners(modes.s, modes.right, models.mass(sample), unstable)
    grown = np.flatnonzero(unstable)
    out = {
        **_record(modes, settings.tolerance),
        **_composition(modes, energy_shares(models.masses, modes.right), partners),
        "vectors": modes.right[:, grown].astype(np.complex64), "vector_mode": grown,
        **_together(more, modes, partners, False),
    }  # fmt: skip
    coordinates = models.coordinates(modes.right)
    if coordinates is not None:
        out["coordinates"] = coordinates.astype(np.complex64)
    return out


def _together(
    more: Sequence[More], modes: Modes, partners: NDArray[np.intp], by_reduction: bool
) -> Arrays:
    """What is made of the modes beside them; what fails is named in ``lost``."""
    out: Arrays = {}
    lost: list[str] = []
    for name, make in more:
        made, missing = spared(name, partial(make, modes, partners, by_reduction))
        out |= made or {}
        lost += missing
    return out | ({"lost": "; ".join(lost)} if lost else {})


def _record(modes: Modes, tolerance: float) -> Arrays:
    return {
        "s": modes.s, "residual": modes.residual, "error": modes.error,
        "condition": modes.condition, "verdict": np.array(modes.verdict, dtype=str),
        "damping": modes.damping, "expected": modes.count.expected,
        "count_kind": modes.count.kind, "counted": modes.count.how,
        "tolerance_missed": _missed(modes, tolerance), "stability_seconds": modes.seconds,
    }  # fmt: skip


def _missed(modes: Modes, tolerance: float) -> int:
    """Modes whose estimated error is beyond the tolerance, rigid ones aside."""
    return int(np.sum(relative_errors(modes.s, modes.error) > tolerance))


def _composition(modes: Modes, shares: dict[str, Array], partner: NDArray[np.intp]) -> Arrays:
    """What a mode is made of: its flutter partner, and the layers' shares of its kinetic energy."""
    values = np.array(list(shares.values())).reshape(len(shares), len(modes))
    return {"partner": partner, "layers": np.array(list(shares), dtype=str), "shares": values}

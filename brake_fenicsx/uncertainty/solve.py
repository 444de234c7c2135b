"""Complex modes of one sample: which solver takes it, and what is kept of its modes.

Samples go through a reduced model, where there is one: that of the scene's bodies, or that of
bodies whose materials change, either with damping or without; all others are solved at full order.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.macro.equilibrium import Equilibrium
from brake_fenicsx.macro.solver import local_rows
from brake_fenicsx.stability import (
    DampedReduced,
    Modes,
    Reduced,
    complex_modes,
    contact_interface,
)
from brake_fenicsx.stability.changing.shifts import Changes
from brake_fenicsx.stability.operators import tangent
from brake_fenicsx.stability.participation import (
    damped_partners,
    energy_shares,
    flutter_partners,
)
from brake_fenicsx.stability.terms import (
    damping_of_sample,
    rates_of_sample,
)

from .shared import Shared

if TYPE_CHECKING:
    from .changing import ChangingBodies
    from .sampling import SampleInput

Array = NDArray[np.float64]
Arrays = dict[str, Any]


def modes_of_sample(
    shared: Shared,
    sample: SampleInput,
    eq: Equilibrium,
    by_reduction: bool,
    comm: MPI.Comm = MPI.COMM_SELF,
) -> Arrays:
    """Complex modes of a sample, as arrays to store: the one place that chooses the solver.

    Args:
        shared: what all samples share.
        sample: its inputs; materials that differ from the scene's change the stiffness.
        eq: its equilibrium.
        by_reduction: whether the reduced model of the scene's own bodies may serve.
        comm: processes that call together and may share the work; the first has the arrays.
    """
    rates = _rates(shared, sample, eq.p)
    if by_reduction and not sample.materials:
        if rates is not None and shared.damped is not None:
            return _damped(shared, shared.damped, sample, eq, rates)
        if rates is None and shared.reduced is not None:
            return _reduced(shared, shared.reduced, sample, eq)
    elif by_reduction and shared.changing is not None:
        if rates is None or shared.changing.damped:
            return _changing(shared, shared.changing, sample, eq, rates)
    C = None if rates is None else sample_damping(shared, sample, eq)
    return _full(shared, sample, eq, C, comm)


def expanded(
    shared: Shared, sample: SampleInput, data: Mapping[str, Any], chosen: NDArray[np.intp]
) -> NDArray[np.complex128]:
    """Displacements of some stored modes of the reduced model of the scene's bodies.

    Args:
        shared: what all samples share.
        sample: the inputs of the stored sample.
        data: what was stored of it.
        chosen: numbers of the modes.

    Returns:
        Shape (dofs, chosen).
    """
    s, a = data["s"][chosen], data["coordinates"][:, chosen].astype(complex)
    rates = _rates(shared, sample, data["p"])
    if rates is not None and shared.damped is not None:
        return shared.damped.expand(s, a, data["k"], data["mu"], *rates)
    if shared.reduced is None:
        raise ValueError("modes of a reduced model that is not there")
    return shared.reduced.expand(s, a, data["k"], data["mu"])


def modes_again(shared: Shared, sample: SampleInput, data: Mapping[str, Any]) -> Modes:
    """Modes of a stored sample whose materials change, in coordinates of the present bodies.

    Args:
        shared: what all samples share.
        sample: the inputs of the stored sample.
        data: what was stored of it.
    """
    if shared.changing is None:
        raise ValueError("modes of a reduced model that is not there")
    rates, settings = _rates(shared, sample, data["p"]), shared.stability
    return shared.changing.modes(
        sample.random, data["k"], data["mu"], rates, settings.zeta_max, settings.tolerance
    )


def _rates(shared: Shared, sample: SampleInput, p: Array) -> tuple[Array, Array] | None:
    """Friction's own damping [Pa s/m], along and across; None where nothing damps the sample.

    A damped model without the undamped one takes all samples of the scene's own bodies.
    """
    terms, contact = shared.terms, shared.brake.contact
    if terms is None:
        return None
    rates = rates_of_sample(terms, contact, p, sample.mu, sample.slope)
    damped = terms.bulk is not None or np.any(rates)
    own = not sample.materials
    return rates if damped or (shared.only_damped and own) else None


def sample_damping(shared: Shared, sample: SampleInput, eq: Equilibrium) -> sp.csr_matrix | None:
    """Damping C [N s/m] of a sample, whole on this process; None where nothing damps it."""
    changes, bulk = {}, shared.bulk
    if bulk is not None:
        changes = {
            name: bulk.change({**bulk.materials, name: C}) for name, C in sample.materials.items()
        }
    contact = shared.brake.contact
    return damping_of_sample(shared.terms, contact, eq.p, sample.mu, sample.slope, changes)


def _reduced(shared: Shared, reduced: Reduced, sample: SampleInput, eq: Equilibrium) -> Arrays:
    modes = reduced.modes(eq.k, sample.mu, shared.stability.tolerance)
    return {
        **_record(modes),
        **_composition(modes, energy_shares(shared.grams, modes.right), flutter_partners(modes.s)),
        "coordinates": modes.right.astype(np.complex64),
    }


def _damped(
    shared: Shared,
    model: DampedReduced,
    sample: SampleInput,
    eq: Equilibrium,
    rates: tuple[Array, Array],
) -> Arrays:
    settings = shared.stability
    modes = model.modes(eq.k, sample.mu, *rates, settings.zeta_max, settings.tolerance)
    unstable = np.array(modes.verdict) == "unstable"
    # The kept modes are orthonormal in the mass; what is static moves next to none of it.
    one = sp.identity(len(modes.right), format="csr")
    partners = damped_partners(modes.s, modes.right, one, unstable)
    return {
        **_record(modes),
        **_composition(modes, energy_shares(shared.grams, modes.right), partners),
        "coordinates": modes.right.astype(np.complex64),
    }


def _changing(
    shared: Shared,
    changing: ChangingBodies,
    sample: SampleInput,
    eq: Equilibrium,
    rates: tuple[Array, Array] | None,
) -> Arrays:
    settings = shared.stability
    modes = changing.modes(
        sample.random, eq.k, sample.mu, rates, settings.zeta_max, settings.tolerance,
        _doubt(shared, sample, eq, rates is not None),
    )  # fmt: skip
    shares = energy_shares(shared.changing_grams, modes.right)
    coordinates = modes.right if shared.onto is None else shared.onto @ modes.right
    unstable = np.array(modes.verdict) == "unstable"
    if rates is None:
        partners = flutter_partners(modes.s)
    else:
        # Spaces of the bodies are orthonormal in the mass.
        one = sp.identity(len(modes.right), format="csr")
        partners = damped_partners(modes.s, modes.right, one, unstable)
    grown = np.flatnonzero(unstable)
    return {
        **_record(modes), **_composition(modes, shares, partners),
        "coordinates": coordinates.astype(np.complex64),
        # For their pictures: nothing is solved again, as long as the bodies are the same.
        "in_bodies": modes.right[:, grown].astype(np.complex64), "vector_mode": grown,
        "bodies": changing.mark,
    }  # fmt: skip


def _doubt(shared: Shared, sample: SampleInput, eq: Equilibrium, damped: bool) -> Changes | None:
    """What the doubt of an equilibrium changes at contact."""
    if eq.doubt is None:
        return None
    laws, gaps = sample.laws, eq.g + eq.doubt
    k = np.array([laws.stiffness(g) for g in gaps]) - eq.k
    if not damped or shared.terms is None:
        return Changes(k)
    p = np.array([laws.pressure(g) for g in gaps]) - eq.p
    terms, contact = shared.terms, shared.brake.contact
    return Changes(k, *rates_of_sample(terms, contact, p, sample.mu, sample.slope))


def _full(
    shared: Shared,
    sample: SampleInput,
    eq: Equilibrium,
    C: sp.csr_matrix | None,
    comm: MPI.Comm,
) -> Arrays:
    b, stability = shared.brake, shared.stability
    # Only undamped problems with friction are shared.
    friction = contact_interface(b.N, b.T, b.w * eq.k, sample.mu) if sample.mu.any() else None
    if C is not None or friction is None:
        if comm.rank > 0:
            return {}
        comm = MPI.COMM_SELF
    stiffness = shared.K
    if shared.bulk is not None and sample.materials:
        stiffness = shared.bulk.stiffness(sample.materials)
    K = tangent(stiffness, b.N, b.T, b.w, eq.k, sample.mu)
    band = (stability.band[0], stability.band[1])
    M = local_rows(shared.M)
    modes = complex_modes(M, C, K, band, zeta_max=stability.zeta_max, friction=friction, comm=comm)
    if comm.rank > 0:
        return {}
    unstable = np.array(modes.verdict) == "unstable"
    if C is None:
        partners = flutter_partners(modes.s)
    else:
        partners = damped_partners(modes.s, modes.right, M, unstable)
    grown = np.flatnonzero(unstable)
    out = {
        **_record(modes),
        **_composition(modes, energy_shares(shared.masses, modes.right), partners),
        "vectors": modes.right[:, grown].astype(np.complex64), "vector_mode": grown,
    }  # fmt: skip
    if shared.basis is not None:
        out["coordinates"] = (shared.basis.T @ (M @ modes.right)).astype(np.complex64)
    return out


def _record(modes: Modes) -> Arrays:
    return {
        "s": modes.s, "residual": modes.residual, "error": modes.error,
        "condition": modes.condition, "verdict": np.array(modes.verdict, dtype=str),
        "damping": modes.damping, "expected": modes.count.expected, "counted": modes.count.how,
        "stability_seconds": modes.seconds,
    }  # fmt: skip


def _composition(modes: Modes, shares: dict[str, Array], partner: NDArray[np.intp]) -> Arrays:
    """What a mode is made of: its flutter partner, and the layers' shares of its kinetic energy."""
    values = np.array(list(shares.values())).reshape(len(shares), len(modes))
    return {"partner": partner, "layers": np.array(list(shares), dtype=str), "shares": values}

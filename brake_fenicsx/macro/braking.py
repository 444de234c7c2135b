"""Braking equilibrium of an assembled brake: laws and critical gaps in, displacements out."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike

from brake_fenicsx.arguments import Array, Index
from brake_fenicsx.errors import NotConverged, SceneError
from brake_fenicsx.micro.combined import OneLaw, join_laws
from brake_fenicsx.micro.law import Law, Laws, separations_at

from .contact_forces import EnrichedGap
from .equilibrium import Compliance, Equilibrium, compliance, displacement, raised_friction
from .equilibrium import equilibrium as solve


def equilibrium(
    ops: Any,
    laws: Law | Laws | Sequence[Law],
    g_cr: ArrayLike,
    mu: float | Array,
    index: Index | None = None,
    steps: int = 1,
    comm: MPI.Comm | None = None,
) -> Equilibrium:
    """Equilibrium of one set of laws and critical gaps, with its displacement.

    Args:
        ops: operators of a brake, see ``pipeline.assemble``: a frozen record with ``K``, ``N``,
            ``T``, ``w``, ``g0``, ``f``, ``pressed`` and ``compliance``; its compliance is computed
            if it has none, and kept by the caller's ``with_compliance`` for many equilibria.
        laws: one law for all elements, one per element, or a library.
        g_cr: critical gap of each element, or of all [m].
        mu: friction coefficient, one or one per element; 0 for an equilibrium without friction.
        index: number of each element's law in a library; element i takes law i if not given.
        steps: equal load steps.
        comm: processes that share the compliance; this process alone if None.

    Returns:
        ``.u`` [m] on all free dofs; ``.g`` [m], ``.p`` [Pa], ``.k`` and ``.k_vibration`` [Pa/m]
        per element; ``.iterations``, ``.residual``.

    Raises:
        SceneError: the number of laws or gaps does not fit the contact elements.
        Separated, NotConverged: there is no equilibrium, or it was not found.
    """
    n = len(ops.w)
    for name, value in (("g_cr", g_cr), ("mu", mu)):
        given = np.asarray(value, dtype=float)
        if given.shape not in ((), (n,)):
            raise SceneError(f"""{name}: shape {given.shape}; give one value, or one for each of the
                {n} contact elements""")
        if not np.all(np.isfinite(given)):
            raise SceneError(f"{name}: a value is not finite")
    gaps = np.broadcast_to(np.asarray(g_cr, dtype=float), (n,))
    enriched = EnrichedGap(*_library(laws, index, n), gaps)
    if ops.compliance is None:
        ops = with_compliance(ops, enriched, comm)
    try:
        eq = solve(ops, enriched, mu, steps)
    except NotConverged as error:
        eq = raised_friction(ops, enriched, mu, error)
    return replace(eq, u=displacement(ops, eq, ops.f))


def with_compliance(ops: Any, laws: EnrichedGap, comm: MPI.Comm | None = None) -> Any:
    """The brake with its interface compliance, for springs as stiff as the laws under its loads.

    Args:
        ops: operators of a brake.
        laws: laws and critical gaps of its elements.
        comm: processes that share the work; this process alone if None.
    """
    comm = MPI.COMM_SELF if comm is None else comm
    k0 = np.full(len(ops.w), reference_stiffness(laws, ops.pressed / float(ops.w.sum())))
    found: Compliance = compliance(ops.K, ops.N, ops.T, ops.w, ops.f, k0, comm)
    return replace(ops, compliance=found)


def reference_stiffness(laws: EnrichedGap, pressure: float) -> float:
    """Median stiffness of small vibrations of the laws at a common pressure [Pa/m].

    Args:
        laws: laws of the contact elements.
        pressure: mean contact pressure [Pa].
    """
    d = separations_at(laws.laws, laws.index, pressure)
    return float(np.median(laws.laws.vibration(laws.index, d)[0]))


def _library(laws: Law | Laws | Sequence[Law], index: Index | None, n: int) -> tuple[Laws, Index]:
    """Laws as a library, and each element's number in it."""
    if isinstance(laws, list | tuple):
        laws = join_laws([OneLaw(law) for law in laws])
    if not hasattr(laws, "__len__"):
        return OneLaw(laws), np.zeros(n, dtype=np.intp)
    count = len(laws)  # type: ignore[arg-type]
    if index is None and count not in (1, n):
        raise SceneError(f"{count} laws for {n} contact elements: give index, or one law for each")
    if index is None:
        index = np.zeros(n, dtype=np.intp) if count == 1 else np.arange(n)
    if np.shape(index) != (n,) or np.min(index) < 0 or np.max(index) >= count:
        raise SceneError(f"index: {n} numbers from 0 to {count - 1} are needed")
    return laws, np.asarray(index, dtype=np.intp)  # type: ignore[return-value]

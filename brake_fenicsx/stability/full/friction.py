"""All modes of a large undamped problem with friction, and their number on the interface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.folder.memory import release_memory
from brake_fenicsx.folder.processes import in_turns

from ..eigensolvers.argument_principle import RIM, undamped_reach, undamped_region
from ..eigensolvers.arnoldi import nearest_modes, with_conjugates
from ..eigensolvers.eigenpairs import matched
from ..eigensolvers.symmetric import shifted_factor, symmetric_modes
from .interface import MOST_ORDERS, ORDERS, Interface, Inverse, moments
from .interface_count import InterfaceModes, at_interface, prove
from .problem import Found, SplitProblem, agree

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# The frictionless modes are complete up to this multiple of the band's highest frequency. The bound
# of the proof falls with its sixth power (three moments), the number of modes grows. Measured: at
# 1.6 three moments prove rough contact, and stiff contact takes six.
CUTOFF = 1.6


def friction_modes(
    p: SplitProblem, friction: Interface, low: float, high: float, zeta_max: float,
    comm: MPI.Comm = MPI.COMM_SELF,
) -> Found | None:  # fmt: skip
    """Block Arnoldi from either side, and the proof; collective.

    Args:
        p: the problem.
        friction: its friction as an interface.
        low: lower end of the band [1/s^2].
        high: upper end [1/s^2].
        zeta_max: largest damping ratio looked for.
        comm: two processes that share the work, or one.

    Returns:
        The modes of the band and a little more; None where the frictionless stiffness
        is not positive semi-definite.

    Raises:
        NotConverged: an iteration fails.
        InaccurateResult: left and right eigenvalues or the count differ.
    """
    held: list[Any] = []
    # Every process factors the matrix for itself; where memory is short for one, all raise.
    list(
        in_turns(comm.size, lambda i: held.append(shifted_factor(p.frictionless, p.M, high)), comm)
    )
    if held[0] is None:
        return None
    factor, sigma = held[0]
    given = p.frictionless, p.M, factor, sigma, CUTOFF**2 * high
    parts: tuple[Callable[[], Any], ...] = (
        lambda: at_interface(symmetric_modes(*given), friction),
        lambda: moments(factor, p.M, friction, keep=True),
    )
    modes, known = in_turns(2, lambda i: parts[i](), comm)
    inverse = Inverse(factor, friction, known)
    reach = undamped_reach(high, zeta_max) - sigma
    kappa, right, left, steps = _both_sides(p, inverse, modes, reach, comm)
    del inverse
    known = replace(known, SL=None)
    region = undamped_region(kappa, low, high, zeta_max)
    proof = prove(modes, friction, known, region, kappa, comm)
    while not proof.remainder < 1 and len(known.RL) < MOST_ORDERS:
        # Stiff contact: more of what the kept modes leave out is needed.
        known = moments(factor, p.M, friction, len(known.RL) + ORDERS)
        proof = prove(modes, friction, known, region, kappa, comm)
    factor.destroy()
    unproven = "" if proof.remainder < 1 else f"; not proven, it should be below 1{p.remedy}"
    bound = f"remainder {proof.remainder:.1g}{unproven}"
    how = f"winding number on the interface of rank {friction.rank} ({bound})"
    agree(int(region.holds(kappa).sum()), proof.count, high, f"the {how}")
    return Found(kappa, right, left, f"inertia without friction, {how}", steps)


def _both_sides(
    p: SplitProblem, inverse: Inverse, modes: InterfaceModes, reach: float, comm: MPI.Comm
) -> tuple[Complex, Complex, Complex, int]:
    """Right and left eigenpairs, conjugates included."""
    expected = int(np.sum(modes.kappa <= reach)) + 1

    def side(transposed: bool) -> tuple[Complex, Complex, int]:
        found = nearest_modes(
            lambda b: inverse(p.M @ b, transposed), p.M.shape[0], modes.sigma, RIM * reach, expected
        )
        release_memory()
        return found

    (kappa, right, steps), (other, left, more) = in_turns(2, lambda i: side(i > 0), comm)
    # Both of each pair: round-off splits a true doublet into a pair on one side alone.
    (kappa, right), (other, left) = with_conjugates(kappa, right), with_conjugates(other, left)
    i, j = matched(kappa, other, modes.sigma, reach)
    return kappa[i], right[:, i], left[:, j].conj(), steps + more

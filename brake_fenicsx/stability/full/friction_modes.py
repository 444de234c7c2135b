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
from brake_fenicsx.macro.solver import BlockProduct

from ..eigensolvers.argument_principle import RIM, undamped_reach, undamped_region
from ..eigensolvers.arnoldi import BLOCK, combined, nearest_modes
from ..eigensolvers.eigenpairs import both_sides
from ..eigensolvers.symmetric import complete, count_below, modes_not_counted, shifted_factor
from ..modes import Count
from .eigenproblem import Found, SplitProblem, agree
from .interface import MOST_ORDERS, Interface, Inverse, moments, more_moments
from .interface_count import Determinant, InterfaceModes, at_interface, below, moments_needed, prove

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# The frictionless modes are complete up to this multiple of the largest |kappa - sigma| of the
# region. Each moment divides the bound of the proof by it, the number of modes grows. Measured: one
# moment proves rough contact (bound 0.2), and perfect contact takes eight.
LIMIT = 1.85

# Modes up to this share of the limit are left out of further moments, see ``Moments.low``.
LOW = 0.15

# Relative residuals of block Lanczos, whose modes serve the proof and the start of block Arnoldi,
# and of block Arnoldi. Left vectors weigh residuals of right ones: few digits do.
FRICTIONLESS, RIGHT, LEFT = 1e-6, 1e-10, 1e-8

# Share of other displacements than modes of the band in the block that block Arnoldi starts from.
OTHERS = 1e-2


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
    reach = undamped_reach(high, zeta_max) - sigma
    pencil, limit = (p.frictionless, p.M), LIMIT * reach

    def without_friction() -> tuple[InterfaceModes, Array, Array]:
        found = modes_not_counted(p.M, factor, sigma, limit, tolerance=FRICTIONLESS)
        band, lowest = (found.Phi[:, found.kappa <= end] for end in (reach, LOW * limit))
        return at_interface(found, friction), _starting_block(band), np.asfortranarray(lowest)

    parts: tuple[Callable[[], Any], ...] = (
        without_friction,
        lambda: (count_below(*pencil, limit), moments(factor, p.M, friction, keep=True)),
    )
    (modes, start, lowest), (counted, known) = in_turns(2, lambda i: parts[i](), comm)
    modes = below(modes, *complete(*pencil, modes.kappa, counted))
    inverse = Inverse(factor, friction, known)
    kappa, right, left = _both_sides(p, inverse, modes, reach, start, comm)
    del inverse
    known = replace(known, SL=None)
    region = undamped_region(kappa, low, high, zeta_max)
    det = Determinant(modes, friction, known)
    for orders in range(moments_needed(det, region, comm), MOST_ORDERS + 1):
        if orders > len(known.RL):
            # Stiff contact: more of what the kept modes leave out is needed.
            known = more_moments(factor, p.M, friction, known, orders, lowest, comm)
            det = Determinant(modes, friction, known)
        proof = prove(det, region, kappa, comm)
        if proof.remainder < 1:
            break
    factor.destroy()
    proven = proof.remainder < 1
    bound = f"remainder {proof.remainder:.1g}" + ("" if proven else ", which should be below 1")
    how = f"winding number on the interface of rank {friction.rank} ({bound})"
    agree(int(region.holds(kappa).sum()), proof.count, high, f"the {how}")
    how = f"inertia without friction, {how}" + ("" if proven else p.remedy)
    return Found(kappa, right, left, Count("proven" if proven else "counted", how))


def _starting_block(Phi: Array) -> Array:
    """Random combinations of modes to start from, and a little of all other displacements."""
    rng, (n, size) = np.random.default_rng(0), Phi.shape
    modal = combined(Phi, rng.standard_normal((size, BLOCK)))
    others = rng.standard_normal((n, BLOCK))
    lengths = [np.linalg.norm(x, axis=0) for x in (modal, others)]
    return modal + others * (np.where(lengths[0] > 0, OTHERS * lengths[0], 1.0) / lengths[1])


def _both_sides(
    p: SplitProblem,
    inverse: Inverse,
    modes: InterfaceModes,
    reach: float,
    start: Array,
    comm: MPI.Comm,
) -> tuple[Complex, Complex, Complex]:
    """Right and left eigenpairs, conjugates included."""
    expected = int(np.sum(modes.kappa <= reach)) + 1
    mass = BlockProduct(p.M)

    def side(transposed: bool) -> tuple[Complex, Complex]:
        found = nearest_modes(
            lambda b: inverse(mass(b), transposed),
            *(p.M.shape[0], modes.sigma, RIM * reach, expected),
            tolerance=LEFT if transposed else RIGHT,
            start=start,
        )
        release_memory()
        return found

    return both_sides(side, modes.sigma, reach, comm)

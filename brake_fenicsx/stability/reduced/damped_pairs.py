"""Modes of a damped sample in the reduced model, with residuals, errors and their number.

T of ``damped_sample`` is divided down to a quadratic pencil whose modes are its own. What T leaves
out is taken off by the two-sided quotient, its effect of second order estimated; modes beyond the
tolerance are refined on the full problem.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult

from ..full.completeness import count_zeros
from ..full.damped_rows import NEAR_ZERO, damped_rows, rectangle
from ..modes import Complex, Count, Modes
from .damped_errors import beyond, left_out
from .damped_sample import DampedSample
from .division import quadratic_divisor, quadratic_pairs
from .neighbours import widened, with_neighbours
from .sample_errors import DIGITS

Array = NDArray[np.float64]

# Better eigenvalues and what they may still be off, of eigenvalues, right and left vectors and a
# tolerance; see ``Refined``.
Refine = Callable[[Complex, Complex, Complex, float | Array], tuple[Complex, Array]]

# Errors of eigenvalues with right and left vectors of unit norm and conditions.
Doubted = Callable[[Complex, Complex, Complex, Array], Array]

# The bound takes the bodies for symmetric, and their terms for those of a geometric series.
DOUBT = 2.0

# Smallest derivative that is divided by: a double eigenvalue has none.
TINY = 1e-300


def sample_modes(
    sample: DampedSample,
    band: tuple[float, float],
    zeta_max: float,
    start: float,
    tolerance: float,
    refined: Refine | None,
    doubted: Doubted | None = None,
) -> Modes:
    """Modes of the band, each with its residual and error.

    Args:
        sample: the sample.
        band: lowest and highest frequency [Hz].
        zeta_max: decaying modes up to this damping ratio are looked for.
        start: when the clock was started [s].
        tolerance: relative error of lambda beyond which a mode is refined.
        refined: steps on the full problem; without them no mode is refined.
        doubted: errors of lambda [1/s] that the basis adds.

    Raises:
        InaccurateResult: the count differs.
    """
    low, high = (2 * np.pi * f for f in band)
    every = quadratic_pairs(*quadratic_divisor(sample.T), high)
    _count(sample, every[0], high, zeta_max)
    s = every[0]
    near = (s.imag >= 0) & (s.imag <= high) & (s.real >= -zeta_max * np.abs(s))
    chosen = np.flatnonzero(near | (np.abs(s) <= NEAR_ZERO * high))
    chosen = chosen[np.lexsort((s[chosen].real, s[chosen].imag))]
    a, b = every[1][:, chosen], every[2][:, chosen]
    s, error, condition, residual, which = _certified(
        sample, every, chosen, tolerance, refined, doubted
    )
    # A shift takes its digits from what is close to zero.
    floor = 1e-14 * sample.basis.Lambda[-1] + DIGITS * sample.basis.sigma
    error += floor * condition / np.maximum(2 * np.abs(s), 1e-6 * high)
    rows, s = damped_rows(s, a, error, (low, high), zeta_max)
    return Modes(
        s, a[:, rows], b[:, rows], residual[rows], error[rows], condition[rows],
        Count(s.size, "winding number of det T(lambda), on a basis complete by inertia"),
        int(which[rows].sum()), time.perf_counter() - start, np.zeros(s.size, dtype=bool),
    )  # fmt: skip


def _certified(
    sample: DampedSample,
    every: tuple[Complex, Complex, Complex],
    chosen: NDArray[np.intp],
    tolerance: float,
    refined: Refine | None,
    doubted: Doubted | None,
) -> tuple[Complex, Array, Array, Array, NDArray[np.bool_]]:
    """Better eigenvalues, errors, conditions, residuals, and which modes were refined."""
    values, right, left = every
    s, a, b = values[chosen], right[:, chosen], left[:, chosen]
    columns = np.arange(s.size)
    derivative = sum(j * values ** (j - 1) * (T @ right) for j, T in enumerate(sample.T) if j)
    slopes = np.einsum("im,im->m", left.conj(), derivative)
    slopes = np.where(np.abs(slopes) > TINY, slopes, TINY)
    conditions = np.maximum(2 * np.abs(values) / np.abs(slopes), 1.0)
    r_a, r_z = left_out(sample, s, a)
    y = sample.left_terms(s, b)
    bound, residual = beyond(
        sample, s, (a, sample.forces(s, sample.gaps(s, a))), (b, sample.left_gaps(s, b)), (r_a, r_z)
    )
    # Terms of y that are left out are smaller than its last two.
    bound = DOUBT * bound + sum(np.abs(np.einsum("im,im->m", x.conj(), r_z)) for x in y[-2:])
    mixed = (left.conj().T @ (r_a + sample.modal(s, r_z))) / slopes[:, None]
    change = -mixed[chosen, columns]
    change = np.where(s.imag == 0, change.real, change)
    apart = np.abs(values[:, None] - s)
    apart[chosen, columns] = np.inf
    nearest = np.maximum(apart.min(axis=0), 1e-12 * np.abs(values).max(initial=0.0))
    # Of second order: what is left out mixes in of all other modes.
    second = conditions @ (np.abs(mixed) ** 2 / np.maximum(apart, nearest))
    # Close to another eigenvalue a change of first order is none.
    alone = np.abs(change) * conditions[chosen] <= 0.1 * nearest
    error = bound / np.abs(slopes[chosen]) + second + np.where(alone, 0.0, np.abs(change))
    if doubted is not None:
        error += doubted(s, a, b, conditions[chosen])
    error = widened(error, nearest)
    new = np.where(alone, s + change, s)
    which = (error > tolerance * np.abs(s)) & (refined is not None)
    if refined is not None and which.any():
        which, away = with_neighbours(s, which)
        better, left_over = refined(s[which], a[:, which], b[:, which], 0.1 * tolerance)
        settled = (np.abs(better - s[which]) <= 0.5 * away[which]) & (left_over < error[which])
        new[which] = np.where(settled, better, new[which])
        error[which] = np.where(settled, left_over, error[which])
    return new, error, conditions[chosen], residual, which


def _count(sample: DampedSample, s: Complex, high: float, zeta_max: float) -> None:
    """Compare with the turns of det T around the band.

    Raises:
        InaccurateResult: the numbers differ.
    """
    region = rectangle(s, high, 2 * zeta_max, 1.1)
    found = int(region.holds(s).sum())
    counted = count_zeros(sample.at, region, s[np.abs(s) < 4 * (high + region.high)])
    if found != counted:
        raise InaccurateResult(
            f"reduced model, damped: {found} modes found, the winding number counts {counted}"
        )

"""Modes of an undamped sample in the reduced model, with residuals, errors and their number.

The pencil of the sample has modes of its own. Close ones among them are first set right together,
see ``neighbours``; then what the pencil leaves out is taken off each by the two-sided quotient and
its effect of second order, and estimated beyond that. Modes beyond the tolerance are corrected on
the full problem, and if that is not enough refined there.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ..full.completeness import Trapezium, lowest_real, opening
from ..modes import Complex, Modes, counted_rows, undamped_rows
from .correction import Deeper
from .damped_pairs import Refine
from .neighbours import (
    SAFE,
    close_groups,
    seen_together,
    separation,
    widened,
    with_neighbours,
)
from .pencil import Pencil, with_conjugates
from .sample import Sample
from .sample_errors import LeftOut, corrected, doubted, doubted_poles, left_out

Array = NDArray[np.float64]

# Damping ratios up to this one are counted.
ZETA_MAX = 0.4

# Smallest derivative of the determinant's factor that is divided by: a double eigenvalue has none.
TINY = 1e-300

# Share of what a shift of first order does to the next that is taken for third order.
THIRD = 0.3

# No kappa is claimed to be closer than this: higher orders are not measured by the second alone.
SURE = 4e-11

# Modes below this share of the shift may be those of a body that nothing holds.
RIGID = 1e-4

# How often close modes are set right together.
ROUNDS = 3


@dataclass(frozen=True, slots=True)
class _Trial:
    """Eigenpairs without negative imaginary part, and what the pencil leaves out of them."""

    kappa: Complex
    a: Complex
    b: Complex
    slope: Complex
    out: LeftOut

    @property
    def condition(self) -> Array:
        """Condition of each eigenvalue."""
        norms = np.linalg.norm(self.a, axis=0) * np.linalg.norm(self.b, axis=0)
        return np.asarray(norms / np.abs(self.slope))

    @property
    def first(self) -> Complex:
        """Psi' P phi, as far as the basis knows it."""
        return np.asarray(np.einsum("im,im->m", self.b.conj(), self.out.rest))

    def shifts(self, first: Complex) -> tuple[Complex, Complex, Array]:
        """Shifts of first order, psi' P phi given, of second order, and the size of its terms."""
        mixed, size = _mixed(self.kappa, self.b, self.out.rest, self.slope)
        return _keep_real(first / self.slope, self.kappa), _keep_real(mixed, self.kappa), size


def undamped_modes(
    sample: Sample,
    band: tuple[float, float],
    start: float,
    tolerance: float = 1e-6,
    deeper: Deeper | None = None,
    refined: Refine | None = None,
) -> Modes:
    """Modes of the band with residuals and errors.

    Args:
        sample: the sample.
        band: lowest and highest frequency [Hz].
        start: when the clock was started [s].
        tolerance: relative error of lambda beyond which a mode is corrected.
        deeper: the full problem; without it no mode is corrected.
        refined: steps on the full problem, for what is still beyond the tolerance then.

    Raises:
        InaccurateResult: the count differs.
    """
    sigma = sample.sigma
    highest = (2 * np.pi * 1.02 * band[1]) ** 2 + sigma
    pencil = Pencil(*sample.operators)
    pairs = pencil.pairs(highest, _region(band, sigma))
    half = np.flatnonzero(pairs.kappa.imag >= 0)
    t = _trial(sample, pairs.kappa[half], pairs.right[:, half], pairs.left[:, half])
    t = _neighbours_together(sample, t)
    first = t.first
    tail = t.out.tail + doubted(sample, t.kappa, t.out) + doubted_poles(sample.pole_doubt, t.a, t.b)
    # Half of the tolerance for the tail: |d lambda / lambda| = |d kappa / kappa| / 2.
    beyond = tail > tolerance * np.abs(t.slope * t.kappa)
    # A basis of an earlier program may end at order 2.
    beyond &= len(sample.basis.NN) > 3
    if deeper is not None and beyond.any():
        first[beyond], tail[beyond] = corrected(sample, deeper, t.kappa, t.b, t.out, beyond)
    condition, apart = t.condition, separation(t.kappa)
    shift, mixed, size = t.shifts(first)
    # Close to another eigenvalue a correction by orders is none.
    safe = (np.abs(shift) + np.abs(mixed)) * condition <= SAFE * apart
    # The second order is taken off, and yet counted in full: a mode about to merge with another
    # adds what no order tells.
    known = size + THIRD**2 * np.abs(shift) ** 2 * condition / apart
    nothing = np.zeros_like(pairs.near)
    far, every = (pencil.coupled_shift(t.kappa, t.out.rest, x) for x in (pairs.near, nothing))
    second = np.where(safe, known + far * condition, np.abs(shift) + every * condition)
    floor = 1e-14 * sample.basis.Lambda[-1] * condition + SURE * np.abs(t.kappa)
    error = widened((tail + t.out.rounding) / np.abs(t.slope) + second + floor, apart)
    kappa = np.where(safe, t.kappa + shift + mixed, t.kappa)
    # |d lambda / lambda| <= tolerance; of rigid modes nothing is asked.
    wanted = 2 * tolerance * np.maximum(np.abs(kappa - sigma), RIGID * sigma)
    left = error > wanted
    if refined is not None and left.any():
        left, away = with_neighbours(t.kappa, left)
        better, bound = refined(
            t.kappa[left], t.a[:, left], t.b[:, left], 0.25 * (wanted / np.abs(kappa))[left]
        )
        settled = (np.abs(better - t.kappa[left]) <= 0.5 * away[left]) & (bound < error[left])
        kappa[left] = np.where(settled, better, kappa[left])
        error[left] = np.where(settled, bound + floor[left], error[left])
        beyond |= left
    which, values, right, left_vectors = with_conjugates(kappa, t.a, t.b)
    order, lam, spread, real = undamped_rows(values - sigma, error[which], band)
    rows = which[order]
    return Modes(
        lam, right[:, order], left_vectors[:, order], t.out.residual[rows], spread,
        condition[rows],
        counted_rows(lam, "winding number of det T, on a basis complete by inertia", ZETA_MAX),
        0 if deeper is None and refined is None else int(beyond[rows].sum()),
        time.perf_counter() - start, real,
    )  # fmt: skip


def _trial(sample: Sample, kappa: Complex, a: Complex, b: Complex) -> _Trial:
    _, M, Q = sample.operators
    slope = np.einsum("im,im->m", b.conj(), M @ a - 2 * kappa * (Q @ a))
    slope = np.where(np.abs(slope) > TINY, slope, TINY)
    return _Trial(kappa, a, b, slope, left_out(sample, kappa, a, b))


def _neighbours_together(sample: Sample, t: _Trial) -> _Trial:
    """Close modes with what the pencil leaves out of them; the others as they are."""
    for _ in range(ROUNDS):
        reach = sum(np.abs(x) for x in t.shifts(t.first)[:2]) * t.condition
        groups = close_groups(t.kappa, np.asarray(reach))
        if not groups:
            break
        new = [
            seen_together(sample.operators, t.kappa[g], t.a[:, g], t.b[:, g], t.out.rest[:, g])
            for g in groups
        ]
        others = np.setdiff1d(np.arange(t.kappa.size), np.concatenate(groups))
        t = _joined(
            t, others, _trial(sample, *(np.concatenate(x, axis=-1) for x in zip(*new, strict=True)))
        )
    return t


def _joined(t: _Trial, kept: NDArray[np.intp], new: _Trial) -> _Trial:
    """Some modes of one and all of the other."""
    out = (
        np.concatenate([getattr(t.out, f.name)[..., kept], getattr(new.out, f.name)], axis=-1)
        for f in fields(LeftOut)
    )
    kappa, a, b, slope = (
        np.concatenate([x[..., kept], y], axis=-1)
        for x, y in zip(
            (t.kappa, t.a, t.b, t.slope), (new.kappa, new.a, new.b, new.slope), strict=True
        )
    )
    return _Trial(kappa, a, b, slope, LeftOut(*out))


def _region(band: tuple[float, float], sigma: float) -> Trapezium:
    """What holds the band in the plane of kappa + sigma, for damping ratios up to ZETA_MAX.

    A hair wider than that, so that a mode on the very edge is not on the contour. Modes of the
    region that lie beyond the band by their own frequency belong to the proof, not to the rows.
    """
    low, high = ((2 * np.pi * f) ** 2 for f in band)
    bottom = lowest_real(low, ZETA_MAX) * (1 - 1e-7) if low > 0 else -0.02 * high
    top = high * (1 + 1e-7)
    return Trapezium(bottom + sigma, top + sigma, opening(ZETA_MAX), 1e-3 * high)


def _keep_real(shift: Complex, kappa: Complex) -> Complex:
    """A real eigenvalue of a real problem stays real."""
    return np.where(kappa.imag == 0, shift.real + 0j, shift)


def _mixed(kappa: Complex, b: Complex, rest: Complex, slope: Complex) -> tuple[Complex, Array]:
    """Shift of second order: what is left out mixes in of all other modes that are known.

    Args:
        kappa: eigenvalues without negative imaginary part, shape (modes,).
        b: their left vectors.
        rest: what T a leaves out of their right vectors.
        slope: derivative of each eigenvalue's equation.

    Returns:
        The shift, and the sum of the sizes of its terms.
    """
    own, mates = b.conj().T @ rest, b.T @ rest
    terms = _exchange(kappa, kappa, own, own / slope[:, None])
    # The conjugate mates of complex ones.
    complex_ones = np.flatnonzero(kappa.imag > 0)
    there = mates[complex_ones] / slope[complex_ones, None].conj()
    back = mates[:, complex_ones].conj()
    terms = np.hstack([terms, _exchange(kappa, kappa[complex_ones].conj(), back, there)])
    return terms.sum(axis=1) / slope, np.abs(terms).sum(axis=1) / np.abs(slope)


def _exchange(kappa: Complex, others: Complex, back: Complex, there: Complex) -> Complex:
    """What goes to each other mode and back, over the distance; 0 for a mode itself.

    Args:
        kappa: eigenvalues, shape (modes,).
        others: those of the other modes, shape (others,).
        back: from each other mode, at its own kappa, shape (modes, others).
        there: to each of them, shape (others, modes).
    """
    away = kappa[:, None] - others
    away[away == 0] = np.inf
    # What is left out grows with the third power of kappa.
    return np.asarray(back * (kappa[:, None] / others) ** 3 * there.T / away)

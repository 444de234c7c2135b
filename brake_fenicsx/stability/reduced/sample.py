"""One sample in the reduced model: the pencil, its residual and error.

With the basis of ``reduction`` and F = N' dD + mu T' D the problem in modal coordinates a is

    T(kappa) a = [Lambda - kappa + B (I + C(kappa))^-1 Phi_N] a = 0,
    B = Phi' F,   C(kappa) = N R(kappa) F = C0 + kappa C1 + kappa^2 C2 + ...

To second order in kappa this is the pencil that ``pencil`` solves. For the trial vectors
phi = Phi a - R F g and psi' = b' Phi' - y' N R, with R to second order, the full residual has three
parts, all of which the offline matrices measure:

    P(kappa) phi = M Phi r_a + F r_g + kappa^3 M R2 F g,
    r_a = (Lambda - kappa) a + B g,   r_g = Phi_N a - (I + C) g,

and psi' P phi / psi' M phi is the error of kappa to first order. Of the last part

    psi' kappa^3 M R2 F g = - y' (kappa^3 C3 + kappa^4 C4 + kappa^5 C5) g,

what the basis knows is taken off, the rest bounded with R_(j+1) <= R_j / limit, since the reference
has no mode left below its limit.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from ..complex_columns import on_parts, times
from ..full.completeness import Trapezium, lowest_real, opening
from ..modes import Complex, Modes, counted_rows, undamped_rows
from .basis import Basis
from .correction import Deeper
from .pencil import Pencil

if TYPE_CHECKING:
    from .refinement import Refinement

Array = NDArray[np.float64]

# Damping ratios up to this one are counted.
ZETA_MAX = 0.4

# Smallest derivative of the determinant's factor that is divided by: a double eigenvalue has none.
TINY = 1e-300

# What the error of a basis may be elsewhere, over that where it was checked.
DOUBT = 4.0

# Relative error of the modes of such a basis at the least.
DIGITS = 1e-9

# Share of a shift of second order that is taken for what third order and its own error come to.
THIRD = 0.3

# No kappa is claimed to be closer than this: higher orders are not measured by the second alone.
SURE = 4e-11

# Terms of the answer of the gaps to what the pencil leaves out.
ANSWERS = 2


class Sample:
    """Reduced operators of one contact stiffness and one friction coefficient."""

    def __init__(
        self,
        basis: Basis,
        k: Array,
        mu: float | Array,
        sigma: float = 0.0,
        doubt: Sequence[Sequence[tuple[Array, Array]]] = (),
    ):
        """Factor the interface problem and expand it in kappa.

        Args:
            basis: offline result.
            k: contact stiffness of each element [Pa/m], shape (elements,).
            mu: friction coefficient, one or one per element.
            sigma: shift of the basis, whose eigenvalues are kappa + sigma [1/s^2].
            doubt: sets of typical errors of the basis, (N R_j N', N R_j T') for j = 0, 1, ...
        """
        b = self.basis = basis
        self.sigma, self.doubt = sigma, doubt
        self.dD, self.mD = b.w * (k - b.k0), mu * b.w * k
        self.C1, self.C2 = (self._residual_gap(j) for j in (1, 2))
        E = self._residual_gap(0)
        E[np.diag_indices_from(E)] += 1.0
        self._lu = la.lu_factor(E, overwrite_a=True, check_finite=False)
        self.B = b.Phi_N.T * self.dD + b.Phi_T.T * self.mD
        self.S = self.solve(b.Phi_N)
        self.S1 = self.solve(self.C1 @ self.S)
        self.S2 = self.solve(self.C1 @ self.S1 - self.C2 @ self.S)

    def _residual_gap(self, j: int) -> Array:
        """C_j = R_j,NN dD + mu R_j,NT D."""
        C = self.basis.NN[j] * self.dD
        if self.mD.any():
            C += self.basis.NT[j] * self.mD
        return C

    def solve(self, x: Array, trans: int = 0) -> Array:
        """(I + C_0)^-1 x, or its transpose."""
        return np.asarray(la.lu_solve(self._lu, x, trans=trans, check_finite=False))

    @cached_property
    def operators(self) -> tuple[Array, Array, Array]:
        """K_r, M_r, Q_r of T = K_r - kappa M_r + kappa^2 Q_r."""
        K, M, Q = self.B @ self.S, self.B @ self.S1, self.B @ self.S2
        K[np.diag_indices_from(K)] += self.basis.Lambda
        M[np.diag_indices_from(M)] += 1.0
        return K, M, Q

    def gaps(self, a: Complex, kappa: Complex) -> Complex:
        """Gaps g = (I + C)^-1 Phi_N a, to second order in kappa, shape (elements, modes)."""
        S, S1, S2 = (times(A, a) for A in (self.S, self.S1, self.S2))
        return S - kappa * S1 + kappa**2 * S2

    def modes(
        self,
        band: tuple[float, float],
        start: float,
        tolerance: float = 1e-6,
        deeper: Deeper | None = None,
        refined: Refinement | None = None,
    ) -> Modes:
        """Modes of the band with residuals and errors.

        Args:
            band: lowest and highest frequency [Hz].
            start: when the clock was started [s].
            tolerance: relative error of lambda beyond which a mode is corrected.
            deeper: the full problem; without it no mode is corrected.
            refined: the full problem, for what is still beyond the tolerance then.

        Raises:
            InaccurateResult: the count differs.
        """
        Lambda = self.basis.Lambda
        K_r, M_r, Q_r = self.operators
        highest = (2 * np.pi * 1.02 * band[1]) ** 2 + self.sigma
        pencil = Pencil(K_r, M_r, Q_r)
        pairs = pencil.pairs(highest, _region(band, self.sigma))
        half = np.flatnonzero(pairs.kappa.imag >= 0)
        kappa, a, b = pairs.kappa[half], pairs.right[:, half], pairs.left[:, half]
        slope = np.einsum("im,im->m", b.conj(), M_r @ a - 2 * kappa * (Q_r @ a))
        slope = np.where(np.abs(slope) > TINY, slope, TINY)
        rest, tail, residual, parts = self._errors(kappa, a, b, K_r, M_r, Q_r)
        first = np.einsum("im,im->m", b.conj(), rest)
        # Half of the tolerance for the tail: |d lambda / lambda| = |d kappa / kappa| / 2.
        beyond = tail > tolerance * np.abs(slope * kappa)
        # A basis of an earlier program may end at order 2.
        beyond &= len(self.basis.NN) > 3
        if deeper is not None and beyond.any():
            first[beyond], tail[beyond] = self._corrected(deeper, kappa, b, parts, beyond)
        condition = np.linalg.norm(a, axis=0) * np.linalg.norm(b, axis=0) / np.abs(slope)
        apart = _separation(kappa)
        shift = _keep_real(first / slope, kappa)
        mixed = _keep_real(_mixed(kappa, b, rest, slope), kappa)
        # Close to another eigenvalue a correction by orders is none.
        safe = (np.abs(shift) + np.abs(mixed)) * condition <= 0.1 * apart
        known = THIRD * (np.abs(mixed) + THIRD * np.abs(shift) ** 2 * condition / apart)
        far, every = (pencil.coupled_shift(kappa, rest, x) for x in (pairs.kappa, kappa[:0]))
        second = np.where(safe, known + far * condition, np.abs(shift) + every * condition)
        floor = 1e-14 * Lambda[-1] * condition + SURE * np.abs(kappa)
        error = tail / np.abs(slope) + second + floor
        shift = shift + mixed
        start_at, kappa = kappa, np.where(safe, kappa + shift, kappa)
        left = error > 2 * tolerance * np.abs(kappa)
        if refined is not None and left.any():
            better, bound = refined(start_at[left], a[:, left], b[:, left], 0.5 * tolerance)
            settled = np.abs(better - start_at[left]) <= 0.5 * apart[left]
            settled &= bound < error[left]
            kappa[left] = np.where(settled, better, kappa[left])
            error[left] = np.where(settled, bound + floor[left], error[left])
            beyond |= left
        both = _with_mates(pairs.kappa)
        kappa = np.where(pairs.kappa.imag < 0, kappa[both].conj(), kappa[both])
        order, lam, spread, real = undamped_rows(kappa - self.sigma, error[both], band)
        return Modes(
            lam, pairs.right[:, order], pairs.left[:, order], residual[both][order], spread,
            condition[both][order],
            counted_rows(lam, "winding number of det T, on a basis complete by inertia", ZETA_MAX),
            0 if deeper is None and refined is None else int(beyond[both][order].sum()),
            time.perf_counter() - start, real,
        )  # fmt: skip

    def _corrected(
        self,
        deeper: Deeper,
        kappa: Complex,
        b: Complex,
        known: tuple[Complex, ...],
        which: NDArray[np.bool_],
    ) -> tuple[Complex, Array]:
        """Error psi' P phi of some modes with all that the full problem adds, and its new bound.

        The gaps' answer h to what is left out is itself left out by C_3 and what follows: taken off
        to first order, and its size kept as part of the bound.
        """
        v_N, v_T, left_out, r_a, h = (x[:, which] for x in known)
        z, top = kappa[which], len(self.basis.NN) - 1
        y = first = self._solves(times(self.B.T, b[:, which]), 1)
        for _ in range(2 * ANSWERS):
            more = times(self.C1.T, z.conj() * y) + times(self.C2.T, z.conj() ** 2 * y)
            y = first - self._solves(more, 1)
        part, bound = deeper(z, y, v_N, v_T, top)
        part = part + np.einsum("im,im->m", b[:, which].conj(), r_a)
        part += np.einsum("im,im->m", y.conj(), left_out)
        C_h = times(self.basis.NN[3], self.dD[:, None] * h)
        C_h += times(self.basis.NT[3], self.mD[:, None] * h)
        answer = z**3 * np.einsum("im,im->m", y.conj(), C_h)
        return part - answer, bound + np.abs(answer)

    def _errors(
        self, kappa: Complex, a: Complex, b: Complex, K_r: Array, M_r: Array, Q_r: Array
    ) -> tuple[Complex, Array, Array, tuple[Complex, ...]]:
        """What T a leaves out, b' of it being psi' P phi; bound of its tail; relative residual.

        Last what a correction starts from: forces of the modes on the elements, parts of the rest.
        """
        s, top = self.basis, len(self.basis.NN) - 1
        S1a, S2a = times(self.S1, a), times(self.S2, a)
        g = times(self.S, a) - kappa * S1a + kappa**2 * S2a
        y = self._solves(times(self.B.T, b), 1)
        y -= self._solves(times(self.C1.T, kappa.conj() * y), 1)
        r_a = times(K_r, a) - kappa * times(M_r, a) + kappa**2 * times(Q_r, a)
        # Of r_g only the terms beyond the expansion of ``gaps`` are left.
        r_g = kappa**3 * (times(self.C2, S1a - kappa * S2a) - times(self.C1, S2a))
        v_N, v_T = self.dD[:, None] * g, self.mD[:, None] * g
        left_out, last = r_g.copy(), times(s.NN[top], v_N)
        for j in range(3, top + 1):
            C_j = last if j == top else times(s.NN[j], v_N)
            left_out -= kappa**j * (C_j + times(s.NT[j], v_T))
        h = self._answer(left_out, kappa)
        limit, size = s.limit, np.abs(kappa)
        normal = np.sqrt(np.maximum(np.einsum("im,im->m", v_N.conj(), last).real, 0.0))
        slip = np.sqrt(_quadratic(s.TT, v_T)) / limit ** (top / 2)
        tail = np.sqrt(_quadratic(s.NN[top], y)) * (normal + slip)
        tail *= size ** (top + 1) / np.maximum(limit - size, 1e-3 * limit)
        tail += self._doubted(kappa, y, v_N, v_T)
        A_NN, _, A_TT = s.compliance
        forces = np.sqrt(_quadratic(A_NN, self.dD[:, None] * r_g))
        forces += np.sqrt(_quadratic(A_TT, self.mD[:, None] * r_g))
        modal = np.sqrt((1 / s.Lambda) @ np.abs(r_a) ** 2)
        norm = modal + forces + size**3 * limit ** (top / 2 - 3) * (normal + slip)
        norm = norm / np.sqrt(s.Lambda @ np.abs(a) ** 2)
        return r_a + times(self.B, h), tail, norm, (v_N, v_T, left_out, r_a, h)

    def _doubted(self, kappa: Complex, y: Complex, v_N: Complex, v_T: Complex) -> Array:
        """Error of each mode under the typical errors of the basis, all added up.

        A mode that they happen to leave alone shares the doubt of the others.
        """
        total = np.zeros(y.shape[1])
        for errors in self.doubt:
            first = sum(
                kappa**j * np.einsum("im,im->m", y.conj(), times(NN, v_N) + times(NT, v_T))
                for j, (NN, NT) in enumerate(errors)
            )
            total += DOUBT * np.abs(first)
        # Of modes that no contact moves nothing is doubted but the digits of their bodies.
        size = np.abs(kappa) * bool(len(self.doubt))
        shared = float(np.median(total / np.abs(kappa))) if size.any() else 0.0
        return np.maximum(total, max(shared, DIGITS) * size)

    def _answer(self, r: Complex, kappa: Complex) -> Complex:
        """(I + C0 + kappa C1 + kappa^2 C2)^-1 r by a series in kappa."""
        h = first = self._solves(r)
        for _ in range(ANSWERS):
            h = first - self._solves(times(self.C1, kappa * h) + times(self.C2, kappa**2 * h))
        return h

    def _solves(self, x: Complex, trans: int = 0) -> Complex:
        """E^-1 x for complex columns, of imaginary parts only those that are there."""
        return on_parts(lambda v: self.solve(v, trans), x)


def _quadratic(A: Array, x: NDArray) -> Array:
    """X' A x of each column, for symmetric semi-definite A."""
    return np.asarray(np.maximum(np.einsum("im,im->m", x.conj(), times(A, x)).real, 0.0))


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


def _mixed(kappa: Complex, b: Complex, rest: Complex, slope: Complex) -> Complex:
    """Shift of second order: what is left out mixes in of all other modes that are known.

    Args:
        kappa: eigenvalues without negative imaginary part, shape (modes,).
        b: their left vectors.
        rest: what T a leaves out of their right vectors.
        slope: derivative of each eigenvalue's equation.
    """
    own, mates = b.conj().T @ rest, b.T @ rest
    total = _exchange(kappa, kappa, own, own / slope[:, None])
    # The conjugate mates of complex ones.
    complex_ones = np.flatnonzero(kappa.imag > 0)
    there = mates[complex_ones] / slope[complex_ones, None].conj()
    total += _exchange(kappa, kappa[complex_ones].conj(), mates[:, complex_ones].conj(), there)
    return np.asarray(total / slope)


def _exchange(kappa: Complex, others: Complex, back: Complex, there: Complex) -> Complex:
    """Sum over other modes of what goes there and back, over the distance; 0 for a mode itself.

    Args:
        kappa: eigenvalues, shape (modes,).
        others: those of the other modes, shape (others,).
        back: from each other mode, at its own kappa, shape (modes, others).
        there: to each of them, shape (others, modes).
    """
    away = kappa[:, None] - others
    away[away == 0] = np.inf
    # What is left out grows with the third power of kappa.
    return np.asarray((back * (kappa[:, None] / others) ** 3 * there.T / away).sum(axis=1))


def _with_mates(kappa: Complex) -> NDArray[np.intp]:
    """For each eigenvalue its position among those without negative imaginary part."""
    return np.asarray(np.cumsum(kappa.imag >= 0) - 1)


def _separation(kappa: Complex) -> Array:
    """Distance of each eigenvalue from its nearest neighbour, its own conjugate included."""
    if not kappa.size:
        return np.zeros(0)
    distance = np.abs(kappa[:, None] - kappa[None, :])
    np.fill_diagonal(distance, np.inf)
    mate = np.where(kappa.imag > 0, 2 * kappa.imag, np.inf)
    nearest = np.minimum(distance.min(axis=0), mate)
    return np.asarray(np.maximum(nearest, 1e-12 * np.abs(kappa).max()))

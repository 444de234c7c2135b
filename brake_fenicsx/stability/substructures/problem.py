"""Eigenvalues of one sample, from the matrices that its contact and its bodies make.

With the kept coordinates a of all bodies and the motions y that contact forces follow, eliminating
what the kept modes leave out gives, exactly,

    own(z) a + forced(z) y = 0,       own = W'P W - D_XX,      forced = (W'I' - D_XI) J,
    E(z) y = source(z) a,             E = 1 + D_OI J,          source = O W - D_OX,

and T(z) = own + forced E^-1 source. T is expanded in powers of z; its zeros come from a
companion matrix, and the two-sided Rayleigh quotient with all moments corrects them (``errors``):
b'T(z)a is evaluated with y and the left motions eta solved for, which makes its error of second
order (Schwetlick and Schreiber, Linear Algebra Appl. 436, 2012; Guettel and Tisseur, Acta Numerica
26, 2017, doi:10.1017/S0962492917000034).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult

from ..eigensolvers.arnoldi import on_parts, times
from ..modes import Complex
from .errors import ROUND_OFF
from .moments import SIGMA, Rows
from .polynomials import Coefficients, Zeros, applied, zeros

Array = NDArray[np.float64]
Index = NDArray[np.intp]

# Least power of z in T (two of lambda for each of kappa), the most, and the share of T_0 that the
# last one (two of lambda) may have at the end of the band. Measured against full order on a block,
# mu p / V from 0.03 to 0.9 times the impedance of the lining: the stated errors hold where this is
# settled, and are up to 16 times too small where it is not.
LEAST, MOST, SETTLED = {False: 2, True: 4}, 16, 1e-3

# Last known terms that tell what is truncated.
TAIL = {False: 2, True: 4}

# Steps at most of the motions y and eta, and the share of the truncation of the moments, or the
# round-off, that the error which they leave in the quotient may have.
STEPS, SHARE = 8, 0.1


@dataclass(frozen=True, slots=True)
class Quotient:
    """What the two-sided quotient finds of some zeros of T, in z.

    Attributes:
        products: b_i' T(z_j) a_j of left vectors i and zeros j, shape (zeros, zeros); and those of
            the left vectors' conjugates.
        slope: b' T'(z) a.
        truncated: what the moments beyond the last add, over the slope: the last known terms, which
            fall by |z| over the distance of the nearest pole; and what y and eta leave.
        y: motions that contact forces follow, shape (followed rows, zeros).
        right: a of each zero.
        left: [eta; b], the motions of what is left out that are seen.
    """

    products: tuple[Complex, Complex]
    slope: Complex
    truncated: Array
    y: Complex
    right: Complex
    left: Complex


class SampleProblem:
    """The problem of one sample.

    Attributes:
        E: coefficients of E(z).
        source: coefficients of source(z).
        forced: coefficients of forced(z).
        own: coefficients of own(z).
    """

    def __init__(
        self, E: Coefficients, source: Coefficients, forced: Coefficients, own: Coefficients,
        rows: Rows, pole: float,
    ):  # fmt: skip
        """Take the coefficients.

        Args:
            E: see above.
            source: likewise.
            forced: likewise.
            own: likewise.
            rows: blocks of contact rows.
            pole: least modulus of a pole of what the kept modes leave out.
        """
        self.E, self.source, self.forced, self.own = E, source, forced, own
        self._rows, self._pole = rows, pole

    @property
    def T(self) -> Array:
        """Coefficients of the expanded T, as many as it takes."""
        return self._expanded[1]

    @cached_property
    def _lu(self) -> tuple[NDArray[Any], NDArray[Any]] | None:
        return la.lu_factor(self.E[0], check_finite=False) if len(self.E[0]) else None

    @cached_property
    def _expanded(self) -> tuple[Array, Array]:
        return self._series()

    def _series(self) -> tuple[Array, Array]:
        """Coefficients of E^-1 source and of T, as many as it takes.

        Raises:
            InaccurateResult: the series does not settle.
        """
        Y: list[Array] = []
        T: list[Array] = []
        sizes: list[float] = []
        damped = self._rows.damped
        end = float(np.hypot(1.0, self._rows.shift) if damped else 1.0 + SIGMA)
        for n in range(MOST + 1):
            rhs = self.source[n].copy() if n < len(self.source) else np.zeros_like(self.source[0])
            for k in range(1, min(n, len(self.E) - 1) + 1):
                rhs -= self.E[k] @ Y[n - k].astype(self.E[k].dtype, copy=False)
            Y.append(self._static(rhs))
            T.append(self.own[n].copy() if n < len(self.own) else np.zeros_like(self.own[0]))
            for k in range(min(n, len(self.forced) - 1) + 1):
                T[n] += self.forced[k] @ Y[n - k]
            sizes.append(float(la.norm(T[n])) * end**n)
            if n >= LEAST[damped] and max(sizes[-2 if damped else -1 :]) <= SETTLED * sizes[0]:
                return np.array(Y), np.array(T)
        raise InaccurateResult(
            "the motions of the contact are no short series in lambda: the damping of sliding,"
            ' mu p / V, is too strong for the reduced model; use stability.method = "full", or'
            ' stability.on_tolerance = "full order"'
        )

    def zeros(self, reach: float, near: Callable[[Complex], Index]) -> Zeros:
        """Zeros of T, none missing up to a modulus; vectors of those that ``near`` chooses."""
        return zeros(self.T, 2 if self._rows.damped else 1, reach, near)

    def quotient(self, found: Zeros) -> Quotient:
        """The two-sided quotient with all moments, for some zeros."""
        z, a, b = found.z, found.right, found.left
        count, damped = len(self.E), self._rows.damped
        powers = np.arange(count)[:, None]
        fall = np.minimum(np.abs(z) / self._pole, 0.9)
        tail = powers[-TAIL[damped] :]
        kept = self._terms([(self.own, a)], z, b)
        source = [times(A, a) for A in self.source]
        y, last = self.motions(z, a), np.full(z.size, np.inf)
        forced = applied(self.forced, z, b, transpose=True)
        eta = self.solve(forced, 1)
        for _ in range(STEPS):
            moved = [-times(A, y) for A in self.E]
            for n, product in enumerate(source):
                moved[n] = moved[n] + product
            unsolved = np.sum([z**n * x for n, x in enumerate(moved)], axis=0)
            change = self.solve(forced - applied(self.E, z, eta, transpose=True), 1)
            eta = eta + change
            terms = kept + self._terms([(self.forced, y)], z, b)
            terms += np.array([_paired(eta, x) for x in moved])
            slope = np.sum((powers * terms)[1:] * z ** powers[:-1], axis=0)
            slope = np.where(np.abs(slope) > 1e-300, slope, 1e-300)
            # One term alone may be nought by chance.
            ends = np.abs(terms[tail[:, 0]] * z**tail) * fall ** (count - 1 - tail)
            truncated = np.max(ends, axis=0) * fall / (1 - fall)
            # eta gains by both steps what it gained by this one, y what it did.
            gained = np.abs(_paired(change, unsolved))
            size = la.norm(change, axis=0) / np.maximum(la.norm(eta, axis=0), 1e-300)
            rate = np.minimum(np.maximum(size, np.sqrt(gained / last)), 0.9)
            left = gained * rate / (1 - rate)
            if np.all(left <= np.maximum(SHARE * truncated, ROUND_OFF)):
                break
            y, last = y + self.solve(unsolved), np.maximum(gained, 1e-300)
        rest = applied(self.own, z, a) + applied(self.forced, z, y)
        products = b.T @ rest + eta.T @ unsolved, b.conj().T @ rest + eta.conj().T @ unsolved
        truncated = (truncated + left) / np.abs(slope)
        return Quotient(products, slope, truncated, y, a, np.vstack([eta, b]))

    def _terms(self, parts: list[tuple[Coefficients, Complex]], z: Complex, b: Complex) -> Complex:
        """Coefficients of b' A(z) x, as many as there are moments, shape (moments, zeros)."""
        terms = np.zeros((len(self.E), z.size), complex)
        for coefficients, x in parts:
            for n, A in enumerate(coefficients):
                terms[n] += _paired(b, times(A, x))
        return terms

    def motions(self, z: Complex, a: Complex) -> Complex:
        """E^-1 source a as far as it is expanded, shape (followed rows, zeros)."""
        return applied(self._expanded[0], z, a)

    def solve(self, x: Complex, trans: int = 0) -> Complex:
        """E_0^-1 x, or its transpose."""
        return on_parts(lambda v: self._static(v, trans), x)

    def _static(self, x: Array, trans: int = 0) -> Array:
        """The same of real columns."""
        if self._lu is None:
            return x
        return np.asarray(la.lu_solve(self._lu, x, trans=trans, check_finite=False))


def _paired(left: Complex, right: Complex) -> Complex:
    """Products of columns, not conjugated."""
    return np.asarray(np.einsum("im,im->m", left, right))

r"""Moments of what the kept modes of a substructure leave out: residual flexibility and beyond.

Without contact a substructure is a matrix polynomial P(w) = P_0 + w P_1 + w^2 P_2 about a real
shift, in units in which the end of the band is 1:

    undamped    w = kappa + sigma,      P = [K + sigma M, -M],                  kappa = -lambda^2
    damped      w = lambda - lambda_0,  P = [K + lambda_0 C + sigma M, C + 2 lambda_0 M, M]

with sigma = lambda_0^2. With u = W a + v, W the kept modes and v M-orthogonal to them, let S(w) be
the inverse of P(w) on these v. All that the interface and the kept modes know of v is

    D(w) = [O; W'P(w)] S(w) [I', P(w) W, F'] = sum w^n D_n,

O the rows of the motions that contact forces follow, I those that they act along, F loads. D_0
holds the residual flexibility (MacNeal 1971, Rubin 1975); the higher moments are those that
second-order Arnoldi methods match (Bai and Su, SIAM J. Matrix Anal. Appl. 26, 2005), here computed
exactly about one point, of a body without damping in powers of kappa + sigma. Where the modes are
those of the body itself and it is not damped, P(w) W lies in the span of M W and couples with
nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import comb

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.macro.solver import Factor

from ..eigensolvers.arnoldi import plus
from ..modes import Complex
from .low_rank import SHARE, MomentPlan
from .series import Series
from .substructure import Substructure

Array = NDArray[np.float64]

# sigma in units of the band's end: positive, so that free bodies have a factor, and small.
SIGMA = 0.05

# A damping matrix is symmetric up to this share of its largest entry.
SYMMETRIC = 1e-12


@dataclass(frozen=True, slots=True)
class Rows:
    """Blocks of contact rows: those whose motion forces follow, and those forces act along.

    Attributes:
        followed: "N", then "T" and "R" where forces follow the slip rates along and across.
        damped: whether a body depends on a rate: its variable w is lambda - lambda_0 then, else
            kappa + sigma.
    """

    followed: str
    damped: bool

    @property
    def acting(self) -> str:
        """Normal forces and friction act in any case."""
        return "NT" + "R" * ("R" in self.followed)

    @property
    def rates(self) -> bool:
        """Whether anything depends on a rate, so that eigenvalues are z = lambda - lambda_0."""
        return self.damped or self.followed != "N"

    @property
    def shift(self) -> float:
        """lambda_0; 0 where eigenvalues are z = kappa + sigma."""
        return float(np.sqrt(SIGMA)) if self.rates else 0.0

    def gaps(self, motions: int) -> int:
        """Gaps among a number of motions that forces follow; slips come after them."""
        return motions // len(self.followed)

    @property
    def _contact_rates_alone(self) -> bool:
        """Whether contact forces follow rates and bodies do not, so that w is not z."""
        return self.rates and not self.damped

    def variable(self, z: Complex) -> Complex:
        """The variable w of the bodies at eigenvalues z."""
        return SIGMA - (z + self.shift) ** 2 if self._contact_rates_alone else z

    def slope(self, z: Complex) -> Complex:
        """dw/dz."""
        return -2 * (z + self.shift) if self._contact_rates_alone else np.ones_like(z)

    def powers(self, count: int) -> Array:
        """Coefficients of z^m in w^n, n < count, shape (powers of z, count)."""
        w = [0.0, -2 * self.shift, -1.0] if self._contact_rates_alone else [0.0, 1.0]
        out = np.zeros(((count - 1) * (len(w) - 1) + 1, count))
        out[0, 0] = 1.0
        for n in range(1, count):
            out[:, n] = np.convolve(out[:, n - 1], w)[: len(out)]
        return out


def shifted_polynomial(
    K: sp.csr_matrix, C: sp.csr_matrix | None, M: sp.csr_matrix, omega: float, rows: Rows
) -> list[sp.csr_matrix]:
    """P_0, P_1 and, with rates, P_2 of a body, in units of the band's end.

    Args:
        K: stiffness [N/m].
        C: damping [N s/m]; None where the body has none.
        M: mass [kg].
        omega: end of the band [rad/s].
        rows: whether anything depends on a rate.
    """
    K = K / omega**2
    if not rows.damped:
        return [(K + SIGMA * M).tocsr(), -M]
    s = rows.shift
    C = sp.csr_matrix(K.shape) if C is None else C / omega
    return [(K + s * C + SIGMA * M).tocsr(), (C + 2 * s * M).tocsr(), M]


class Complement:
    """Inverse of P_0 on the displacements that are M-orthogonal to the kept modes.

    The share of the kept modes is taken off dense right-hand sides before a solve. Sparse ones
    would become dense: theirs is taken off the solution, where a solve has made it larger by at
    most 1 / SIGMA.
    """

    def __init__(self, P0: sp.csr_matrix, M: sp.csr_matrix, W: Array):
        """Factor P_0.

        Args:
            P0: P_0 or its transpose, shape (n, n).
            M: mass [kg].
            W: M-orthonormal kept modes, shape (n, m).

        Raises:
            InaccurateResult: a symmetric P_0 is not positive definite.
        """
        size = abs(P0).max()
        symmetric = abs(P0 - P0.T).max() <= SYMMETRIC * size
        self.factor = Factor(P0, "brake_residual_", symmetric=symmetric)
        if symmetric and self.factor.negative_pivots:
            self.factor.destroy()
            raise InaccurateResult(
                "the stiffness of a body is not positive definite somewhere in the box of the"
                " random materials: narrow their distributions"
            )
        self._W, self._MW = W, np.asfortranarray(M @ W)
        self._Y = self.factor.solve(self._MW)
        self._small = np.linalg.inv(self._MW.T @ self._Y) if W.shape[1] else np.zeros((0, 0))

    def clear(self, b: Array) -> Array:
        """Right-hand sides without their share of the kept modes, shape (n, columns)."""
        return plus(np.array(b, order="F"), self._MW, self._W.T @ b, -1.0)

    def kept(self, P0W: Array) -> Array:
        """S_0 P_0 W, which takes no solve, from P_0 W."""
        x = plus(np.array(self._W, order="F"), self._Y, self._W.T @ P0W, -1.0)
        return self._cleared(x)

    def solve(self, b: Array | sp.csc_matrix, cleared: bool = False) -> Array:
        """S_0 b, for a block of right-hand sides.

        Args:
            b: shape (n, columns), dense or sparse.
            cleared: whether they have no share of the kept modes as they are.
        """
        return self._cleared(self.factor.solve(b if cleared or sp.issparse(b) else self.clear(b)))

    def _cleared(self, x: Array) -> Array:
        """Solutions without the kept modes, in the memory of ``x``."""
        return plus(x, self._Y, self._small @ (self._MW.T @ x), -1.0)


def coupled(body: Substructure) -> bool:
    """Whether kept modes of the centre of the box couple with what they leave out."""
    return body.C is not None or bool(body.changes)


def plan_of(body: Substructure, kept: int, rows: Rows, count: int) -> MomentPlan:
    """Which moments ``moments`` computes of every column at a point, and which of combinations.

    Args:
        body: the body.
        kept: number of its kept modes.
        rows: blocks of its contact rows.
        count: number of moments.
    """
    if rows.damped and not _even(body, rows):
        return MomentPlan(count)
    count = count // 2 + 1 if rows.damped else count
    return MomentPlan.of(number_of_columns(body, kept, rows), kept, count)


def number_of_columns(body: Substructure, kept: int, rows: Rows) -> int:
    """Contact rows that forces follow and, where these are coupled, kept modes."""
    return body.elements.size * len(rows.followed) + kept * coupled(body)


def _even(body: Substructure, rows: Rows) -> bool:
    """Whether an undamped body among damped ones: half as long a series, in w^2 + 2 lambda_0 w."""
    return rows.damped and not body.ratios and not coupled(body)


def moments(
    body: Substructure,
    P: Sequence[sp.csr_matrix],
    M: sp.csr_matrix,
    W: Array,
    rows: Rows,
    count: int,
    comm: MPI.Comm,
    progress: Callable[[int], None] = lambda solves: None,
) -> Array:
    """D_0 ... of a body, its rows shared by the processes of a communicator; collective.

    Args:
        body: the body.
        P: its matrix polynomial at a point of the box.
        M: its mass at the centre of the box [kg], shape (n, n).
        W: M-orthonormal kept modes, shape (n, m).
        rows: blocks of its contact rows.
        count: number of moments.
        comm: processes that share the work.
        progress: called with the number of solves that were done.

    Returns:
        Shape (count, followed rows + kept modes, acting rows + kept modes + loads); the rows and
        columns of the kept modes are there only where the body is ``coupled``.

    Raises:
        InaccurateResult: P_0 has no factor.
    """
    plan = plan_of(body, W.shape[1], rows, count)
    even = _even(body, rows)
    P = [P[0], P[2]] if even else P
    # M v has no share of modes that v is M-orthogonal to.
    cleared = len(P) == 2 and min(abs(P[1] + M).max(), abs(P[1] - M).max()) == 0
    complement = Complement(P[0].T.tocsr(), M, W)
    modal = W if coupled(body) else W[:, :0]
    series = Series(body, P, complement, modal, rows, cleared)
    D, error = series.moments(plan, comm, progress)
    if not error <= SHARE:
        D, _ = series.moments(MomentPlan(plan.exact + plan.further), comm)
    complement.factor.destroy()
    return _in_powers_of_w(D, rows.shift, count) if even else D


def _in_powers_of_w(D: Array, s: float, count: int) -> Array:
    """Coefficients of w^n of the sum of (w^2 + 2 s w)^k D_k."""
    out = np.zeros((count, *D.shape[1:]))
    for k, one in enumerate(D):
        for i in range(min(k + 1, count - k)):
            out[k + i] += comb(k, i) * (2 * s) ** (k - i) * one
    return out

"""Proof that no mode of the problem with friction is missing, on the contact interface.

K - kappa M = (K_s - kappa M) + left' right has the determinant

    det(K_s - kappa M) det G(kappa),     G = I + right (K_s - kappa M)^-1 left'.

The zeros of the first factor are counted by inertia. G is analytic but for these poles, so that the
number of eigenvalues in a region is that of the poles plus the turns of det G along its edge. With
the modes Phi, Lambda below a limit and the moments about sigma, kappa' = kappa - sigma,

    G = I + P (Lambda' - kappa')^-1 Q' + R_0 + kappa' R_1 + ... + kappa'^(J-1) R_(J-1) + remainder,
    P = right Phi,  Q = left Phi,  R_j = right S^-1 (M S^-1)^j left' - P Lambda'^-(j+1) Q'.

All modes below the limit are in Phi, so that the remainder is the sum over the modes beyond it of
P (kappa' / Lambda')^J / (Lambda' - kappa') Q'. With A A' = P Lambda'^-1 P' <= right S^-1 right' and
B B' = Q Lambda'^-m Q' = left S^-1 (M S^-1)^(m-1) left' less its part in Phi, m <= J, the turns of
det G are those of its known part as long as

    |kappa'|^J limit'^((1 + m) / 2 - J) / (limit' - |kappa'|) |B' G^-1| |A| < 1

along the edge; the largest value of the left-hand side is kept with the count. One moment suffices
for rough contact. Each further R_j that is known makes it smaller by |kappa'| / limit'.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

from mpi4py import MPI

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from brake_fenicsx.folder.processes import in_turns, on_first

from ..eigensolvers.argument_principle import Trapezium, determinant_phase, turn_along
from ..eigensolvers.arnoldi import times
from ..eigensolvers.symmetric import Symmetric
from .interface import MOST_ORDERS, POWER_LL, Interface, Moments

Array = NDArray[np.float64]

# Subspace iterations for the norm in the bound of the remainder: at the first point, at all others.
FIRST_STEPS, STEPS = 12, 3

# Where the bound at the corner of the region is larger than the first number, as many moments are
# taken as should bring it to the second. Along the edge it was up to three times as large.
ENOUGH, WANTED = 0.5, 0.2


@dataclass(frozen=True, slots=True)
class Proof:
    """Number of eigenvalues in a region.

    Attributes:
        count: the number.
        remainder: bound of what the expansion leaves out, relative; below 1 it is a proof.
        points: points of the edge.
    """

    count: int
    remainder: float
    points: int


@dataclass(frozen=True, slots=True)
class InterfaceModes:
    """The modes of the frictionless problem at the interface.

    Attributes:
        kappa: eigenvalues [1/s^2], ascending; all there are below the limit.
        limit: proven by inertia [1/s^2].
        sigma: shift of the moments [1/s^2].
        P: right Phi, shape (rank, modes).
        Q: left Phi, shape (rank, modes).
    """

    kappa: Array
    limit: float
    sigma: float
    P: Array
    Q: Array


def at_interface(modes: Symmetric, friction: Interface) -> InterfaceModes:
    """Rows of some modes at the interface."""
    P, Q = friction.right @ modes.Phi, friction.left @ modes.Phi
    return InterfaceModes(modes.kappa, modes.limit, modes.sigma, P, Q)


def below(modes: InterfaceModes, inside: NDArray[np.bool_], limit: float) -> InterfaceModes:
    """The modes below a limit up to which a count has found them complete."""
    kappa, P, Q = modes.kappa[inside], modes.P[:, inside], modes.Q[:, inside]
    return InterfaceModes(kappa, limit, modes.sigma, P, Q)


class Determinant:
    """Phase of det G, and the bound of the remainder."""

    def __init__(self, modes: InterfaceModes, friction: Interface, moments: Moments):
        """Prepare.

        Args:
            modes: the frictionless problem at the interface.
            friction: the friction term.
            moments: its moments about the shift of the modes.
        """
        self.sigma, self.kappa = modes.sigma, modes.kappa
        self.limit = modes.limit - modes.sigma
        away = modes.kappa - modes.sigma
        self.P, self.Q = modes.P, modes.Q
        self.R = np.array(moments.RL)
        self.m = min(len(self.R), POWER_LL)

        def kept(left: Array, power: int) -> Array:
            seen = slice(moments.low if power > 1 else 0, None)
            return np.asarray((left[:, seen] / away[seen] ** power) @ self.Q[:, seen].T)

        for j, R in enumerate(self.R):
            R -= kept(self.P, j + 1)
        self.R[0] += np.eye(friction.rank)
        values, vectors = la.eigh(moments.LL - kept(self.Q, self.m))
        self.B = np.sqrt(np.maximum(values, 0.0)) * vectors
        self.A = np.sqrt(moments.RR)
        self._begin()

    def _begin(self) -> None:
        self.remainder, self.points = 0.0, 0
        self._x = np.random.default_rng(0).standard_normal((len(self.P), 4)).astype(complex)

    def turn(self, path: NDArray, candidates: NDArray, poles: Array) -> tuple[float, float, int]:
        """Turn of ``phase`` along a path [rad], largest remainder there, and number of points."""
        self._begin()
        turned = turn_along(lambda z: self.phase(z, candidates, poles), path)
        return turned, self.remainder, self.points

    def phase(self, kappa: complex, candidates: NDArray, poles: Array) -> complex:
        """Phase of det G prod(poles - kappa) / prod(candidates - kappa), up to a constant sign.

        Args:
            kappa: a point of the edge.
            candidates: eigenvalues that are divided out.
            poles: those of G in the region and as far beyond it as there are candidates. Each pole
                further away has an eigenvalue next to it, and the two together hardly turn the
                phase of det G. With the pole alone multiplied, the eigenvalues of many would turn
                it by whole turns between two points of the edge.
        """
        z = kappa - self.sigma
        modal, powers = 1 / (self.kappa - kappa), z ** np.arange(len(self.R))
        # Real matrices: their products with the two parts, not complex copies of them.
        G = np.empty(self.R.shape[1:], dtype=complex)
        for part, m, n in ((G.real, modal.real, powers.real), (G.imag, modal.imag, powers.imag)):
            part[:] = (self.P * m) @ self.Q.T + np.tensordot(n, self.R, 1)
        lu = la.lu_factor(G, overwrite_a=True, check_finite=False)
        self.remainder = max(self.remainder, self._bound(abs(z), lu))
        self.points += 1
        return determinant_phase(lu, candidates - kappa, poles - kappa)

    def _bound(self, z: float, lu: tuple[NDArray, NDArray]) -> float:
        """Bound of the relative remainder; |B' G^-1| by subspace iteration, so from just below.

        It goes on from where the last point of the edge, a close one, has left it.
        """
        if not z < self.limit:
            return np.inf
        size = 0.0
        for _ in range(FIRST_STEPS if self.points == 0 else STEPS):
            x = la.qr(self._x, mode="economic", check_finite=False)[0]
            y = times(self.B.T, la.lu_solve(lu, x, check_finite=False))
            size = float(np.linalg.norm(y, 2))
            self._x = la.lu_solve(lu, times(self.B, y), trans=2, check_finite=False)
        J = len(self.R)
        power = (1 + self.m) / 2
        return (z / self.limit) ** J * self.limit**power / (self.limit - z) * size * self.A


def moments_needed(det: Determinant, region: Trapezium, comm: MPI.Comm) -> int:
    """Number of moments that should prove a count, by the bound at the corner; collective.

    Args:
        det: the determinant with the moments that are known.
        region: where to count.
        comm: the processes.
    """
    corner = complex(region.high, region.slope * region.high + region.rise)

    def needed() -> int:
        none = np.zeros(0)
        det.phase(corner, none, none)
        known, ratio = len(det.R), abs(corner - det.sigma) / det.limit
        if det.remainder < ENOUGH or not ratio < 1:
            return known
        return min(known + ceil(np.log(WANTED / det.remainder) / np.log(ratio)), MOST_ORDERS)

    return on_first(needed, comm)


def prove(
    det: Determinant, region: Trapezium, candidates: NDArray, comm: MPI.Comm = MPI.COMM_SELF
) -> Proof:
    """Count the eigenvalues of a region, conjugates included; collective.

    Args:
        det: the determinant, of modes that are complete beyond the region.
        region: where to count.
        candidates: what an eigensolver found, in the region and near it, conjugates included.
        comm: two processes, each of which follows half of the edge, or one.

    Returns:
        The count and what it is worth.

    Raises:
        InaccurateResult: an eigenvalue lies on the edge of the region.
    """
    path = region.upper_half(6)
    halves = path[: path.size // 2 + 1], path[path.size // 2 :]
    poles = det.kappa[det.kappa <= candidates.real.max(initial=region.high)]
    done = in_turns(2, lambda i: det.turn(halves[i], candidates, poles), comm)
    turned, remainder, points = zip(*done, strict=True)
    count = int(region.holds(candidates).sum()) + int(np.rint(sum(turned) / np.pi))
    return Proof(count, max(remainder), sum(points))

"""All modes of a large undamped problem with friction, and the proof that none is missing.

Block Arnoldi finds them, and the contact interface counts them:

K - kappa M = (K_s - kappa M) + left' right has the determinant

    det(K_s - kappa M) det G(kappa),     G = I + right (K_s - kappa M)^-1 left'.

The zeros of the first factor are counted by inertia. G is analytic but for these poles, so that the
number of eigenvalues in a region is that of the poles plus the turns of det G along its edge. With
the modes Phi, Lambda below a limit and the moments about sigma, kappa' = kappa - sigma,

    G = I + P (Lambda' - kappa')^-1 Q' + R_0 + kappa' R_1 + ... + kappa'^(J-1) R_(J-1) + remainder,
    P = right Phi,  Q = left Phi,  R_j = right S^-1 (M S^-1)^j left' - P Lambda'^-(j+1) Q'.

All modes below the limit are in Phi, so that the remainder is the sum over the modes beyond it of
P (kappa' / Lambda')^J / (Lambda' - kappa') Q'. Over these modes let A A' = P Lambda'^-1 P', that is
right S^-1 right' less its part in Phi, or no more than limit / limit' if right K_s^-1 right' <= 1,
and B B' = Q Lambda'^-m Q' = left S^-1 (M S^-1)^(m-1) left' less its part in Phi, m <= J. The turns
of det G are those of its known part as long as

    |kappa'|^J limit'^((1 + m) / 2 - J) / (limit' - |kappa'|) |B' G^-1| |A| < 1

along the edge; the largest value of the left-hand side is kept with the count. One moment suffices
for rough contact. Each further R_j that is known makes it smaller by |kappa'| / limit'. The shift
lies amid the band, where |kappa'| is half as large as about zero: fewer modes lie below the limit,
and Krylov spaces reach the ends of the band with fewer vectors.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.linalg as la

from brake_fenicsx.arguments import AnyArray, Array, Complex
from brake_fenicsx.folder.processes import in_turns, on_first, release_memory
from brake_fenicsx.macro.solver import BlockProduct

from ..eigensolvers import argument_principle, symmetric
from ..eigensolvers.eigenpairs import (
    BLOCK,
    both_sides,
    combined,
    nearest_modes,
    searched,
    times,
)
from ..modes import Count
from . import interface

# The frictionless modes are complete up to this multiple of the largest |kappa - sigma| of the
# region, beyond the shift. Each moment divides the bound of the proof by it, the number of modes
# grows. Measured: one moment proves rough contact (bound 0.5); perfect contact takes eight.
LIMIT = 1.85

# Modes up to this share of the limit are left out of further moments, see ``Moments.low``.
LOW = 0.15

# Relative residuals of block Lanczos, whose modes serve the proof and the start of block Arnoldi,
# and of block Arnoldi. Left vectors weigh residuals of right ones: few digits do.
FRICTIONLESS, RIGHT, LEFT = 1e-6, 1e-10, 1e-8

# Share of other displacements than modes of the band in the block that block Arnoldi starts from.
OTHERS = 1e-2

# The shift, as a share of the highest kappa of the band. Modes at zero are far from it, and a
# Krylov space of blocks holds no more copies of them than a block has vectors: where there are
# modes below RIGID, the shift is a little below zero.
AMID, RIGID = 0.55, 1e-6

# [dofs] below which one process finds right and left vectors side by side: solves of few columns
# are bound by memory, and one of both sides takes two thirds of the time of two. Of larger problems
# two processes find one side each; one process does the same, and so finds the same bits.
SIDE_BY_SIDE = 60_000

# Subspace iterations for the norm in the bound of the remainder: at the first point, at all others.
FIRST_STEPS, STEPS = 12, 3

# Where the bound at the corner of the region is larger than the first number, as many moments are
# taken as should bring it to the second. Along the edge it was up to three times as large.
ENOUGH, WANTED = 0.5, 0.2


def friction_modes(
    p: interface.SplitProblem,
    friction: interface.Interface,
    low: float,
    high: float,
    zeta_max: float,
    comm: MPI.Comm = MPI.COMM_SELF,
    amid: bool = True,
) -> interface.Found | None:
    """Block Arnoldi from either side, and the proof; collective.

    Args:
        p: the problem.
        friction: its friction as an interface.
        low: lower end of the band [1/s^2].
        high: upper end [1/s^2].
        zeta_max: largest damping ratio looked for.
        comm: two processes that share the work, or one.
        amid: whether the shift may lie amid the band.

    Returns:
        The modes of the band and a little more; None where the frictionless stiffness
        is not positive semi-definite.

    Raises:
        NotConverged: an iteration fails.
        InaccurateResult: left and right eigenvalues or the count differ.
    """
    pencil, held = (p.frictionless, p.M), list[Any]()
    sigma = AMID * high if amid else -symmetric.SHIFT * high
    # Every process factors the matrix for itself; where memory is short for one, all raise.
    list(in_turns(comm.size, lambda i: held.append(symmetric.factor_near(*pencil, sigma)), comm))
    factor, sigma = held[0]
    if not amid and factor.negative_pivots:
        factor.destroy()
        return None
    reach = argument_principle.undamped_reach(high, zeta_max, sigma)
    limit = sigma + LIMIT * reach

    def without_friction() -> tuple[Array, ...]:
        found = symmetric.modes_not_counted(p.M, factor, sigma, limit, tolerance=FRICTIONLESS)
        away = np.abs(found.kappa - sigma)
        band, nearest = (found.Phi[:, away <= end] for end in (reach, LOW * (limit - sigma)))
        seen = friction.right @ found.Phi, friction.left @ found.Phi
        return found.kappa, *seen, _starting_block(band), np.asfortranarray(nearest)

    parts: tuple[Callable[[], Any], ...] = (
        without_friction,
        lambda: (
            symmetric.count_below(*pencil, limit),
            interface.moments(factor, p.M, friction, keep=True),
        ),
    )
    (kappa, P, Q, start, nearest), (counted, known) = in_turns(2, lambda i: parts[i](), comm)
    lost = np.sum(kappa < sigma) < factor.negative_pivots
    if amid and (lost or kappa.min(initial=high) < RIGID * high):
        factor.destroy()
        return friction_modes(p, friction, low, high, zeta_max, comm, amid=False)
    inside, limit = symmetric.complete(*pencil, kappa, counted)
    modes = InterfaceModes(kappa[inside], limit, sigma, P[:, inside], Q[:, inside])
    inverse = interface.Inverse(factor, friction, known)
    kappa, right, left = _both_sides(p, inverse, modes, reach, start, comm)
    del inverse
    known = replace(known, SL=None)
    region = argument_principle.undamped_region(kappa, low, high, zeta_max)
    det = Determinant(modes, friction, known)
    for orders in range(moments_needed(det, region, comm), interface.MOST_ORDERS + 1):
        if orders > len(known.RL):
            # Stiff contact: more of what the kept modes leave out is needed.
            known = interface.moments(factor, p.M, friction, orders, lowest=nearest, comm=comm)
            det = Determinant(modes, friction, known)
        proof = prove(det, region, kappa, comm)
        if proof.remainder < 1:
            break
    factor.destroy()
    proven = proof.remainder < 1
    bound = f"remainder {proof.remainder:.1g}" + ("" if proven else ", which should be below 1")
    how = f"winding number on the interface of rank {friction.rank} ({bound})"
    interface.agree(int(region.holds(kappa).sum()), proof.count, high, f"the {how}")
    how = f"inertia without friction, {how}" + ("" if proven else p.remedy)
    return interface.Found(kappa, right, left, Count("proven" if proven else "counted", how))


def _starting_block(Phi: Array) -> Array:
    """Random combinations of modes to start from, and a little of all other displacements."""
    rng, (n, size) = np.random.default_rng(0), Phi.shape
    modal = combined(Phi, rng.standard_normal((size, BLOCK)))
    others = rng.standard_normal((n, BLOCK))
    lengths = [np.linalg.norm(x, axis=0) for x in (modal, others)]
    return modal + others * (np.where(lengths[0] > 0, OTHERS * lengths[0], 1.0) / lengths[1])


def _both_sides(
    p: interface.SplitProblem,
    inverse: interface.Inverse,
    modes: "InterfaceModes",
    reach: float,
    start: Array,
    comm: MPI.Comm,
) -> tuple[Complex, Complex, Complex]:
    """Right and left eigenpairs, conjugates included."""
    expected = int(np.sum(np.abs(modes.kappa - modes.sigma) <= reach)) + 1
    mass = BlockProduct(p.M)

    def apply(asked: dict[bool, Array]) -> dict[bool, Array]:
        # Solves of both sides as one: the fewer columns a solve has, the more one of them costs.
        right = asked[False].shape[1] if False in asked else 0
        b = np.hstack([asked[side] for side in (False, True) if side in asked])
        x = inverse(mass(b), turned=b.shape[1] - right)
        return {side: x[:, right:] if side else x[:, :right] for side in asked}

    def found(sides: tuple[bool, ...]) -> dict[bool, tuple[Complex, Complex]]:
        reached = argument_principle.RIM * reach
        done = searched(
            {
                side: nearest_modes(
                    *(p.M.shape[0], modes.sigma, reached, expected),
                    tolerance=LEFT if side else RIGHT,
                    start=start,
                )
                for side in sides
            },
            apply,
        )
        release_memory()
        return done

    if p.M.shape[0] < SIDE_BY_SIDE:
        of_sides = on_first(lambda: found((False, True)), comm)
        return both_sides(of_sides.__getitem__, modes.sigma, reach)
    return both_sides(lambda side: found((side,))[side], modes.sigma, reach, comm)


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
        kappa: eigenvalues [1/s^2], the closest to sigma first; all there are below the limit.
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


class Determinant:
    """Phase of det G, and the bound of the remainder."""

    def __init__(
        self, modes: InterfaceModes, friction: interface.Interface, moments: interface.Moments
    ):
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
        self.m = min(len(self.R), interface.POWER_LL)

        def kept(left: Array, power: int, right: Array = modes.Q) -> Array:
            seen = slice(moments.low if power > 1 else 0, None)
            return np.asarray((left[:, seen] / away[seen] ** power) @ right[:, seen].T)

        for j, R in enumerate(self.R):
            R -= kept(self.P, j + 1)
        self.R[0] += np.eye(friction.rank)
        values, vectors = la.eigh(moments.LL - kept(self.Q, self.m))
        self.B = np.sqrt(np.maximum(values, 0.0)) * vectors
        self._small = len(self.R) == 1 and 0 < len(away) < friction.rank
        if self._small:
            self._prepare()
        size = max(modes.limit / self.limit, 1.0)
        if moments.RR is not None:
            size = max(la.eigvalsh(moments.RR - kept(self.P, 1, self.P))[-1], 0.0)
        self.A = float(np.sqrt(size))
        self._begin()

    def _begin(self) -> None:
        self.remainder, self.points = 0.0, 0
        self._x = np.random.default_rng(0).standard_normal((len(self.P), 4)).astype(complex)

    def _prepare(self) -> None:
        """What does not depend on kappa in G = R + P D^-1 Q', D = Lambda - kappa, one moment R.

        With T = D + Q' R^-1 P, a pencil no larger than the number of modes,

            det G = det R det T / det D,    G^-1 = R^-1 - (R^-1 P) T^-1 (Q' R^-1).
        """
        lu = la.lu_factor(self.R[0], check_finite=False)
        self._BR = la.lu_solve(lu, self.B, trans=1).T
        self._QR = la.lu_solve(lu, self.Q, trans=1).T
        self._BRP, self._pencil = self._BR @ self.P, self._QR @ self.P

    def turn(self, path: AnyArray, candidates: AnyArray, poles: Array) -> tuple[float, float, int]:
        """Turn of ``phase`` along a path [rad], largest remainder there, and number of points."""
        self._begin()
        turned = argument_principle.turn_along(lambda z: self.phase(z, candidates, poles), path)
        return turned, self.remainder, self.points

    def phase(self, kappa: complex, candidates: AnyArray, poles: Array) -> complex:
        """Phase of det G prod(poles - kappa) / prod(candidates - kappa), up to a constant sign.

        Args:
            kappa: a point of the edge.
            candidates: eigenvalues that are divided out.
            poles: those of G in the region and as far beyond it as there are candidates. Each pole
                further away has an eigenvalue next to it, and the two together hardly turn the
                phase of det G. With the pole alone multiplied, the eigenvalues of many would turn
                it by whole turns between two points of the edge.
        """
        z, away = kappa - self.sigma, self.kappa - kappa
        if self._small:
            T, zeros = self._pencil + np.diag(away), np.r_[candidates - kappa, away]
        else:
            T, zeros = np.empty(self.R.shape[1:], complex), candidates - kappa
            modal, powers = 1 / away, z ** np.arange(len(self.R))
            # Real matrices: their products with the two parts, not complex copies of them.
            for part, m, n in (
                (T.real, modal.real, powers.real), (T.imag, modal.imag, powers.imag)
            ):  # fmt: skip
                part[:] = (self.P * m) @ self.Q.T + np.tensordot(n, self.R, 1)
        lu = la.lu_factor(T, overwrite_a=True, check_finite=False)
        self.remainder = max(self.remainder, self._bound(abs(z), lu))
        self.points += 1
        return argument_principle.determinant_phase(lu, zeros, poles - kappa)

    def _bound(self, z: float, lu: tuple[AnyArray, AnyArray]) -> float:
        """Bound of the relative remainder; |B' G^-1| by subspace iteration, so from just below.

        It goes on from where the last point of the edge, a close one, has left it.
        """
        if not z < self.limit:
            return np.inf
        size = 0.0
        for _ in range(FIRST_STEPS if self.points == 0 else STEPS):
            x = la.qr(self._x, mode="economic", check_finite=False)[0]
            y = self._solved(lu, x)
            size = float(np.linalg.norm(y, 2))
            self._x = self._solved(lu, y, True)
        J = len(self.R)
        power = (1 + self.m) / 2
        return (z / self.limit) ** J * self.limit**power / (self.limit - z) * size * self.A

    def _solved(self, lu: tuple[AnyArray, AnyArray], x: Complex, adjoint: bool = False) -> Complex:
        """B' G^-1 x, or its adjoint G^-H B x, from the factors of the matrix of ``phase``."""

        def inverse(y: Complex) -> Complex:
            return np.asarray(la.lu_solve(lu, y, trans=2 * adjoint, check_finite=False))

        if not self._small:
            return inverse(times(self.B, x)) if adjoint else times(self.B.T, inverse(x))
        if adjoint:
            return times(self._BR.T, x) - times(self._QR.T, inverse(times(self._BRP.T, x)))
        return times(self._BR, x) - times(self._BRP, inverse(times(self._QR, x)))


def moments_needed(det: Determinant, region: argument_principle.Trapezium, comm: MPI.Comm) -> int:
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
        return min(
            known + ceil(np.log(WANTED / det.remainder) / np.log(ratio)), interface.MOST_ORDERS
        )

    return on_first(needed, comm)


def prove(
    det: Determinant,
    region: argument_principle.Trapezium,
    candidates: AnyArray,
    comm: MPI.Comm = MPI.COMM_SELF,
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

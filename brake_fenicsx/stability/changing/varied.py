"""A body of variable stiffness as its contact elements see it, for any stiffness in a box.

A(theta) = K + sum c_j(theta) K_j + sigma M is positive definite. With a space W, the modes of the
body at some anchors theta_a, the resolvent on the interface B = [N; T] is

    B (A - kappa' M)^-1 B' = B W (W'A W - kappa')^-1 W'B' + R_0(theta) + kappa' R_1(theta) + ...,

kappa' = kappa + sigma. The first term is exact for every theta (A is linear in the coefficients);
the rest is small and smooth in theta, because W is the same for all: R_j is computed at anchors,
see ``rest``, and interpolated with a degree that falls from j to j + 1; the last ones are
those of the centre. Rows that forces follow alone are kept, N R_j [N' T'] without damping.

Where damping is not in proportion, its share t of the stiffness is one more coordinate of the box,
see ``proportion``; at t = 0 the body is the undamped one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from mpi4py import MPI

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.macro.condensation import interface_moments, petsc_matrix, slip_compliance
from brake_fenicsx.macro.solver import Factor

from ..full.lanczos import RealModes
from ..reduced.deflation import Deflated
from .anchors import Anchors
from .bodies import Body, looked_at, places_of
from .expansion import Expansion, Moment
from .rest import rest_moments
from .space import joined, projected, ritz_errors, shared
from .view import Arrays, View, complete_modes

Array = NDArray[np.float64]

# R_0 is interpolated with the degree of the anchors, R_1 and R_2 with these at most.
LATER_DEGREES = 3, 2

# From this j on, directions of W beyond so many times the kept kappa add less than 1e-7.
FAR_ORDER, FAR = 3, 16.0

# Total degree of the anchors whose modes are in W.
MODES_DEGREE = 2

# Relative residual of those modes but the centre's: far below what NEW leaves out.
FILLING = 1e-6

# Points that show what the interpolation is worth, and their coordinates. Polynomials in t go on to
# 2i, where x (x^2 - 1), what three anchors leave, is as large as at 2.3.
CHECKS, CORNER, CORNER_T = 2, 0.9, 2.3


# An eigenvalue's error is looked up at so many times its size, since eigenvalues move.
NEARBY = 1.2


class VariedBody:
    """A body whose stiffness changes from sample to sample.

    Attributes:
        W: M-orthonormal, shape (dofs, directions).
        limit: modes in W end here [1/s^2], as kappa'.
        kept: modes that samples keep end here, as kappa'; what W knows beyond counts as rest.
        TT: T R_0 T' of the centre, loads included.
        every_doubt: errors of R_0, R_1, ... at each point that checks the interpolation, shape
            (checks, orders, rows that are looked at, all columns).
        poles: eigenvalues at those points, ascending, and the largest relative error up to each.
    """

    varies = True

    def __init__(
        self,
        body: Body,
        coefficients: Callable[[Array], Array],
        anchors: Anchors,
        sigma: float,
        limits: tuple[float, float],
        order: int,
        comm: MPI.Comm,
        progress: Callable[[int], None] = lambda n: None,
        known: Arrays | None = None,
        names: str = "N",
        stretched: bool = False,
    ):
        """Solve at the anchors, which the processes share.

        Args:
            body: the body.
            coefficients: of the unit changes, at a point of [-1, 1]^d.
            anchors: the anchors; their degree is that of the interpolation of R_0.
            sigma: shift that makes the stiffness positive definite [1/s^2].
            limits: modes are kept up to this kappa, and in W up to that one [1/s^2].
            order: largest j of R_j.
            comm: processes that share the work.
            progress: called with the number of anchors done.
            known: ``arrays`` of the same body, made earlier.
            names: blocks of rows that forces follow, see ``looked_at``.
            stretched: whether the last coordinate is the share t of the damping.
        """
        self.body, self.anchors, self.names = looked_at(body, names), anchors, names
        self._stretched, self._slips = stretched, body.T
        self._n, self._loads = body.N.shape[0], body.T.shape[0] - body.N.shape[0]
        self._columns = places_of(names, "NT", self._n, self._loads)
        self.sigma, self._coefficients = sigma, coefficients
        self.kept, self.limit = (limit + sigma for limit in limits)
        self._numbers = [number for number, _ in body.parts]
        self._last: tuple[Array, View] | None = None
        if known is None:
            self._solve(order, comm, progress)
        else:
            self._take(known)
        # The matrices have served: some hundred megabytes in every process.
        none = self._slips = sp.csr_matrix((0, 0))
        self.body = replace(body, K=none, M=none, parts=(), C=none, R=none)
        self.doubt = self.every_doubt[:, :, : self._n, self._columns]

    @property
    def directions(self) -> int:
        """Number of its coordinates."""
        return int(self.W.shape[1])

    def arrays(self) -> Arrays:
        """All that was computed."""
        return {
            "W": self.W, "TT": self.TT, "doubt": self.every_doubt, "higher": self._higher,
            "W_B": self._W_B, "projected": self._projected, "poles": self.poles,
            **{f"R_{j}": R for j, R in enumerate(self._R)},
        }  # fmt: skip

    def _take(self, known: Arrays) -> None:
        """The reverse of ``arrays``."""
        self.W, self.TT, self.every_doubt, self._higher, self._W_B, self._projected, self.poles = (
            known[name] for name in ("W", "TT", "doubt", "higher", "W_B", "projected", "poles")
        )
        self._R = [known[f"R_{j}"] for j in range(len(_degrees(self.anchors)))]

    def _solve(self, order: int, comm: MPI.Comm, progress: Callable[[int], None]) -> None:
        """The work at the anchors."""
        anchors, body = self.anchors, self.body
        number = anchors.count(min(MODES_DEGREE, anchors.degree))
        found = shared(range(number), self._modes, comm, progress)
        self.W, centre = joined(found, body.M, comm), found[0]
        del found
        self._W_B = np.ascontiguousarray((sp.vstack([body.N, body.T]) @ self.W).T)
        self._projected = projected([body.K, *(part for _, part in body.parts)], self.W, comm)
        # Towards two corners, where no anchor is: the interpolation is worst there.
        alternate = (-1.0) ** np.arange(anchors.points.shape[1])
        corner = np.full(alternate.size, CORNER)
        if self._stretched:
            corner[-1] = CORNER_T
        checks = [-corner, corner * alternate]
        needed = [anchors.count(degree) for degree in _degrees(anchors)]
        top = len(needed) - 1
        counts = [sum(i < n for n in needed) for i in range(len(anchors.points))]
        # The longest first.
        tasks = [(x, top + 1, True) for x in checks]
        tasks += [(x, n, False) for x, n in zip(anchors.points, counts, strict=True)]
        answers = shared(tasks, lambda task: self._rest(*task), comm, progress)
        solved = [R for R, _ in answers]
        corners, solved = solved[: len(checks)], solved[len(checks) :]
        Lambda, error = np.hstack([poles for _, poles in answers[: len(checks)]])
        up = np.argsort(Lambda)
        self.poles = np.array([Lambda[up], np.maximum.accumulate((error / Lambda)[up])])
        self._R = [np.array([r[j] for r in solved[:n]]) for j, n in enumerate(needed)]
        self._higher, self.TT = self._centre(centre, order, comm)
        self.every_doubt = np.array(
            [
                [
                    *(r[j] - self._interpolated(x, j, len(r[j])) for j in range(top + 1)),
                    self._followed(r[top]),
                ]
                for x, r in zip(checks, corners, strict=True)
            ]
        )

    def view(self, x: Array) -> View:
        """The body at a point of [-1, 1]^d; the last one is kept, others may ask for the same."""
        if self._last is None or not np.array_equal(self._last[0], x):
            self._last = x.copy(), self._view(self._place(x))
        return self._last[1]

    def expansion(self, x: Array) -> Expansion:
        """The body at a point of [-1, 1]^d, as damped samples take it."""
        x = self._place(x)
        Lambda, Q = la.eigh(self._stiffness(x), driver="evd", check_finite=False)
        kept, top = int(np.searchsorted(Lambda, self.kept, side="right")), len(self._R)
        moments = []
        for j, (degree, R) in enumerate(zip(_degrees(self.anchors), self._R, strict=True)):
            weights = self.anchors.weights(x, degree)[None]
            if self._stretched:
                weights = self.anchors.series(x[:-1], degree)
            moments.append(Moment(j, weights, R))
        one = np.ones((1, 1))
        moments += [Moment(top + j, one, R[None]) for j, R in enumerate(self._higher)]
        difference = Q.T @ self._difference(x) @ Q if self._stretched else None
        Phi = Q.T @ self._W_B
        return Expansion(self._n, Lambda, Phi, Q, kept, difference, moments, self.TT)

    def _place(self, x: Array) -> Array:
        """The undamped body's place among the anchors."""
        size = self.anchors.points.shape[1]
        return np.r_[x[: size - 1], 0.0] if self._stretched else x

    def _view(self, x: Array) -> View:
        # Divide and conquer: the default driver takes four times as long for some of these.
        Lambda, Q = la.eigh(self._stiffness(x), driver="evd", check_finite=False)
        Phi, n = (Q.T @ self._W_B)[:, self._columns], self._n
        kept, far = np.searchsorted(Lambda, [self.kept, FAR * self.kept], side="right")
        moments = []
        for j in range(len(self._R) + len(self._higher)):
            beyond = slice(kept, None if j < FAR_ORDER else far)
            scaled = Phi[beyond, :n] / Lambda[beyond, None] ** (j + 1)
            total = scaled.T @ Phi[beyond]
            known = j - len(self._R)
            rest = self._interpolated(x, j, n) if known < 0 else self._higher[known][:n]
            total += rest[:, self._columns]
            moments.append(total)
        Phi = Phi[:kept]
        return View(Lambda[:kept], Phi[:, :n].T, Phi[:, n:].T, Q[:, :kept], moments, self.TT)

    def _interpolated(self, x: Array, j: int, rows: int) -> Array:
        """The first rows of R_j at a point."""
        R = self._R[j]
        # They stand side by side: a part of each matrix, without a copy.
        flat = R.reshape(len(R), -1)[:, : rows * R.shape[2]]
        weights = self.anchors.weights(x, _degrees(self.anchors)[j])
        return np.asarray((weights @ flat).reshape(rows, -1))

    def _difference(self, x: Array) -> Array:
        """W' DeltaC W, what t multiplies."""
        end = np.r_[x[:-1], 1.0]
        c = (self._coefficients(end) - self._coefficients(x))[self._numbers]
        size = self.directions
        D = c @ self._projected[1:].reshape(c.size, -1)
        return np.asarray(D.reshape(size, size))

    def _stiffness(self, x: Array) -> Array:
        """W'A W."""
        c = np.r_[1.0, self._coefficients(x)[self._numbers]]
        size = self.directions
        A: Array = (c @ self._projected.reshape(c.size, -1)).reshape(size, size)
        A[np.diag_indices(size)] += self.sigma
        return A

    def _factor(self, x: Array) -> Factor:
        change = self.body.change(self._coefficients(x))
        A = self.body.K + change + self.sigma * self.body.M
        factor = Factor(petsc_matrix(A.tocsr()), "brake_body_")
        if factor.negative_pivots:
            raise InaccurateResult("a body of variable stiffness is not positive definite")
        return factor

    def _modes(self, number: int) -> RealModes:
        """Modes at an anchor; those of the centre are deflated, the others only fill W."""
        x = self.anchors.points[number]
        factor = self._factor(x)
        K = (self.body.K + self.body.change(self._coefficients(x))).tocsr()
        tolerance = FILLING if number else 1e-9
        found = complete_modes(factor, K, self.body.M, self.sigma, self.limit, tolerance)
        factor.destroy()
        return found

    def _rest(self, x: Array, count: int, poles: bool) -> tuple[list[Array], Array]:
        """The first R_j at a point; eigenvalues and their errors where they are asked for."""
        factor, A = self._factor(x), self._stiffness(x)
        R = rest_moments(factor, self.body, self.W, self._W_B, A, count)
        found = np.zeros((2, 0))
        if poles:
            Lambda, Q = la.eigh(A, driver="evd", check_finite=False)
            kept = Lambda <= self.kept
            modes = self.W @ Q[:, kept], Lambda[kept]
            K = self.body.K + self.body.change(self._coefficients(x)) + self.sigma * self.body.M
            found = np.array([Lambda[kept], ritz_errors(factor, K, self.body.M, modes, self.limit)])
        factor.destroy()
        return R, found

    def pole_doubt(self, Lambda: Array) -> Array:
        """Typical errors of its eigenvalues in W [1/s^2], where they were checked."""
        return np.asarray(Lambda * np.interp(NEARBY * Lambda, *self.poles))

    def _centre(self, found: RealModes, order: int, comm: MPI.Comm) -> tuple[Array, Array]:
        """What follows the interpolated R_j at the centre, T R_0 T' there."""
        b, centre = self.body, np.zeros(self.anchors.points.shape[1])
        factor = self._factor(centre)
        rest = Deflated(factor, found.Phi, found.Lambda)
        moments = interface_moments(rest, b.M, b.N, b.T, order, comm, between=factor)
        TT = slip_compliance(rest, self._slips, comm)
        factor.destroy()
        # The other directions of W: at the centre their values lie beyond the limit.
        Lambda, Q = la.eigh(self._stiffness(centre), driver="evd")
        Phi, n = Q[:, found.Lambda.size :].T @ self._W_B, b.N.shape[0]
        Lambda = Lambda[found.Lambda.size :, None]
        higher = [
            np.hstack(moments[j]) - (Phi[:, :n] / Lambda ** (j + 1)).T @ Phi
            for j in range(len(self._R), order + 1)
        ]
        return np.array(higher).reshape(-1, *self._R[0].shape[1:]), TT

    def _followed(self, last: Array) -> Array:
        """What the first R_j that is not interpolated must change like, by the one before."""
        before, n = self._R[-1][0], len(last)
        if not len(self._higher):
            return np.zeros_like(last)
        ratio = np.linalg.norm(self._higher[0][:, :n]) / np.linalg.norm(before[:, :n])
        return np.asarray(ratio * (len(self._R) + 1) / len(self._R) * (last - before))


def _degrees(anchors: Anchors) -> list[int]:
    """Degree of each R_j that is interpolated."""
    return [anchors.degree, *(d for d in LATER_DEGREES if d <= anchors.degree)]


def work_at(anchors: Anchors) -> int:
    """Anchors, and points that check them, at which a body is solved."""
    return anchors.count(min(MODES_DEGREE, anchors.degree)) + len(anchors.points) + CHECKS

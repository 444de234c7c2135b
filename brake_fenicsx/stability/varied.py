"""A body of variable stiffness as its contact elements see it, for any stiffness in a box.

A(theta) = K + sum c_j(theta) K_j + sigma M is positive definite. With a space W, the modes of the
body at some anchors theta_a, the resolvent on the interface B = [N; T] is

    B (A - kappa' M)^-1 B' = B W (W'A W - kappa')^-1 W'B' + R_0(theta) + kappa' R_1(theta) + ...,

kappa' = kappa + sigma. The first term is exact for every theta (A is linear in the coefficients);
the rest is small and smooth in theta, because W is the same for all: R_j is computed at anchors and
interpolated with a degree that falls by one from j to j + 1; the last ones are those of the centre.

With c = (W'A W)^-1 W'B', E = A^-1 B' - W c and s = W'M E (so that W'M A^-1 B' = c + s),

    R_0 = B E,   R_1 = B A^-1 M E + s'c,
    R_2 = B A^-1 M Y + s'(W'A W)^-1 (c + s) + c'(W'A W)^-1 s,   Y = D M E + D M W c,

D = A^-1 - W (W'A W)^-1 W': no difference of large terms is left.
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
from brake_fenicsx.macro.solver import Factor, blocks

from .anchors import Anchors
from .bodies import Body
from .deflation import Deflated
from .lanczos import RealModes
from .view import Arrays, View, complete_modes

Array = NDArray[np.float64]

# R_j are interpolated up to this j at most.
INTERPOLATED = 2

# From this j on, directions of W beyond so many times the kept kappa add less than 1e-7.
FAR_ORDER, FAR = 3, 16.0

# Total degree of the anchors whose modes are in W.
MODES_DEGREE = 2

# Smallest mass of a direction in W beyond the modes of the centre; those of other anchors have one,
# times (limit / Lambda)^4.
NEW = 1e-7

# Points that show what the interpolation is worth, and their coordinates.
CHECKS, CORNER = 2, 0.9


class VariedBody:
    """A body whose stiffness changes from sample to sample.

    Attributes:
        W: M-orthonormal, shape (dofs, directions).
        limit: modes in W end here [1/s^2], as kappa'.
        kept: modes that samples keep end here, as kappa'; what W knows beyond counts as rest.
        TT: T R_0 T' of the centre.
        doubt: for each point that checks the interpolation its errors of R_0, R_1, ...
    """

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
        """
        self.body, self.anchors = body, anchors
        self.sigma, self._coefficients = sigma, coefficients
        self.kept, self.limit = (limit + sigma for limit in limits)
        computed = self._computed(order, comm, progress) if known is None else known
        self._arrays, self.W, self.TT = computed, computed["W"], computed["TT"]
        self._R = [computed[f"R_{j}"] for j in range(min(INTERPOLATED, anchors.degree) + 1)]
        self._higher = [*zip(computed["higher_NN"], computed["higher_NT"], strict=True)]
        self.doubt = [[self._split(r) for r in point] for point in computed["doubt"]]
        self._project()
        # The matrices have served: some hundred megabytes in every process.
        none = sp.csr_matrix((0, 0))
        self.body = replace(body, K=none, M=none, parts=())

    def arrays(self) -> Arrays:
        """All that was computed."""
        return self._arrays

    def _project(self) -> None:
        """Operators in the space W."""
        body = self.body
        self.W_N, self.W_T = body.N @ self.W, body.T @ self.W
        self._K = self.W.T @ (body.K @ self.W)
        self._parts = {j: self.W.T @ (part @ self.W) for j, part in body.parts}

    def _computed(self, order: int, comm: MPI.Comm, progress: Callable[[int], None]) -> Arrays:
        """The work at the anchors."""
        anchors, degree = self.anchors, self.anchors.degree
        number = anchors.count(min(MODES_DEGREE, degree))
        found = _shared(list(anchors.points[:number]), self._modes, comm, progress)
        self.W = _joined(found, self.body.M)
        self._project()
        # Towards two corners, where no anchor is: the interpolation is worst there.
        alternate = (-1.0) ** np.arange(anchors.points.shape[1])
        checks = [-CORNER * np.ones_like(alternate), CORNER * alternate]
        top = min(INTERPOLATED, degree)
        needed = [anchors.count(degree - j) for j in range(top + 1)]
        tasks = [(x, sum(i < n for n in needed)) for i, x in enumerate(anchors.points)]
        tasks += [(x, top + 1) for x in checks]
        solved = _shared(tasks, lambda task: self._rest(*task), comm, progress)
        # Of each R_j the values at the first anchors, one a row.
        self._R = [np.array([r[j].ravel() for r in solved[:n]]) for j, n in enumerate(needed)]
        self._higher, TT = self._centre(found[0], order, comm)
        doubt = [
            [*(r[j].ravel() - self._interpolated(x, j) for j in range(top + 1)),
             self._followed(r[top].ravel())]
            for x, r in zip(checks, solved[len(anchors.points) :], strict=True)
        ]  # fmt: skip
        return {
            "W": self.W, "TT": TT, "doubt": np.array(doubt),
            **{f"R_{j}": R for j, R in enumerate(self._R)},
            "higher_NN": np.array([pair[0] for pair in self._higher]),
            "higher_NT": np.array([pair[1] for pair in self._higher]),
        }  # fmt: skip

    def view(self, x: Array) -> View:
        """The body at a point of [-1, 1]^d."""
        Lambda, Q = la.eigh(self._projected(x))
        kept = Lambda <= self.kept
        Phi_N, Phi_T = self.W_N @ Q, self.W_T @ Q
        NN, NT = [], []
        for j in range(len(self._R) + len(self._higher)):
            if j < len(self._R):
                part = self._split(self._interpolated(x, j))
            else:
                part = self._higher[j - len(self._R)]
            beyond = ~kept if j < FAR_ORDER else ~kept & (Lambda < FAR * self.kept)
            scaled = Phi_N[:, beyond] / Lambda[beyond] ** (j + 1)
            NN.append(part[0] + scaled @ Phi_N[:, beyond].T)
            NT.append(part[1] + scaled @ Phi_T[:, beyond].T)
        return View(Lambda[kept], Phi_N[:, kept], Phi_T[:, kept], Q[:, kept], NN, NT, self.TT)

    def _interpolated(self, x: Array, j: int) -> Array:
        """R_j at a point, flat."""
        return np.asarray(self.anchors.weights(x, self.anchors.degree - j) @ self._R[j])

    def _projected(self, x: Array) -> Array:
        """W'A W."""
        c = self._coefficients(x)
        A = self._K + sum(c[j] * part for j, part in self._parts.items())
        A[np.diag_indices_from(A)] += self.sigma
        return np.asarray(0.5 * (A + A.T))

    def _factor(self, x: Array) -> Factor:
        change = self.body.change(self._coefficients(x))
        A = self.body.K + change + self.sigma * self.body.M
        factor = Factor(petsc_matrix(A.tocsr()), "brake_body_")
        if factor.negative_pivots:
            raise InaccurateResult("a body of variable stiffness is not positive definite")
        return factor

    def _modes(self, x: Array) -> RealModes:
        """Modes at an anchor."""
        factor = self._factor(x)
        K = (self.body.K + self.body.change(self._coefficients(x))).tocsr()
        found = complete_modes(factor, K, self.body.M, self.sigma, self.limit)
        factor.destroy()
        return found

    def _rest(self, x: Array, count: int) -> list[Array]:
        """The first R_j, rows of N and T, columns of N."""
        b, factor = self.body, self._factor(x)
        n, M = b.N.shape[0], b.M
        both, columns = sp.vstack([b.N, b.T]).tocsr(), b.N.T.tocsc()
        A_W = la.cho_factor(self._projected(x))
        c = la.cho_solve(A_W, np.vstack([self.W_N, self.W_T]).T)
        R = [np.empty((both.shape[0], n)) for _ in range(count)]
        if count > 1:
            MW = factor.solve(M @ self.W)
            s = (both @ MW).T - c
        for part in blocks(n):
            E = factor.solve(columns[:, part].toarray()) - self.W @ c[:, part]
            R[0][:, part] = both @ E
            if count > 1:
                Y = factor.solve(M @ E)
                R[1][:, part] = both @ Y + s.T @ c[:, part]
            if count > 2:
                answer = la.cho_solve(A_W, s[:, part])
                other = la.cho_solve(A_W, c[:, part])
                Y += MW @ c[:, part] - self.W @ (answer + other)
                R[2][:, part] = both @ factor.solve(M @ Y) + s.T @ (answer + other) + c.T @ answer
        factor.destroy()
        return R

    def _centre(
        self, found: RealModes, order: int, comm: MPI.Comm
    ) -> tuple[list[tuple[Array, Array]], Array]:
        """What follows the interpolated R_j at the centre, T R_0 T' there."""
        b, centre = self.body, np.zeros(self.anchors.points.shape[1])
        factor = self._factor(centre)
        rest = Deflated(factor, found.Phi, found.Lambda)
        moments = interface_moments(rest, b.M, b.N, b.T, order, comm, between=factor)
        TT = slip_compliance(rest, b.T, comm)
        factor.destroy()
        # The other directions of W: at the centre their values lie beyond the limit.
        Lambda, Q = la.eigh(self._projected(centre))
        other = Q[:, found.Lambda.size :]
        Lambda, N, T = Lambda[found.Lambda.size :], self.W_N @ other, self.W_T @ other
        higher = []
        for j in range(len(self._R), order + 1):
            scaled = N / Lambda ** (j + 1)
            higher.append((moments[j][0] - scaled @ N.T, moments[j][1] - scaled @ T.T))
        return higher, TT

    def _followed(self, last: Array) -> Array:
        """What the first R_j that is not interpolated must change like, by the one before."""
        change = last - self._R[-1][0]
        before = self._split(self._R[-1][0])[0]
        ratio = np.linalg.norm(self._higher[0][0]) / np.linalg.norm(before) if self._higher else 0.0
        return np.asarray(ratio * (len(self._R) + 1) / len(self._R) * change)

    def _split(self, flat: Array) -> tuple[Array, Array]:
        """N R N' and N R T' from rows of N and T."""
        n = self.body.N.shape[0]
        whole = flat.reshape(-1, n)
        NN = whole[:n]
        return 0.5 * (NN + NN.T), np.ascontiguousarray(whole[n:].T)


def _joined(found: list[RealModes], M: sp.csr_matrix) -> Array:
    """M-orthonormal space of all modes; those of the first set come first, as they are."""
    first = found[0].Phi
    # A low mode that W misses by a little is a pole of the rest close to zero: R_2 sees it with
    # (limit / Lambda)^3.
    limit = found[0].Lambda[-1]
    rest = np.hstack([first[:, :0], *(m.Phi * (limit / m.Lambda) ** 2 for m in found[1:])])
    for _ in range(2):
        rest -= first @ (first.T @ (M @ rest))
    values, vectors = la.eigh(rest.T @ (M @ rest))
    good = values > NEW
    more = rest @ (vectors[:, good] / np.sqrt(values[good]))
    for _ in range(2):
        more -= first @ (first.T @ (M @ more))
        values, vectors = la.eigh(more.T @ (M @ more))
        more = more @ (vectors / np.sqrt(values))
    return np.hstack([first, more])


def work_at(anchors: Anchors) -> int:
    """Anchors, and points that check them, at which a body is solved."""
    return anchors.count(min(MODES_DEGREE, anchors.degree)) + len(anchors.points) + CHECKS


def _shared(tasks: list, work: Callable, comm: MPI.Comm, progress: Callable[[int], None]) -> list:
    """Results of all tasks on every process; each task is done by one of them."""
    own = {}
    for i in range(comm.rank, len(tasks), comm.size):
        own[i] = work(tasks[i])
        progress(1)
    return [comm.bcast(own.get(i), root=i % comm.size) for i in range(len(tasks))]

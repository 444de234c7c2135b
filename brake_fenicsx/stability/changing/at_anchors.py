"""The offline work on a body of variable stiffness: its modes and what they leave out, at anchors.

See ``varied`` for what is computed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

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
from .bodies import Body
from .interpolated import Rests, Stiffness, degrees
from .rest import rest_moments
from .space import complete_modes, joined, projected, ritz_errors, shared
from .view import Arrays

Array = NDArray[np.float64]

# Total degree of the anchors whose modes are in W.
MODES_DEGREE = 2

# Relative residual of those modes but the centre's: far below what NEW leaves out.
FILLING = 1e-6

# Points that show what the interpolation is worth, and their coordinates. Polynomials in t go on to
# 2i, where x (x^2 - 1), what three anchors leave, is as large as at 2.3.
CHECKS, CORNER, CORNER_T = 2, 0.9, 2.3


@dataclass(frozen=True, slots=True)
class Varied:
    """A body of variable stiffness.

    Attributes:
        body: the body, see ``looked_at``.
        coefficients: of all unit changes at a point of [-1, 1]^d.
        anchors: the anchors; their degree is that of the interpolation of R_0.
        sigma: shift that makes the stiffness positive definite [1/s^2].
        kept: modes that samples keep end here [1/s^2], as kappa'; what W knows beyond is rest.
        limit: modes in W end here, as kappa'.
        stretched: whether the last coordinate is the share t of the damping.
    """

    body: Body
    coefficients: Callable[[Array], Array]
    anchors: Anchors
    sigma: float
    kept: float
    limit: float
    stretched: bool

    def elastic(self, x: Array) -> sp.csr_matrix:
        """K(x) [N/m]."""
        return (self.body.K + self.body.change(self.coefficients(x))).tocsr()

    def at(self, x: Array) -> sp.csr_matrix:
        """A = K(x) + sigma M [N/m]."""
        return (self.elastic(x) + self.sigma * self.body.M).tocsr()

    def factor(self, x: Array) -> Factor:
        """Its factor."""
        factor = Factor(petsc_matrix(self.at(x)), "brake_body_")
        if factor.negative_pivots:
            raise InaccurateResult("a body of variable stiffness is not positive definite")
        return factor

    def stiffness(self, projected: Array) -> Stiffness:
        """W'A W, by W'K W and the same of the unit changes."""
        numbers = np.array([number for number, _ in self.body.parts], dtype=np.intp)
        return Stiffness(projected, numbers, self.coefficients, self.sigma)

    def checks(self) -> list[Array]:
        """Towards two corners, where no anchor is: the interpolation is worst there."""
        alternate = (-1.0) ** np.arange(self.anchors.points.shape[1])
        corner = np.full(alternate.size, CORNER)
        if self.stretched:
            corner[-1] = CORNER_T
        return [-corner, corner * alternate]

    def modes(self, number: int) -> RealModes:
        """Modes at an anchor; those of the centre are deflated, the others only fill W."""
        x = self.anchors.points[number]
        factor = self.factor(x)
        tolerance = FILLING if number else 1e-9
        found = complete_modes(
            factor, self.elastic(x), self.body.M, self.sigma, self.limit, tolerance
        )
        factor.destroy()
        return found


def work_at(anchors: Anchors) -> int:
    """Anchors, and points that check them, at which a body is solved."""
    return anchors.count(min(MODES_DEGREE, anchors.degree)) + len(anchors.points) + CHECKS


def solve_at_anchors(
    varied: Varied, T: sp.csr_matrix, order: int, comm: MPI.Comm, progress: Callable[[int], None]
) -> Arrays:
    """All that ``VariedBody`` wants to know of a body; the processes share the anchors.

    Args:
        varied: the body.
        T: its slips, loads included, shape (elements + loads, dofs).
        order: largest j of R_j.
        comm: the processes.
        progress: called with the number of anchors done.

    Raises:
        InaccurateResult: the stiffness is not positive definite at some point, or an inertia count
            finds a missing mode.
    """
    anchors, body = varied.anchors, varied.body
    number = anchors.count(min(MODES_DEGREE, anchors.degree))
    found = shared(range(number), varied.modes, comm, progress)
    W, centre = joined(found, body.M, comm), found[0]
    del found
    W_B = np.ascontiguousarray((sp.vstack([body.N, body.T]) @ W).T)
    stiffness = varied.stiffness(projected([body.K, *(part for _, part in body.parts)], W, comm))

    def solved(task: tuple[Array, int, bool]) -> tuple[list[Array], Array]:
        """The first R_j at a point; eigenvalues and their errors where they are asked for."""
        x, count, check = task
        factor, A = varied.factor(x), stiffness.at(x)
        R = rest_moments(factor, body, W, W_B, A, count)
        poles = _poles(varied, factor, x, W, A) if check else np.zeros((2, 0))
        factor.destroy()
        return R, poles

    needed = [anchors.count(degree) for degree in degrees(anchors)]
    counts = [sum(i < n for n in needed) for i in range(len(anchors.points))]
    # The longest first.
    tasks = [(x, len(needed), True) for x in varied.checks()]
    tasks += [(x, n, False) for x, n in zip(anchors.points, counts, strict=True)]
    answers = shared(tasks, solved, comm, progress)
    checked, at_anchors = answers[:CHECKS], [R for R, _ in answers[CHECKS:]]
    R = tuple(np.array([r[j] for r in at_anchors[:n]]) for j, n in enumerate(needed))
    higher, TT = _at_centre(varied, centre, (stiffness, W_B), R, (T, order), comm)
    return {
        "W": W, "W_B": W_B, "projected": stiffness.projected, "higher": higher, "TT": TT,
        "doubt": _errors(varied, Rests(anchors, R), higher, [R for R, _ in checked]),
        "poles": _ascending(np.hstack([poles for _, poles in checked])),
        **{f"R_{j}": values for j, values in enumerate(R)},
    }  # fmt: skip


def _poles(varied: Varied, factor: Factor, x: Array, W: Array, stiffness: Array) -> Array:
    """Eigenvalues of the kept modes in W, and how much too large they are."""
    Lambda, Q = la.eigh(stiffness, driver="evd", check_finite=False)
    kept = Lambda <= varied.kept
    modes = W @ Q[:, kept], Lambda[kept]
    errors = ritz_errors(factor, varied.at(x), varied.body.M, modes, varied.limit)
    return np.array([Lambda[kept], errors])


def _ascending(poles: Array) -> Array:
    """Eigenvalues, ascending, and the largest relative error up to each."""
    Lambda, error = poles
    up = np.argsort(Lambda)
    return np.array([Lambda[up], np.maximum.accumulate((error / Lambda)[up])])


def _at_centre(
    varied: Varied,
    found: RealModes,
    space: tuple[Stiffness, Array],
    R: tuple[Array, ...],
    wanted: tuple[sp.csr_matrix, int],
    comm: MPI.Comm,
) -> tuple[Array, Array]:
    """What follows the interpolated R_j at the centre, and T R_0 T' there."""
    (stiffness, W_B), (T, order), b = space, wanted, varied.body
    centre = np.zeros(varied.anchors.points.shape[1])
    factor = varied.factor(centre)
    rest = Deflated(factor, found.Phi, found.Lambda)
    moments = interface_moments(rest, b.M, b.N, b.T, order, comm, between=factor)
    TT = slip_compliance(rest, T, comm)
    factor.destroy()
    # The other directions of W: at the centre their values lie beyond the limit.
    Lambda, Q = la.eigh(stiffness.at(centre), driver="evd")
    Phi, n = Q[:, found.Lambda.size :].T @ W_B, b.N.shape[0]
    Lambda = Lambda[found.Lambda.size :, None]
    higher = [
        np.hstack(moments[j]) - (Phi[:, :n] / Lambda ** (j + 1)).T @ Phi
        for j in range(len(R), order + 1)
    ]
    return np.array(higher).reshape(-1, *R[0].shape[1:]), TT


def _errors(varied: Varied, rests: Rests, higher: Array, checked: list[list[Array]]) -> Array:
    """Errors of R_0, R_1, ... at the points that check them."""
    pairs = zip(varied.checks(), checked, strict=True)
    return np.array(
        [
            [
                *(R - rests.at(x, j, len(R)) for j, R in enumerate(found)),
                _followed(rests.values, higher, found[-1]),
            ]
            for x, found in pairs
        ]
    )


def _followed(R: tuple[Array, ...], higher: Array, last: Array) -> Array:
    """What the first R_j that is not interpolated must change like, by the one before."""
    before, n = R[-1][0], len(last)
    if not len(higher):
        return np.zeros_like(last)
    ratio = np.linalg.norm(higher[0][:, :n]) / np.linalg.norm(before[:, :n])
    return np.asarray(ratio * (len(R) + 1) / len(R) * (last - before))

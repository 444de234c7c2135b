"""One substructure of the reduced model: kept modes, projected matrices, interpolated moments.

The kept modes W are those of the centre of the parameter box alone, below a cutoff. If
K(p) >= r K(0), the theorem of Courant and Fischer places every pole of the complement S(z; p)
beyond r cutoff^2, for every p: the moments D_n(p) fall geometrically and are smooth functions of p,
and no mode below that limit can be missed anywhere in the box, by one inertia count at the centre.
W'P(z; p)W is affine and exact; D_n(p) is interpolated, with a degree that falls with n.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import comb

from mpi4py import MPI

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import BrakeError, InaccurateResult
from brake_fenicsx.macro.condensation import petsc_matrix
from brake_fenicsx.macro.solver import Factor

from ..eigensolvers.lanczos import lowest_modes
from ..eigensolvers.symmetric import count_below
from .moments import SIGMA, Rows, coupled, moments, shifted_polynomial
from .parameters import Interpolation, Parameters
from .substructure import Substructure

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Accuracy:
    """What a tolerance asks of the model.

    Attributes:
        cutoff: kept modes reach up to this multiple of the band's end.
        degrees: total degree of the interpolation of each moment D_n; as many as moments.
    """

    cutoff: float
    degrees: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class AtPoint:
    """A substructure at a point of the box.

    Attributes:
        modal: W'P_n W, in units of the band's end, shape (2 or 3, modes, modes).
        D: moments, shape (count, rows, columns).
        errors: estimates of the errors of D, each of the shape of D: the step from one degree
            lower times what one degree gains, and the errors that were measured at two points.
    """

    modal: Array
    D: Array
    errors: list[Array]


class Component:
    """A substructure, reduced.

    Attributes:
        body: its matrices.
        W: M-orthonormal kept modes, shape (n, modes).
        kappa: their eigenvalues at the centre of the box [1/s^2].
        followed: motions of the kept modes that forces follow, shape (followed rows, modes).
        acting: motions along which forces act, shape (acting rows, modes).
        loads: loads on the kept modes [N], shape (loads, modes).
        coupled: whether D has rows and columns of the kept modes.
        reach: no pole of what is left out lies below it anywhere in the box, over the band's end.
    """

    def __init__(
        self,
        body: Substructure,
        modes: tuple[Array, Array],
        known: dict[str, Array] | None,
        rows: Rows,
        parameters: Parameters,
        accuracy: Accuracy,
        omega: float,
        comm: MPI.Comm,
        progress: Callable[[int], None],
    ):
        """Compute the moments at the anchors, or take those of an earlier offline stage.

        Args:
            body: the body.
            modes: kept modes and their eigenvalues, see ``kept_modes``.
            known: ``arrays`` of an earlier offline stage; None to compute them.
            rows: blocks of its contact rows.
            parameters: of all bodies.
            accuracy: cutoff and degrees.
            omega: end of the band [rad/s].
            comm: processes that share the work.
            progress: called with the number of solves that were done.

        Raises:
            InaccurateResult: the body has no positive definite stiffness somewhere in the box.
        """
        self.body, (self.W, self.kappa) = body, modes
        self._rows, self._omega, self._parameters = rows, omega, parameters
        self._constant: AtPoint | None = None
        W, self.coupled = self.W, coupled(body)
        # Poles of what is left out lie beyond r cutoff^2 in kappa.
        self.reach = accuracy.cutoff * np.sqrt(parameters.softening)
        self._own = parameters.acting_on(list(body.changes))
        interface = body.interface
        self.followed = np.vstack([interface[name] @ W for name in rows.followed])
        self.acting = np.vstack([interface[name] @ W for name in rows.acting])
        self.loads = body.loads.T @ W
        self._project()
        degrees = accuracy.degrees if self._own.size else (0,) * len(accuracy.degrees)
        self._degrees = degrees
        self._box = Interpolation(self._own.size, max(degrees))
        if known is not None:
            self._D = [known[f"D{n}"] for n in range(len(degrees))]
            self._checks, self._gain = known["checks"], known["gain"]
            return
        counts, ends = points_of(degrees, self._own.size)
        points = [*self._box.points, *(self._box.checks if self._own.size else ())]
        checks, self._gain = [], np.zeros(len(degrees))
        for i, found in enumerate(self._at_points(points, counts, comm, progress)):
            if i == 0:
                self._D = [np.empty((end, *found.shape[1:])) for end in ends]
            if i < ends[0]:
                for n in range(len(found)):
                    self._D[n][i] = found[n]
                continue
            D, step = self._interpolated(points[i])
            checks.append(found - D)
            size = [[la.norm(A) for A in every] for every in (checks[-1], step)]
            self._gain = np.maximum(self._gain, np.divide(size[0], size[1]))
        self._checks = np.array(checks).reshape(len(checks), len(degrees), *self._D[0].shape[1:])

    def arrays(self) -> dict[str, Array]:
        """What the offline stage made, to be kept in a file."""
        made = {f"D{n}": D for n, D in enumerate(self._D)}
        return {
            "W": self.W,
            "kappa": self.kappa,
            "checks": self._checks,
            "gain": self._gain,
            **made,
        }

    def at(self, x: Array) -> AtPoint:
        """The substructure at a point of the box, shape (d,); one and the same if none moves it."""
        own = x[self._own]
        if not own.size and self._constant is not None:
            return self._constant
        D, step = self._interpolated(own)
        # One degree more gains about what it gains at the points that were checked.
        errors = [self._gain[:, None, None] * step, *self._checks] if self._own.size else []
        if (growth := self._box.growth(own)) > 1:
            errors = [growth * error for error in errors]
        found = AtPoint(self._modal(x), D, errors)
        self._constant = None if own.size else found
        return found

    def polynomial(self, x: Array) -> list[sp.csr_matrix]:
        """P_0, P_1, ... at a point of the box, at full order."""
        c = self._parameters.coefficients(x)
        body = self.body
        return shifted_polynomial(
            body.stiffness(c), body.damping(c), body.M, self._omega, self._rows
        )

    def _project(self) -> None:
        """K and C of the kept modes, and of each unit change."""
        W, body = self.W, self.body
        self._K = {None: W.T @ (body.K @ W)} | {j: W.T @ (A @ W) for j, A in body.changes.items()}
        self._C = None if body.C is None else W.T @ (body.C @ W)

    def _modal(self, x: Array) -> Array:
        """W'P_n W in units of the band's end."""
        c, one = self._parameters.coefficients(x), np.eye(self.W.shape[1])
        K = self._K[None] + sum(c[j] * self._K[j] for j in self.body.changes)
        K = K / self._omega**2
        if not self._rows.damped:
            return np.array([K + SIGMA * one, -one])
        s, C = self._rows.shift, np.zeros_like(K)
        if self._C is not None:
            shares = self.body.shares
            C = self._C + sum(c[j] * shares[j] * self._K[j] for j in self.body.changes)
            C = C / self._omega
        return np.array([K + s * C + SIGMA * one, C + 2 * s * one, one])

    def _at_points(
        self,
        points: Sequence[Array],
        counts: list[int],
        comm: MPI.Comm,
        progress: Callable[[int], None],
    ) -> Iterator[Array]:
        """Moments at points of the own parameters, as many as are asked for; collective.

        Processes take points in turns, so that the factor of a point is made once; if there are
        fewer points than processes, all share the columns of each.
        """
        together = len(points) < comm.size
        turns = 1 if together else comm.size
        sharing = comm if together else MPI.COMM_SELF
        for first in range(0, len(points), turns):
            own: object = None
            mine = first if together else first + comm.rank
            if mine < len(points):
                x = np.zeros(self._parameters.dimension)
                x[self._own] = points[mine]
                given = self.polynomial(x), self.W, self._rows, counts[mine], sharing, progress
                try:
                    own = moments(self.body, *given)
                except BrakeError as error:
                    own = error
            for i in range(min(turns, len(points) - first)):
                one = own if together else comm.bcast(own, root=i)
                if isinstance(one, BrakeError):
                    raise one
                yield np.asarray(one)

    def _interpolated(self, own: Array) -> tuple[Array, Array]:
        """Moments at a point of the own parameters, and the step from one degree lower."""
        D = np.empty((len(self._D), *self._D[0].shape[1:]))
        if not own.size:
            for n, values in enumerate(self._D):
                D[n] = values[0]
            return D, D[:0]
        step = np.empty_like(D)
        for n, (values, degree) in enumerate(zip(self._D, self._degrees, strict=True)):
            weights = self._box.weights(own, degree)
            lower = weights - self._box.weights(own, degree - 1)
            count = len(values)
            both = np.array([weights[:count], lower[:count]])
            D[n], step[n] = (both @ values.reshape(count, -1)).reshape(2, *values.shape[1:])
        return D, step


def points_of(degrees: Sequence[int], dimension: int) -> tuple[list[int], list[int]]:
    """How many moments each point of the offline stage needs, and how many anchors each moment.

    Args:
        degrees: total degree of the interpolation of each moment, not increasing.
        dimension: number of parameters; the two points of the check come last.
    """
    ends = [comb(degree + dimension, dimension) for degree in degrees]
    checks = [len(degrees)] * (2 if dimension else 0)
    return [sum(i < end for end in ends) for i in range(ends[0])] + checks, ends


def kept_modes(
    body: Substructure, centre: Array, omega: float, cutoff: float
) -> tuple[Array, Array]:
    """Real modes of a body at the centre of the box, all of them below a cutoff.

    Args:
        body: the body.
        centre: coefficients of the unit changes there.
        omega: end of the band [rad/s].
        cutoff: multiple of it.

    Returns:
        M-orthonormal modes, shape (n, modes), and their kappa [1/s^2].

    Raises:
        InaccurateResult: the stiffness is indefinite, or an inertia count finds a mode missing.
    """
    K, limit = body.stiffness(centre), (cutoff * omega) ** 2
    sigma = SIGMA * omega**2
    factor = Factor(petsc_matrix((K + sigma * body.M).tocsr()), "brake_modes_")
    if factor.negative_pivots:
        factor.destroy()
        raise InaccurateResult("the stiffness of a body is not positive definite")
    expected, limit = count_below(K, body.M, limit)
    found = lowest_modes(factor, body.M, limit + sigma)
    factor.destroy()
    if found.Lambda.size != expected:
        raise InaccurateResult(
            f"a body has {expected} modes below {np.sqrt(limit) / 2 / np.pi:.0f} Hz by inertia,"
            f" {found.Lambda.size} were found"
        )
    return found.Phi, found.Lambda - sigma

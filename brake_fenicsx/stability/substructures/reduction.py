"""Offline stage of one substructure: kept modes, projected matrices, moments at the anchors."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import ceil

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, eigsh

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.folder.processes import in_turns
from brake_fenicsx.macro.solver import Factor

from ..eigensolvers.lanczos import lowest_modes
from ..eigensolvers.symmetric import count_below
from .component import interface_at, polynomial
from .interpolated import InterpolatedMoments
from .moments import SIGMA, Complement, Rows, moments, number_of_columns, plan_of
from .parameters import Parameters
from .substructure import Substructure

Array = NDArray[np.float64]


# The poles of what the kept modes leave out lie beyond this multiple of the square of the band's
# end, wherever in the box; with shapes beyond almost that, after some attempts, and never below
# the last multiple of the end itself.
POLES, ALMOST, NEAREST, ATTEMPTS = 3.3, 0.95, 1.3, 4

# Relative accuracy of the lowest pole.
POLE_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True)
class KeptModes:
    """Modes that a body keeps.

    Attributes:
        W: M-orthonormal modes of the centre of the box, shape (n, modes).
        kappa: their eigenvalues [1/s^2].
        cutoff: all modes below this multiple of the band's end.
        reach: no pole of what is left out lies below this multiple of the band's end anywhere in
            the box.
    """

    W: Array
    kappa: Array
    cutoff: float
    reach: float


class Reduction:
    """The offline stage of one body."""

    def __init__(
        self,
        body: Substructure,
        modes: KeptModes,
        rows: Rows,
        parameters: Parameters,
        degrees: tuple[int, ...],
        orders: NDArray[np.intp],
        omega: float,
        comm: MPI.Comm,
    ):
        """Plan it.

        Args:
            body: the body.
            modes: what it keeps.
            rows: blocks of its contact rows.
            parameters: of all bodies.
            degrees: level of the interpolation of each moment D_n, see ``Interpolation``; as many
                as moments.
            orders: degree of the first moment in each parameter, shape (d,).
            omega: end of the band [rad/s].
            comm: processes that share the work.
        """
        self._body, self._W, self._kappa = body, modes.W, modes.kappa
        self._rows, self._parameters, self._degrees = rows, parameters, degrees
        self._reach = modes.reach
        self._omega, self._comm = omega, comm
        self._beyond = body.damping_beyond(modes.cutoff * omega)
        self._own = parameters.acting_on(list(body.changes), body.elements.size)
        self._orders = orders[self._own]
        self._moments = InterpolatedMoments([*map(int, self._orders)], degrees)
        # Processes take points in turns, so that the factor of a point is made once; if there are
        # fewer points than processes, all share the columns of each.
        self._together = len(self._moments.points) < comm.size

    @property
    def points(self) -> int:
        """Points of the box where moments are computed."""
        return len(self._moments.points)

    @property
    def solves(self) -> int:
        """Solves of this process."""
        kept, comm = self._W.shape[1], self._comm
        columns = number_of_columns(self._body, kept, self._rows)
        counts = [self._moments.counts[i] for i in self._moments.order]
        plans = [plan_of(self._body, kept, self._rows, n) for n in counts]
        solves = [columns * p.exact + p.rank * p.further for p in plans]
        if self._together:
            return ceil(sum(solves) / comm.size)
        return sum(solves[comm.rank :: comm.size])

    def arrays(self, progress: Callable[[int], None]) -> dict[str, NDArray]:
        """What ``Component`` takes, on the first process alone, nothing on others; collective.

        Args:
            progress: called with the number of solves that were done.

        Raises:
            InaccurateResult: the body has no positive definite stiffness somewhere in the box, or
                it is damped too strongly for the series of moments.
        """
        body, W, comm = self._body, self._W, self._comm
        order = self._moments.order
        every: Iterable[Array]
        if self._together:
            every = (self._at(i, comm, progress) for i in order)
        else:
            alone = MPI.COMM_SELF
            every = in_turns(len(order), lambda n: self._at(order[n], alone, progress), comm)
        for i, found in zip(order, every, strict=True):
            if i == 0:
                self._check_convergence(found)
            if comm.rank == 0:
                self._moments.add(i, found)
        if comm.rank > 0:
            return {}
        modal = [W.T @ (A @ W) for A in (body.K, body.M, *body.changes.values())]
        damping = [] if body.C is None else [W.T @ (body.C @ W)]
        if body.ratios:
            # C = M W diag(2 zeta omega) W'M couples nothing with what the modes leave out.
            by_ratio = np.diag(body.modal_damping(W, self._kappa))
            damping = [damping[0] + by_ratio] if damping else [by_ratio]
        return {
            **body.arrays(), **self._moments.arrays(), "W": W, "kappa": self._kappa,
            "beyond": self._beyond,
            "reach": np.array(self._reach),
            "degrees": np.array(self._degrees), "orders": self._orders,
            "modal": np.array(modal), "modal_C": np.array(damping),
        }  # fmt: skip

    def _at(self, i: int, comm: MPI.Comm, progress: Callable[[int], None]) -> Array:
        """Moments at a point, as many as it needs; collective over ``comm``."""
        x = np.zeros(self._parameters.dimension)
        x[self._own] = self._moments.points[i]
        P = polynomial(self._body, self._parameters, x, self._omega, self._rows, self._beyond)
        count = self._moments.counts[i]
        M = self._body.mass(self._parameters.centre)
        body = replace(self._body, interface=interface_at(self._body, self._parameters, x))
        return moments(body, P, M, self._W, self._rows, count, comm, progress)

    def _check_convergence(self, D: Array) -> None:
        """Whether the moments fall fast enough up to the band's end.

        Raises:
            InaccurateResult: they do not: the body is damped too strongly.
        """
        size = [float(np.linalg.norm(A)) for A in D]
        step = 2 if self._rows.damped else 1
        # With rates they turn in the complex plane: a single one may be small by its phase.
        if len(size) > 2 * step and max(size[-step:]) > max(size[-2 * step : -step]):
            raise InaccurateResult(
                "damping too large for the frequency expansion of the reduced model up to the end"
                " of the band"
            )


def kept_modes(
    body: Substructure, parameters: Parameters, omega: float, cutoff: float | None
) -> KeptModes:
    """Real modes of a body at the centre of the box, all of them below a cutoff.

    Args:
        body: the body.
        parameters: of all bodies.
        omega: end of the band [rad/s].
        cutoff: multiple of it; None: so that all poles of what is left out lie beyond ``POLES``.

    Raises:
        InaccurateResult: the stiffness is indefinite, an inertia count finds a mode missing, or
            the shape changes so much that poles stay close to the band.
    """
    softening, shaped = parameters.softening, _changes_shape(body, parameters)
    least = POLES / softening
    for _ in range(ATTEMPTS):
        kept = float(np.sqrt(least)) if cutoff is None else cutoff
        W, kappa = _modes_below(body, parameters, omega, kept)
        if not shaped:
            return KeptModes(W, kappa, kept, kept * float(np.sqrt(softening)))
        # Materials soften every shape alike; shapes are compared at the centre of the materials.
        pole = min(_lowest_pole(body, parameters, x, W, omega) for x in parameters.extreme_shapes)
        if cutoff is not None or softening * pole >= ALMOST * POLES:
            break
        least *= POLES / (softening * pole)
    reach = float(np.sqrt(softening * pole))
    if reach < NEAREST:
        raise InaccurateResult(
            f"modes that are left out come down to {reach:.2f} times the end of the band where a"
            " length, a density or a mass changes: narrow its range, or raise stability.cutoff"
        )
    return KeptModes(W, kappa, kept, reach)


def _changes_shape(body: Substructure, parameters: Parameters) -> bool:
    """Whether a parameter of the shape moves the body."""
    return bool(np.isin(parameters.acting_on(list(body.changes)), parameters.shapes).any())


def _lowest_pole(
    body: Substructure, parameters: Parameters, x: Array, W: Array, omega: float
) -> float:
    """Least kappa of the body at a point of the box, held M-orthogonal to its kept modes.

    Args:
        body: the body.
        parameters: of all bodies.
        x: the point, shape (d,).
        W: kept modes, shape (n, modes).
        omega: end of the band [rad/s].

    Returns:
        Over the square of the band's end.
    """
    c = parameters.coefficients(x)
    K, M = body.stiffness(c) / omega**2, body.mass(c)
    complement = Complement((K + SIGMA * M).tocsr(), body.mass(parameters.centre), W)
    inverse = LinearOperator(
        K.shape, lambda b: complement.solve(b.reshape(-1, 1)).ravel(), dtype=float
    )
    start = inverse @ np.ones(K.shape[0])
    (found,) = eigsh(
        K, 1, M, sigma=-SIGMA, OPinv=inverse, v0=start, tol=POLE_TOLERANCE,
        return_eigenvectors=False,
    )  # fmt: skip
    complement.factor.destroy()
    return float(found)


def _modes_below(
    body: Substructure, parameters: Parameters, omega: float, cutoff: float
) -> tuple[Array, Array]:
    """M-orthonormal modes at the centre, shape (n, modes), and their kappa [1/s^2]; as above."""
    centre, sigma = parameters.centre, SIGMA * omega**2
    K, M = body.stiffness(centre), body.mass(centre)
    # One factor at a time.
    expected, limit = count_below(K, M, (cutoff * omega) ** 2)
    factor = Factor((K + sigma * M).tocsr(), "brake_modes_")
    if factor.negative_pivots:
        factor.destroy()
        raise InaccurateResult("the stiffness of a body is not positive definite")
    found = lowest_modes(factor, M, limit + sigma)
    factor.destroy()
    if found.Lambda.size != expected:
        raise InaccurateResult(
            f"a body has {expected} modes below {np.sqrt(limit) / 2 / np.pi:.0f} Hz by inertia,"
            f" {found.Lambda.size} were found"
        )
    return found.Phi, found.Lambda - sigma

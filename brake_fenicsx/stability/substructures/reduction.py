"""Offline stage of one substructure: kept modes, projected matrices, moments at the anchors."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import ceil

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.folder.processes import in_turns
from brake_fenicsx.macro.solver import Factor

from ..eigensolvers.lanczos import lowest_modes
from ..eigensolvers.symmetric import count_below
from .component import polynomial
from .interpolated import InterpolatedMoments
from .moments import SIGMA, Rows, coupled, moments
from .parameters import Parameters
from .substructure import Substructure

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Accuracy:
    """What a tolerance asks of the model.

    Attributes:
        cutoff: kept modes reach up to this multiple of the band's end.
        degrees: total degree of the interpolation of each moment D_n; as many as moments.
    """

    cutoff: float
    degrees: tuple[int, ...]


class Reduction:
    """The offline stage of one body."""

    def __init__(
        self,
        body: Substructure,
        modes: tuple[Array, Array],
        rows: Rows,
        parameters: Parameters,
        accuracy: Accuracy,
        omega: float,
        comm: MPI.Comm,
    ):
        """Plan it.

        Args:
            body: the body.
            modes: kept modes and their eigenvalues, see ``kept_modes``.
            rows: blocks of its contact rows.
            parameters: of all bodies.
            accuracy: cutoff and degrees.
            omega: end of the band [rad/s].
            comm: processes that share the work.
        """
        self._body, (self._W, self._kappa) = body, modes
        self._rows, self._parameters, self._accuracy = rows, parameters, accuracy
        self._omega, self._comm = omega, comm
        self._beyond = body.damping_beyond(accuracy.cutoff * omega)
        self._own = parameters.acting_on(list(body.changes))
        self._moments = InterpolatedMoments(self._own.size, accuracy.degrees)
        # Processes take points in turns, so that the factor of a point is made once; if there are
        # fewer points than processes, all share the columns of each.
        self._together = len(self._moments.points) < comm.size

    @property
    def solves(self) -> int:
        """Solves of this process."""
        modes = self._W.shape[1] * coupled(self._body)
        columns = self._body.elements.size * len(self._rows.followed) + modes
        counts, comm = self._moments.counts, self._comm
        if self._together:
            return ceil(columns / comm.size) * sum(counts)
        return columns * sum(counts[comm.rank :: comm.size])

    def arrays(self, progress: Callable[[int], None]) -> dict[str, NDArray]:
        """What ``Component`` takes, on the first process alone, nothing on others; collective.

        Args:
            progress: called with the number of solves that were done.

        Raises:
            InaccurateResult: the body has no positive definite stiffness somewhere in the box, or
                it is damped too strongly for the series of moments.
        """
        body, W, comm = self._body, self._W, self._comm
        number = len(self._moments.points)
        every: Iterable[Array]
        if self._together:
            every = (self._at(i, comm, progress) for i in range(number))
        else:
            every = in_turns(number, lambda i: self._at(i, MPI.COMM_SELF, progress), comm)
        for i, found in enumerate(every):
            if i == 0:
                self._check_convergence(found)
            if comm.rank == 0:
                self._moments.add(i, found)
        if comm.rank > 0:
            return {}
        stiffness = [W.T @ (A @ W) for A in (body.K, *body.changes.values())]
        damping = [] if body.C is None else [W.T @ (body.C @ W)]
        if body.ratios:
            # C = M W diag(2 zeta omega) W'M couples nothing with what the modes leave out.
            modal = np.diag(body.modal_damping(W, self._kappa))
            damping = [damping[0] + modal] if damping else [modal]
        return {
            **body.arrays(), **self._moments.arrays(), "W": W, "kappa": self._kappa,
            "beyond": self._beyond,
            # Poles of what is left out lie beyond r cutoff^2 in kappa.
            "reach": np.array(self._accuracy.cutoff * np.sqrt(self._parameters.softening)),
            "degrees": np.array(self._accuracy.degrees),
            "followed": np.vstack([body.interface[name] @ W for name in self._rows.followed]),
            "acting": np.vstack([body.interface[name] @ W for name in self._rows.acting]),
            "modal_K": np.array(stiffness), "modal_C": np.array(damping),
        }  # fmt: skip

    def _at(self, i: int, comm: MPI.Comm, progress: Callable[[int], None]) -> Array:
        """Moments at a point, as many as it needs; collective over ``comm``."""
        x = np.zeros(self._parameters.dimension)
        x[self._own] = self._moments.points[i]
        P = polynomial(self._body, self._parameters, x, self._omega, self._rows, self._beyond)
        count = self._moments.counts[i]
        return moments(self._body, P, self._W, self._rows, count, comm, progress)

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
    body: Substructure, centre: Array, omega: float, cutoff: float
) -> tuple[Array, Array]:
    """Real modes of a body at the centre of the box, all of them below a cutoff.

    Args:
        body: the body.
        centre: coefficients of the changes there, shape (2, changes).
        omega: end of the band [rad/s].
        cutoff: multiple of it.

    Returns:
        M-orthonormal modes, shape (n, modes), and their kappa [1/s^2].

    Raises:
        InaccurateResult: the stiffness is indefinite, or an inertia count finds a mode missing.
    """
    K, sigma = body.stiffness(centre), SIGMA * omega**2
    # One factor at a time.
    expected, limit = count_below(K, body.M, (cutoff * omega) ** 2)
    factor = Factor((K + sigma * body.M).tocsr(), "brake_modes_")
    if factor.negative_pivots:
        factor.destroy()
        raise InaccurateResult("the stiffness of a body is not positive definite")
    found = lowest_modes(factor, body.M, limit + sigma)
    factor.destroy()
    if found.Lambda.size != expected:
        raise InaccurateResult(
            f"a body has {expected} modes below {np.sqrt(limit) / 2 / np.pi:.0f} Hz by inertia,"
            f" {found.Lambda.size} were found"
        )
    return found.Phi, found.Lambda - sigma

"""A body as its contact elements see it: kept modes, and moments of what they leave out."""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.macro.condensation import interface_moments, petsc_matrix, slip_compliance
from brake_fenicsx.macro.solver import Factor

from .bodies import Body
from .deflation import Deflated
from .lanczos import RealModes, lowest_modes
from .symmetric import count_below

Array = NDArray[np.float64]
Arrays = dict[str, Array]


@dataclass(frozen=True, slots=True)
class View:
    """A body as its interface sees it, at one stiffness.

    Attributes:
        Lambda: kappa' of the kept modes [1/s^2].
        Phi_N: their gaps, shape (elements, modes).
        Phi_T: their slips.
        shapes: the modes in the coordinates of W, shape (W, modes).
        NN: N R_j N', j = 0, 1, ...
        NT: N R_j T'.
        TT: T R_0 T'.
    """

    Lambda: Array
    Phi_N: Array
    Phi_T: Array
    shapes: Array
    NN: list[Array]
    NT: list[Array]
    TT: Array


@dataclass(frozen=True, slots=True)
class FixedBody:
    """A body of constant stiffness.

    Attributes:
        body: the body.
        W: its modes.
        always: what its interface sees.
    """

    body: Body
    W: Array
    always: View

    def view(self, x: Array) -> View:
        """The same at every point."""
        return self.always

    def arrays(self) -> Arrays:
        """All that was computed."""
        s = self.always
        return {
            "W": self.W, "Lambda": s.Lambda, "Phi_N": s.Phi_N, "Phi_T": s.Phi_T,
            "NN": np.array(s.NN), "NT": np.array(s.NT), "TT": s.TT,
        }  # fmt: skip


def fixed_body(
    body: Body, sigma: float, limit: float, order: int, comm: MPI.Comm, known: Arrays | None = None
) -> FixedBody:
    """A body of constant stiffness, see ``VariedBody`` for the arguments."""
    if known is not None:
        modes = known["Lambda"], known["Phi_N"], known["Phi_T"], np.eye(known["Lambda"].size)
        view = View(*modes, [*known["NN"]], [*known["NT"]], known["TT"])
        return FixedBody(body, known["W"], view)
    factor = Factor(petsc_matrix((body.K + sigma * body.M).tocsr()), "brake_body_")
    found = complete_modes(factor, body.K, body.M, sigma, limit + sigma)
    rest = Deflated(factor, found.Phi, found.Lambda)
    moments = interface_moments(rest, body.M, body.N, body.T, order, comm, between=factor)
    TT = slip_compliance(rest, body.T, comm)
    factor.destroy()
    NN, NT = ([m[i] for m in moments] for i in (0, 1))
    Phi, shapes = found.Phi, np.eye(found.Lambda.size)
    view = View(found.Lambda, body.N @ Phi, body.T @ Phi, shapes, NN, NT, TT)
    return FixedBody(body, Phi, view)


def complete_modes(
    factor: Factor, K: sp.csr_matrix, M: sp.csr_matrix, sigma: float, limit: float
) -> RealModes:
    """All modes of K + sigma M below a limit, proven by inertia.

    Raises:
        InaccurateResult: inertia counts another number.
    """
    found = lowest_modes(factor, M, limit)
    expected, _ = count_below(K, M, limit - sigma)
    if expected != found.Lambda.size:
        raise InaccurateResult(
            f"a body has {expected} modes by inertia, {found.Lambda.size} were found"
        )
    return found

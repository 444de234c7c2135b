"""A body of constant stiffness as its contact elements see it, damped or not."""

from __future__ import annotations

from dataclasses import dataclass, replace

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.macro.condensation import interface_moments, petsc_matrix, slip_compliance
from brake_fenicsx.macro.solver import Factor

from ..reduced.contact_forces import interface_rows
from ..reduced.damped_basis import damped_moments
from ..reduced.deflation import Deflated
from .bodies import Body, looked_at, places_of
from .expansion import Expansion, Moment
from .space import complete_modes
from .view import Arrays, View

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FixedBody:
    """A body of constant stiffness.

    Attributes:
        body: the body.
        W: its modes.
        always: what its interface sees.
        Phi: all rows of its interface on the modes, shape (modes, columns).
        moments: R_j, rows that are looked at on all columns, shape (orders, rows, columns).
        series: see ``Expansion``.
    """

    body: Body
    W: Array
    always: View
    Phi: Array
    moments: Array
    series: tuple[Array, Array] | None = None

    @property
    def varies(self) -> bool:
        """Never."""
        return False

    @property
    def directions(self) -> int:
        """Number of its coordinates."""
        return int(self.W.shape[1])

    @property
    def doubt(self) -> Array:
        """None: nothing is interpolated."""
        return np.zeros((0, 0, 0, 0))

    @property
    def every_doubt(self) -> Array:
        """None."""
        return self.doubt

    def pole_doubt(self, Lambda: Array) -> Array:
        """None: they are those of the body itself."""
        return np.zeros_like(Lambda)

    def view(self, x: Array) -> View:
        """The same at every point."""
        return self.always

    def expansion(self, x: Array) -> Expansion:
        """The same at every point."""
        s, one = self.always, np.ones((1, 1))
        moments = [Moment(j, one, R[None]) for j, R in enumerate(self.moments)]
        kept, n = s.Lambda.size, len(s.Phi_N)
        return Expansion(n, s.Lambda, self.Phi, s.shapes, kept, None, moments, s.TT, self.series)

    def arrays(self) -> Arrays:
        """All that was computed."""
        s, series = self.always, self.series
        return {
            "W": self.W, "Lambda": s.Lambda, "Phi": self.Phi, "moments": self.moments, "TT": s.TT,
            **({} if series is None else {"C": series[0], "G": series[1]}),
        }  # fmt: skip


def fixed_body(
    body: Body,
    sigma: float,
    limit: float,
    order: int,
    comm: MPI.Comm,
    known: Arrays | None = None,
    names: str = "N",
) -> FixedBody:
    """A body of constant stiffness.

    Args:
        body: the body.
        sigma: shift that makes its stiffness positive definite [1/s^2].
        limit: its modes up to this kappa are kept [1/s^2].
        order: largest j of R_j.
        comm: processes that share the work.
        known: ``arrays`` of the same body, made earlier.
        names: blocks of rows that forces follow, see ``looked_at``.
    """
    seen, n = looked_at(body, names), body.N.shape[0]
    if known is None:
        known = _solved(body, seen, sigma, limit, order, comm)
    Lambda, Phi, moments = known["Lambda"], known["Phi"], known["moments"]
    columns = places_of(names, "NT", n, body.T.shape[0] - n)
    plain = Phi[:, columns]
    rows = [R[:n, columns] for R in moments]
    always = View(Lambda, plain[:, :n].T, plain[:, n:].T, np.eye(Lambda.size), rows, known["TT"])
    return FixedBody(seen, known["W"], always, Phi, moments)


def damped_body(
    fixed: FixedBody,
    body: Body,
    sigma: float,
    names: str,
    comm: MPI.Comm,
    known: Arrays | None = None,
) -> FixedBody:
    """A clamped body of constant stiffness under any damping, such as a disc that turns.

    Args:
        fixed: the body without damping.
        body: its matrices.
        sigma: shift of its eigenvalues [1/s^2].
        names: blocks of rows that forces follow.
        comm: processes that share the work.
        known: ``arrays`` of the same body, made earlier.
    """
    if known is not None:
        return replace(fixed, series=(known["C"], known["G"]))
    n, Phi = body.N.shape[0], fixed.W
    O, I = interface_rows(names, body.N, body.T[:n], body.R)
    factor = Factor(petsc_matrix(body.K), "brake_body_")
    modes = Phi, fixed.always.Lambda - sigma
    G = damped_moments(factor, modes, body.M, body.C, O, I, comm)
    factor.destroy()
    return replace(fixed, series=(np.asarray(Phi.T @ (body.C @ Phi)), np.array(G)))


def _solved(
    body: Body, seen: Body, sigma: float, limit: float, order: int, comm: MPI.Comm
) -> Arrays:
    """Modes and moments of a body of constant stiffness."""
    factor = Factor(petsc_matrix((body.K + sigma * body.M).tocsr()), "brake_body_")
    found = complete_modes(factor, body.K, body.M, sigma, limit + sigma)
    rest = Deflated(factor, found.Phi, found.Lambda)
    pairs = interface_moments(rest, body.M, seen.N, seen.T, order, comm, between=factor)
    TT = slip_compliance(rest, body.T, comm)
    factor.destroy()
    Phi = np.ascontiguousarray((sp.vstack([seen.N, seen.T]) @ found.Phi).T)
    moments = np.array([np.hstack(pair) for pair in pairs])
    return {"W": found.Phi, "Lambda": found.Lambda, "Phi": Phi, "moments": moments, "TT": TT}

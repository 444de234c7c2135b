"""A body as its contact elements see it: kept modes, and moments of what they leave out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.macro.condensation import interface_moments, petsc_matrix, slip_compliance
from brake_fenicsx.macro.solver import Factor

from ..full.lanczos import RealModes, lowest_modes
from ..full.symmetric import count_below
from ..reduced.contact_forces import interface_rows
from ..reduced.damped_basis import damped_moments
from ..reduced.deflation import Deflated
from .bodies import Body, looked_at, places_of
from .congruent import Image
from .expansion import Expansion, Moment

Array = NDArray[np.float64]
Arrays = dict[str, Array]


@dataclass(frozen=True, slots=True)
class View:
    """A body as its interface sees it, at one stiffness.

    Attributes:
        Lambda: kappa' of the kept modes [1/s^2].
        Phi_N: their gaps, shape (elements, modes).
        Phi_T: their slips, and what the loads do on them, shape (elements + loads, modes).
        shapes: the modes in the coordinates of W, shape (W, modes).
        moments: N R_j [N' T'] for j = 0, 1, ..., shape (elements, 2 elements + loads).
        TT: T R_0 T', shape (elements + loads, elements + loads).
    """

    Lambda: Array
    Phi_N: Array
    Phi_T: Array
    shapes: Array
    moments: Sequence[Array]
    TT: Array


class Seen(Protocol):
    """A body that can be looked at."""

    @property
    def body(self) -> Body:
        """The body; its dofs are the rows of W, its elements those of a view."""

    @property
    def varies(self) -> bool:
        """Whether it looks different at another point."""

    @property
    def W(self) -> Array:
        """Displacements of its coordinates, M-orthonormal, shape (dofs, directions)."""

    @property
    def directions(self) -> int:
        """Number of its coordinates."""

    @property
    def doubt(self) -> Array:
        """Errors of R_0, R_1, ... where they were checked, as ``View.moments``; may be none."""

    @property
    def every_doubt(self) -> Array:
        """The same of all rows and columns."""

    def pole_doubt(self, Lambda: Array) -> Array:
        """Typical errors of its eigenvalues in W [1/s^2], where they were checked."""

    def view(self, x: Array) -> View:
        """The body at a point of the box."""

    def expansion(self, x: Array) -> Expansion:
        """The same, as damped samples take it."""

    def arrays(self) -> Arrays:
        """All that was computed."""


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


@dataclass(frozen=True, slots=True)
class ImageBody:
    """A body that is the image of another one, and looks the same from its elements.

    Attributes:
        image: how it is one.
        of: the other one.
    """

    image: Image
    of: Seen

    @property
    def body(self) -> Body:
        """The body, in the order of the other one."""
        return self.image.body

    @property
    def varies(self) -> bool:
        """Like the other one."""
        return self.of.varies

    @property
    def W(self) -> Array:
        """Those of the other one, turned."""
        return self.image.signs[:, None] * self.of.W

    @property
    def directions(self) -> int:
        """Like the other one."""
        return self.of.directions

    @property
    def doubt(self) -> Array:
        """Like the other one."""
        return self.of.doubt

    @property
    def every_doubt(self) -> Array:
        """Like the other one."""
        return self.of.every_doubt

    def pole_doubt(self, Lambda: Array) -> Array:
        """Like the other one."""
        return self.of.pole_doubt(Lambda)

    def view(self, x: Array) -> View:
        """Like the other one."""
        return self.of.view(x)

    def expansion(self, x: Array) -> Expansion:
        """Like the other one."""
        return self.of.expansion(x)

    def arrays(self) -> Arrays:
        """Nothing of its own."""
        return {}


def fixed_body(
    body: Body,
    sigma: float,
    limit: float,
    order: int,
    comm: MPI.Comm,
    known: Arrays | None = None,
    names: str = "N",
) -> FixedBody:
    """A body of constant stiffness, see ``VariedBody`` for the arguments."""
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


def complete_modes(
    factor: Factor,
    K: sp.csr_matrix,
    M: sp.csr_matrix,
    sigma: float,
    limit: float,
    tolerance: float = 1e-9,
) -> RealModes:
    """All modes of K + sigma M below a limit, proven by inertia.

    Raises:
        InaccurateResult: inertia counts another number.
    """
    found = lowest_modes(factor, M, limit, tolerance)
    expected, _ = count_below(K, M, limit - sigma)
    if expected != found.Lambda.size:
        raise InaccurateResult(
            f"a body has {expected} modes by inertia, {found.Lambda.size} were found"
        )
    return found

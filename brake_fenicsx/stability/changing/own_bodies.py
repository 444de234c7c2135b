"""The bodies of one sample themselves, each solved with the sample's own stiffness.

The modes that the reduced model keeps of a body come from a space W; with the body's own stiffness
A = K + sigma M they leave A Phi = M Phi Lambda + E, orthogonal to W. Bodies that are images of
others, and those that are the same in every sample, are not factored again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.macro.condensation import petsc_matrix
from brake_fenicsx.macro.solver import Factor

from ..reduced.trial_vectors import Reference
from .view import ImageBody, Seen

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Whole:
    """A sample's brake at full order, without its contact.

    Attributes:
        K: stiffness [N/m], shape (dofs, dofs).
        M: mass [kg].
        N: gap operator, shape (elements, dofs).
        T: slip operator.
        R: slip across the sliding direction.
        C: damping of the bodies [N s/m]; None where they have none.
    """

    K: sp.csr_matrix
    M: sp.csr_matrix
    N: sp.csr_matrix
    T: sp.csr_matrix
    R: sp.csr_matrix
    C: sp.csr_matrix | None = None


@dataclass(frozen=True, slots=True)
class Factored:
    """A body solved for itself and for its images.

    Attributes:
        factor: factor of A = K + sigma M.
        M: mass [kg].
        Phi: kept modes, shape (dofs, modes).
        defect: E, likewise.
    """

    factor: Factor
    M: sp.csr_matrix
    Phi: Array
    defect: Array

    def rest(self, b: Array) -> Array:
        """What the kept modes leave of A^-1 b."""
        return self.factor.solve(b - self.M @ (self.Phi @ (self.Phi.T @ b)))


@dataclass(frozen=True, slots=True)
class _Seat:
    """Where a body, or an image of it, stands among all dofs and all modes."""

    dofs: Index
    signs: Array
    modes: slice


@dataclass(frozen=True, slots=True)
class ByBody:
    """Columns that belong to one body each, as a matrix over all dofs.

    Attributes:
        size: number of all dofs and of all columns.
        parts: the columns of each body, and where they stand.
    """

    size: tuple[int, int]
    parts: tuple[tuple[Array, _Seat], ...]

    def __matmul__(self, x: Array) -> Array:
        out = np.zeros((self.size[0], x.shape[1]))
        for A, seat in self.parts:
            out[seat.dofs] = seat.signs[:, None] * (A @ x[seat.modes])
        return out

    @property
    def T(self) -> _Transposed:
        """The transposed matrix."""
        return _Transposed(self)


@dataclass(frozen=True, slots=True)
class _Transposed:
    of: ByBody

    def __matmul__(self, x: Array) -> Array:
        out = np.empty((self.of.size[1], x.shape[1]))
        for A, seat in self.of.parts:
            out[seat.modes] = A.T @ (seat.signs[:, None] * x[seat.dofs])
        return out


class OwnBodies:
    """The bodies of a sample, factored with its own stiffness.

    Attributes:
        reference: as the steps on the full problem take them.
    """

    def __init__(
        self,
        bodies: Sequence[Seen],
        shapes: Sequence[Array],
        Lambda: Array,
        whole: Whole,
        sigma: float,
        constant: dict[int, Factored],
    ):
        """Factor the bodies that no earlier one is the image of.

        Args:
            bodies: the bodies.
            shapes: their kept modes in the coordinates of their spaces.
            Lambda: eigenvalues of all kept modes, sigma included [1/s^2].
            whole: the sample at full order.
            sigma: shift [1/s^2].
            constant: bodies that are the same in every sample; completed here.
        """
        self._own: list[Factor] = []
        self._seats: dict[int, tuple[Factored, list[_Seat]]] = {}
        first = 0
        for i, (body, Q) in enumerate(zip(bodies, shapes, strict=True)):
            modes = slice(first, first + Q.shape[1])
            first = modes.stop
            if isinstance(body, ImageBody):
                seats = self._seats[id(body.of)][1]
                seats.append(_Seat(body.body.dofs, body.image.signs, modes))
                continue
            made = constant.get(i)
            if made is None:
                made = _factored(body, Q, Lambda[modes] - sigma, whole, sigma)
                if body.varies:
                    self._own.append(made.factor)
                else:
                    constant[i] = made
            seat = _Seat(body.body.dofs, np.ones(len(body.body.dofs)), modes)
            self._seats[id(body)] = made, [seat]
        size = (whole.M.shape[0], Lambda.size)
        every = [(made, seat) for made, seats in self._seats.values() for seat in seats]
        Phi, defect = (
            ByBody(size, tuple((getattr(made, name), seat) for made, seat in every))
            for name in ("Phi", "defect")
        )
        self.reference = Reference(self, whole.M, Phi, Lambda, defect)

    def solve(self, b: Array | sp.csc_matrix) -> Array:
        """What the kept modes leave of A^-1 b, shape (dofs, columns)."""
        b = b if isinstance(b, np.ndarray) else b.toarray()
        out, n = np.empty_like(b), b.shape[1]
        for made, seats in self._seats.values():
            x = made.rest(np.hstack([s.signs[:, None] * b[s.dofs] for s in seats]))
            for j, s in enumerate(seats):
                out[s.dofs] = s.signs[:, None] * x[:, j * n : (j + 1) * n]
        return out

    def destroy(self) -> None:
        """Free the factors that are the sample's alone."""
        for factor in self._own:
            factor.destroy()


def _factored(body: Seen, Q: Array, kappa: Array, whole: Whole, sigma: float) -> Factored:
    """A body with the stiffness of the sample."""
    dofs = body.body.dofs
    K, M = (A[dofs][:, dofs].tocsr() for A in (whole.K, whole.M))
    factor = Factor(petsc_matrix((K + sigma * M).tocsr()), "brake_body_")
    if factor.negative_pivots:
        raise InaccurateResult("a body of a sample is not positive definite")
    M.eliminate_zeros()
    Phi = body.W @ Q
    return Factored(factor, M, Phi, K @ Phi - M @ (Phi * kappa))

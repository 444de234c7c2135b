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
class _Turned:
    """A body in the order and with the signs of the one that is factored for it."""

    dofs: Index
    signs: Array


class OwnBodies:
    """Solves with A = K + sigma M of a sample, what its kept modes carry taken out.

    Attributes:
        reference: the same as the steps on the full problem take it.
    """

    def __init__(
        self,
        bodies: Sequence[Seen],
        shapes: Sequence[Array],
        Lambda: Array,
        whole: Whole,
        sigma: float,
        constant: dict[int, Factor],
    ):
        """Factor the bodies that no earlier one is the image of.

        Args:
            bodies: the bodies.
            shapes: their kept modes in the coordinates of their spaces.
            Lambda: eigenvalues of all kept modes, sigma included [1/s^2].
            whole: the sample at full order.
            sigma: shift [1/s^2].
            constant: factors of bodies that are the same in every sample; completed here.
        """
        self._own: list[Factor] = []
        self._factors: list[tuple[Factor, list[_Turned]]] = []
        size = (whole.M.shape[0], Lambda.size)
        every, defect = np.zeros(size), np.zeros(size)
        self.reference = Reference(self, whole.M, every, Lambda, defect)
        first = 0
        found: dict[int, tuple[list[_Turned], Array, Array]] = {}
        for i, (body, Q) in enumerate(zip(bodies, shapes, strict=True)):
            dofs, own = body.body.dofs, slice(first, first + Q.shape[1])
            first = own.stop
            if isinstance(body, ImageBody):
                turned, (group, Phi, E) = _Turned(dofs, body.image.signs), found[id(body.of)]
                group.append(turned)
                every[dofs, own], defect[dofs, own] = (turned.signs[:, None] * x for x in (Phi, E))
                continue
            K, M = (A[dofs][:, dofs].tocsr() for A in (whole.K, whole.M))
            Phi = body.W @ Q
            E = K @ Phi - M @ (Phi * (Lambda[own] - sigma))
            every[dofs, own], defect[dofs, own] = Phi, E
            group = [_Turned(dofs, np.ones(dofs.size))]
            found[id(body)] = group, Phi, E
            factor = constant.get(i)
            if factor is None:
                factor = Factor(petsc_matrix((K + sigma * M).tocsr()), "brake_body_")
                if factor.negative_pivots:
                    raise InaccurateResult("a body of a sample is not positive definite")
                if body.varies:
                    self._own.append(factor)
                else:
                    constant[i] = factor
            self._factors.append((factor, group))

    def solve(self, b: Array | sp.csc_matrix) -> Array:
        """What the kept modes leave of A^-1 b, shape (dofs, columns)."""
        b = b if isinstance(b, np.ndarray) else b.toarray()
        Phi, M = self.reference.Phi, self.reference.M
        left = b - M @ (Phi @ (Phi.T @ b))
        out, n = np.empty_like(left), b.shape[1]
        for factor, group in self._factors:
            both = np.hstack([t.signs[:, None] * left[t.dofs] for t in group])
            x = factor.solve(both)
            for j, t in enumerate(group):
                out[t.dofs] = t.signs[:, None] * x[:, j * n : (j + 1) * n]
        return out

    def destroy(self) -> None:
        """Free the factors that are the sample's alone."""
        for factor in self._own:
            factor.destroy()

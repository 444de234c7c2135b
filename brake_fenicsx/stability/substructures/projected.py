"""The problem of one value of a line on trial vectors, and the residual of the whole problem.

The trial vectors are a = V c, y = Y e. Contact forces J(x) y with the stiffness of the value itself
are exact in every element, also where the law has a kink; the test motions are those that do work
on them, (k Y)'. The residual r of the whole problem says what the projection costs: r' P^-1 r over
the slope, with the static compliance of springs and bodies in the contact elements, and in the
coordinates the distance to the next mode beyond the trial vectors (G. W. Stewart and J. Sun, Matrix
Perturbation Theory, 1990, section V.2, there for one symmetric matrix).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from ..eigensolvers.arnoldi import on_parts
from ..modes import Complex
from .contact_linearisation import ContactLinearisation
from .contact_rows import SIGMA
from .polynomials import Zeros, applied
from .sample_problem import Quotient, SampleProblem
from .trial import TrialSpace, UnitContact

if TYPE_CHECKING:
    from .reduced_model import ReducedModel

Array = NDArray[np.float64]

# A stiffness of motions that work on no spring, over that of the others.
NO_FORCE = 1e-13

# So many coefficients tell the residual of the motions; those beyond are a ten-thousandth of D_0.
SEEN = 3

# Least distance to the modes beyond the trial vectors, in units of the band's end squared.
NEAREST = 1e-3


class Projected:
    """The problem of one value on a trial space, and what that leaves out.

    Attributes:
        problem: of the form of the whole one.
    """

    def __init__(
        self, model: ReducedModel, unit: UnitContact, t: TrialSpace, contact: ContactLinearisation
    ):
        """Project the problem.

        Args:
            model: of all samples.
            unit: its bodies.
            t: the trial space.
            contact: what acts in the contact elements at the value.
        """
        self._t, self._unit, self._rows = t, unit, model.rows
        unit_k = unit.stiffness[:, None]
        self._k, f = contact.k[:, None] / unit_k, contact.friction[:, None] / unit_k
        # Friction over stiffness: one matrix for both forces saves half of the products.
        mu = np.divide(f, self._k, out=np.zeros_like(f), where=self._k > 0).T
        forces = zip(unit.normal, unit.friction, strict=True)
        self._D = [A + B * mu.astype(B.dtype) for A, B in forces]
        self._lead: Array = unit.lead[0] + unit.lead[1] * mu
        self._J: Array = self._k * t.Y
        self._E = _products(self._D, self._J)
        self._E[0] += t.Y
        self._forced: Array = self._lead @ self._J
        E = [self._J.T @ A for A in self._E]
        # Motions of open elements alone meet no force.
        E[0][np.diag_indices(len(E[0]))] += NO_FORCE
        source, forced, own = self._J.T @ t.source, t.V.T @ self._forced, t.V.T @ t.own
        self.problem = SampleProblem(E, source, forced, own, model.rows)

    def square(self, z: Complex) -> Array:
        """|lambda|^2 in units of the band's end."""
        shift = self._rows.shift
        return np.asarray(np.abs(z + shift) ** 2 if self._rows.rates else np.abs(z - SIGMA))

    def left_out(self, zeros: Zeros, q: Quotient) -> Array:
        """What the whole problem adds to b' T a of each zero: r' P^-1 r of both residuals."""
        t, unit, z, a, b = self._t, self._unit, zeros.z, zeros.right, zeros.left
        eta = q.left[: t.Y.shape[1]]
        right = self._work(
            z,
            applied(self._E[:SEEN], z, q.y) - applied(t.source, z, a),
            applied(t.own, z, a) + applied(self._forced, z, q.y),
        )
        # The bodies are symmetric: own' = own.
        seen = _products([A.T for A in self._D[:SEEN]], self._J)
        seen[0] += t.Y
        source = [np.asarray(A.T @ self._J) for A in unit.source]
        met = [np.asarray(A.T @ t.V) for A in self._lead]
        left = self._work(
            z,
            applied(seen, z, eta) - applied(met, z, b),
            applied(t.own, z, b) + applied(source, z, eta),
        )
        return np.sqrt(right * left)

    def _work(self, z: Complex, motions: Complex, rest: Complex) -> Array:
        """Of missing motions against springs and bodies together, and of missing coordinates."""
        missing: NDArray[Any] = (self._root * motions).astype(np.complex64)
        stood = on_parts(lambda x: la.solve_triangular(self._stiff, x, trans="T"), missing)
        distance = np.maximum(self._t.beyond - SIGMA - self.square(z), NEAREST)
        work = la.norm(stood, axis=0) ** 2 + la.norm(rest, axis=0) ** 2 / distance
        return np.asarray(work)

    @property
    def _root(self) -> Array:
        return np.asarray(np.sqrt(self._k))

    @cached_property
    def _stiff(self) -> NDArray[Any]:
        """Factor of 1 + k^1/2 D k^1/2: of the symmetric part, whose inverse bounds the whole's."""
        D = self._D[0]
        D = (0.5 * self._root * (D + D.T) * self._root.T).astype(np.float32)
        return np.asarray(la.cholesky(np.eye(len(D), dtype=np.float32) + D, check_finite=False))


def _products(A: Sequence[NDArray[Any]], X: Array) -> list[Array]:
    """A X of some matrices, each in its own precision."""
    return [(B @ X.astype(B.dtype)).astype(float) for B in A]

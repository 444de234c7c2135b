"""Braking equilibrium on all displacements: the reference of the condensed one.

One sparse factorisation per Newton iteration, without a dense matrix of the contact elements.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult, NotConverged
from brake_fenicsx.macro.contact_forces import EnrichedGap
from brake_fenicsx.macro.equilibrium import Equilibrium, record
from brake_fenicsx.macro.newton import Newton
from brake_fenicsx.macro.solver import Factor, with_interface

Array = NDArray[np.float64]


def sparse_equilibrium(
    ops: Any,
    laws: EnrichedGap,
    mu: float | Array = 0.0,
    k0: float = 1e11,
    steps: int = 1,
    tolerance: float = 1e-10,
    max_iterations: int = 60,
) -> Equilibrium:
    """Braking equilibrium under the ramped loads by Newton's iteration on u: as the condensed one.

    Args:
        ops: anything with ``.K``, ``.N``, ``.T``, ``.w``, ``.g0`` and ``.f``
            (loads [N] on all free dofs).
        laws: law and critical gap of every element.
        mu: friction coefficient, one or one per element; 0: without friction.
        k0: stiffness of the springs that find the force the contact carries [Pa/m].
        steps: equal load steps.
        tolerance: relative residual of the last step.
        max_iterations: Newton iterations allowed in one step.

    Returns:
        The equilibrium with its displacement on all free dofs.

    Raises:
        Separated: the loads pull the bodies apart.
        NotConverged: Newton's iteration stalls, or no element is in contact on the way.
    """
    start = time.perf_counter()
    system = Sparse(ops, mu, k0)
    found = Newton(system, laws, max_iterations).ramp(steps, tolerance)
    # The last linear solve is the last full Newton step: its displacement belongs to the state.
    return record(laws, mu, found, start, system.u)


class Sparse:
    """The bodies through their stiffness matrix; see ``newton.System``."""

    def __init__(self, ops: Any, mu: float | Array, k0: float):
        """Collect the operators.

        Args:
            ops: see ``sparse_equilibrium``.
            mu: friction coefficient, one or one per element.
            k0: stiffness of the springs of ``carried`` [Pa/m].
        """
        self.K, self.N, self.w, self.g0, self.f = ops.K, ops.N, ops.w, ops.g0, ops.f
        self.k0 = k0
        self.u: Array = np.zeros_like(ops.f)
        self._sliding = bool(np.any(mu))
        # Nodal forces of a pressure: N' p + T' mu p.
        traction = sp.diags(mu * np.ones_like(self.w))
        self._push = (ops.N + traction @ ops.T).tocsr() if self._sliding else ops.N

    def carried(self) -> tuple[float, float]:
        """Force of the springs k0 under the loads [N], and k0 [Pa/m]."""
        k = np.full(self.w.shape, self.k0)
        g = self.linear(1.0, k * self.g0, k)
        return float(np.sum(self.w * k * (self.g0 - g))), self.k0

    def linear(self, load: float, a: Array, k: Array) -> Array:
        """Gaps of the system whose contact pressures are a - k g."""
        A = with_interface(self.K, self._push, self.w * k, self.N)
        b = load * self.f + self._push.T @ (self.w * (a - k * self.g0))
        try:
            factor = Factor(A, "brake_equilibrium_", symmetric=not self._sliding)
        except InaccurateResult as error:
            raise NotConverged(f"equilibrium: {error}; raise the load steps") from error
        self.u = factor.solve(b)
        factor.destroy()
        return np.asarray(self.g0 + self.N @ self.u)

    def norm(self, pressure: Array) -> float:
        """Euclidean norm of the nodal forces of some pressures."""
        return float(np.linalg.norm(self._push.T @ (self.w * pressure)))

"""Braking equilibrium with enriched contact and friction, condensed on the contact elements.

    K u = f + N'W p(g) + mu T'W p(g),   g = g0 + N u,

with q = p + k0 (g - g0):  u = K0^-1 (f + N'W q + mu T'W p), so that g alone is unknown. Newton's
step in g is the step of the full system.
"""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from brake_fenicsx.errors import NotConverged

from .condensation import Compliance
from .friction import friction_traction
from .gap import EnrichedGap
from .newton import Newton, State

Array = NDArray[np.float64]

# Halvings of the friction coefficient that find its limit, to one part in a hundred.
BISECTIONS = 7

# Steps of iterative refinement before double precision takes over.
REFINEMENTS = 12


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """Equilibrium of the contact elements.

    Attributes:
        g: gaps [m], shape (elements,).
        p: pressures [Pa].
        k: stiffnesses -dp/dg of loading [Pa/m].
        k_vibration: stiffnesses of small vibrations about the equilibrium [Pa/m]: ``k`` where
            no contact has yielded.
        mu: friction coefficient of the equilibrium, one or one per element (0: solved without
            friction).
        iterations: Newton iterations of each load step.
        residual: norm of the full residual relative to the contact forces, both in the norm of
            the interface compliance (condensed) or Euclidean (sparse).
        history: residuals of the last load step, one per iteration.
        seconds: time [s].
        u: displacement on all free dofs [m], where it was asked for.
    """

    g: Array
    p: Array
    k: Array
    k_vibration: Array
    mu: float | Array
    iterations: tuple[int, ...]
    residual: float
    history: tuple[float, ...]
    seconds: float
    u: Array | None = None


def equilibrium(
    ops: Any,
    laws: EnrichedGap,
    mu: float | Array = 0.0,
    steps: int = 1,
    tolerance: float = 1e-10,
    max_iterations: int = 60,
) -> Equilibrium:
    """Balance of virtual work of contact and solids under the ramped loads, Eq. (11).

    Args:
        ops: anything with ``.w`` [m^2], ``.g0`` [m] and ``.compliance`` (Compliance).
        laws: law and critical gap of every element.
        mu: friction coefficient, one or one per element; 0 solves without friction, as section 2
            of the source does.
        steps: equal load steps.
        tolerance: relative residual of the last step.
        max_iterations: Newton iterations allowed in one step.

    Returns:
        The equilibrium with its residual.

    Raises:
        Separated: the loads pull the bodies apart.
        NotConverged: Newton's iteration stalls.
    """
    start = time.perf_counter()
    system = Condensed(ops.compliance, ops.w, ops.g0, mu)
    found = Newton(system, laws, max_iterations).ramp(steps, tolerance)
    return record(laws, mu, found, start)


def limit_of_friction(
    ops: Any, laws: EnrichedGap, mu: float | Array, steps: int, error: NotConverged
) -> NotConverged:
    """The error of a failed equilibrium, with the friction up to which there is one.

    Args:
        ops: as in ``equilibrium``.
        laws: law and critical gap of every element.
        mu: friction coefficient at which none was found, one or one per element.
        steps: equal load steps.
        error: how the equilibrium failed.

    Returns:
        The same error where friction is not the cause.
    """

    def found(share: float) -> bool:
        try:
            equilibrium(ops, laws, share * np.asarray(mu), steps)
        except NotConverged:
            return False
        return True

    largest = float(np.max(np.abs(mu)))
    # Without friction it must be found: else another cause made it fail.
    if largest == 0.0 or not found(0.0):
        return error
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if found(middle) else (low, middle)
    return NotConverged(
        f"equilibrium: none was found at a friction coefficient of {largest:.3g}, but up to"
        f" {low * largest:.3g} there is one: more friction tips or locks a part; lower the"
        " friction, or change supports or loads"
    )


def record(
    laws: EnrichedGap,
    mu: float | Array,
    found: tuple[State, list[int], list[float]],
    start: float,
    u: Array | None = None,
) -> Equilibrium:
    """What a ramp found, as an equilibrium; the clock was started at ``start`` [s]."""
    (g, _), counts, history = found
    return Equilibrium(
        g, laws.pressure(g), laws.stiffness(g), laws.vibration(g), mu, tuple(counts), history[-1],
        tuple(history), time.perf_counter() - start, u,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Jacobian:
    """1 + NN diag(n) + NT diag(t), solved by single-precision factors and refinement.

    Attributes:
        NN: compliance [m/N], shape (elements, elements).
        NT: the same from slip to gap.
        n: stiffness [N/m], shape (elements,).
        t: the same for the friction forces; None without friction.
    """

    NN: Array
    NT: Array
    n: Array
    t: Array | None

    def times(self, x: Array) -> Array:
        """Product with a vector."""
        y = x + self.NN @ (self.n * x)
        return np.asarray(y if self.t is None else y + self.NT @ (self.t * x))

    def solve(self, b: Array) -> Array:
        """Solution to double precision.

        Raises:
            NotConverged: the matrix is singular.
        """
        try:
            with warnings.catch_warnings():
                # Nearly all elements open: the line search judges what the step is worth.
                warnings.simplefilter("ignore", la.LinAlgWarning)
                x = self._refined(b)
                return x if x is not None else la.solve(self._matrix(float), b, overwrite_a=True)
        except (la.LinAlgError, ValueError) as error:
            raise NotConverged(
                "equilibrium: all contact elements open during the iteration; raise the load steps"
            ) from error

    def _refined(self, b: Array) -> Array | None:
        """Solution by refinement; None where single precision is not enough of a start."""
        lu = la.lu_factor(self._matrix(np.float32), overwrite_a=True, check_finite=False)
        x, last = np.zeros_like(b), np.inf
        for _ in range(REFINEMENTS):
            r = b - self.times(x)
            dx = la.lu_solve(lu, r.astype(np.float32), check_finite=False).astype(float)
            size = float(np.linalg.norm(dx))
            x = x + dx
            if size <= 1e-15 * np.linalg.norm(x):
                return x
            if not size < 0.5 * last:
                # Round-off of the residual, or no convergence at all.
                return x if last <= 1e-13 * np.linalg.norm(x) else None
            last = size
        return None

    def _matrix(self, kind: type) -> Array:
        J = np.multiply(self.NN, self.n, dtype=kind, casting="same_kind")
        if self.t is not None:
            J += np.multiply(self.NT, self.t, dtype=kind, casting="same_kind")
        J[np.diag_indices_from(J)] += 1.0
        return J


@dataclass(frozen=True, slots=True)
class Condensed:
    """The bodies through the compliance of their contact elements; see ``newton.System``.

    Attributes:
        compliance: the bodies seen from the contact elements.
        w: areas [m^2], shape (elements,).
        g0: gaps of the undeformed bodies [m].
        mu: friction coefficient, one or one per element.
    """

    compliance: Compliance
    w: Array
    g0: Array
    mu: float | Array

    def carried(self) -> tuple[float, float]:
        """Force of the springs k0 under the loads [N], and their mean [Pa/m]."""
        c = self.compliance
        return -float(np.sum(self.w * c.k0 * c.Nf)), float(c.k0.mean())

    def linear(self, load: float, a: Array, k: Array) -> Array:
        """Gaps of the system whose contact pressures are a - k g."""
        c, k0 = self.compliance, self.compliance.k0
        rhs = self.g0 + load * c.Nf + c.NN @ (self.w * (a - k0 * self.g0))
        wf = friction_traction(self.w, self.mu) if np.any(self.mu) else None
        if wf is not None:
            rhs = rhs + c.NT @ (wf * a)
        return self._jacobian(k).solve(np.asarray(rhs, float))

    def _jacobian(self, k: Array) -> Jacobian:
        """Derivative of the gaps' equation where contact has the stiffness k."""
        c = self.compliance
        t = friction_traction(self.w, self.mu) * k if np.any(self.mu) else None
        return Jacobian(c.NN, c.NT, self.w * (k - c.k0), t)

    def norm(self, pressure: Array) -> float:
        """Norm of the forces of some pressures, weighted with the compliance."""
        force = self.w * pressure
        return float(np.sqrt(abs(force @ self.compliance.NN @ force)))


def displacement(ops: Any, eq: Equilibrium, f: Array) -> Array:
    """Displacement u_e of an equilibrium [m], on all free dofs.

    Args:
        ops: anything with ``.N``, ``.T``, ``.w``, ``.g0`` and ``.compliance``.
        eq: the equilibrium.
        f: loads [N], all free dofs.

    Returns:
        Shape (free dofs,).
    """
    q = eq.p + ops.compliance.k0 * (eq.g - ops.g0)
    traction = friction_traction(eq.p, eq.mu)
    return ops.compliance.solve(f + ops.N.T @ (ops.w * q) + ops.T.T @ (ops.w * traction))

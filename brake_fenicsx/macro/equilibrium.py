"""Braking equilibrium with enriched contact and friction, condensed on the contact elements.

    K u = f + N'W p(g) + mu T'W p(g),   g = g0 + N u,

with q = p + k0 (g - g0):  u = K0^-1 (f + N'W q + mu T'W p), so that g alone is unknown. Newton's
step in g is the step of the full system. The state between two steps is known through the
linearised pressures t, and the residual of the full system is (N + mu T)'W (t - p(g)): the line
search and the stopping rule cost a product with a small dense matrix, no solve.
"""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from brake_fenicsx.errors import NotConverged, Separated

from .condensation import Compliance
from .friction import friction_traction
from .gap import EnrichedGap

Array = NDArray[np.float64]

# Springs that hold open elements far from equilibrium, over the stiffness of the interface.
HOLD = 0.03


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """Equilibrium of the contact elements.

    Attributes:
        g: gaps [m], shape (elements,).
        p: pressures [Pa].
        k: stiffnesses -dp/dg [Pa/m].
        mu: friction coefficient of the equilibrium (0: solved without friction).
        iterations: Newton iterations of each load step.
        residual: norm of the full residual relative to the contact forces, both in the norm of
            the interface compliance.
        history: residuals of the last load step, one per iteration.
        seconds: time [s].
        u: displacement on all free dofs [m], where it was asked for.
    """

    g: Array
    p: Array
    k: Array
    mu: float
    iterations: tuple[int, ...]
    residual: float
    history: tuple[float, ...]
    seconds: float
    u: Array | None = None


def equilibrium(
    ops: Any,
    laws: EnrichedGap,
    mu: float = 0.0,
    steps: int = 1,
    tolerance: float = 1e-10,
    max_iterations: int = 60,
) -> Equilibrium:
    """Braking equilibrium under the ramped loads, Eq. (9).

    Args:
        ops: anything with ``.w`` [m^2], ``.g0`` [m] and ``.compliance`` (Compliance).
        laws: law and critical gap of every element.
        mu: friction coefficient; 0 solves without friction, as Eq. (9) of the source does.
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
    problem = _Condensed(ops.compliance, ops.w, ops.g0, laws, mu)
    counts: list[int] = []
    state, spring = problem.first_state(1.0 / steps)
    problem = replace(problem, hold=HOLD * spring)
    for step in range(1, steps + 1):
        last = step == steps
        state, history = problem.newton(
            state, step / steps, tolerance if last else 1e-3, max_iterations
        )
        counts.append(len(history) - 1)
    g, _ = state
    return Equilibrium(
        g, laws.pressure(g), laws.stiffness(g), mu, tuple(counts), history[-1], tuple(history),
        time.perf_counter() - start,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Condensed:
    """The condensed system; a state is (g, t): gaps and the pressures that belong to them."""

    compliance: Compliance
    w: Array
    g0: Array
    laws: EnrichedGap
    mu: float
    hold: float = 0.0

    def first_state(self, load: float) -> tuple[tuple[Array, Array], float]:
        """Linear springs carry the first load; their common level is where the laws agree.

        They are as stiff as the laws are there: softer ones let friction tilt a body without
        bound. A common shift of a floating body costs nothing: it starts at first touch.
        """
        level, carried = self._balanced_level(load)
        ones = np.ones(len(self.w))
        mean = float(np.sum(self.w * self.laws.stiffness(level * ones)) / np.sum(self.w))
        k = (mean if mean > 0 else float(self.compliance.k0.mean())) * ones
        free_of_load = level + carried / np.sum(self.w * k)
        g = self._linear(load, k * free_of_load, k)
        # Secant stiffness of the interface: its mean pressure over the scatter of first touch.
        scatter = float(self.laws.first_touch().std())
        secant = carried / float(np.sum(self.w)) / max(scatter, 1e-12)
        return (g, k * (free_of_load - g)), min(0.1 * float(k[0]), secant)

    def _balanced_level(self, load: float) -> tuple[float, float]:
        """Common gap at which the laws carry what the contact must carry, and that force."""
        c, k0 = self.compliance, self.compliance.k0
        carried = -float(np.sum(self.w * k0 * c.Nf)) * load
        first = float(self.laws.first_touch().max())
        if carried <= 0:
            raise Separated("equilibrium: the loads do not press the contact faces together")
        low, high = first - 1e-9, first
        ones = np.ones(len(self.w))
        for _ in range(200):
            if np.sum(self.w * self.laws.pressure(low * ones)) >= carried:
                break
            low = high - 2 * (high - low)
        for _ in range(60):
            middle = 0.5 * (low + high)
            enough = np.sum(self.w * self.laws.pressure(middle * ones)) >= carried
            low, high = (middle, high) if enough else (low, middle)
        return low, carried

    def newton(
        self, state: tuple[Array, Array], load: float, tolerance: float, most: int
    ) -> tuple[tuple[Array, Array], list[float]]:
        """Newton's iteration with line search at one load."""
        with np.errstate(over="ignore", invalid="ignore"):
            return self._newton(state, load, tolerance, most)

    def _newton(
        self, state: tuple[Array, Array], load: float, tolerance: float, most: int
    ) -> tuple[tuple[Array, Array], list[float]]:
        g, t = state
        history = [self._residual(g, t) if load == 1.0 else np.inf]
        for _ in range(most):
            g_new, t_new = self._step(g, load, history[-1])
            s = self._line_search(g, t, g_new - g, t_new - t)
            g, t = g + s * (g_new - g), t + s * (t_new - t)
            history.append(self._residual(g, t))
            if np.isnan(history[-1]):
                break
            # Only a full step moves the loads of the state to the present ones.
            if history[-1] < tolerance and s == 1.0:
                return (g, t), history
        raise NotConverged(
            f"equilibrium: Newton's iteration stands at residual {history[-1]:.2e} after"
            f" {len(history) - 1} iterations, wanted {tolerance:.0e}; raise the load steps"
        )

    def _step(self, g: Array, load: float, residual: float) -> tuple[Array, Array]:
        """Solve the system linearised at g: t = p - k (g_new - g).

        Far from equilibrium weak springs hold what no element holds yet; they fade with the
        residual, so that the last steps are Newton's.
        """
        p, k = self.laws.pressure(g), self.laws.stiffness(g)
        k = k + self.hold * min(residual, 1.0)
        g_new = self._linear(load, p + k * g, k)
        return g_new, p - k * (g_new - g)

    def _linear(self, load: float, a: Array, k: Array) -> Array:
        """Gaps of the system whose contact pressures are a - k g."""
        c, k0 = self.compliance, self.compliance.k0
        J = c.NN * (-self.w * (k0 - k))
        rhs = self.g0 + load * c.Nf + c.NN @ (self.w * (a - k0 * self.g0))
        if self.mu:
            wf = friction_traction(self.w, self.mu)
            J += c.NT * (wf * k)
            rhs = rhs + c.NT @ (wf * a)
        J[np.diag_indices_from(J)] += 1.0
        try:
            with warnings.catch_warnings():
                # Nearly all elements open: the line search judges what the step is worth.
                warnings.simplefilter("ignore", la.LinAlgWarning)
                return np.asarray(la.solve(J, rhs, overwrite_a=True, check_finite=False))
        except la.LinAlgError as error:
            raise NotConverged(
                "equilibrium: no element is in contact on the way; raise the load steps"
            ) from error

    def _line_search(self, g: Array, t: Array, dg: Array, dt: Array) -> float:
        """Step at which the work of the residual along the direction has dropped enough."""

        def work(s: float) -> float:
            return float(np.sum(self.w * (t + s * dt - self.laws.pressure(g + s * dg)) * dg))

        low, high, f_low = 0.0, 1.0, work(0.0)
        at_zero, f_high = f_low, work(1.0)
        while not np.isfinite(f_high) and high > 1e-6:
            high *= 0.5
            f_high = work(high)
        if abs(f_high) <= 0.8 * abs(at_zero) or at_zero == 0.0 or f_high * at_zero > 0:
            return high
        for _ in range(30):
            s = 0.5 * (low + high) if _ % 3 == 2 else low - f_low * (high - low) / (f_high - f_low)
            value = work(s)
            if abs(value) <= 0.3 * abs(at_zero):
                break
            if value * f_low > 0:
                low, f_low = s, value
            else:
                high, f_high = s, value
        return float(s)

    def _residual(self, g: Array, t: Array) -> float:
        """Norm of the full residual over the norm of the contact forces."""
        p = self.laws.pressure(g)
        error, force = self.w * (t - p), self.w * p
        size = force @ self.compliance.NN @ force
        return (
            float(np.sqrt(abs(error @ self.compliance.NN @ error) / size)) if size > 0 else np.inf
        )


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
    return ops.compliance.factor.solve(f + ops.N.T @ (ops.w * q) + ops.T.T @ (ops.w * traction))

"""Newton's iteration for contact with enriched laws, on whatever solves the linearised system.

A state is (g, t): the gaps and the pressures t that hold the bodies there; at equilibrium
t = p(g). The residual of the full system is (N + mu T)'W (t - p(g)): the line search and the
stopping rule need no solve.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import NotConverged, Separated

from .contact_forces import EnrichedGap

State = tuple[Array, Array]

# Springs that hold open elements far from equilibrium, over the stiffness of the interface.
HOLD = 0.03
# Gaps of an equilibrium differ by less than this multiple of the width of the contact; those of a
# singular matrix by 1e8 times and more.
TILT = 100.0
# Iterations before these springs are taken away; contact that needs them is found in fewer.
PATIENCE = 20
# Round-offs of a gap that a residual may hold.
ROUNDINGS = 8.0
# Work of the residual below this share of the pressures' is round-off: the full step is taken.
ROUND_OFF = 1e-13


class System(Protocol):
    """The bodies between loads and contact elements."""

    @property
    def w(self) -> Array:
        """Areas of the contact elements [m^2]."""

    @property
    def g0(self) -> Array:
        """Gaps of the undeformed bodies [m]."""

    def linear(self, load: float, a: Array, k: Array) -> Array:
        """Gaps [m] under a share of the loads when the contact pressures are a - k g."""

    def carried(self) -> tuple[float, float]:
        """Force [N] that the contact carries under the full loads, and a stiffness [Pa/m]."""

    def norm(self, pressure: Array) -> float:
        """Norm of the nodal forces of some contact pressures."""


@dataclass(frozen=True, slots=True)
class Newton:
    """Newton's iteration with line search, for one set of laws.

    Attributes:
        system: the bodies.
        laws: law and critical gap of every element.
        most: iterations allowed at one load.
    """

    system: System
    laws: EnrichedGap
    most: int

    def ramp(self, steps: int, tolerance: float) -> tuple[State, list[int], list[float]]:
        """Equilibrium under loads that grow in equal steps.

        Args:
            steps: number of load steps.
            tolerance: relative residual of the last step.

        Returns:
            The state, iterations of each step, residuals of the last one.

        Raises:
            Separated: the loads pull the bodies apart.
            NotConverged: the iteration stalls.
        """
        state, hold = self._first_state(1.0 / steps)
        counts, history = [], [np.inf]
        for step in range(1, steps + 1):
            wanted = tolerance if step == steps else 1e-3
            with np.errstate(over="ignore", invalid="ignore"):
                state, history = self._iterate(state, step / steps, wanted, hold)
            counts.append(len(history) - 1)
        return state, counts, history

    def at_once(self, g: Array, tolerance: float) -> tuple[State, list[int], list[float]]:
        """Equilibrium under the full loads from the gaps of one nearby [m]; else as ``ramp``."""
        with np.errstate(over="ignore", invalid="ignore"):
            state, history = self._iterate((g, self.laws.pressure(g)), 1.0, tolerance, 0.0)
        return state, [len(history) - 1], history

    def _first_state(self, load: float) -> tuple[State, float]:
        """Linear springs carry the first load; their common level is where the laws agree.

        They are as stiff as the laws are there: softer ones let friction tilt a body without
        bound. A common shift of a floating body costs nothing: it starts at first touch.
        """
        w, laws = self.system.w, self.laws
        level, carried, usual = self._balanced_level(load)
        ones = np.ones(len(w))
        mean = float(np.sum(w * laws.stiffness(level * ones)) / np.sum(w))
        k = (mean if mean > 0 else usual) * ones
        free_of_load = level + carried / np.sum(w * k)
        g = self.system.linear(load, k * free_of_load, k)
        # Secant stiffness of the interface: its mean pressure over the scatter of the ways that the
        # elements have to first touch, of rough laws as of curved faces.
        scatter = float((laws.first_touch() - self.system.g0).std())
        secant = carried / float(np.sum(w)) / max(scatter, 1e-12)
        return (g, k * (free_of_load - g)), HOLD * min(0.1 * float(k[0]), secant)

    def _balanced_level(self, load: float) -> tuple[float, float, float]:
        """Common gap at which the laws carry what the contact must carry, and that force."""
        w, laws = self.system.w, self.laws
        force, usual = self.system.carried()
        carried = force * load
        if carried <= 0:
            raise Separated("equilibrium: the loads do not press the contact faces together")
        first = float(laws.first_touch().max())
        low, high = first - 1e-9, first
        ones = np.ones(len(w))
        for _ in range(200):
            if np.sum(w * laws.pressure(low * ones)) >= carried:
                break
            low = high - 2 * (high - low)
        # It is a start: no digit of the equilibrium depends on its last ones.
        for _ in range(20):
            middle = 0.5 * (low + high)
            enough = np.sum(w * laws.pressure(middle * ones)) >= carried
            low, high = (middle, high) if enough else (low, middle)
        return low, carried, usual

    def _iterate(
        self, state: State, load: float, tolerance: float, hold: float
    ) -> tuple[State, list[float]]:
        """Newton's iteration at one load."""
        g, t = state
        p, k = self.laws.loading(g)
        history = [self._residual(t, p) if hold and load == 1.0 else np.inf]
        for i in range(self.most):
            # Far from equilibrium weak springs hold what no element holds yet; they fade with
            # the residual, so that the last steps are Newton's. Beside a stiff penalty they too are
            # stiffer than the bodies and let an element open by a small part of its way in each
            # step: after a while they are halved every time.
            k = k + hold * min(history[-1], 0.5 ** max(i - PATIENCE, 0))
            # The pressures t are those of the very system that was solved: from p - k (g_new - g)
            # round-off of a gap of metres, where a part has come loose, would make any state one.
            a = p + k * g
            g_new = self.system.linear(load, a, k)
            t_new = a - k * g_new
            s, p, k = self._line_search(g, t, p, g_new - g, t_new - t)
            g, t = g + s * (g_new - g), t + s * (t_new - t)
            history.append(self._residual(t, p))
            if np.isnan(history[-1]):
                break
            # Only a full step moves the loads of the state to the present ones.
            if s == 1.0 and history[-1] < max(tolerance, self._reachable(history, g, p, k)):
                self._check_tilt(g)
                return (g, t), history
        raise NotConverged(f"""equilibrium: not converged after {len(history) - 1} iterations
            (residual {history[-1]:.2e}, {tolerance:.0e} needed); check supports and loads, then
            raise the load steps""")

    def _reachable(self, history: list[float], g: Array, p: Array, k: Array) -> float:
        """Residual that round-off of the gaps and pressures leaves, once steps gain nothing."""
        if not history[-1] > 0.5 * history[-2]:
            return 0.0
        gaps = np.abs(g) + np.abs(self.laws.g_cr) + np.abs(self.system.g0)
        size = self.system.norm(p)
        noise = np.finfo(float).eps * (np.abs(p) + k * gaps)
        return ROUNDINGS * self.system.norm(noise) / size if size > 0 else 0.0

    def _check_tilt(self, g: Array) -> None:
        """Whether the bodies tilt by an angle that linear kinematics can mean.

        The matrix of a part that tips is singular to round-off, and its residual small all the
        same: the pressures balance the loads to the round-off of gaps of any size.

        Raises:
            NotConverged: gaps open by many times the width of the contact.
        """
        opening, width = g - self.system.g0, float(np.sqrt(np.sum(self.system.w)))
        if (spread := float(np.ptp(opening))) > TILT * width:
            raise NotConverged(f"""equilibrium: a part tips or comes loose, gaps of the contact
                differ by {spread:.2g} m; lower the friction, or change supports or loads""")

    def _line_search(
        self, g: Array, t: Array, p: Array, dg: Array, dt: Array
    ) -> tuple[float, Array, Array]:
        """Step at which the work of the residual along it has dropped enough, and p and k there."""
        w, loading = self.system.w, [(p, p)]

        def work(s: float) -> float:
            loading[0] = self.laws.loading(g + s * dg) if s else loading[0]
            return float(np.sum(w * (t + s * dt - loading[0][0]) * dg))

        low, high, f_low = 0.0, 1.0, work(0.0)
        at_zero, f_high = f_low, work(1.0)
        while not np.isfinite(f_high) and high > 1e-6:
            high *= 0.5
            f_high = work(high)
        small = ROUND_OFF * float(np.sum(w * np.abs(t * dg)))
        enough = abs(f_high) <= max(0.8 * abs(at_zero), small)
        if enough or at_zero == 0.0 or f_high * at_zero > 0:
            return high, *loading[0]
        for i in range(30):
            s = 0.5 * (low + high) if i % 3 == 2 else low - f_low * (high - low) / (f_high - f_low)
            value = work(s)
            if abs(value) <= 0.3 * abs(at_zero):
                break
            if value * f_low > 0:
                low, f_low = s, value
            else:
                high, f_high = s, value
        return float(s), *loading[0]

    def _residual(self, t: Array, p: Array) -> float:
        """Norm of the full residual over the norm of the contact forces."""
        size = self.system.norm(p)
        return self.system.norm(t - p) / size if size > 0 else np.inf

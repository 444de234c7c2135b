"""Growth of a mode over its amplitude, and the limit cycles where it is zero.

The branch alpha(a) is followed from the linear mode by pseudo-arclength (Keller 1977), so that it
may turn back. Where alpha falls through zero on the way, a cycle is stable along its branch; where
it rises, vibrations beyond it grow: a mode that is linearly stable then grows from a kick.
Without damping alpha ends at zero, where the mode parts into two that do not grow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import trapezoid

from brake_fenicsx.errors import NotConverged

from .harmonic_balance import Change, Condition, HarmonicBalance, Vibration

Array = NDArray[np.float64]

# First, largest and smallest step along the branch, in logarithms of the amplitude.
FIRST, LARGEST, SMALLEST, POINTS = 0.4, 0.8, 1e-3, 60

# Share of the linear growth at which growth without damping counts as ended: alpha^2 falls
# linearly in the amplitude there, and the amplitude is off by the square of this share.
ENDED = 0.02

# Behind a stable cycle the branch is followed until decay is this share of the linear growth, or
# until the amplitude has changed by these factors.
DECAYS, BELOW, BEYOND = 0.5, 0.7, 2.0

# Tolerance of the points between the cycles.
ROUGHLY = 1e-6

STABLE, UNSTABLE, UNDAMPED = "stable", "unstable", "undamped"


@dataclass(frozen=True, slots=True)
class Cycle:
    """A limit cycle.

    Attributes:
        kind: "stable", "unstable", or "undamped": where growth without damping ends, and nothing
            settles.
        at: the vibration.
    """

    kind: str
    at: Vibration


@dataclass(slots=True)
class Branch:
    """Growth over amplitude.

    Attributes:
        amplitude: of the points [m], shape (points,).
        s: alpha + i omega there [1/s].
        cycles: in the order of the branch.
        end: why it ends.
    """

    amplitude: list[float] = field(default_factory=list)
    s: list[complex] = field(default_factory=list)
    cycles: list[Cycle] = field(default_factory=list)
    end: str = ""


def follow(
    problem: HarmonicBalance,
    start: Vibration,
    largest: float,
    damped: bool = True,
    seen: Callable[[Vibration], None] = lambda found: None,
) -> Branch:
    """Follow a mode from a small amplitude on.

    Args:
        problem: its equations.
        start: a vibration along the linear mode.
        largest: amplitude at which to end [m].
        damped: whether anything is damped.
        seen: called with every vibration of the branch.

    Raises:
        NotConverged: not even the first vibration is found.
    """
    branch, size = Branch(), max(abs(start.s.real), 1e-3 * start.s.imag)
    p, along, _ = problem.solve(start, _at_amplitude(start.amplitude), ROUGHLY)
    direction, step, low, high = np.array([1.0, 0.0]), FIRST, 0.0, largest
    while True:
        branch.amplitude.append(p.amplitude)
        branch.s.append(p.s)
        seen(p)
        if (low and p.s.real < -DECAYS * abs(start.s.real)) or not low < p.amplitude < high:
            branch.end = "stable" if low else "largest amplitude"
            return branch
        if len(branch.s) == POINTS:
            branch.end = "too many points"
            return branch
        if not damped and p.s.real <= ENDED * start.s.real:
            branch.cycles.append(Cycle(UNDAMPED, p))
            branch.end = "no growth"
            return branch
        direction = _tangent(p, along, size, direction)
        found = None
        while found is None:
            guess = p.moved(along, direction[0] * p.amplitude * step)
            try:
                found = problem.solve(guess, _at_distance(p, direction, size, step), ROUGHLY)
            except NotConverged:
                step *= 0.4
                if step < SMALLEST:
                    branch.end = "lost"
                    return branch
        q, along, iterations = found
        if damped and (p.s.real > 0) != (q.s.real > 0):
            cycle = _crossing(problem, p, q)
            branch.cycles.append(cycle)
            if cycle.kind == STABLE:
                low, high = BELOW * cycle.at.amplitude, min(largest, BEYOND * cycle.at.amplitude)
        p, step = q, min(LARGEST, step * (1.5 if iterations <= 5 else 0.8))


def time_to_reach(branch: Branch, cycle: Cycle, share: float = 0.01) -> float:
    """Time from a share of a cycle's amplitude to 95 % of it [s]; nan where growth is not positive.

    Args:
        branch: growth over amplitude.
        cycle: the first one that growth ends at.
        share: of its amplitude at the start; below the first point growth is that of the point.
    """
    a, alpha = np.array(branch.amplitude), np.real(branch.s)
    inside = a < cycle.at.amplitude
    a, alpha = np.r_[a[inside], cycle.at.amplitude], np.r_[alpha[inside], cycle.at.s.real]
    x = np.linspace(np.log(share), np.log(0.95), 200) + np.log(cycle.at.amplitude)
    growth = np.interp(x, np.log(a), alpha)
    if np.any(np.diff(a) <= 0) or np.any(growth <= 0):
        return float("nan")
    return float(trapezoid(1 / growth, x))


def _at_amplitude(amplitude: float) -> Condition:
    return lambda v: (v.amplitude - amplitude, 0.0, 1.0)


def _tangent(p: Vibration, along: Change, size: float, before: Array) -> Array:
    """Direction of the branch in (ln a, alpha / size), on from the one before."""
    d = np.array([1 / p.amplitude, along.s.real / size])
    return np.asarray(d / np.linalg.norm(d) * (1.0 if d @ before >= 0 else -1.0))


def _at_distance(p: Vibration, direction: Array, size: float, step: float) -> Condition:
    """A step away from p along the branch."""
    to_amplitude, to_alpha = direction[0] / p.amplitude, direction[1] / size

    def condition(v: Vibration) -> tuple[float, float, float]:
        away = to_amplitude * (v.amplitude - p.amplitude) + to_alpha * (v.s.real - p.s.real)
        return away - step, to_alpha, to_amplitude

    return condition


def _crossing(problem: HarmonicBalance, p: Vibration, q: Vibration) -> Cycle:
    """The cycle between two vibrations of which one grows and one decays."""
    share = p.s.real / (p.s.real - q.s.real)
    between = Change(q.a - p.a, q.y - p.y, q.s - p.s, q.amplitude - p.amplitude)
    found, _, _ = problem.solve(p.moved(between, share), lambda v: (v.s.real, 1.0, 0.0))
    return Cycle(STABLE if p.s.real > 0 else UNSTABLE, found)

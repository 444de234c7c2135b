"""Where modes merge, split and begin to squeal: values of the parameter to a wanted accuracy.

Of two modes d = (lambda_1 - lambda_2)^2 is an analytic function of the parameter, through the
point where they merge too (T. Kato, Perturbation Theory for Linear Operators, 1980, chapter II;
a defective eigenvalue: A. P. Seyranian and A. A. Mailybaev, Multiparameter Stability Theory, 2003).
Without damping d is real and changes its sign there, and an unstable pair has the growth rate
sqrt(d) / 2: lock-in, and the onset of squeal with a threshold too, are simple zeros of smooth
functions. With damping d has its zero at a complex value of the parameter, next to which the pair
passes; a mode then begins to squeal where its own damping passes the threshold.

Over many samples, each family of modes begins to squeal at a critical value. A sample that squeals
at the first value has its critical value at or before it, and one that never squeals beyond the
last: the distribution is known between these, as for times of failure that are censored on both
sides at common values. Probabilities have Wilson's intervals; the interval of a quantile is that of
order statistics, which holds for any distribution (H. A. David and H. N. Nagaraja, Order
Statistics, 2003, section 7.1).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import brentq
from scipy.stats import binom

from brake_fenicsx.arguments import Array, Complex
from brake_fenicsx.results.ensemble_statistics import Proportion, wilson

from .branches import Branch, Followed, Solve
from .matching import State, conjugate_pair, group_likeness, squared_distance

MERGING, SPLITTING = "merging", "splitting"
ONSET, END = "onset of squeal", "end of squeal"
FROM_FIRST = "squeals from the first value"
JUMP = "jump"

# A root is looked for by polynomials through so many points, so many times.
POINTS, SMOOTH = 4, 6

# Modes among which a pair is looked for, by its likeness with the pair it was before.
AROUND = 8


@dataclass(frozen=True, slots=True)
class Event:
    """A merging, a splitting, an onset or an end of squeal.

    Attributes:
        kind: which of these.
        x: value of the parameter.
        error: accuracy of the value.
        s: eigenvalue there [1/s].
        branches: the two branches that merge; one of a mode that begins to squeal, and -1.
        vector: right vector there, shape (m,).
    """

    kind: str
    x: float
    error: float
    s: complex
    branches: tuple[int, int]
    vector: Complex = field(repr=False)


def find_events(
    followed: Followed, solve: Solve, threshold: float, tolerance: float, onsets_alone: bool = False
) -> list[Event]:
    """All events of some followed branches, in the order of their values.

    Args:
        followed: the branches.
        solve: gives the modes at a value of the parameter.
        threshold: a mode squeals where -2 alpha / |omega| lies below minus this.
        tolerance: wanted accuracy of the value, relative to the whole range.
        onsets_alone: whether only the first onset of each branch is wanted.
    """
    first, last = followed.states[0].x, followed.states[-1].x
    width = tolerance * abs(last - first)
    found = []
    for branch in followed.branches:
        found += _crossings(followed, solve, branch, threshold, width, onsets_alone)
    if not onsets_alone:
        for kind, events in ((MERGING, followed.merged), (SPLITTING, followed.split)):
            found += [_merging(followed, solve, kind, at, (i, j), width) for at, i, j in events]
        found += [_jump(followed, number) for number in followed.jumps]
    sign = 1.0 if last >= first else -1.0
    return sorted(found, key=lambda e: sign * e.x)


def _merging(
    followed: Followed, solve: Solve, kind: str, state: int, pair: tuple[int, int], width: float
) -> Event:
    """Root of d between two states."""
    a, b = followed.states[state], followed.states[state + 1]
    search = _Search(followed, solve, pair, state)
    start = squared_distance(a, _modes(followed, pair, state))
    start = start or -squared_distance(b, _modes(followed, pair, state + 1))
    x, error = search.root(lambda s, *at: (squared_distance(s, at) / start).real, a.x, b.x, width)
    there, (i, j) = search.at(x)
    mean = 0.5 * (there.s[i] + there.s[j])
    return Event(kind, x, error, complex(mean), pair, there.right[:, i])


def _jump(followed: Followed, number: int) -> Event:
    """Modes change at once between two states; no branch is named, and no vector."""
    a, b = followed.states[number - 1], followed.states[number]
    none = np.zeros(len(b.right), complex)
    return Event(JUMP, b.x, abs(b.x - a.x), complex("nan"), (-1, -1), none)


def _modes(followed: Followed, pair: tuple[int, int], state: int) -> tuple[int, int]:
    one, two = (followed.at(followed.branches[n], state) for n in pair)
    return one, two


def _crossings(
    followed: Followed, solve: Solve, branch: Branch, threshold: float, width: float,
    first_alone: bool,
) -> list[Event]:  # fmt: skip
    """Where a branch begins and ends to squeal, or where it first begins."""
    events = []
    loud = [_squeals(followed, branch, n, threshold) for n in branch.states]
    if loud[0] and branch.states[0] == 0:
        first, mode = followed.states[0], branch.modes[0]
        s, vector = complex(first.s[mode]), first.right[:, mode]
        events.append(Event(FROM_FIRST, first.x, 0.0, s, (branch.number, -1), vector))
    for n in range(len(loud) - 1):
        if first_alone and events:
            break
        if loud[n] == loud[n + 1] or (first_alone and loud[n]):
            continue
        state = branch.states[n]
        kind = ONSET if loud[n + 1] else END
        events.append(_crossing(followed, solve, branch, state, kind, threshold, width))
    return events


def _squeals(followed: Followed, branch: Branch, state: int, threshold: float) -> bool:
    s, mode = followed.states[state], followed.at(branch, state)
    return bool(s.verdict[mode] == "unstable" and s.damping[mode] < -threshold)


def _crossing(
    followed: Followed, solve: Solve, branch: Branch, state: int, kind: str, threshold: float,
    width: float,
) -> Event:  # fmt: skip
    """Where the damping of a branch passes the threshold between two states."""
    a, b = followed.states[state], followed.states[state + 1]
    mate = _mate(followed, branch, state)
    if mate is None:
        # One mode has no continuation through a merging; the faster growing one of both has.
        group = _turning(followed, branch, state) or (branch.number,)

        def value(s: State, *modes: int) -> float:
            return float(s.damping[list(modes)].min() + threshold)

    else:
        # Of an undamped pair d grows smoothly from below zero to (threshold |omega|)^2.
        group = branch.number, mate

        def value(s: State, *modes: int) -> float:
            omega = 0.5 * abs(s.s[list(modes)].imag.sum())
            return squared_distance(s, modes).real - (threshold * omega) ** 2

    search = _Search(followed, solve, group, state)
    x, error = search.root(value, a.x, b.x, width)
    there, modes = search.at(x)
    growth = -there.damping if mate is None else there.s.real
    i = max(modes, key=lambda n: float(growth[n]))
    s, vector = complex(there.s[i]), there.right[:, i]
    return Event(kind, x, error, s, (branch.number, -1), vector)


def _turning(followed: Followed, branch: Branch, state: int) -> tuple[int, int] | None:
    """The pair of a branch that merges or splits in a step."""
    pairs = ((one, two) for at, one, two in followed.merged + followed.split if at == state)
    return next((pair for pair in pairs if branch.number in pair), None)


def _mate(followed: Followed, branch: Branch, state: int) -> int | None:
    """The branch that is a conjugate pair with another one on one side of a step at least."""
    step = state, state + 1
    for other in followed.branches:
        if other is not branch and {*step} <= {*other.states}:
            pairs = (_modes(followed, (branch.number, other.number), n) for n in step)
            if any(map(conjugate_pair, (followed.states[n] for n in step), pairs)):
                return other.number
    return None


def _merges(state: State, pair: Sequence[int]) -> bool:
    """Whether two modes of an undamped brake are a pair that merges, or one that has merged."""
    on_axis = np.abs(state.s.real[list(pair)]) <= 1e-9 * np.abs(state.s[list(pair)])
    return bool(on_axis.all()) or conjugate_pair(state, pair)


class _Search:
    """A group of modes at further values of the parameter, found by its projector.

    It begins with a state, the next one, and the states around where the branches are there too.
    """

    def __init__(self, followed: Followed, solve: Solve, group: tuple[int, ...], state: int):
        self._solve, branches = solve, [followed.branches[n] for n in group]
        self._states: dict[float, tuple[State, tuple[int, ...]]] = {}
        for n in (state, state + 1, state - 1, state + 2):
            if all(n in b.states for b in branches):
                modes = tuple(followed.at(b, n) for b in branches)
                self._states[followed.states[n].x] = followed.states[n], modes

    def at(self, x: float) -> tuple[State, tuple[int, ...]]:
        if x not in self._states:
            near = min(self._states, key=lambda known: abs(known - x))
            state = self._solve(x)
            self._states[x] = state, _same_group(*self._states[near], state)
        return self._states[x]

    def root(
        self, value: Callable[..., float], a: float, b: float, width: float
    ) -> tuple[float, float]:
        """Zero of a function of the group between two values, and its accuracy."""
        computed: dict[float, float] = {}

        def f(x: float) -> float:
            if x not in computed:
                state, group = self.at(x)
                computed[x] = value(state, *group)
            return computed[x]

        fa, fb = f(a), f(b)
        if fa == 0.0 or fb == 0.0:
            return (a if fa == 0.0 else b), width
        if fa * fb > 0:
            return (b if abs(fb) <= abs(fa) else a), abs(b - a)
        last = np.inf
        for _ in range(SMOOTH):
            known = sorted(self._states, key=lambda x: abs(x - 0.5 * (a + b)))[:POINTS]
            x = _interpolated_root([(x, f(x)) for x in {*known, a, b}], a, b)
            if abs(x - last) <= 0.5 * width:
                # That one was computed.
                return last, width
            last, fx = x, f(x)
            if fx == 0.0:
                return x, width
            if fx * f(a) > 0:
                a = x
            else:
                b = x
        # Not smooth, as where a contact element opens.
        return float(brentq(f, a, b, xtol=width, rtol=4 * np.finfo(float).eps)), width


def _interpolated_root(points: Sequence[tuple[float, float]], a: float, b: float) -> float:
    """Root between two values of the polynomial through some points; their secant's if none."""
    x, y = np.array(points).T
    middle, half = 0.5 * (a + b), 0.5 * abs(b - a)
    at = dict(points)
    secant = (a * at[b] - b * at[a]) / (at[b] - at[a])
    scaled = (x - middle) / half
    roots = np.roots(np.linalg.solve(np.vander(scaled), y / np.abs(y).max()))
    real = roots[np.abs(roots.imag) <= 1e-9].real
    inside = middle + half * real[np.abs(real) < 1]
    return float(inside[np.argmin(np.abs(inside - secant))]) if inside.size else secant


def _same_group(old: State, group: tuple[int, ...], new: State) -> tuple[int, ...]:
    """The modes of a state that are those of a group in another one, nearly."""
    middle = float(np.mean([old.s[i].imag for i in group]))
    order = np.argsort(np.abs(new.s.imag - middle))[:AROUND]
    candidates: list[tuple[int, ...]] = [(int(i),) for i in order]
    if len(group) == 2:
        candidates = [(int(i), int(j)) for n, i in enumerate(order) for j in order[n + 1 :]]
        if new.undamped:
            # Among three modes of nearly one shape a growing one may be taken for either of the
            # two that merge: Re d of it and a mode on the axis passes zero where nothing merges.
            candidates = [pair for pair in candidates if _merges(new, pair)] or candidates
    return min(candidates, key=lambda chosen: abs(group_likeness(old, group, new, chosen) - 1.0))


@dataclass(frozen=True, slots=True)
class Critical:
    """Critical values of one family.

    Attributes:
        family: number; -1 for the first of any family.
        frequency: median at the onset [Hz].
        values: critical value of every sample, ``-inf`` where it squeals at the first value and
            ``inf`` where it does not squeal up to the last; in the direction of the sweep, so
            that a falling sweep has them negative.
        sign: -1 for a falling sweep.
    """

    family: int
    frequency: float
    values: Array
    sign: float

    def by(self, x: float) -> Proportion:
        """Share of samples that have begun to squeal by a value, with its interval."""
        return wilson(int(np.sum(self.values <= self.sign * x)), self.values.size)

    def quantile(self, share: float) -> tuple[float, float, float]:
        """Value by which a share of samples squeals, and its 95 % interval; infinite if censored.

        One sample has no interval: its ends are nan.

        Args:
            share: between 0 and 1.
        """
        ordered, n = np.sort(self.values), self.values.size
        low, high = (int(binom.ppf(p, n, share)) for p in (0.025, 0.975))
        place = min(int(np.ceil(share * n)) - 1, n - 1)
        ends = [ordered[low - 1] if low >= 1 else -np.inf, ordered[high] if high < n else np.inf]
        found = [float(v) for v in (ordered[max(place, 0)], *(ends if n > 1 else [np.nan] * 2))]
        value, first, last = (self.sign * v for v in found)
        return (value, first, last) if self.sign > 0 else (value, last, first)

    @property
    def reached(self) -> int:
        """Samples that begin to squeal up to the last value."""
        return int(np.sum(self.values < np.inf))


def critical_values(
    onsets: Sequence[Sequence[tuple[int, float, float]]], rising: bool
) -> list[Critical]:
    """Critical values of every family, and first of any family.

    Args:
        onsets: of each sample (family, value, frequency [Hz]) of every mode that begins to squeal;
            the value is ``-inf`` or ``inf`` where it squeals at the first value.
        rising: whether the values of the sweep rise.

    Returns:
        Any family first, then by the number of samples in which they squeal.
    """
    sign = 1.0 if rising else -1.0
    families = sorted({family for sample in onsets for family, *_ in sample})
    found = []
    for family in [-1, *families]:
        first, frequencies = np.full(len(onsets), np.inf), []
        for k, sample in enumerate(onsets):
            own = [o for o in sample if family in (-1, o[0])]
            if own:
                _, value, frequency = min(own, key=lambda o: sign * o[1])
                first[k] = sign * value
                frequencies.append(frequency)
        middle = float(np.median(frequencies)) if frequencies else float("nan")
        found.append(Critical(family, middle, first, sign))
    return sorted(found, key=lambda c: (c.family >= 0, -c.reached, c.frequency))

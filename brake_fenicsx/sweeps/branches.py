"""Branches: modes followed over a parameter by their left and right vectors.

From one value to the next a mode is continued by the one with its spectral projector
(``matching``). Where that is not certain the step is halved, down to LEAST of the whole range; what
is not certain even then is cut, and the branch says so. A merging is passed by the projector of the
pair. After it the branch of the lower frequency takes the growing mode: a convention.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from brake_fenicsx.arguments import Complex
from brake_fenicsx.errors import NotConverged

from .matching import Match, State, conjugate_pair, match

Solve = Callable[[float], State]

# Smallest step, relative to the whole range: a tenth of the accuracy of a merging point. From the
# longer one on, modes may jump where a contact element opens or closes.
LEAST, JUMP = 1e-5, 1e-3

# Modes meet within a step if the square of their gap is expected to fall to the first share of what
# it is at either end, or to the second of the larger of both; and not so near to its ends, relative
# to the whole range.
MEETING, ROUGH, AWAY = 0.1, 0.05, 1e-4

# Ends of a branch.
FIRST, LAST = "first value", "last value"
ENTERED, LEFT = "entered the band", "left the band"
CUT = "cut: mode tracking was ambiguous"
NO_EQUILIBRIUM = "no equilibrium at a value beyond"


@dataclass(slots=True)
class Branch:
    """A mode over the parameter.

    Attributes:
        number: of the branch.
        states: numbers of its states.
        modes: its mode in each of them.
        begin: why it begins.
        end: why it ends.
    """

    number: int
    states: list[int]
    modes: list[int]
    begin: str
    end: str = LAST


@dataclass(slots=True)
class Followed:
    """All modes of a band over a parameter.

    Attributes:
        states: the modes at every value that was computed, in ascending or descending order.
        branches: the branches.
        merged: state before, and the two branches that are a conjugate pair after it.
        split: state before, and the two branches that are a pair until there.
        jumps: states before which modes jumped.
        stopped: why the values beyond the last state have no modes; empty if they have.
    """

    states: list[State] = field(default_factory=list)
    branches: list[Branch] = field(default_factory=list)
    merged: list[tuple[int, int, int]] = field(default_factory=list)
    split: list[tuple[int, int, int]] = field(default_factory=list)
    jumps: list[int] = field(default_factory=list)
    stopped: str = ""

    def at(self, branch: Branch, state: int) -> int:
        """Mode of a branch in a state."""
        return branch.modes[state - branch.states[0]]


def follow(solve: Solve, values: Sequence[float], band: tuple[float, float]) -> Followed:
    """Follow the modes of a band.

    Args:
        solve: gives the modes at a value of the parameter.
        values: values at which the modes are wanted, ascending or descending.
        band: lowest and highest frequency [Hz].

    Returns:
        The branches; their states hold all ``values`` and those between that were needed, up to the
        first one that has no equilibrium.

    Raises:
        NotConverged: the first value has none.
    """
    work = _Follower(solve, band, abs(values[-1] - values[0]))
    work.begin(values[0])
    try:
        if len(values) > 1 and work.done.states[0].undamped:
            # How fast gaps change at the first value: where modes meet within the first step.
            start, next_ = values[:2]
            step = min(0.5 * JUMP * abs(values[-1] - start), 0.5 * abs(next_ - start))
            work.advance(solve(start + np.copysign(step, next_ - start)))
        for x in values[1:]:
            work.advance(solve(x))
    except NotConverged as error:
        work.stop(str(error))
    return work.done


class _Follower:
    def __init__(self, solve: Solve, band: tuple[float, float], width: float):
        self.done, self._solve, self._band, self._width = Followed(), solve, band, width
        # The smallest step, which grows where one after the other is uncertain however small.
        self._smallest = 2 * LEAST
        # Branch of each mode of the last state, and dlambda/dx there.
        self._branch: dict[int, Branch] = {}
        self._speed: Complex | None = None
        # The step from the last state that was halved at last.
        self._beyond: Match | None = None

    def begin(self, x: float) -> None:
        first = self._solve(x)
        self.done.states.append(first)
        for mode in range(first.s.size):
            self._found(0, mode, FIRST)

    def stop(self, why: str) -> None:
        """End all branches where the brake has no equilibrium any more."""
        self.done.stopped = why
        for branch in self._branch.values():
            branch.end = NO_EQUILIBRIUM

    def advance(self, b: State) -> None:
        """Go on to a state, by halves where that is needed."""
        ahead = [b]
        while ahead:
            a, b = self.done.states[-1], ahead[-1]
            step = abs(b.x - a.x) / self._width
            may_jump = step <= JUMP and a.open != b.open
            smallest = step <= self._smallest
            matching = match(a, b, self._band, self._speed, may_jump, smallest)
            between = self._between(matching)
            if between is None or smallest:
                ahead.pop()
                self._take(matching)
                self._beyond = None
                wider = 2.0 if between is not None else 0.5
                self._smallest = max(2 * LEAST, wider * self._smallest)
            else:
                self._beyond = matching
                ahead.append(self._solve(a.x + between * (b.x - a.x)))

    def _between(self, matching: Match) -> float | None:
        """Place of a step, 0 to 1, where modes are needed too; None where it can be taken.

        There two undamped modes meet or nearly do: they cross without coupling, or they merge and
        split again within the step. Modes of a growing pair stand at their common frequency.
        """
        if not matching.confident:
            return 0.5
        a, b = matching.a, matching.b
        # Modes that stay together, such as a doublet, meet in every step however small.
        short = abs(b.x - a.x) <= JUMP * self._width
        if short or not (a.undamped and b.undamped):
            return None
        away = AWAY * self._width / abs(b.x - a.x)
        order = [int(i) for i in np.argsort(a.s.imag) if int(i) in matching.pairs]
        for number, i in enumerate(order):
            for j in order[number + 1 : number + 3]:
                k, m = matching.pairs[i], matching.pairs[j]
                if conjugate_pair(a, (i, j)) or conjugate_pair(b, (k, m)):
                    continue
                gap, then, place = (a.s[j] - a.s[i]).imag, (b.s[m] - b.s[k]).imag, None
                grow = np.any(a.s[[i, j]].real) or np.any(b.s[[k, m]].real)
                if gap * then < 0:
                    place = gap / (gap - then)
                elif grow or j == order[number + 1]:
                    # Between a mode and one of a pair stands the other one of the pair.
                    place = self._closest(i, j, matching, then)
                if place is not None and away < place < 1 - away:
                    return float(place)
        return None

    def _closest(self, i: int, j: int, matching: Match, then: float) -> float | None:
        """Where the parabola through three squares of a gap is lowest, if that is nearly zero.

        The third value is the one beyond, where a step to it was halved, or the one before.
        """
        states, one, two = self.done.states, self._branch[i], self._branch[j]
        beyond, a, b = self._beyond, matching.a, matching.b
        if beyond is not None and {i, j} <= {*beyond.pairs}:
            third, (p, q) = beyond.b, (beyond.pairs[i], beyond.pairs[j])
        elif min(len(one.states), len(two.states)) > 1:
            third, (p, q) = states[-2], (one.modes[-2], two.modes[-2])
        else:
            return None
        x = (np.array([third.x, b.x]) - a.x) / (b.x - a.x)
        before = (third.s[p] - third.s[q]).imag ** 2
        now = (a.s[i] - a.s[j]).imag ** 2
        # now + c x + d x^2
        rise = np.array([before, then**2]) - now
        d, c = np.linalg.solve(np.column_stack([x**2, x]), rise)
        ends = now, then**2
        if not d > 0 or not now - c**2 / (4 * d) < max(MEETING * min(ends), ROUGH * max(ends)):
            return None
        return float(-c / (2 * d))

    def _take(self, matching: Match) -> None:
        done = self.done
        done.states[-1] = matching.a
        number = len(done.states)
        done.states.append(matching.b)
        before, self._branch = self._branch, {}
        for i, j in matching.pairs.items():
            branch = before[i]
            branch.states.append(number)
            branch.modes.append(j)
            self._branch[j] = branch
        for kind, pairs in ((done.merged, matching.merged), (done.split, matching.split)):
            kind += [(number - 1, before[i].number, before[j].number) for i, j in pairs]
        for i in matching.lost:
            before[i].end = CUT
        for i in matching.left:
            before[i].end = LEFT
        for j in matching.new:
            self._found(number, j, CUT)
        for j in matching.entered:
            self._found(number, j, ENTERED)
        if matching.jumped:
            done.jumps.append(number)
        speed = np.full(matching.b.s.size, np.nan, complex)
        # What modes did that just merged, split or jumped says nothing of what they will do.
        turned = {*matching.jumped, *(i for two in matching.merged + matching.split for i in two)}
        for i, j in matching.pairs.items():
            if i not in turned:
                speed[j] = (matching.b.s[j] - matching.a.s[i]) / (matching.b.x - matching.a.x)
        self._speed = speed

    def _found(self, state: int, mode: int, why: str) -> None:
        branch = Branch(len(self.done.branches), [state], [mode], why)
        self.done.branches.append(branch)
        self._branch[mode] = branch

"""The modes at one value of a parameter, and which of them continue those of the value before.

Left and right vectors give the spectral projector of a group of modes,
P = Phi (Psi^H Phi)^-1 Psi^H. The trace of the product of two such projectors, over their rank, is
the modal assurance criterion of modes that are not orthogonal: 1 for the same group, 0 for another
one (M. I. Friswell, "On the design of modal actuators and sensors", and for two-sided vectors R. J.
Allemang, Sound and Vibration 37(8), 2003). Where two modes merge, their own projectors grow without
bound, and that of the pair stays analytic (T. Kato, Perturbation Theory for Linear Operators, 1980,
chapter II).
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from brake_fenicsx.arguments import Array, Complex
from brake_fenicsx.errors import NotConverged
from brake_fenicsx.mac import mac
from brake_fenicsx.samples.study import Study
from brake_fenicsx.stability.modes import Modes
from brake_fenicsx.stability.substructures.parameter_line import Basis

# A mode continues another where their likeness differs from 1 by less, and no other mode is
# likelier than the rest.
ALIKE = 0.25

# Modes that far beside each other among those left over may be a pair, and two eigenvalues closer
# than this share of |lambda|, or ten times their errors, are one.
BESIDE, EQUAL, ERRORS = 4, 1e-9, 10.0

# Two modes that change places within the smallest step are closer than this share of |lambda|
# before and after it.
CROSSING = 1e-4

# Condition number from which two modes of a pair are close to a merging; modes that are not coupled
# have 1.
COUPLED = 3.0

# Across a jump, where a contact element opens at once, a mode continues the one it is so alike to.
LIKELIEST = 0.5

# d = (lambda_1 - lambda_2)^2 passes zero if it turns by pi, up to this angle: exactly so without
# damping, and with damping that follows mass and stiffness.
TURNED = 1e-2

# A mode may leave or enter the band whose frequency lies this share from its end, or that would be
# beyond it after one more step like the last one.
EDGE = 2e-3

# Equilibria that are kept as starts.
KEPT = 8

# Relative error of lambda at most that a value found on the vectors of others may add.
FINEST = 1e-5


@dataclass(frozen=True, slots=True)
class State:
    """Oscillating modes at one value of the parameter, sorted by frequency.

    Attributes:
        x: value of the parameter.
        s: eigenvalues lambda [1/s] with omega > 0, shape (modes,).
        right: right vectors in coordinates in which the mass is the identity, shape (m, modes).
        left: left vectors, likewise.
        error: estimated errors of lambda [1/s].
        condition: condition numbers of lambda [-].
        verdict: "stable", "unstable" or "neutral".
        open: which contact elements are open, packed.
    """

    x: float
    s: Complex
    right: Complex
    left: Complex
    error: Array
    condition: Array
    verdict: NDArray[np.str_]
    open: bytes = b""

    @classmethod
    def of(cls, x: float, modes: Modes, k: Array | None = None) -> "State":
        """The oscillating ones of some modes; rigid modes and divergence belong to no branch.

        Args:
            x: value of the parameter.
            modes: all modes there.
            k: stiffness of the contact elements [Pa/m], shape (elements,).
        """
        kept = np.flatnonzero(modes.s.imag > 0)
        kept = kept[np.lexsort((modes.s.real[kept], modes.s.imag[kept]))]
        right, left = (X[:, kept].astype(complex) for X in (modes.right, modes.left))
        right, left = (v / np.linalg.norm(v, axis=0) for v in (right, left))
        known = modes.error[kept], modes.condition[kept], np.array(modes.verdict, dtype=str)[kept]
        gaps = b"" if k is None else np.packbits(k == 0).tobytes()
        return cls(float(x), modes.s[kept], right, left, *known, gaps)

    @property
    def frequency(self) -> Array:
        """|omega| / 2 pi [Hz]."""
        return np.asarray(self.s.imag / (2 * np.pi))

    @property
    def damping(self) -> Array:
        """-2 alpha / |omega| [-]."""
        return np.asarray(-2 * self.s.real / self.s.imag)

    @property
    def undamped(self) -> bool:
        """Whether every mode has its mirror image -conj(lambda), as without damping."""
        apart = np.abs(self.s[:, None] + self.s[None, :].conj()).min(axis=1, initial=np.inf)
        return bool(np.all(apart <= 1e-9 * np.abs(self.s)))

    def turned(self, group: Sequence[int], other: "State", theirs: Sequence[int]) -> "State":
        """This state with the vectors of equal eigenvalues turned to those of another state.

        Args:
            group: modes of one eigenvalue, whose vectors are any basis of their space.
            other: the other state.
            theirs: its modes that continue them.
        """
        own, mate = list(group), list(theirs)
        R, L = self.right[:, own], self.left[:, own]
        right = R @ np.linalg.solve(L.conj().T @ R, L.conj().T @ other.right[:, mate])
        left = L @ np.linalg.solve(R.conj().T @ L, R.conj().T @ other.left[:, mate])
        new_right, new_left = self.right.copy(), self.left.copy()
        new_right[:, own] = right / np.linalg.norm(right, axis=0)
        new_left[:, own] = left / np.linalg.norm(left, axis=0)
        return replace(self, right=new_right, left=new_left)


def likeness(a: State, b: State) -> Complex:
    """Two-sided modal assurance criterion of every mode of a with every mode of b.

    Returns:
        Traces of the products of their projectors, shape (modes of a, modes of b); they are not
        bounded where a mode is nearly defective.
    """
    return mac(a.right, b.right, a.left, b.left)


def group_likeness(a: State, group: Sequence[int], b: State, theirs: Sequence[int]) -> float:
    """The same of two groups of modes, real part over their number; 0 for a defective group."""
    R, L = a.right[:, list(group)], a.left[:, list(group)]
    S, N = b.right[:, list(theirs)], b.left[:, list(theirs)]
    try:
        first = np.linalg.solve(L.conj().T @ R, L.conj().T @ S)
        second = np.linalg.solve(N.conj().T @ S, N.conj().T @ R)
    except np.linalg.LinAlgError:
        return 0.0
    return float(np.trace(first @ second).real / len(group))


class Points:
    """Modes of a sample over one scalar of the scene; see ``branches.Solve``."""

    def __init__(
        self,
        study: Study,
        task: tuple[str, int],
        key: str,
        fixed: Mapping[str, float] | None = None,
        ends: Sequence[float] = (),
    ):
        """Choose the sample.

        Args:
            study: the samples of the scene, prepared.
            task: approach and number of the sample.
            key: dotted key of the scalar.
            fixed: values of further scalars, SI.
            ends: first and last value of a line, which are computed first: those between are found
                on their vectors, where these suffice.
        """
        self._study, self._task, self._key = study, task, key
        self._fixed, self._ends = dict(fixed or {}), [*ends]
        self._gaps: dict[float, Array] = {}
        self._ready: dict[float, State] = {}
        stability = study.scene.stability
        self.line = Basis(min(stability.tolerance if stability else FINEST, FINEST))

    def __call__(self, x: float) -> State:
        """The modes at a value of the scalar, SI."""
        while self._ends:
            with suppress(NotConverged):
                end = self._ends.pop(0)
                self._ready[end] = self._computed(end)
        return self._ready.pop(x) if x in self._ready else self._computed(x)

    def _computed(self, x: float) -> State:
        values = {**self._fixed, self._key: x}
        eq, modes = self._study.solved(self._task, values, self._near(x), self.line)
        self._gaps[x] = eq.g
        if len(self._gaps) > KEPT:
            self._gaps.pop(next(iter(self._gaps)))
        return State.of(x, modes, eq.k_vibration)

    def _near(self, x: float) -> Array | None:
        """Gaps to start from: of the nearest value, or on the line through the two nearest."""
        near = sorted(self._gaps, key=lambda known: abs(known - x))[:2]
        if len(near) < 2:
            return self._gaps[near[0]] if near else None
        a, b = near
        return self._gaps[a] + (x - a) / (b - a) * (self._gaps[b] - self._gaps[a])


@dataclass(slots=True)
class Match:
    """Modes of b that continue those of a.

    Attributes:
        a: the first state; vectors of equal eigenvalues may have been turned.
        b: the second state, likewise.
        pairs: mode of a -> mode of b.
        merged: two modes of a that differ in frequency, and in growth in b; the lower one first.
        split: two modes of a that differ in growth, and in frequency in b; the growing one first.
        lost: modes of a that nothing continues, and that did not leave the band.
        new: modes of b that continue nothing, and that did not enter the band.
        left: modes of a that left the band.
        entered: modes of b that entered it.
        jumped: modes of a whose continuation is only the likeliest mode of b.
    """

    a: State
    b: State
    pairs: dict[int, int] = field(default_factory=dict)
    merged: list[tuple[int, int]] = field(default_factory=list)
    split: list[tuple[int, int]] = field(default_factory=list)
    lost: list[int] = field(default_factory=list)
    new: list[int] = field(default_factory=list)
    left: list[int] = field(default_factory=list)
    entered: list[int] = field(default_factory=list)
    jumped: list[int] = field(default_factory=list)

    @property
    def confident(self) -> bool:
        """Whether every mode has its continuation or a reason to have none."""
        return not self.lost and not self.new


def match(
    a: State,
    b: State,
    band: tuple[float, float],
    speed: Complex | None = None,
    across_jump: bool = False,
    smallest: bool = False,
) -> Match:
    """Match the modes of two values of the parameter.

    Args:
        a: the modes at the first value.
        b: those at the second.
        band: lowest and highest frequency [Hz], at whose ends modes come and go.
        speed: dlambda/dx of the modes of a over the last step, nan where it is not known.
        across_jump: whether the likeliest mode is enough where no mode is certain.
        smallest: whether the step is the smallest one: modes that change places within it cross.
    """
    matching = Match(a, b)
    sim = likeness(a, b)
    free_a, free_b = set(range(a.s.size)), set(range(b.s.size))
    close = np.abs(sim - 1.0) < ALIKE
    for i, j in zip(*np.nonzero(close), strict=True):
        if close[i].sum() == 1 and close[:, j].sum() == 1:
            matching.pairs[int(i)] = int(j)
            free_a.discard(int(i))
            free_b.discard(int(j))
    _pairs(matching, free_a, free_b, speed, smallest)
    if across_jump:
        _likeliest(matching, sim, free_a, free_b)
    step = b.x - a.x
    moved = np.zeros(a.s.size) if speed is None else np.nan_to_num(np.abs(speed * step))
    reach = 2 * moved.max(initial=0.0) / (2 * np.pi)
    for i in sorted(free_a):
        at_edge = _at_edge(a.frequency[i], band, 2 * moved[i] / (2 * np.pi))
        (matching.left if at_edge else matching.lost).append(i)
    for j in sorted(free_b):
        (matching.entered if _at_edge(b.frequency[j], band, reach) else matching.new).append(j)
    return matching


def _likeliest(matching: Match, sim: Complex, free_a: set[int], free_b: set[int]) -> None:
    """Continue what is left over by the likeliest modes, if they are likely."""
    free_a.update(matching.lost)
    free_b.update(matching.new)
    matching.lost, matching.new = [], []
    rows, columns = sorted(free_a), sorted(free_b)
    size = np.nan_to_num(np.abs(sim[np.ix_(rows, columns)]), posinf=0.0)
    for r, c in zip(*linear_sum_assignment(-np.minimum(size, 1.0)), strict=True):
        if LIKELIEST <= size[r, c] <= 1 / LIKELIEST:
            matching.pairs[rows[r]] = columns[c]
            matching.jumped.append(rows[r])
            free_a.discard(rows[r])
            free_b.discard(columns[c])


def _at_edge(f: float, band: tuple[float, float], reach: float) -> bool:
    near = max(reach, EDGE * f)
    return bool(f - near < band[0] or f + near > band[1])


def _pairs(
    matching: Match, free_a: set[int], free_b: set[int], speed: Complex | None, smallest: bool
) -> None:
    """Continue pairs of modes by their common projector; what is matched leaves the free ones."""
    while True:
        best, score = None, ALIKE
        theirs = list(_beside(matching.b, sorted(free_b)))
        for pair in _beside(matching.a, sorted(free_a)):
            for mate in theirs:
                off = abs(group_likeness(matching.a, pair, matching.b, mate) - 1.0)
                if off < score:
                    best, score = (pair, mate), off
        if best is None:
            return
        pair, mate = best
        free_a.difference_update(pair)
        free_b.difference_update(mate)
        _one_pair(matching, pair, mate, speed, smallest)


def _beside(state: State, free: Sequence[int]) -> list[tuple[int, int]]:
    """Pairs of free modes that lie close to each other."""
    return [(i, j) for i, j in combinations(free, 2) if free.index(j) - free.index(i) <= BESIDE]


def _one_pair(
    matching: Match,
    pair: tuple[int, int],
    mate: tuple[int, int],
    speed: Complex | None,
    smallest: bool,
) -> None:
    """Say which of two modes continues which."""
    a, b = matching.a, matching.b
    apart = _apart(a, pair), _apart(b, mate)
    # Of a pair that differs in frequency the lower mode comes first, else the growing one: the
    # lower branch takes the growing mode beyond a merging, a convention, since both are the pair.
    ordered = _ordered(a, pair), _ordered(b, mate)
    coupled = max(a.condition[list(pair)].max(), b.condition[list(mate)].max()) >= COUPLED
    if passes_zero(a, pair, b, mate):
        (matching.merged if apart[0] else matching.split).append(ordered[0])
        matching.pairs |= dict(zip(*ordered, strict=True))
    elif apart[0] == apart[1] and (
        coupled or (conjugate_pair(a, pair) and conjugate_pair(b, mate))
    ):
        # Next to their merging, which is not between: they keep their order.
        matching.pairs |= dict(zip(*ordered, strict=True))
    elif order := _one_by_one(matching, pair, mate, speed, smallest and not coupled):
        matching.pairs |= order
    else:
        matching.lost += list(pair)
        matching.new += list(mate)


def _one_by_one(
    matching: Match,
    pair: tuple[int, int],
    mate: tuple[int, int],
    speed: Complex | None,
    as_equal: bool,
) -> dict[int, int] | None:
    """Two separate modes on either side: equal eigenvalues have no vectors of their own."""
    crossing = as_equal and _close(matching.a, pair) and _close(matching.b, mate)
    if crossing or equal(matching.b, mate):
        matching.b = matching.b.turned(mate, matching.a, pair)
        return dict(zip(pair, mate, strict=True))
    if equal(matching.a, pair):
        if speed is not None and np.isfinite(speed[list(pair)]).all():
            # Crossing: each goes on as it went.
            going = matching.a.s[list(pair)] + speed[list(pair)] * (matching.b.x - matching.a.x)
            straight = np.abs(going - matching.b.s[list(mate)]).max()
            crossed = np.abs(going - matching.b.s[list(mate[::-1])]).max()
            chosen = mate if straight < crossed else mate[::-1]
            return dict(zip(pair, chosen, strict=True))
        matching.a = matching.a.turned(pair, matching.b, mate)
        return dict(zip(pair, mate, strict=True))
    return None


def conjugate_pair(state: State, pair: Sequence[int]) -> bool:
    """Whether two modes are lambda and -conj(lambda) off the imaginary axis."""
    one, two = state.s[pair[0]], state.s[pair[1]]
    return bool(one.real * two.real < 0 and abs(one + two.conjugate()) <= 1e-9 * abs(one))


def equal(state: State, pair: Sequence[int]) -> bool:
    """Whether two eigenvalues are one, as far as is known."""
    one, two = state.s[pair[0]], state.s[pair[1]]
    limit = max(EQUAL * abs(one), ERRORS * float(state.error[list(pair)].max()))
    return bool(abs(one - two) <= limit)


def _close(state: State, pair: Sequence[int]) -> bool:
    """Whether two modes may change places within the smallest step."""
    one, two = state.s[pair[0]], state.s[pair[1]]
    return bool(abs(one - two) <= CROSSING * abs(one))


def squared_distance(state: State, pair: Sequence[int]) -> complex:
    """(lambda_1 - lambda_2)^2, analytic in the parameter where the two merge too."""
    return complex((state.s[pair[0]] - state.s[pair[1]]) ** 2)


def passes_zero(a: State, pair: Sequence[int], b: State, mate: Sequence[int]) -> bool:
    """Whether d of a pair passes zero on its way: it turns by pi, one way or the other."""
    d, e = squared_distance(a, pair), squared_distance(b, mate)
    if _apart(a, pair) == _apart(b, mate):
        return False
    if d == 0 or e == 0:
        # Merged just there: equal eigenvalues without coupling are no merging.
        return max(a.condition[list(pair)].max(), b.condition[list(mate)].max()) >= COUPLED
    ratio = e / d
    return bool(ratio.real < 0 and abs(ratio.imag) <= TURNED * abs(ratio.real))


def _apart(state: State, pair: Sequence[int]) -> bool:
    """Whether two modes differ in frequency rather than in growth, or not at all."""
    step = state.s[pair[0]] - state.s[pair[1]]
    return bool(abs(step.imag) >= abs(step.real))


def _ordered(state: State, pair: Sequence[int]) -> tuple[int, int]:
    """Two modes by their frequency where they differ in it, else the growing one first."""
    key = state.s.imag if _apart(state, pair) else -state.s.real
    first, second = sorted(pair, key=lambda i: float(key[i]))
    return first, second

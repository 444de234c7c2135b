"""The smallest change of a number after which hardly any sample squeals, by search."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from brake_fenicsx.results.statistics import Share, wilson

# Share of the samples that may still squeal.
MOST = 0.05


@dataclass(frozen=True, slots=True)
class Change:
    """The smallest change that is enough, or the farthest one where none is.

    Attributes:
        value: of the number; None where no value is enough.
        share: samples that squeal at it, or at the farthest value.
    """

    value: float | None
    share: Share


def enough(hits: int, samples: int) -> bool:
    """Whether so few samples squeal that the family counts as stopped."""
    return hits <= int(MOST * samples)


def smallest_change(
    outcomes: Callable[[float], Iterable[bool]],
    ends: tuple[float, float],
    samples: int,
    steps: int,
    accuracy: float,
) -> Change:
    """Search for the smallest change that is enough.

    Values are tried from the first end outward: nothing is assumed of how the samples depend on the
    number from one to the next. Within the last step the border is found by bisection.

    Args:
        outcomes: gives, sample by sample, whether it squeals at a value; samples that cannot change
            the answer are not asked for.
        ends: value of the scene, and the farthest one.
        samples: how many there are.
        steps: values that are tried outward.
        accuracy: of the value, relative to the range.
    """

    def hits(x: float) -> int:
        count = 0
        for squeals in outcomes(x):
            count += squeals
            if not enough(count, samples):
                break
        return count

    start, stop = ends
    for before, x in pairwise(_short(v) for v in np.linspace(start, stop, steps + 1)):
        if not enough(count := hits(x), samples):
            continue
        # Halves of a step reach the accuracy exactly, but for round-off.
        while abs(x - before) > accuracy * abs(stop - start) * (1 + 1e-9):
            middle = _short(0.5 * (before + x))
            if enough(there := hits(middle), samples):
                x, count = middle, there
            else:
                before = middle
        return Change(x, wilson(count, samples))
    return Change(None, wilson(sum(outcomes(stop)), samples))


def _short(x: float) -> float:
    """A value without the last digits, which only round-off fills."""
    return float(f"{x:.12g}")

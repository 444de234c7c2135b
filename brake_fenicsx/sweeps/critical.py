"""The value of a parameter at which each family of modes begins to squeal, over many samples.

A sample that squeals at the first value has its critical value at or before it, and one that never
squeals beyond the last: the distribution is known between these, as for times of failure that are
censored on both sides at common values. Probabilities have Wilson's intervals; the interval of a
quantile is that of order statistics, which holds for any distribution (H. A. David and H. N.
Nagaraja, Order Statistics, 2003, section 7.1).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binom

from brake_fenicsx.arguments import Array
from brake_fenicsx.results.ensemble_statistics import Proportion, wilson


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

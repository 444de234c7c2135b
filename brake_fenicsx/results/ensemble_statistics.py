"""Shares of samples, their differences, rank correlations: each with its 95 % interval.

A share has Wilson's score interval (J. Am. Stat. Assoc. 22, 1927, doi:10.2307/2276774), and a
difference of two shares has Newcombe's hybrid score interval: of independent shares (Statistics in
Medicine 17, 1998, 873) or of paired ones (the same volume, 2635). Spearman's correlation has the
interval of Fisher's transform with the standard error 1.03 / sqrt(n - 3) (E. C. Fieller, H. O.
Hartley, E. S. Pearson, Biometrika 44, 1957, 470).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Proportion:
    """A share of samples with its 95 % Wilson interval: hits of n, low <= hits / n <= high.

    A single sample is no random sample: its interval is nan.
    """

    hits: int
    n: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """The share itself."""
        return self.hits / self.n if self.n else float("nan")

    @property
    def cells(self) -> list[float | None]:
        """Share, lower and upper end as cells of a table; None where there is none."""
        shown = self.n > 0, self.n > 1, self.n > 1
        cells = zip(shown, (self.value, self.low, self.high), strict=True)
        return [value if there else None for there, value in cells]


def wilson(hits: int, n: int) -> Proportion:
    """Share of ``hits`` among ``n`` with its interval, which is (0, 1) without a trial.

    One trial has none.
    """
    from scipy.stats import binomtest

    if n == 0:
        return Proportion(0, 0, 0.0, 1.0)
    if n == 1:
        return Proportion(int(hits), 1, float("nan"), float("nan"))
    # The p-value, which nobody reads, takes longest for another hypothesis.
    interval = binomtest(int(hits), int(n), hits / n).proportion_ci(method="wilson")
    return Proportion(int(hits), int(n), float(interval.low), float(interval.high))


def difference(
    first: NDArray[np.bool_], second: NDArray[np.bool_], paired: bool
) -> tuple[float, float, float]:
    """Difference of two shares, second minus first, with its 95 % interval.

    Args:
        first: outcome of each sample of the first run.
        second: of the second one; of the same samples where they are paired.
        paired: whether the outcomes belong together one by one.
    """
    p, q = wilson(int(first.sum()), first.size), wilson(int(second.sum()), second.size)
    phi = _phi(first, second) if paired else 0.0
    change = q.value - p.value
    down, up = (q.value - q.low, p.high - p.value), (q.high - q.value, p.value - p.low)
    low, high = (np.sqrt(max(x * x - 2 * phi * x * y + y * y, 0.0)) for x, y in (down, up))
    return change, float(change - low), float(change + high)


def _phi(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> float:
    """Newcombe's phi of a table of four fields, with its correction for continuity."""
    a, b = int(np.sum(first & second)), int(np.sum(first & ~second))
    c, d = int(np.sum(~first & second)), int(np.sum(~first & ~second))
    sums = (a + b) * (c + d) * (a + c) * (b + d)
    if sums == 0:
        return 0.0
    cross = float(a * d - b * c)
    if cross > 0:
        cross = max(cross - first.size / 2, 0.0)
    return float(cross / np.sqrt(sums))


@dataclass(frozen=True, slots=True)
class Correlation:
    """Spearman's rank correlation with its 95 % interval."""

    rho: float
    low: float
    high: float


def rank_correlation(x: Array, y: Array) -> Correlation:
    """Rank correlation of an input with an outcome; nan where one never changes."""
    from scipy.stats import spearmanr

    if x.size < 5 or np.ptp(x) == 0 or np.ptp(y) == 0:
        return Correlation(np.nan, np.nan, np.nan)
    rho = float(spearmanr(x, y)[0])
    z, half = np.arctanh(np.clip(rho, -1 + 1e-12, 1 - 1e-12)), 1.96 * 1.03 / np.sqrt(x.size - 3)
    return Correlation(rho, float(np.tanh(z - half)), float(np.tanh(z + half)))

"""What counts as squeal, and the share of samples that squeal with its interval.

The interval is Wilson's score interval (J. Am. Stat. Assoc. 22, 1927, doi:10.2307/2276774).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Z_95 = 1.959963984540054


@dataclass(frozen=True, slots=True)
class Share:
    """A share of samples with its 95 % Wilson interval: hits of n, low <= hits / n <= high."""

    hits: int
    n: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """The share itself."""
        return self.hits / self.n if self.n else float("nan")


def squeals(modes: Mapping[str, Any], threshold: float) -> NDArray[np.bool_]:
    """Which modes count as squeal: unstable, and the damping below minus the threshold."""
    return (modes["verdict"] == "unstable") & (modes["damping"] < -threshold)


def wilson(hits: int, n: int, z: float = Z_95) -> Share:
    """Share of ``hits`` among ``n`` with its Wilson score interval.

    Args:
        hits: number of events.
        n: number of trials.
        z: half width of the interval in standard deviations.

    Returns:
        The share; its interval is (0, 1) without any trial.
    """
    if n == 0:
        return Share(0, 0, 0.0, 1.0)
    p = hits / n
    scale = 1.0 / (1.0 + z * z / n)
    centre = scale * (p + z * z / (2 * n))
    half = scale * z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    low = 0.0 if hits == 0 else float(centre - half)
    high = 1.0 if hits == n else float(centre + half)
    return Share(hits, n, low, high)

"""Laws of random inputs by their quantiles: a point of the unit interval to a value.

Cutting at min and max shrinks the interval of probabilities, so that no point is wasted and a
design keeps its structure.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import InputLaw
from brake_fenicsx.scene import Distribution

Array = NDArray[np.float64]


def quantile(d: Distribution | InputLaw, u: ArrayLike, nominal: float = np.nan) -> Array:
    """Values of a law at some probabilities.

    Args:
        d: the law, in SI units, or one of a user's own.
        u: probabilities, in [0, 1].
        nominal: the value in the scene, which ``spread`` refers to, SI.

    Returns:
        Values, same shape.
    """
    u = np.asarray(u, float)
    if not isinstance(d, Distribution):
        return d.quantile(u, nominal)
    if d.law == "uniform":
        low, high = d.min, d.max
        if d.spread is not None:
            low, high = nominal * (1 - d.spread), nominal * (1 + d.spread)
        return np.asarray(low + u * (high - low))
    if d.law == "measured":
        values = np.sort([v for v in d.values if d.min <= v <= d.max])
        return values[np.minimum((u * values.size).astype(int), values.size - 1)]
    if d.mean is None or d.sd is None:
        raise SceneError(f"samples.random: a {d.law} law needs mean and sd")
    if d.law == "normal":
        return d.mean + d.sd * _normal(u, (d.min - d.mean) / d.sd, (d.max - d.mean) / d.sd)
    # Mean and standard deviation of the logarithm from those of the value.
    variance = np.log1p((d.sd / d.mean) ** 2)
    sd = np.sqrt(variance)
    low, high = np.log(d.min) if d.min > 0 else -np.inf, np.log(d.max)
    mean = np.log(d.mean) - 0.5 * variance
    return np.asarray(np.exp(mean + sd * _normal(u, (low - mean) / sd, (high - mean) / sd)))


def _normal(u: Array, low: float, high: float) -> Array:
    """Quantiles of the standard normal law between two bounds."""
    if low > 0:
        # Probabilities next to 1 have no digits left; those next to 0 have.
        return -_normal(1 - u, -high, -low)
    first, last = special.ndtr(low), special.ndtr(high)
    return np.asarray(special.ndtri(first + u * (last - first)))

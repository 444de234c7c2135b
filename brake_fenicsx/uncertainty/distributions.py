"""Laws of random inputs by their quantiles: a point of the unit interval to a value.

Cutting at min and max shrinks the interval of probabilities, so that no point is wasted and a
design keeps its structure.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
    # It takes long to load, and few scenes need it.
    from scipy import stats

    if d.law == "normal":
        a, b = (d.min - d.mean) / d.sd, (d.max - d.mean) / d.sd
        return np.asarray(stats.truncnorm.ppf(u, a, b, loc=d.mean, scale=d.sd))
    # Mean and standard deviation of the logarithm from those of the value.
    variance = np.log1p((d.sd / d.mean) ** 2)
    law = stats.lognorm(np.sqrt(variance), scale=d.mean * np.exp(-0.5 * variance))
    low, high = law.cdf(max(d.min, 0.0)), law.cdf(d.max)
    return np.asarray(law.ppf(low + u * (high - low)))

"""What makes a scan implausible."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.surface.topography import Topography

Array = NDArray[np.float64]
# A value this often at the end of the heights, and so much more often than the next, is no height.
MANY, TIMES = 10, 10
# Sides of a pixel that differ by less than this are equal: a size may leave a point out.
SQUARE = 0.02


def pile_at_an_end(heights: Array) -> tuple[int, float] | None:
    """Many points at exactly one height that is the highest or the lowest of all.

    Args:
        heights: heights [m], shape (nx, ny); nan where missing.

    Returns:
        How many points, and their height [m]; None if there is no such pile.
    """
    values, many = np.unique(heights[np.isfinite(heights)], return_counts=True)
    if values.size < 3:
        return None
    ends: Any = ((many[0], many[1], values[0]), (many[-1], many[-2], values[-1]))
    for count, beside, value in ends:
        if count >= MANY and count > TIMES * beside:
            return int(count), float(value)
    return None


def implausible(topo: Topography) -> tuple[str, ...]:
    """What no instrument would deliver of a surface, as one line each with its remedy."""
    doubts = []
    if topo.size.max() > 0.5 or topo.size.min() < 1e-7:
        doubts.append(f"lateral size {topo.size[0]:.3g} x {topo.size[1]:.3g} m; give 'size'")
    ratio = topo.pixel.max() / topo.pixel.min()
    if ratio > 5.0:
        doubts.append(f"pixels {ratio:.3g} times longer than wide; give 'size'")
    elif ratio > 1.0 + SQUARE:
        across = topo.size / topo.heights.shape[::-1]
        if across.max() < (1.0 + SQUARE) * across.min():
            doubts.append(
                f"pixels {ratio:.3g} times longer than wide, and square with the sides of the map"
                " exchanged; correct 'size' or 'rows'"
            )
    low, high = np.nanpercentile(topo.heights, [0.5, 99.5])
    if doubts:  # heights cannot be judged against a size that is wrong
        pass
    elif high - low > topo.size.max():
        doubts.append(f"heights span {high - low:.3g} m, more than the scan; give 'height_unit'")
    elif 0.0 < high - low < 1e-7 * topo.size.min():
        doubts.append(f"heights span {high - low:.3g} m only; give 'height_unit'")
    if (pile := pile_at_an_end(topo.heights)) is not None:
        doubts.append(
            f"{pile[0]} points at exactly {1e6 * pile[1]:.6g} um, an end of the heights: missing"
            " points or a detector at its limit; export the scan with its missing points marked"
        )
    share = float(topo.valid.mean())
    if share < 0.7:
        doubts.append(f"only {share:.0%} of the points are valid")
    return tuple(f"{topo.source}: implausible: {text}" for text in doubts)

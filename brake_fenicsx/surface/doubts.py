"""What makes the heights of a scan implausible, and where points of it are missing."""

import numpy as np
from scipy.ndimage import label, maximum_filter

from brake_fenicsx.arguments import Array
from brake_fenicsx.surface.topography import Topography

# A value this often at the end of the heights, and so much more often than the next, is no height.
MANY, TIMES = 10, 10
EMPTY = 0.25  # of the range of the heights without any: two surfaces, or numbers read wrongly
FEW_VALID = 0.7  # share of the points
RIM = 0.9  # of the rims of holes lie in the lower half of the heights where the deepest are missing
# Sides of a pixel that differ by less than this are equal: a size may leave a point out.
SQUARE = 0.02


def pile_at_an_end(heights: Array) -> tuple[int, float] | None:
    """Many points at exactly one height that is the highest or the lowest of all.

    Args:
        heights: heights [m], shape (nx, ny); nan where missing.

    Returns:
        How many points, and their height [m]; None if there is no such pile.
    """
    z = heights[np.isfinite(heights)]
    for end, inwards in ((z.min(), z > z.min()), (z.max(), z < z.max())):
        rest = z[inwards]
        if not rest.size or rest.min() == rest.max():
            return None
        beside = rest.min() if end < rest[0] else rest.max()
        count = z.size - rest.size
        if count >= MANY and count > TIMES * np.count_nonzero(rest == beside):
            return int(count), float(end)
    return None


def gap_in_the_heights(heights: Array) -> tuple[float, float] | None:
    """The longest range without a height, where it is a quarter of that which holds 98 % of them.

    The steps of a coarse detector are no gap: the next longest range is nearly as long.

    Args:
        heights: heights [m], shape (nx, ny); nan where missing.

    Returns:
        Its lower and upper end [m]; None if there is none.
    """
    low, high = np.nanpercentile(heights, [1.0, 99.0])
    z = np.sort(heights[(heights >= low) & (heights <= high)])
    widths = np.diff(z)
    if widths.size < 2:
        return None
    order = np.argpartition(widths, widths.size - 2)[-2:]
    if widths[order[1]] <= max(EMPTY * (high - low), TIMES * widths[order[0]]):
        return None
    return float(z[order[1]]), float(z[order[1] + 1])


def where_missing(heights: Array) -> str:
    """Where points are missing: ``"deepest"``, ``"highest"`` or, without a rule, ``"anywhere"``.

    The points around a hole tell: nine in ten of them, each weighing as much as its hole is large,
    lie in the lower or in the upper half of all heights.

    Args:
        heights: levelled heights [m], shape (nx, ny); nan where missing.
    """
    missing = np.isnan(heights)
    holes, count = label(missing, np.ones((3, 3)))
    hole = np.where(missing, 0, maximum_filter(holes, 3))
    rim = hole > 0
    if not rim.any():
        return "anywhere"
    area, length = (np.bincount(x.ravel(), minlength=count + 1) for x in (holes, hole))
    weight = (area / np.maximum(length, 1))[hole[rim]]
    low = float(weight @ (heights[rim] < np.nanmedian(heights)) / weight.sum())
    return "deepest" if low > RIM else "highest" if low < 1.0 - RIM else "anywhere"


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
    if (gap := gap_in_the_heights(topo.heights)) is not None:
        doubts.append(
            f"no height between {1e6 * gap[0]:.6g} and {1e6 * gap[1]:.6g} um: two surfaces at"
            " different heights, or a file whose numbers are read wrongly; cut the scan to one"
            " surface, or export it as text"
        )
    share = float(topo.valid.mean())
    if share < FEW_VALID:
        doubts.append(f"only {share:.0%} of the points are valid")
    return tuple(f"{topo.source}: implausible: {text}" for text in doubts)

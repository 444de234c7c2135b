"""A scan or an artificial surface: heights that know their size; levelling, clean-up, doubts.

Every treatment has a name and a count: nothing is masked, filled or rescaled silently.
Doubts are what makes the heights of a scan implausible, and where points of it are missing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import label, maximum_filter, minimum_filter
from scipy.sparse.linalg import splu

from brake_fenicsx.arguments import Array, Mask, one_of, positive, real
from brake_fenicsx.display import html_table
from brake_fenicsx.errors import SurfaceError

SAME_PIXEL = 1e-6  # relative difference that the rounding of a file explains
LEVELS = ("none", "mean", "plane", "second-order")
OUTLIERS = ("spike", "mad", "none")

# A value this often at the end of the heights, and so much more often than the next, is no height.
MANY, TIMES = 10, 10
EMPTY = 0.25  # of the range of the heights without any: two surfaces, or numbers read wrongly
FEW_VALID = 0.7  # share of the points
RIM = 0.9  # of the rims of holes lie in the lower half of the heights where the deepest are missing
# Sides of a pixel that differ by less than this are equal: a size may leave a point out.
SQUARE = 0.02


@dataclass(frozen=True, slots=True)
class SynthesisRecord:
    """What the synthesis reached.

    Attributes:
        psd_error: rms over the rings of C / C_target - 1 of the family's mean, every ring with its
            weight in the mean square slope [-].
        slope_ratio: rms slope of the family over that of the spectrum [-].
        C0_scale: factor between the given PSD and the one imposed: 1, unless the variance is that
            of the scan [-].
        S_q: root-mean-square height of the family [m].
        low: treatment of the wave numbers below the scan's band.
        low_share: share of the variance in those wave numbers [-].
    """

    psd_error: float
    slope_ratio: float
    C0_scale: float
    S_q: float
    low: str
    low_share: float


@dataclass(frozen=True, slots=True)
class Topography:
    """Heights on a regular grid of pixels.

    Attributes:
        heights: heights [m], shape (nx, ny); nan where the instrument saw nothing.
        size: lengths of the scan [m], shape (2,); a pixel measures ``size / (nx, ny)``.
        periodic: whether the surface repeats itself without a step.
        source: where the heights come from, for messages and reports.
        warnings: what is doubtful about an artificial surface.
        record: errors reached by the synthesis, for an artificial surface.
    """

    heights: Array
    size: Array
    periodic: bool = False
    source: str = ""
    warnings: tuple[str, ...] = ()
    record: SynthesisRecord | None = field(default=None, compare=False)

    def __repr__(self) -> str:
        """One line."""
        (nx, ny), (lx, ly) = self.shape, 1e3 * self.size
        return f"Topography({self.source}: {nx} x {ny} points, {lx:.4g} x {ly:.4g} mm)"

    def _repr_html_(self) -> str:
        """Size and heights as a table of a notebook."""
        h = 1e6 * self.heights[self.valid]
        rows: list[list[Any]] = [
            ["points missing", int(np.sum(~self.valid))],
            ["S_q [um]", float(h.std())],
            ["lowest and highest [um]", f"{h.min():.4g} to {h.max():.4g}"],
            ["pixel [um]", "{:.4g} x {:.4g}".format(*(1e6 * self.pixel))],
            ["periodic", "yes" if self.periodic else "no"],
        ]
        return html_table(repr(self), ("", ""), rows)

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of pixels (nx, ny)."""
        return self.heights.shape[0], self.heights.shape[1]

    @property
    def pixel(self) -> Array:
        """Lengths of one pixel [m], shape (2,)."""
        return self.size / np.array(self.heights.shape)

    @property
    def valid(self) -> Mask:
        """Where a height was measured, shape (nx, ny)."""
        return np.isfinite(self.heights)


def make_topography(
    heights: Array, size: Array | tuple[float, float], periodic: bool = False, source: str = "array"
) -> Topography:
    """Check heights and size and put them together.

    Args:
        heights: heights [m], shape (nx, ny); nan, inf or masked where missing.
        size: lengths [m], shape (2,).
        periodic: whether the surface repeats itself.
        source: name for messages.

    Raises:
        SurfaceError: not a two-dimensional array, no valid point, or a size that is not positive.
    """
    h, lengths = real(f"{source}: heights", heights), real(f"{source}: size", size)
    if h.ndim != 2 or min(h.shape) < 2:
        raise SurfaceError(f"""{source}: heights of shape {h.shape}; a scan has at least 2 x 2
            pixels""")
    if lengths.shape != (2,) or not np.all(lengths > 0.0):
        raise SurfaceError(f"{source}: size {size} m; give two positive lengths as 'size'")
    if np.isnan(h).all():
        raise SurfaceError(f"{source}: no valid point in the scan; measure again or mask less")
    return Topography(h, lengths, periodic, source)


Scans = Topography | Sequence[Topography]  # of one surface, on the same grid


def first(scans: Scans) -> Topography:
    """The scan, or the first of several: all have its grid."""
    return scans if isinstance(scans, Topography) else scans[0]


def on_grid_of(reference: Topography, scan: Topography) -> Topography:
    """A scan that can be averaged with another one, with exactly the lengths of that.

    Args:
        reference: the other scan.
        scan: the scan, whose pixels may differ by rounding.

    Raises:
        SurfaceError: pixels of another size, or another number of them: the spectra would not
            have the same wave vectors.
    """
    if not np.allclose(scan.pixel, reference.pixel, rtol=SAME_PIXEL, atol=0.0):
        one, other = (
            " x ".join(f"{1e6 * float(v):.6g}" for v in t.pixel) for t in (scan, reference)
        )
        raise SurfaceError(f"""pixels of {one} um, and of {other} um in {reference.source}: scans
            are averaged on one grid; measure them alike, or correct surface.size, which applies to
            all""")
    if scan.shape != reference.shape:
        (nx, ny), (mx, my) = scan.shape, reference.shape
        raise SurfaceError(f"""{nx} x {ny} pixels, and {mx} x {my} in {reference.source}: scans are
            averaged on one grid; cut both to {min(nx, mx)} x {min(ny, my)} pixels""")
    return replace(scan, size=reference.size)


def form(topo: Topography, level: str) -> Array:
    """Least-squares form of the valid heights [m], shape (nx, ny).

    Args:
        topo: the scan.
        level: ``"none"`` (zero), ``"mean"``, ``"plane"`` or ``"second-order"`` (all terms x^i y^j
            with i + j <= 2).
    """
    one_of("level", level, LEVELS)
    if level == "none":
        return np.zeros(topo.shape)
    order = {"mean": 0, "plane": 1, "second-order": 2}[level]
    # Products of Legendre polynomials, which are all but independent.
    vander: Any = np.polynomial.legendre.legvander
    x, y = (vander(np.linspace(-1.0, 1.0, n), order) for n in topo.shape)
    i, j = np.array([(i, k - i) for k in range(order + 1) for i in range(k + 1)]).T
    inside = topo.valid
    if inside.sum() < i.size:
        raise SurfaceError(f"""{topo.source}: {inside.sum()} valid points cannot carry level =
            {level!r}""")
    middle = topo.heights[inside].mean()  # taken off first: an instrument's zero may be far away
    h = np.where(inside, topo.heights - middle, 0.0)
    products = np.einsum("xi,xk->xik", x, x), np.einsum("yj,yl->yjl", y, y)
    gram = np.einsum("xik,xjl->ijkl", products[0], np.tensordot(inside, products[1], 1))
    coefficients = np.zeros((order + 1, order + 1))
    rhs = (x.T @ h @ y)[i, j]
    coefficients[i, j] = np.linalg.lstsq(gram[i, j][:, i, j], rhs, rcond=None)[0]
    return np.asarray(x @ coefficients @ y.T + middle)


def outliers(heights: Array, rule: str = "spike", threshold: float = 6.0) -> Mask:
    """Mark points that do not belong to the surface.

    Both rules measure in robust standard deviations: 1.4826 times the median distance of the
    heights from their median.

    Args:
        heights: levelled heights [m], shape (nx, ny), nan where missing.
        rule: ``"spike"``: farther than ``threshold`` from the median of the 5 x 5 pixels around;
            a summit, however high, has flanks and stays. ``"mad"``: farther than ``threshold``
            from the median of all heights. ``"none"``.
        threshold: distance in robust standard deviations [-].
    """
    one_of("outliers", rule, OUTLIERS)
    positive(threshold=threshold)
    valid = np.isfinite(heights)
    middle = np.median(heights[valid])
    spread = 1.4826 * np.median(np.abs(heights[valid] - middle))
    if rule == "none" or spread == 0.0:
        return np.zeros(heights.shape, dtype=bool)
    far = threshold * spread
    if rule == "mad":
        return valid & (np.abs(np.where(valid, heights, middle) - middle) > far)
    z = fill(heights)
    marked = valid & ((maximum_filter(z, 5) - z > far) | (z - minimum_filter(z, 5) > far))
    i, j = np.nonzero(marked)  # the others are near all of the pixels around
    around = sliding_window_view(np.pad(z, 2, mode="edge"), (5, 5))[i, j]
    marked[i, j] = np.abs(np.median(around.reshape(i.size, 25), axis=1) - z[i, j]) > far
    return marked


def fill(heights: Array) -> Array:
    """Fill missing points with the harmonic function of the heights around them.

    Args:
        heights: heights [m], shape (nx, ny), nan where missing; at least one valid.

    Returns:
        Heights without nan [m], shape (nx, ny). Filled points lie between their neighbours, so
        no new extreme arises. Edges of the scan have no slope across them.
    """
    return filling(np.isnan(heights))(heights)


def filling(missing: Mask) -> Callable[[Array], Array]:
    """How to fill the same missing points of many surfaces, see ``fill``.

    Args:
        missing: where there is no height, shape (nx, ny); not everywhere.
    """
    if not missing.any():
        return lambda heights: heights
    count = int(missing.sum())
    number = np.full(missing.shape, -1)
    number[missing] = np.arange(count)
    # A rim of one pixel that is no neighbour: number -2.
    numbers = np.pad(number, 1, constant_values=-2)
    rows, columns, degree = [], [], np.zeros(count)
    nx, ny = missing.shape
    beside = [(slice(i, i + nx), slice(j, j + ny)) for i, j in ((0, 1), (2, 1), (1, 0), (1, 2))]
    for part in beside:
        other = numbers[part][missing]
        degree += other > -2
        rows.append(np.flatnonzero(other >= 0))
        columns.append(other[other >= 0])
    row, column = np.concatenate(rows), np.concatenate(columns)
    matrix = sp.diags(degree) - sp.csr_matrix((np.ones(row.size), (row, column)), (count, count))
    solver = splu(matrix.tocsc())

    def filled(heights: Array) -> Array:
        """These heights with the missing points filled, whatever stands there."""
        around = np.pad(np.where(missing, 0.0, heights), 1)
        result = heights.copy()
        result[missing] = solver.solve(sum(around[part][missing] for part in beside))
        return result

    return filled


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

"""What makes a scan implausible, or the statistics of it unlike those of the surface."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label, maximum_filter

from brake_fenicsx.surface.psd import RadialPsd
from brake_fenicsx.surface.spectrum import BiFractal
from brake_fenicsx.surface.topography import Topography

if TYPE_CHECKING:
    from brake_fenicsx.surface.statistics import SurfaceStatistics

Array = NDArray[np.float64]
# A value this often at the end of the heights, and so much more often than the next, is no height.
MANY, TIMES = 10, 10
EMPTY = 0.25  # of the range of the heights without any: two surfaces, or numbers read wrongly
FEW_VALID, MANY_OUTLIERS = 0.7, 0.05  # shares of the points
NOISE = -1.0  # white noise has a slope of 0; a steeper spectrum is that of a rough surface
MISSED = 2.0  # times the measured variance of an octave
FORM = 0.5  # share of the variance in a second-order form
DIRECTED = 0.5  # anisotropy; (r - 1) / (r + 1) of a surface stretched by r: three times as long
OTHER = 0.15  # relative difference of S_q of artificial surfaces and scan
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
    values, many = np.unique(heights[np.isfinite(heights)], return_counts=True)
    if values.size < 3:
        return None
    ends: Any = ((many[0], many[1], values[0]), (many[-1], many[-2], values[-1]))
    for count, beside, value in ends:
        if count >= MANY and count > TIMES * beside:
            return int(count), float(value)
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
    order = np.argsort(widths)[-2:]
    if order.size < 2 or widths[order[1]] <= max(EMPTY * (high - low), TIMES * widths[order[0]]):
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


def of_statistics(stats: SurfaceStatistics) -> tuple[str, ...]:
    """What is doubtful about statistics of scans, or given ones, one line each with its remedy."""
    lines = [line for one in stats.each for line in (*one.doubts, *_lost(one))]
    return (*lines, *_spectrum(stats), *_direction(stats), *_form(stats))


def _lost(stats: SurfaceStatistics) -> Iterator[str]:
    """Points that are missing by a rule, and too many outliers."""
    topo = stats.topography
    if topo is None:
        return
    share = stats.missing / topo.heights.size
    if stats.lost == "deepest":
        yield (
            f"{topo.source}: the deepest {share:.0%} of the surface are missing: how deep they are"
            " is not known; laws take them for as deep as the rims of the holes, and S_q, S_sk and"
            " S_ku are those of the rest"
        )
    if stats.lost == "highest":
        yield (
            f"{topo.source}: the highest {share:.0%} of the surface are missing, which carry the"
            " load: no law can be told from this scan; measure it with less light"
        )
    if (marked := stats.outliers / topo.heights.size) > MANY_OUTLIERS:
        yield (
            f"{topo.source}: {marked:.0%} of the points are spikes and were masked: no usual"
            " measurement; measure again"
        )


def _spectrum(stats: SurfaceStatistics) -> Iterator[str]:
    """Noise, and a spectrum that is not that of the scan."""
    fit, fitted = stats.bifractal, stats.spectrum.misfit is None
    if fit.convex:
        cut = f'surface.cutoff = "{2e6 * np.pi / fit.q_c:.3g} um"'
        why = f"this is usually instrument noise; set {cut}"
        if fit.c2 < NOISE:
            why = f"if this is instrument noise, set {cut}" + (
                '; if not, surface.spectrum = "measured"' if fitted else ""
            )
        yield (
            f"the PSD flattens above {fit.q_c:.3g} rad/m (slope {fit.c2:.2f} after"
            f" {fit.c1:.2f}){', which the bi-fractal model cannot represent' * fitted}: {why}"
        )
    wave, ratio = worst_octave(stats.psd, fit) if stats.psd and fitted else (np.nan, 1.0)
    if not 1 / MISSED < ratio < MISSED:
        more, times = ("more", ratio) if ratio > 1 else ("less", 1 / ratio)
        yield (
            f"the bi-fractal fit misses the spectrum: about a wavelength of {1e6 * wave:.3g} um"
            f" artificial surfaces have {times:.1f} times {more} variance than the scan; use"
            ' surface.spectrum = "measured"'
        )
    elif abs((times := stats.variance_ratio) - 1.0) > OTHER:
        cause = "waves longer than the scan, or heights that differ from place to place; scan more"
        if fitted:
            cause = 'the bi-fractal fit; use surface.spectrum = "measured"'
        elif any(one.lost != "anywhere" for one in stats.each):
            cause = "the missing points"
        yield f"artificial surfaces as large as the scan have {times:.2f} times its S_q: {cause}"


def _direction(stats: SurfaceStatistics) -> Iterator[str]:
    """Isotropic surfaces that stand for a scan with a direction."""
    if stats.anisotropy > DIRECTED and stats.spectrum.lay is None:
        grooves = np.degrees(stats.direction) % 180.0 - 90.0
        yield (
            f"the scan has a direction: grooves at {grooves:.0f} deg from its x axis, anisotropy"
            f" {stats.anisotropy:.2f}; the artificial surfaces have none: write surface.spectrum ="
            ' "directional"'
        )


def _form(stats: SurfaceStatistics) -> Iterator[str]:
    """A bow or bend that was not removed."""
    if stats.level != "second-order" and stats.curvature > FORM:
        yield (
            f"level = {stats.level!r} leaves a bow or bend with {stats.curvature:.0%} of the"
            " variance of the scan, which is form and not roughness: remove it with"
            ' surface.level = "second-order"'
        )


def worst_octave(psd: RadialPsd, fit: BiFractal) -> tuple[float, float]:
    """Where a fit is worst: wavelength [m] at the middle of the octave, and variance over measured.

    Args:
        psd: measured spectrum.
        fit: of it.
    """
    q, C = psd.q[psd.reliable], psd.C[psd.reliable]
    octave = np.floor(np.log2(q / q[0])).astype(int)
    many = np.bincount(octave) > 0
    own, other = (np.bincount(octave, q * density)[many] for density in (C, fit(q)))
    worst = int(np.argmax(np.abs(np.log(other / own))))
    middle = q[0] * 2.0 ** (np.flatnonzero(many)[worst] + 0.5)
    return float(2.0 * np.pi / middle), float(other[worst] / own[worst])

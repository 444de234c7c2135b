"""From scans to their statistics: what the artificial surfaces have to share with them.

Of a surface that a scan shows only in part, missing points are filled harmonically, and the filled
surface is smoother than the measured one: by how much at every wave number depends on the sizes of
the holes. Random surfaces of the spectrum that is sought lose the same points and are levelled,
filled and transformed like the scan; what they lose on average is what the scan has lost (indirect
inference).

Reference: C. Gourieroux, A. Monfort, E. Renault, J. Appl. Econometrics 8 (1993) S85,
doi:10.1002/jae.3950080507.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.fft

from brake_fenicsx.arguments import Array, one_of
from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.surface.hdf import matched, measured, moments, pooled
from brake_fenicsx.surface.psd import (
    Density,
    RadialPsd,
    anisotropy,
    radial_psd,
    ring_sums,
    wave_numbers,
    waves_of,
)
from brake_fenicsx.surface.record import SurfaceStatistics
from brake_fenicsx.surface.spectrum import BiFractal, fit_bifractal, spectrum_of
from brake_fenicsx.surface.topography import (
    Scans,
    Topography,
    fill,
    filling,
    form,
    implausible,
    outliers,
    where_missing,
)

# The paper's scan: 256 pixels over 1.8 mm; the band of statistics that come without a scan.
DISTRIBUTIONS = ("measured", "johnson", "normal")
PAPER_BAND = (2.0 * np.pi / 1.8e-3, np.pi * 256 / 1.8e-3)


def characterise(
    topo: Topography,
    level: str = "plane",
    outlier_rule: str = "spike",
    threshold: float = 6.0,
    cutoff: float | None = None,
    distribution: str = "measured",
    spectrum: str = "measured",
) -> SurfaceStatistics:
    """Level a scan, clean it, and take its moments, height distribution and spectrum.

    Args:
        topo: the scan.
        level: form to remove: ``"none"``, ``"mean"``, ``"plane"``, ``"second-order"``; only the
            mean of a periodic surface.
        outlier_rule: ``"spike"``, ``"mad"`` or ``"none"``; see ``topography.outliers``.
        threshold: robust standard deviations beyond which a point is an outlier [-].
        cutoff: shortest wave length the instrument resolves [m].
        distribution: ``hdf`` is ``"measured"`` (the heights themselves), ``"johnson"`` (matched to
            the four moments) or ``"normal"``.
        spectrum: ``"measured"``, ``"directional"`` or its ``"fit"``, see ``spectrum.spectrum_of``.

    Raises:
        SurfaceError: a flat scan, or too few valid points.
    """
    level = "mean" if topo.periodic and level != "none" else level  # it cannot have a tilt
    levelled, marked = _clean(topo, level, outlier_rule, threshold)
    h = levelled.heights[levelled.valid]
    zero = float(np.mean(topo.heights[levelled.valid]))
    mean, S_q, S_sk, S_ku = moments(h)
    if S_q <= 1e-12 * max(float(np.nanmax(np.abs(topo.heights))), 1e-300):
        raise SurfaceError(f"{topo.source}: the scan is flat; a rough surface is needed here")
    missing = int(topo.heights.size - topo.valid.sum())
    few = missing + marked <= FEW * topo.heights.size
    lost = "anywhere" if few else where_missing(levelled.heights)
    complete = _counted(levelled, lost)
    levelled = replace(levelled, heights=levelled.heights - np.nanmean(complete.heights))
    bow = np.nanvar(np.where(levelled.valid, form(levelled, "second-order"), np.nan)) / S_q**2
    return SurfaceStatistics(
        mean=zero, median=zero + float(np.median(h)) - mean, S_q=S_q, S_sk=S_sk, S_ku=S_ku,
        errors=_moment_errors(levelled),
        **described([complete], level, cutoff, distribution, spectrum),
        topography=levelled, level=level, missing=missing, lost=lost, outliers=marked,
        curvature=0.0 if topo.periodic else float(bow), doubts=implausible(topo),
    )  # fmt: skip


def averaged(
    scans: Sequence[SurfaceStatistics],
    cutoff: float | None = None,
    distribution: str = "measured",
    spectrum: str = "measured",
) -> SurfaceStatistics:
    """Statistics of several scans of one surface together; those of one scan as they are.

    Variance, spectrum, mean and median are means over the scans, all of one weight; skewness,
    kurtosis and distribution are those of all heights about the mean plane of each scan.

    Args:
        scans: statistics of each scan, on one grid (``topography.on_grid_of``).
        cutoff: shortest wave length the instrument resolves [m].
        distribution: as for ``characterise``.
        spectrum: as for ``characterise``.
    """
    if len(scans) == 1:
        return scans[0]
    topos = [_counted(t, scan.lost) for scan in scans for t in scan.topographies]
    each = np.array([(s.mean, s.S_q, s.S_sk, s.S_ku, s.median) for s in scans])
    errors = each[:, :4].std(axis=0, ddof=1) / np.sqrt(len(scans))
    _, S_q, S_sk, S_ku = moments(pooled([t.heights for s in scans for t in s.topographies]))
    return SurfaceStatistics(
        mean=float(each[:, 0].mean()), median=float(each[:, 4].mean()), errors=_four(errors),
        S_q=S_q, S_sk=S_sk, S_ku=S_ku,
        **described(topos, scans[0].level, cutoff, distribution, spectrum),
        level=scans[0].level, missing=sum(s.missing for s in scans),
        outliers=sum(s.outliers for s in scans), curvature=max(s.curvature for s in scans),
        scans=tuple(scans),
    )  # fmt: skip


def _counted(topo: Topography, lost: str) -> Topography:
    """Levelled heights that artificial surfaces are made from: filled where valleys are missing.

    No instrument sees how deep they are, and the contact does not reach them: the holes count as
    area of the height of their rim.
    """
    if lost != "deepest":
        return topo
    filled = fill(topo.heights)
    return replace(topo, heights=filled - filled.mean())


def described(
    scans: Sequence[Topography], level: str, cutoff: float | None, distribution: str, spectrum: str
) -> dict[str, Any]:
    """Distribution and spectra of levelled scans of one surface together, by their names.

    Args:
        scans: levelled scans on one grid.
        level: form that was removed.
        cutoff: as for ``characterise``.
        distribution: as for ``characterise``.
        spectrum: as for ``characterise``.
    """
    one_of("distribution", distribution, DISTRIBUTIONS)
    heights = [t.heights for t in scans]

    def taken(psd: RadialPsd) -> BiFractal:
        return spectrum_of(scans, psd, fit_bifractal(psd), "measured")

    psd = without_holes(radial_psd(scans, cutoff), scans, level, taken)
    johnson = distribution != "measured"
    hdf = matched(*moments(pooled(heights))[1:], distribution) if johnson else measured(heights)
    fit = fit_bifractal(psd)
    strength, direction = anisotropy(scans, psd.band)
    spectra = {"psd": psd, "bifractal": fit, "spectrum": spectrum_of(scans, psd, fit, spectrum)}
    return {"hdf": hdf, **spectra, "anisotropy": strength, "direction": direction}


def given_statistics(
    S_q: float,
    S_sk: float = 0.0,
    S_ku: float = 3.0,
    c1: float = -2.0,
    c2: float = -4.5,
    q_c: float = 30e3,
    mean: float = 0.0,
    band: tuple[float, float] = PAPER_BAND,
    distribution: str = "johnson",
) -> SurfaceStatistics:
    """Statistics from numbers alone; the defaults are the paper's slopes and our corner.

    Args:
        S_q: root-mean-square height [m].
        S_sk: skewness [-].
        S_ku: kurtosis [-].
        c1: slope of ln C over ln q below the corner [-], negative or zero.
        c2: slope above the corner [-], negative.
        q_c: corner wave number [rad/m].
        mean: mean height over the instrument's zero [m].
        band: wave numbers of the scan behind the numbers (lo, hi) [rad/m]; C0 follows from S_q
            over this band, and ``low = "flat"`` holds the PSD below it.
        distribution: ``"johnson"`` or ``"normal"``.
    """
    if distribution not in ("johnson", "normal"):
        raise SurfaceError(f"""distribution = {distribution!r}: numbers hold no measured heights;
            choose 'johnson' or 'normal', or name a scan""")
    hdf = matched(S_q, S_sk, S_ku, distribution)
    if not (q_c > 0.0 and 0.0 < band[0] < band[1]):
        raise SurfaceError(f"q_c = {q_c} rad/m, band = {band} rad/m: give positive wave numbers")
    if not (c1 <= 0.0 and c2 < 0.0):
        raise SurfaceError(f"c1 = {c1}, c2 = {c2}: slopes of a rough surface are negative")
    unit = BiFractal(c1, c2, q_c, 1.0, band)
    bifractal = BiFractal(c1, c2, q_c, S_q**2 / unit.variance(*band), band)
    errors = _four(np.full(4, np.nan))
    return SurfaceStatistics(mean, mean, S_q, S_sk, S_ku, errors, hdf, bifractal, bifractal)


def _clean(topo: Topography, level: str, rule: str, threshold: float) -> tuple[Topography, int]:
    """Levelled heights without outliers, zero mean, and the number of outliers."""
    heights = topo.heights - form(topo, level)
    marked = outliers(heights, rule, threshold)
    if marked.any():
        kept = Topography(np.where(marked, np.nan, topo.heights), topo.size, topo.periodic)
        heights = kept.heights - form(kept, level)
    heights = heights - np.nanmean(heights)
    levelled = Topography(heights, topo.size, topo.periodic, topo.source)
    return levelled, int(marked.sum())


def _moment_errors(topo: Topography, blocks: int = 4) -> tuple[float, float, float, float]:
    """Standard errors of the moments by leaving out one of blocks x blocks tiles at a time."""
    if min(topo.shape) < 4 * blocks:
        return _four(np.full(4, np.nan))
    tile = np.add.outer(
        np.arange(topo.shape[0]) * blocks // topo.shape[0] * blocks,
        np.arange(topo.shape[1]) * blocks // topo.shape[1],
    )[topo.valid]
    h = topo.heights[topo.valid]
    spread = h.std()
    z = (h - h.mean()) / spread
    sums = np.array([np.bincount(tile, z**k, blocks**2) for k in range(5)])
    sums = (sums.sum(axis=1)[:, None] - sums)[:, sums[0] > 0]
    one, two, three, four = sums[1:] / sums[0]
    variance = two - one**2
    third = three - 3.0 * one * two + 2.0 * one**3
    fourth = four - 4.0 * one * three + 6.0 * one**2 * two - 3.0 * one**4
    S_q = np.sqrt(variance)
    values = np.array([spread * one, spread * S_q, third / S_q**3, fourth / variance**2]).T
    n = len(values)
    return _four(np.sqrt((n - 1) / n * np.sum((values - values.mean(axis=0)) ** 2, axis=0)))


def _four(values: Array) -> tuple[float, float, float, float]:
    mean, S_q, S_sk, S_ku = (float(v) for v in values)
    return mean, S_q, S_sk, S_ku


SURFACES = 16  # of all scans together
ROUNDS = 2
FEW = 0.01  # share of missing points that changes no ring by more
LIKE = 0.7  # coherence over the share of measured points below which waves are not shown
Filling = Callable[[Array], Array]


def without_holes(
    psd: RadialPsd, scans: Scans, level: str, spectrum: Callable[[RadialPsd], Density]
) -> RadialPsd:
    """The radial PSD that scans would have without missing points, on average.

    Its reliable band ends where the filled scans no longer show the waves of the surface.

    Args:
        psd: that of the filled scans.
        scans: levelled scan, or several.
        level: form that was removed from them.
        spectrum: of a radial PSD, what surfaces are made from.
    """
    every = [scans] if isinstance(scans, Topography) else list(scans)
    measured = float(np.mean([scan.valid.mean() for scan in every]))
    if measured > 1.0 - FEW:
        return psd
    fillings = [filling(~scan.valid) for scan in every]
    found = psd
    for _ in range(ROUNDS):
        share, likeness = _shown(spectrum(found), every, fillings, level)
        found = replace(psd, C=psd.C / share)
        short = psd.reliable & (psd.q > np.sqrt(psd.band[0] * psd.band[1]))
        unlike = psd.q[short & (likeness < LIKE * measured)]
        if unlike.size:
            found = replace(found, band=(psd.band[0], min(psd.band[1], float(unlike[0]))))
    return found


def _shown(
    C: Density, scans: Sequence[Topography], fillings: Sequence[Filling], level: str
) -> tuple[Array, Array]:
    """Share of the density that filled scans show of every ring, and their coherence with it [-].

    Coherence of the waves of the filled and of the complete surface: their mean product squared,
    over the product of their mean squares.
    """
    rng = np.random.default_rng(0)  # the same surfaces for every spectrum
    sums: Any = 0.0
    for k in range(max(SURFACES, len(scans))):
        scan, filled = scans[k % len(scans)], fillings[k % len(scans)]
        complete = _levelled(replace(scan, heights=_cut(C, scan, rng)), level)
        seen = np.where(scan.valid, complete.heights, np.nan)
        shown = filled(_levelled(replace(scan, heights=seen), level).heights)
        one, other = waves_of(shown, scan), waves_of(complete.heights, scan)
        sums = sums + np.array([np.abs(one) ** 2, np.abs(other) ** 2, (one * other.conj()).real])
    shown, whole, both = (ring_sums(part, scans[0]) for part in sums)
    return shown / whole, both**2 / (shown * whole)


def _levelled(topo: Topography, level: str) -> Topography:
    return replace(topo, heights=topo.heights - form(topo, level))


def _cut(C: Density, scan: Topography, rng: np.random.Generator) -> Array:
    """Normally distributed heights of the size of a scan, cut from a surface twice as long [m]."""
    times = 1 if scan.periodic else 2
    shape, size = (times * scan.shape[0], times * scan.shape[1]), times * scan.size
    q = wave_numbers(shape, size)
    amplitude = np.sqrt(C(q) * 4.0 * np.pi**2 * (shape[0] * shape[1]) / np.prod(size))
    noise = scipy.fft.rfft2(rng.standard_normal(shape))
    heights = scipy.fft.irfft2(noise * amplitude, s=shape)
    return np.asarray(heights[: scan.shape[0], : scan.shape[1]])

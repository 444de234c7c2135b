"""Statistics of a surface as another scan of it would give them.

The other scan is a cut of an artificial surface of the same statistics, twice as long as the scan:
it has the scatter of long waves and of few summits, and is levelled and described like the scan
(parametric bootstrap). Tiles of the scan drawn with replacement, the block bootstrap, scatter half
as much as scans do: a scan holds few of its own longest waves.

Reference: B. Efron, R. J. Tibshirani, An Introduction to the Bootstrap (1993), section 6.5,
doi:10.1201/9780429246593.
"""

from dataclasses import replace

import numpy as np

from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.surface.hdf import moments, pooled
from brake_fenicsx.surface.record import SurfaceStatistics
from brake_fenicsx.surface.statistics import described
from brake_fenicsx.surface.synthesis import synthesise
from brake_fenicsx.surface.topography import Topography, form


def resampled(stats: SurfaceStatistics, rng: np.random.Generator) -> SurfaceStatistics:
    """Statistics of as many other scans as they were taken from, without errors and doubts.

    Args:
        stats: statistics of scans.
        rng: random numbers of the draw.

    Raises:
        SurfaceError: the statistics were given by numbers alone.
    """
    if stats.psd is None or not stats.topographies:
        raise SurfaceError("statistics given by numbers have no scan that could be drawn anew")
    kind = "fit" if stats.spectrum.misfit is None else "measured"
    kind = kind if stats.spectrum.lay is None else "directional"
    scans = []
    for one in stats.each:
        scan = _other(stats, one, rng)
        heights = scan.heights - form(scan, stats.level)
        scans.append(replace(scan, heights=heights - np.nanmean(heights)))
    heights = pooled([scan.heights for scan in scans])
    cutoff, no_errors = 2.0 * np.pi / stats.psd.band[1], (np.nan,) * 4
    found = described(scans, stats.level, cutoff, stats.hdf.name, kind)
    found["spectrum"] = replace(found["spectrum"], form=stats.spectrum.form)
    mean, S_q, S_sk, S_ku = moments(heights)
    return SurfaceStatistics(
        mean, float(np.median(heights)), S_q, S_sk, S_ku, no_errors, **found, level=stats.level
    )


def _other(
    stats: SurfaceStatistics, one: SurfaceStatistics, rng: np.random.Generator
) -> Topography:
    """A scan of the size, the pixels and the missing points of another.

    Where the deepest points were missing the surface has flat valleys, and none is missing.
    """
    scan = one.topographies[0]
    (nx, ny), times = scan.shape, 1 if scan.periodic else 2
    size = times * scan.size
    whole = synthesise(
        stats.spectrum, stats.hdf, (times * nx, times * ny), (size[0], size[1]), rng, "extend"
    )
    shown = scan.valid | (one.lost == "deepest")
    heights = np.where(shown, whole.heights[:nx, :ny], np.nan)
    return replace(scan, heights=heights, source=f"{scan.source}, drawn anew")

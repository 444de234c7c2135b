"""Statistics of scans as other scans of the same surface would give them.

Heights are those of tiles drawn with replacement (block bootstrap). A tile is as large as one
independent height: the area A over the number N of independent heights, for which the variance of
the mean square of normal heights is 2 / N. Every ring of the spectrum is multiplied by a random
number of mean one and the ring's own variance (frequency-domain bootstrap).

Reference: H. R. Kunsch, Ann. Stat. 17 (1989) 1217, doi:10.1214/aos/1176347265; J. Franke,
W. Hardle, Ann. Stat. 20 (1992) 121, doi:10.1214/aos/1176348515.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.surface.hdf import Measured, fit_tail, matched, moments, summits
from brake_fenicsx.surface.psd import half_plane_weights, psd_2d
from brake_fenicsx.surface.spectrum import fit_bifractal, spectrum_of
from brake_fenicsx.surface.statistics import SurfaceStatistics
from brake_fenicsx.surface.topography import Array, Topography


def resampled(stats: SurfaceStatistics, rng: np.random.Generator) -> SurfaceStatistics:
    """Statistics of a scan drawn from one, or of several drawn from several.

    Args:
        stats: statistics of scans.
        rng: random numbers of the draw.

    Raises:
        SurfaceError: the statistics were given by numbers alone.
    """
    psd, topos = stats.psd, stats.topographies
    if psd is None or not topos:
        raise SurfaceError("statistics given by numbers have no scan that could be drawn anew")
    drawn = [topos[k] for k in rng.integers(0, len(topos), len(topos))]
    heights = np.concatenate([_tiles(topo, rng) for topo in drawn])
    heights = np.sort(heights - heights.mean())
    _, S_q, S_sk, S_ku = moments(heights)
    hdf = (
        Measured(heights, fit_tail(heights, summits([t.heights for t in topos])))
        if stats.hdf.name == "measured"
        else matched(S_q, S_sk, S_ku, stats.hdf.name)
    )
    scatter = np.maximum(psd.scatter, 1e-12)
    density = replace(psd, C=psd.C * rng.gamma(1.0 / scatter, scatter))
    fit = replace(fit_bifractal(density), form=stats.bifractal.form)
    kind = "fit" if stats.spectrum.misfit is None else "measured"
    spectrum = replace(spectrum_of(topos, density, fit, kind), form=stats.spectrum.form)
    return replace(
        stats, S_q=S_q, S_sk=S_sk, S_ku=S_ku, hdf=hdf, psd=density, bifractal=fit, spectrum=spectrum
    )


def independent_heights(topo: Topography) -> float:
    """Number of independent normal heights whose mean square scatters as that of a scan."""
    powers = half_plane_weights(topo.shape) * psd_2d(topo)
    squares = half_plane_weights(topo.shape) * psd_2d(topo) ** 2
    return float(powers.sum() ** 2 / squares.sum())


def _tiles(topo: Topography, rng: np.random.Generator) -> Array:
    """Valid heights of as many tiles as cover the scan, from anywhere in it [m], shape (n,)."""
    side = np.sqrt(np.prod(topo.size) / independent_heights(topo))
    sides = np.clip(np.rint(side / topo.pixel).astype(int), 1, topo.shape)
    count = round(float(np.prod(topo.shape) / np.prod(sides)))
    corners = rng.integers(0, np.array(topo.shape) - sides + 1, (max(count, 1), 2))
    tiles = [topo.heights[i : i + sides[0], j : j + sides[1]].ravel() for i, j in corners]
    heights = np.concatenate(tiles)
    return heights[np.isfinite(heights)]

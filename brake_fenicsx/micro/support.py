"""What a law rests on: the pixels that carry it, and its scatter over scans of one surface.

At the pressures of braking a few highest pixels of a scan carry the load. Another scan of the same
pad has others: laws of statistics that are drawn anew (``surface.resampled``) show by how much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from brake_fenicsx.micro.law import Array, LawSteps
from brake_fenicsx.micro.law_of_surface import law_steps
from brake_fenicsx.micro.library import LawRecipe
from brake_fenicsx.surface import SurfaceStatistics, resampled

PRESSURES = (0.05e6, 0.1e6, 0.2e6, 0.4e6)  # of braking [Pa]
FEW_PIXELS = 100  # of a scan, below which a law hangs on single summits
WINDOW = 0.15  # relative half-width of pressure over which a secant is taken


@dataclass(frozen=True, slots=True)
class LawSupport:
    """Pixels behind laws, and the scatter of laws over scans, at some mean pressures.

    Attributes:
        pressure: mean pressures [Pa], shape (m,).
        scan_pixels: pixels of the scans that are higher than what touches, median, shape (m,).
        grid_pixels: pixels of a patch that touch, median, shape (m,).
        k: 5, 50 and 95 % of the secant stiffness of loading of another scan [Pa/m], shape (3, m).
        v: the same of the stiffness of vibrations [Pa/m], shape (3, m).
    """

    pressure: Array
    scan_pixels: Array
    grid_pixels: Array
    k: Array
    v: Array

    def warning(self) -> str | None:
        """What is doubtful about the laws, or None."""
        few = self.scan_pixels < FEW_PIXELS
        if not few.any():
            return None
        i = int(np.flatnonzero(few)[-1])
        return (
            f"laws: at {self.pressure[i] / 1e6:.2g} MPa the highest {self.scan_pixels[i]:.0f}"
            " pixels of the scan carry the load; another scan gives"
            f" {self.v[0, i] / self.v[1, i]:.2f} to {self.v[2, i] / self.v[1, i]:.2f} times the"
            " stiffness of vibrations (90 %): take a larger scan, or several"
        )


def drawn_law(recipe: LawRecipe, stats: SurfaceStatistics, seed: int, number: int) -> Array:
    """One patch of one scan drawn anew, pressed to the highest of ``PRESSURES``.

    Args:
        recipe: what all laws share.
        stats: statistics of the scan.
        seed: seed of the library.
        number: of the draw, which has its own child of the seed.

    Returns:
        Rows scan pixels, grid pixels, k and v [Pa/m], shape (4, m).
    """
    child = np.random.SeedSequence(seed, spawn_key=(number, 1))
    other = resampled(stats, np.random.default_rng(child))
    top = min(2.0 * max(PRESSURES), recipe.settings.highest)
    settings = replace(recipe.settings, max_pressure=top)
    topo = replace(recipe, psd=other.spectrum, hdf=other.hdf).surface(seed, number)
    steps = law_steps(topo, settings)
    S_q = float(topo.heights.std())
    scan = [stats.pixels_above(d, S_q) for d in _at(steps, steps.d)]
    grid = _at(steps, steps.area) * topo.heights.size
    return np.stack([scan, grid, secant(steps), _at(steps, steps.v)])


def law_support(draws: Sequence[Array]) -> LawSupport:
    """Medians over draws, and the bands in which another scan lies.

    Draws scatter about this scan as this scan does about the surface: the logarithm of the ratio of
    two scans has twice their variance.

    Args:
        draws: what ``drawn_law`` returns.
    """
    scan, grid, k, v = np.swapaxes(draws, 0, 1)
    bands = []
    for stiffness in (k, v):
        ends = np.quantile(stiffness, [0.05, 0.5, 0.95], axis=0)
        bands.append(ends[1] * (ends / ends[1]) ** np.sqrt(2.0))
    medians = np.median(scan, axis=0), np.median(grid, axis=0)
    return LawSupport(np.array(PRESSURES), *medians, *bands)


def secant(steps: LawSteps) -> Array:
    """Stiffness of loading over +-15 % of each of ``PRESSURES`` [Pa/m]."""
    x, p = np.log(steps.p), np.array(PRESSURES)
    d = [np.interp(np.log(p * (1.0 + side * WINDOW)), x, steps.d) for side in (1.0, -1.0)]
    return np.asarray(2.0 * WINDOW * p / np.maximum(d[1] - d[0], 1e-15))


def _at(steps: LawSteps, values: Array | None) -> Array:
    return np.interp(np.log(PRESSURES), np.log(steps.p), np.asarray(values))

"""What a law rests on: the pixels that carry it, and its scatter over scans of one surface.

At the pressures of braking a few highest pixels of a scan carry the load. Another scan of the same
pad has others: laws of statistics that are drawn anew (``surface.resampled``) show by how much.
Two things scatter: patches of one scan, and scans. A face of a brake has many patches, and its
stiffness is that of the library, in which the scatter of patches has gone down to that of its mean.
The scatter of scans alone shows in patches that are made of the same random numbers for every scan.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from brake_fenicsx.arguments import Array
from brake_fenicsx.micro.law import LawSteps
from brake_fenicsx.micro.law_of_surface import WIDTH, law_steps
from brake_fenicsx.micro.library import LawRecipe
from brake_fenicsx.micro.settings import LawSettings
from brake_fenicsx.surface import SurfaceStatistics, Topography, resampled

PRESSURES = (0.05e6, 0.1e6, 0.2e6, 0.4e6)  # of braking [Pa]
FEW_PIXELS = 100  # of a scan, below which a law hangs on single summits
COMMON = 2  # patches that all draws have, of random numbers of their own
ELASTIC = 50  # loads of the line through an elastic law
WINDOW = 0.15  # relative half-width of pressure over which a secant is taken


@dataclass(frozen=True, slots=True)
class LawSupport:
    """Pixels behind laws, and the scatter of laws over scans, at some mean pressures.

    Attributes:
        pressure: mean pressures [Pa], shape (m,).
        scan_pixels: pixels of the scans that are higher than what touches, median, shape (m,).
        grid_pixels: pixels of a patch that touch, median, shape (m,).
        k: 5, 50 and 95 % of the secant stiffness of loading of the library (geometric mean) of
            another scan [Pa/m], shape (3, m).
        v: the same of the stiffness of vibrations [Pa/m], shape (3, m).
        k_patch: as ``k``, of a single patch of another scan [Pa/m], shape (3, m).
        v_patch: as ``v``, of a single patch [Pa/m], shape (3, m).
    """

    pressure: Array
    scan_pixels: Array
    grid_pixels: Array
    k: Array
    v: Array
    k_patch: Array
    v_patch: Array

    def warning(self) -> str | None:
        """What is doubtful about the laws, or None."""
        few = self.scan_pixels < FEW_PIXELS
        if not few.any():
            return None
        i = int(np.flatnonzero(few)[-1])
        library, patch = (
            " to ".join(f"{band[j, i] / band[1, i]:.2f}" for j in (0, 2))
            for band in (self.v, self.v_patch)
        )
        return (
            f"laws: at {self.pressure[i] / 1e6:.2g} MPa the highest {self.scan_pixels[i]:.0f}"
            f" pixels of the scan carry the load; the laws of another scan have {library} times the"
            f" stiffness of vibrations on average (90 %), a single patch {patch} times: take a"
            " larger scan, or several"
        )


def drawn_law(recipe: LawRecipe, stats: SurfaceStatistics, seed: int, number: int) -> Array:
    """Patches of one scan drawn anew, pressed to ``PRESSURES``.

    Args:
        recipe: what all laws share.
        stats: statistics of the scan.
        seed: seed of the library.
        number: of the draw, which has its own child of the seed.

    Returns:
        Rows scan pixels, grid pixels, k and v [Pa/m] of a patch of its own random numbers, then k
        and v of each of the patches that all draws have, shape (4 + 2 COMMON, m).
    """
    child = np.random.SeedSequence(seed, spawn_key=(number, 1))
    other = resampled(stats, np.random.default_rng(child))
    drawn, loads = replace(recipe, psd=other.spectrum, hdf=other.hdf), loads_of(recipe.settings)

    def press(patch: Topography) -> LawSteps:
        return law_steps(patch, recipe.settings, only=loads)

    topo = drawn.surface(seed, COMMON + number)
    steps = press(topo)
    S_q = float(topo.heights.std())
    scan = [stats.pixels_above(d, S_q) for d in _at(steps, steps.d)]
    grid = _at(steps, steps.area) * topo.heights.size
    common = [stiffness(press(drawn.surface(seed, i))) for i in range(COMMON)]
    return np.stack([scan, grid, *stiffness(steps), *np.concatenate(common)])


def loads_of(settings: LawSettings) -> Array:
    """Mean pressures [Pa] that the stiffnesses at ``PRESSURES`` are read from, rising.

    Under a hardness these and the ends of the secants; the vibration stiffness of an elastic
    surface is the slope of a line through many.
    """
    p = np.array(PRESSURES)
    if settings.hardness is None:
        beyond = np.exp(0.5 * WIDTH)
        loads = np.geomspace(p[0] / beyond, p[-1] * beyond, ELASTIC)
    else:
        loads = np.sort(np.outer([1.0 - WINDOW, 1.0, 1.0 + WINDOW], p).ravel())
    return np.append(loads[:-1][loads[:-1] < settings.highest], min(loads[-1], settings.highest))


def law_support(draws: Sequence[Array], laws: Sequence[LawSteps]) -> LawSupport:
    """Medians over draws, and the bands in which another scan lies.

    Draws scatter about this scan as this scan does about the surface: the logarithm of the ratio of
    two scans has twice the variance of scans, and that of the means of both libraries. Bands are
    those of Student's distribution, about the mean of the laws.

    Args:
        draws: what ``drawn_law`` returns, two or more.
        laws: the library.
    """
    scan, grid, *one = np.swapaxes(draws, 0, 1)[:4]
    common = np.log(np.array(draws)[:, 4:]).reshape(len(draws), COMMON, 2, -1)
    wide = stdtrit(len(draws) - 1, 0.95)
    library = np.log([stiffness(law) for law in laws])
    bands = []
    for i, (centre, single) in enumerate(zip(library.mean(axis=0), one, strict=True)):
        scans = _between(common[:, :, i])
        patches = np.maximum(np.var(np.log(single), axis=0, ddof=1) - scans, 0.0)
        for variance in (patches * 2.0 / len(laws), patches * (1.0 + 1.0 / len(laws))):
            reach = wide * np.sqrt(2.0 * scans + variance)
            bands.append(np.exp(centre + np.outer([-1.0, 0.0, 1.0], reach)))
    medians = np.median(scan, axis=0), np.median(grid, axis=0)
    k_band, k_patch, v_band, v_patch = bands
    return LawSupport(np.array(PRESSURES), *medians, k_band, v_band, k_patch, v_patch)


def _between(values: Array) -> Array:
    """Variance of scans in a table of scans and patches, without that of single entries.

    Args:
        values: of every scan and patch, shape (scans, patches, m).
    """
    rows = values.mean(axis=1)
    rest = values - rows[:, None] - values.mean(axis=0) + values.mean(axis=(0, 1))
    scans, patches = values.shape[:2]
    single = np.sum(rest**2, axis=(0, 1)) / ((scans - 1) * (patches - 1))
    return np.asarray(np.maximum(np.var(rows, axis=0, ddof=1) - single / patches, 0.0))


def stiffness(steps: LawSteps) -> Array:
    """Secant stiffness of loading and stiffness of vibrations at ``PRESSURES``, shape (2, m)."""
    return np.stack([secant(steps), _at(steps, steps.v)])


def secant(steps: LawSteps) -> Array:
    """Stiffness of loading over +-15 % of each of ``PRESSURES`` [Pa/m]."""
    x, p = np.log(steps.p), np.array(PRESSURES)
    d = [np.interp(np.log(p * (1.0 + side * WINDOW)), x, steps.d) for side in (1.0, -1.0)]
    return np.asarray(2.0 * WINDOW * p / np.maximum(d[1] - d[0], 1e-15))


def _at(steps: LawSteps, values: Array | None) -> Array:
    return np.interp(np.log(PRESSURES), np.log(steps.p), np.asarray(values))

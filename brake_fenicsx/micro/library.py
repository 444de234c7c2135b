"""Libraries of laws: many surfaces of one kind, their files, and what the laws rest on.

At the pressures of braking a few highest pixels of a scan carry the load. Another scan of the same
pad has others: laws of statistics that are drawn anew (``surface.resampled``) show by how much.
Two things scatter: patches of one scan, and scans. A face of a brake has many patches, and its
stiffness is that of the library, in which the scatter of patches has gone down to that of its mean.
The scatter of scans alone shows in patches that are made of the same random numbers for every scan.
"""

import json
import logging
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from math import ceil, log2
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import stdtrit

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import read_npz, reading
from brake_fenicsx.micro.law import LawLibrary, LawSteps, Longer, make_library
from brake_fenicsx.micro.law_of_surface import WIDTH, LawSettings, doubts, law_steps, reach
from brake_fenicsx.micro.loading import solve_contact
from brake_fenicsx.surface import (
    BiFractal,
    HeightDistribution,
    SurfaceStatistics,
    Topography,
    resampled,
    synthesise,
)

logger = logging.getLogger("brake_fenicsx")


@dataclass(frozen=True, slots=True)
class LawRecipe:
    """Everything a law needs but its random numbers.

    Attributes:
        psd: spectrum of the surfaces.
        hdf: distribution of their heights.
        settings: how they are pressed.
        shape: pixels of a patch (nx, ny).
        size: lengths of a patch [m].
        low: treatment of waves longer than the scan, ``"flat"`` or ``"extend"``.
        variance: ``"spectrum"`` or ``"scan"``: see ``synthesise``.
    """

    psd: BiFractal
    hdf: HeightDistribution
    settings: LawSettings
    shape: tuple[int, int] = (128, 128)
    size: tuple[float, float] = (2.825e-3, 2.825e-3)
    low: str = "flat"
    variance: str = "spectrum"

    def surface(self, seed: int, number: int) -> Topography:
        """Artificial surface ``number`` of the family of ``seed``.

        It draws from its own child of the seed: any surface can be made again alone.
        """
        child = np.random.SeedSequence(seed, spawn_key=(number,))
        rng = np.random.default_rng(child)
        return synthesise(self.psd, self.hdf, self.shape, self.size, rng, self.low, self.variance)

    def law(self, seed: int, number: int, pressure: float = np.inf) -> LawSteps:
        """Steps of the law of that surface up to a mean pressure [Pa], see ``law_steps``."""
        return law_steps(self.surface(seed, number), self.settings, pressure)

    def reach(self, steps: LawSteps, pressure: float) -> float:
        """Mean pressure [Pa] up to which steps made for a pressure are those of the whole law."""
        return reach(steps, self.settings, pressure)

    def longer(self, seed: int) -> Longer:
        """What makes laws of the family of ``seed`` longer, to twice a pressure or beyond.

        Pressures are rounded up to powers of two [MPa], so that a law has few lengths, which are
        kept.
        """

        @cache
        def made(number: int, power: int) -> tuple[LawSteps, float]:
            pressure = 1e6 * 2.0**power
            logger.info("law %d is made longer, to %.3g MPa", number, pressure / 1e6)
            steps = self.law(seed, number, pressure)
            return steps, self.reach(steps, pressure)

        def longer(number: int, pressure: float) -> tuple[LawSteps, float]:
            return made(number, ceil(log2(min(pressure, self.settings.highest) / 1e6)) + 1)

        return longer

    def record(self) -> dict[str, Any]:
        """What the laws were made with, for the record on disk."""
        own = {name: getattr(self, name) for name in ("shape", "size", "low")}
        spectrum = {name: getattr(self.psd, name) for name in ("c1", "c2", "q_c", "C0", "band")}
        if (form := self.psd.form) is not None:
            spectrum["form"] = (form.c1, form.c2, form.q_c, form.C0, form.band)
        heights = {"variance": self.variance, "S_q": self.hdf.S_q, "distribution": self.hdf.name}
        return own | asdict(self.settings) | spectrum | heights


def force_above(
    recipe: LawRecipe, seed: int, mean_pressure: float, limit: float, surfaces: int = 5
) -> float:
    """Share of the force that is carried at more than a pressure, at a mean pressure [-].

    Elastic summits carry far more than any lining does before it yields.

    Args:
        recipe: what all laws share.
        seed: seed of the library.
        mean_pressure: mean pressure on a patch [Pa].
        limit: pressure [Pa].
        surfaces: how many surfaces are pressed; the median of their shares is returned.

    Example:
        >>> pad = given_statistics(10e-6, 0.0, 3.0)
        >>> settings = LawSettings(2.4e9, boundary="periodic")
        >>> recipe = LawRecipe(pad.bifractal, pad.hdf, settings, (32, 32))
        >>> round(force_above(recipe, seed=1, mean_pressure=0.2e6, limit=10e6), 1)
        1.0
    """
    shares = []
    for number in range(surfaces):
        topo = recipe.surface(seed, number)
        load = mean_pressure * float(np.prod(topo.size))
        p = solve_contact(
            topo.heights, topo.size, recipe.settings.E_star, load=load,
            boundary=recipe.settings.boundary, tol=recipe.settings.tolerance,
            hardness=recipe.settings.hardness,
        ).pressure  # fmt: skip
        shares.append(float(p[p > limit].sum() / p.sum()))
    return float(np.median(shares))


def law_library(recipe: LawRecipe, n: int, seed: int) -> LawLibrary:
    """Make ``n`` laws on this process; a run spreads them over its processes.

    Args:
        recipe: what all laws share.
        n: number of laws.
        seed: seed of the library; law i belongs to its child i.

    Example:
        >>> pad = given_statistics(10e-6, 0.0, 3.0)
        >>> settings = LawSettings(2.4e9, max_pressure=1e6)
        >>> recipe = LawRecipe(pad.bifractal, pad.hdf, settings, (32, 32))
        >>> law_library(recipe, 2, seed=1)
        LawLibrary(2 laws up to 1e+06 Pa)
    """
    if n < 1:
        raise SceneError(f"laws = {n}: at least one")
    for text in doubts(recipe.surface(seed, 0)):  # what is doubtful about one is about all
        logger.warning("%s", text)
    steps = [recipe.law(seed, i) for i in range(n)]
    settings = {**recipe.record(), "seed": seed}
    return make_library(steps, list(range(n)), settings)


def save_laws(path: str | Path, laws: LawLibrary) -> None:
    """Write a library: its arrays under their names, and the settings as JSON.

    Args:
        path: ``.npz`` file to write.
        laws: the library.

    Example:
        >>> steps = LawSteps(np.array([1e-6, 0.0]), np.array([1e5, 4e5]), np.array([2e11, 6e11]))
        >>> with TemporaryDirectory() as folder:
        ...     save_laws(Path(folder) / "laws.npz", make_library([steps]))
        ...     load_laws(Path(folder) / "laws.npz")
        LawLibrary(1 laws up to 4e+05 Pa)
    """
    arrays = {name: getattr(laws, name) for name in ("count", "seed", "reach", *LawSteps._fields)}
    arrays = {name: array for name, array in arrays.items() if array is not None}
    with Path(path).open("wb") as file:
        np.savez(file, settings=np.array(json.dumps(laws.settings, sort_keys=True)), **arrays)


def load_laws(path: str | Path) -> LawLibrary:
    """Read a library that ``save_laws`` wrote.

    Raises:
        SceneError: no such file, not a library, or one of an earlier version.

    Example:
        >>> steps = LawSteps(np.array([1e-6, 0.0]), np.array([1e5, 4e5]), np.array([2e11, 6e11]))
        >>> with TemporaryDirectory() as folder:
        ...     save_laws(Path(folder) / "laws.npz", make_library([steps]))
        ...     load_laws(Path(folder) / "laws.npz")
        LawLibrary(1 laws up to 4e+05 Pa)
    """
    file = Path(path)
    with reading(file, "as a library of laws", "remove it and run the micro stage"):
        arrays: dict[str, Any] = dict(read_npz(file))
        settings = json.loads(str(arrays.pop("settings")))
        if "ratio" in arrays:
            raise ValueError("laws of an earlier version, which were wrong between their steps")
        return LawLibrary(settings=settings, **arrays)


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
            f"laws: at {self.pressure[i] / 1e6:.2g} MPa only {self.scan_pixels[i]:.0f} pixels of"
            f" the scan are as high as what touches; the laws of another scan have {library} times"
            f" the stiffness of vibrations on average (90 %), a single patch {patch} times: take a"
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

"""Libraries of laws: many surfaces of one kind, and their files."""

import json
import logging
from dataclasses import asdict, dataclass
from functools import cache
from math import ceil, log2
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import read_npz, reading
from brake_fenicsx.micro.law import LawLibrary, LawSteps, Longer, make_library
from brake_fenicsx.micro.law_of_surface import doubts, law_steps, reach
from brake_fenicsx.micro.loading import solve_contact
from brake_fenicsx.micro.settings import LawSettings
from brake_fenicsx.surface import BiFractal, HeightDistribution, Topography, synthesise

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

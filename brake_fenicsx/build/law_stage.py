"""From artificial surfaces to the library of pressure-gap laws."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, replace
from functools import partial
from math import ceil, inf, log2
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import BrakeError, NotConverged, SceneError, StorageError
from brake_fenicsx.extensions import beside_samples
from brake_fenicsx.folder.files import digest, emptied, whole_file
from brake_fenicsx.folder.log import Progress, logger
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.digest import laws_key
from brake_fenicsx.stages import Run, note_warnings

if TYPE_CHECKING:
    from brake_fenicsx.micro import LawLibrary, LawRecipe, LawSteps
    from brake_fenicsx.micro.halfspace import Boundary
    from brake_fenicsx.micro.settings import BulkCompliance
    from brake_fenicsx.micro.support import LawSupport
    from brake_fenicsx.scene.surface_section import Micro
    from brake_fenicsx.surface import SurfaceStatistics

PIECES = "cache/laws"
# Hardness of a hard lining, a usual pressure of braking [Pa], and the share of the force beyond
# the first at which elastic laws are doubtful.
SOFT, BRAKING, SOME = 400e6, 0.2e6, 0.1
# Laws are made up to this multiple of the mean pressure of the contact, and to this pressure [Pa]:
# the hardest patch of a brake carries two to three times the mean.
TIMES, LEAST = 4.0, 1e6


def law_recipe(scene: Scene, stats: SurfaceStatistics) -> LawRecipe | None:
    """What the artificial surfaces and their laws are made from; None without the stage micro."""
    micro = scene.micro
    if micro is None or "micro" not in scene.stages:
        return None
    from brake_fenicsx.micro import LawRecipe, LawSettings, plane_strain_modulus

    surface = scene.surface
    if surface is None:
        raise SceneError(f"{scene.file}: surface: the section is missing")
    E_star = plane_strain_modulus(micro.E, micro.nu)
    settings = LawSettings(
        E_star,
        max_pressure=None if micro.max_pressure is None else micro.max_pressure * E_star,
        steps=micro.steps,
        boundary=cast("Boundary", micro.boundary),
        bulk_compliance=cast("BulkCompliance", micro.bulk_compliance),
        tolerance=micro.tolerance,
        hardness=micro.hardness,
    )
    pixels, side = int(micro.pixels), float(micro.patch)
    return LawRecipe(
        stats.spectrum, stats.hdf, settings, (pixels, pixels), (side, side), surface.low,
        surface.S_q,
    )  # fmt: skip


def micro_stage(this: Run, stats: SurfaceStatistics) -> LawLibrary:
    """Artificial surfaces to a library of pressure-gap laws, shared by the processes."""
    from brake_fenicsx.micro import load_laws, make_library, save_laws
    from brake_fenicsx.micro.law_of_surface import doubts

    scene, comm = this.scene, this.comm
    micro = scene.micro
    if micro is None:
        raise SceneError(f"{scene.file}: micro: the section is missing")
    path = this.store.path("laws.npz")
    wanted = wanted_pressure(this)

    def key() -> dict[str, Any]:
        return {**laws_key(scene), "pressure": wanted}

    with this.stage("micro"), this.cache.shared("laws.npz", key, comm):
        if not comm.bcast(path.exists(), root=0):
            recipe, number = law_recipe(scene, stats), micro.laws
            if recipe is None:
                raise SceneError(f"{scene.file}: stages: 'micro' is missing")
            first = recipe.surface(micro.seed, 0)
            if first.record is not None:
                r = first.record
                logger.info(
                    "artificial surfaces: %d x %d points; S_q %.2f um, that of the scan %.2f um;"
                    " spectrum of the scan times %.2f; %.0f %% of the variance in longer waves",
                    *first.shape, 1e6 * r.S_q, 1e6 * stats.S_q, r.C0_scale,
                    100 * r.low_share,
                )  # fmt: skip
            if wanted < recipe.settings.highest:
                logger.info(
                    "laws up to %.3g MPa, at least %.3g times the mean pressure of the contact; a"
                    " sample that needs more makes its laws longer", wanted / 1e6, TIMES,
                )  # fmt: skip
            pieces, again = _Pieces(this, key()), support_draws(micro, recipe, stats)
            what = "laws and scans drawn anew" if again else "laws"
            counts = (len(range(comm.rank, n, comm.size)) for n in (number, again))
            whose = " of the first process" * (comm.size > 1)
            progress = Progress(f"{what}{whose}", sum(counts))
            own = {}
            for i in range(comm.rank, number, comm.size):
                own[i] = pieces.law(i, recipe, wanted)
                progress.advance()
            steps = {i: law for part in comm.allgather(own) for i, law in part.items()}
            notes = comm.bcast(
                [*doubts(first), *beyond_elasticity(this, recipe)] if comm.rank == 0 else None
            )
            draw = partial(pieces.drawn, recipe=recipe, stats=stats)
            laws = [steps[i] for i in range(number)]
            support = support_of_laws(this, again, draw, progress, laws) if again else None
            if support is not None and (doubt := support.warning()):
                notes.append(doubt)
            settings = {**recipe.record(), "seed": micro.seed, "notes": notes}
            if support is not None:
                settings["support"] = {k: v.tolist() for k, v in asdict(support).items()}
            reach = [recipe.reach(steps, wanted) for steps in laws]
            library = make_library(laws, list(range(number)), settings, reach)
            if comm.rank == 0:
                with whole_file(path, durable=True) as part:
                    save_laws(part, library)
            comm.Barrier()
            if comm.rank == 0:
                emptied(this.store.path(PIECES))
        library = load_laws(path)
        note_warnings(this, library.settings["notes"])
        recipe = None if library.reach is None else law_recipe(scene, stats)
        return library if recipe is None else replace(library, longer=recipe.longer(micro.seed))


def wanted_pressure(this: Run) -> float:
    """Mean pressure up to which laws are made at first [Pa]; infinite for whole laws.

    Whole ones where the scene names their highest pressure, has no brake, or lets patches vibrate
    beside its samples (limit cycles). Brakes of about one load have one pressure, and so one
    library: a power of two [MPa].
    """
    pressed, area = this.facts.get("pressed_N"), this.facts.get("face_area_mm2")
    micro = this.scene.micro
    if not pressed or not area or micro is None or micro.max_pressure is not None:
        return inf
    if beside_samples(this.scene):  # a vibrating patch passes any pressure of the equilibrium
        return inf
    mean = 1e6 * float(pressed) / float(area)
    return LEAST * 2.0 ** max(0, ceil(log2(TIMES * mean / LEAST)))


class _Pieces:
    """Laws and scans drawn anew, each stored as it is solved, until the library is written."""

    def __init__(self, this: Run, key: dict[str, Any]):
        """Look at what they depend on."""
        self._store, self._key = this.store, digest(key)
        self._seed = 0 if this.scene.micro is None else this.scene.micro.seed
        self._store.path(PIECES).mkdir(parents=True, exist_ok=True)

    def law(self, number: int, recipe: LawRecipe, pressure: float) -> LawSteps:
        """Steps of a law to a pressure [Pa]."""
        from brake_fenicsx.micro import LawSteps

        def solve() -> dict[str, Any]:
            steps = recipe.law(self._seed, number, pressure)._asdict()
            return {name: a for name, a in steps.items() if a is not None}

        return LawSteps(**self._kept(f"law-{number:05d}", solve))

    def drawn(
        self, number: int, recipe: LawRecipe, stats: SurfaceStatistics
    ) -> NDArray[np.float64]:
        """The law of a scan drawn anew, see ``drawn_law``."""
        from brake_fenicsx.micro.support import drawn_law

        make = partial(drawn_law, recipe, stats, self._seed, number)
        return self._kept(f"drawn-{number:05d}", lambda: {"rows": make()})["rows"]

    def _kept(self, name: str, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        file = f"{PIECES}/{name}.npz"
        with suppress(SceneError):  # a damaged one is solved again
            found = self._store.load(file) or {}
            if str(found.pop("key", "")) == self._key:
                return found
        made = make()
        self._store.save(file, key=np.array(self._key), **made)
        return made


def support_draws(micro: Micro, recipe: LawRecipe, stats: SurfaceStatistics) -> int:
    """Scans that are drawn anew for the scatter of the laws; 0 without a scan or a band."""
    from brake_fenicsx.micro.support import PRESSURES

    wanted = stats.topographies and max(PRESSURES) < recipe.settings.highest
    return micro.scans if wanted else 0


def support_of_laws(
    this: Run, scans: int, draw: Callable[[int], NDArray[np.float64]], progress: Progress,
    laws: list[LawSteps],
) -> LawSupport | None:  # fmt: skip
    """Pixels behind the laws and their scatter over scans drawn anew; None without a band."""
    from brake_fenicsx.micro.support import law_support

    comm, draws = this.comm, dict[int, NDArray[np.float64]]()
    for i in range(comm.rank, scans, comm.size):
        try:
            draws[i] = draw(i)
        except StorageError:
            raise
        except BrakeError:  # a scan drawn anew may be too poor for a fit
            logger.debug("scan %d drawn anew gives no law", i, exc_info=True)
        progress.advance()
    every = {i: law for part in comm.allgather(draws) for i, law in part.items()}
    if len(every) < 0.8 * scans:
        logger.warning("only %d of %d scans drawn anew gave a law: no band", len(every), scans)
        return None
    return law_support([every[i] for i in sorted(every)], laws) if len(every) > 1 else None


def beyond_elasticity(this: Run, recipe: LawRecipe) -> list[str]:
    """Whether laws carry more than linings do, or end too low, at the pressure of the brake."""
    from brake_fenicsx.micro import force_above

    pressed, area = this.facts.get("pressed_N"), this.facts.get("face_area_mm2")
    mean = 1e6 * pressed / area if pressed and area else BRAKING
    highest = recipe.settings.highest
    if recipe.settings.hardness is not None:
        if mean < highest:
            return []
        return [
            f"laws end at {highest / 1e6:.3g} MPa, and the mean pressure of the contact is"
            f" {mean / 1e6:.3g} MPa: raise micro.max_pressure or micro.hardness"
        ]
    try:
        share = force_above(recipe, 0, mean, SOFT)
    except NotConverged as error:
        return [f"elastic laws: their highest pressures are not known: {error}"]
    if share < SOME:
        return []
    return [
        f"elastic laws: at a mean pressure of {mean / 1e6:.2g} MPa {100 * share:.0f} % of the force"
        f" is carried at more than {SOFT / 1e6:.0f} MPa, where linings yield; name micro.hardness"
    ]

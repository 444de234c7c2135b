"""From artificial surfaces to the library of pressure-gap laws."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from math import ceil, inf, log2
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from brake_fenicsx import micro
from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import BrakeError, NotConverged, SceneError, StorageError
from brake_fenicsx.extensions import beside_samples
from brake_fenicsx.folder.files import digest, emptied, whole_file
from brake_fenicsx.folder.log import Progress, logger
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.digest import laws_key

if TYPE_CHECKING:
    from brake_fenicsx.micro.halfspace import Boundary
    from brake_fenicsx.micro.law_of_surface import BulkCompliance
    from brake_fenicsx.scene.contact_section import Micro
    from brake_fenicsx.stages import Run
    from brake_fenicsx.surface import SurfaceStatistics, Topography

Made = TypeVar("Made")
PIECES = "cache/laws"
# Hardness of a hard lining, a usual pressure of braking [Pa], and the share of the force beyond
# the first at which elastic laws are doubtful.
SOFT, BRAKING, SOME = 400e6, 0.2e6, 0.1
# Laws are made up to this multiple of the mean pressure of the contact, and to this pressure [Pa]:
# the hardest patch of a brake carries two to three times the mean.
TIMES, LEAST = 4.0, 1e6


def law_recipe(scene: Scene, stats: SurfaceStatistics) -> micro.LawRecipe | None:
    """What the artificial surfaces and their laws are made from; None without the stage micro."""
    table = scene.micro
    if table is None or "micro" not in scene.stages:
        return None
    surface = scene.surface
    if surface is None:
        raise SceneError(f"{scene.file}: surface: the section is missing")
    E_star = micro.plane_strain_modulus(table.E, table.nu)
    settings = micro.LawSettings(
        E_star,
        max_pressure=None if table.max_pressure is None else table.max_pressure * E_star,
        steps=table.steps,
        boundary=cast("Boundary", table.boundary),
        bulk_compliance=cast("BulkCompliance", table.bulk_compliance),
        tolerance=table.tolerance,
        hardness=table.hardness,
    )
    n, side = int(table.pixels), float(table.patch)
    return micro.LawRecipe(
        stats.spectrum, stats.hdf, settings, (n, n), (side, side), surface.low, surface.S_q
    )


def micro_stage(this: Run, stats: SurfaceStatistics, file: str = "laws.npz") -> micro.LawLibrary:
    """Artificial surfaces to a library of pressure-gap laws, a file, shared by the processes."""
    scene, recipe = this.scene, law_recipe(this.scene, stats)
    table = scene.micro
    if table is None or recipe is None:
        raise SceneError(f"{scene.file}: micro: the section is missing")
    path, wanted = this.store.path(file), wanted_pressure(this)

    def key() -> dict[str, Any]:
        return {**laws_key(scene), "pressure": wanted}

    with this.stage("micro"), this.cache.shared(file, key, this.comm):
        path.parent.mkdir(exist_ok=True)
        if not this.comm.bcast(path.exists(), root=0):
            _Laws(this, stats, table, recipe, wanted, digest(key())).write(path)
        library = micro.load_laws(path)
        this.warn(library.settings["notes"])
        if library.reach is None:
            return library
        return replace(library, longer=recipe.longer(table.seed))


def wanted_pressure(this: Run) -> float:
    """Mean pressure up to which laws are made at first [Pa]; infinite for whole laws.

    Whole ones where the scene names their highest pressure, has no brake, lets patches vibrate
    beside its samples (limit cycles), or has elastic laws: single patches of a sample pass the mean
    many times over, and nearly every law would be made anew. Brakes of about one load have one
    pressure, and so one library: a power of two [MPa].
    """
    mean, table = _mean_pressure(this), this.scene.micro
    if mean is None or table is None or table.max_pressure is not None or table.hardness is None:
        return inf
    if beside_samples(this.scene):  # a vibrating patch passes any pressure of the equilibrium
        return inf
    return LEAST * 2.0 ** max(0, ceil(log2(TIMES * mean / LEAST)))


def _mean_pressure(this: Run) -> float | None:
    """Mean pressure of the contact of a brake [Pa]; None without a brake."""
    pressed, area = this.facts.get("pressed_N"), this.facts.get("face_area_mm2")
    return 1e6 * float(pressed) / float(area) if pressed and area else None


@dataclass(frozen=True, slots=True)
class _Laws:
    """Laws of a scene as they are made, each stored as it is solved until the library is written.

    Attributes:
        this: the run.
        stats: statistics of its surface.
        table: the section [micro].
        recipe: what the laws are made from.
        wanted: mean pressure up to which they are made [Pa].
        mark: digest of what they depend on.
    """

    this: Run
    stats: SurfaceStatistics
    table: Micro
    recipe: micro.LawRecipe
    wanted: float
    mark: str

    def write(self, path: Path) -> None:
        """Make the laws and the scatter of scans drawn anew, and write the library; collective."""
        from brake_fenicsx.micro.law_of_surface import doubts
        from brake_fenicsx.micro.library import PRESSURES, law_support

        comm, store, table, recipe = self.this.comm, self.this.store, self.table, self.recipe
        store.path(PIECES).mkdir(parents=True, exist_ok=True)
        first = recipe.surface(table.seed, 0)
        self._note(first)
        # Without a scan, or up to less than the pressures of the band, none is drawn anew.
        band = bool(self.stats.topographies) and max(PRESSURES) < recipe.settings.highest
        scans = table.scans if band else 0
        what = f"contact laws of {table.laws} surfaces"
        what += f" and {scans} resampled scans" * bool(scans)
        counts = (len(range(comm.rank, n, comm.size)) for n in (table.laws, scans))
        progress = Progress(f"{what}{f', process 1 of {comm.size}' * (comm.size > 1)}", *counts)
        laws = self._spread(table.laws, self._law, progress)
        notes = comm.bcast([*doubts(first), *self._beyond()] if comm.rank == 0 else None)
        settings = {**recipe.record(), "seed": table.seed, "notes": notes}
        drawn = self._spread(scans, self._drawn, progress)
        if len(drawn) < 0.8 * scans:
            logger.warning("only %d of %d resampled scans gave a law: no band", len(drawn), scans)
        elif len(drawn) > 1:
            support = law_support(drawn, laws)
            if doubt := support.warning():
                notes.append(doubt)
            settings["support"] = {k: v.tolist() for k, v in asdict(support).items()}
        reach = [recipe.reach(steps, self.wanted) for steps in laws]
        library = micro.make_library(laws, list(range(len(laws))), settings, reach)
        if comm.rank == 0:
            with whole_file(path, durable=True) as part:
                micro.save_laws(part, library)
        comm.Barrier()
        if comm.rank == 0:
            emptied(store.path(PIECES))

    def _note(self, first: Topography) -> None:
        """Log what the first surface is like, and how far laws go."""
        if (r := first.record) is not None:
            level = f", {r.C0_scale:.2f} times its power spectrum" * (abs(r.C0_scale - 1) > 0.005)
            logger.info(
                "artificial surfaces: %d x %d points, S_q %.2f um (scan: %.2f um)%s; waves longer"
                " than the scan have %.0f %% of the variance",
                *(*first.shape, 1e6 * r.S_q, 1e6 * self.stats.S_q, level, 100 * r.low_share),
            )
        if self.wanted < self.recipe.settings.highest:
            logger.info(
                "laws are computed up to %.3g MPa, at least %.3g times the mean contact pressure;"
                " a sample with higher pressures extends its own",
                *(self.wanted / 1e6, TIMES),
            )

    def _spread(
        self, count: int, make: Callable[[int], Made | None], progress: Progress
    ) -> list[Made]:
        """What the processes make of some numbers, in their order; None is left out."""
        comm, own = self.this.comm, dict[int, Made | None]()
        for i in range(comm.rank, count, comm.size):
            own[i] = make(i)
            progress.advance()
        every = {i: made for part in comm.allgather(own) for i, made in part.items()}
        return [every[i] for i in range(count) if every[i] is not None]

    def _law(self, number: int) -> micro.LawSteps:
        """Steps of a law."""

        def solve() -> dict[str, Any]:
            steps = self.recipe.law(self.table.seed, number, self.wanted)._asdict()
            return {name: a for name, a in steps.items() if a is not None}

        return micro.LawSteps(**self._kept(f"law-{number:05d}", solve))

    def _drawn(self, number: int) -> Array | None:
        """The law of a scan drawn anew, see ``drawn_law``; None of one too poor for a fit."""
        from brake_fenicsx.micro.library import drawn_law

        def solve() -> dict[str, Any]:
            return {"rows": drawn_law(self.recipe, self.stats, self.table.seed, number)}

        try:
            return self._kept(f"drawn-{number:05d}", solve)["rows"]
        except StorageError:
            raise
        except BrakeError:
            logger.debug("resampled scan %d gives no law", number, exc_info=True)
            return None

    def _kept(self, name: str, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        file = f"{PIECES}/{name}.npz"
        with suppress(SceneError):  # a damaged one is solved again
            found = self.this.store.load(file) or {}
            if str(found.pop("key", "")) == self.mark:
                return found
        made = make()
        self.this.store.save(file, key=np.array(self.mark), **made)
        return made

    def _beyond(self) -> list[str]:
        """Whether laws carry more than linings do, or end too low, at the brake's pressure."""
        mean, highest = _mean_pressure(self.this) or BRAKING, self.recipe.settings.highest
        if self.recipe.settings.hardness is not None:
            return [
                f"laws end at {highest / 1e6:.3g} MPa, and the mean pressure of the contact is"
                f" {mean / 1e6:.3g} MPa: raise micro.max_pressure or micro.hardness"
            ] * (mean >= highest)
        try:
            share = micro.force_above(self.recipe, 0, mean, SOFT)
        except NotConverged as error:
            return [f"elastic laws: their highest pressures are not known: {error}"]
        return [
            f"elastic laws: at a mean pressure of {mean / 1e6:.2g} MPa {100 * share:.0f} % of the"
            f" force is carried at more than {SOFT / 1e6:.0f} MPa, where linings yield; name"
            " micro.hardness"
        ] * (share >= SOME)

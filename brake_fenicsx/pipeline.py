"""The whole path, top to bottom: one function per stage, and only what the scene names.

scan -> statistics -> artificial surfaces -> laws -> brake -> equilibrium -> complex modes of every
sample -> tables, figures, fields.
"""

from __future__ import annotations

import shutil
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.checks import (
    check,
    remarks,
    surface_warnings,
    warnings,
    with_patch,
    with_pixels,
)
from brake_fenicsx.errors import BrakeError, NotConverged, SceneError
from brake_fenicsx.folder.cache import SharedCache
from brake_fenicsx.folder.entry import PREPARED, check_folder, enter_prepared, open_folder
from brake_fenicsx.folder.files import whole_file
from brake_fenicsx.folder.lock import Share
from brake_fenicsx.folder.log import Progress, logger, start_log
from brake_fenicsx.folder.memory import release_memory
from brake_fenicsx.folder.processes import in_turns, on_first, peak_memory
from brake_fenicsx.folder.store import Store
from brake_fenicsx.folder.termination import end_of_stage
from brake_fenicsx.results.versions import versions
from brake_fenicsx.scene import STAGES, Scene, read_scene
from brake_fenicsx.scene.digest import laws_key, result_digest
from brake_fenicsx.scene.friction import friction_texts, listed
from brake_fenicsx.scene.in_effect import in_effect

if TYPE_CHECKING:
    from brake_fenicsx.macro.brake import Brake
    from brake_fenicsx.micro import LawLibrary, LawRecipe
    from brake_fenicsx.micro.halfspace import Boundary
    from brake_fenicsx.micro.settings import BulkCompliance
    from brake_fenicsx.micro.support import LawSupport
    from brake_fenicsx.surface import SurfaceStatistics
    from brake_fenicsx.uncertainty.study import Study

# Hardness of a hard lining, a usual pressure of braking [Pa], and the share of the force beyond
# the first at which elastic laws are doubtful.
SOFT, BRAKING, SOME = 400e6, 0.2e6, 0.1
DRAWING = 4  # processes that draw figures: each reads all results


@dataclass(slots=True)
class Run:
    """A run as it goes: what the stages hand on.

    Attributes:
        scene: the scene.
        comm: processes of the run.
        store: its results folder.
        cache: what it shares with others.
        seconds: time of each stage [s].
        peak_memory_mb: peak memory of a node after each stage [MB].
        process_memory_mb: the same of a process.
        facts: sizes and figures for the summary.
        prepare: whether the run ends before the samples.
        pictures: whether figures, mode shapes and the mesh are drawn.
    """

    scene: Scene
    comm: MPI.Comm
    store: Store
    cache: SharedCache
    seconds: dict[str, float] = field(default_factory=dict)
    peak_memory_mb: dict[str, float] = field(default_factory=dict)
    process_memory_mb: dict[str, float] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)
    prepare: bool = False
    pictures: bool = True

    @property
    def whole(self) -> bool:
        """Whether the run ends with tables and page."""
        return not self.prepare and self.store.share is None

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Log and time a stage."""
        logger.info("stage '%s' ...", name)
        start = time.perf_counter()
        yield
        self.comm.Barrier()
        self.seconds[name] = time.perf_counter() - start
        self.process_memory_mb[name], self.peak_memory_mb[name] = peak_memory(self.comm)
        logger.info(
            "stage '%s' finished in %.1f s (peak memory %.0f MB)",
            name,
            self.seconds[name],
            self.peak_memory_mb[name],
        )
        release_memory()
        end_of_stage(self.comm)

    @property
    def page(self) -> Path | None:
        """The page of results; None without the stage report."""
        return self.store.path("report.html") if "report" in self.scene.stages else None

    def outcome(self) -> dict[str, Any]:
        """How the run ended, for other programs."""
        good = {name: about["good"] for name, about in self.facts.get("samples", {}).items()}
        return {
            "directory": str(self.store.directory.resolve()),
            "page": None if self.page is None else str(self.page.resolve()),
            "good_samples": good,
            "failed_samples": self.facts.get("failed_samples", 0),
            "seconds": {name: round(value, 3) for name, value in self.seconds.items()},
        }

    def ending(self) -> str:
        """How the run ended, and where to look."""
        if not self.whole:
            what = "prepared" if self.prepare else f"share {self.store.share} done"
            return f"{what}; `run` without --share makes tables and page of {self.store.directory}"
        outcome = self.outcome()
        said = "done"
        if failed := outcome["failed_samples"]:
            of = failed + sum(outcome["good_samples"].values())
            said += f", {failed} of {of} samples failed: see {self.store.path('samples.csv')}"
        look = f"results are in {self.store.directory}"
        return f"{said}; {look if self.page is None else f'open {self.page}'}"


def assemble(scene: str | Path, comm: MPI.Comm, overrides: Sequence[str] = ()) -> Brake:
    """Assemble a scene's brake: stiffness, mass, contact operators and loads.

    Args:
        scene: path of the scene.
        comm: the processes, each of which gets the whole brake.
        overrides: "key=value" replacements in the scene.

    Returns:
        ``K`` [N/m] and ``M`` [kg], the matrices of the bodies; ``N``, ``T``, ``R``, the gap and the
        slips along and across the sliding direction of every contact element; ``w`` [m^2], their
        areas; ``f`` [N], the loads; ``points`` [m], ``mesh``.
    """
    from brake_fenicsx.macro.brake import assemble_brake

    return assemble_brake(read_scene(scene, overrides), comm)


def run(
    scene: str | Path,
    comm: MPI.Comm,
    directory: str | Path | None = None,
    overrides: Sequence[str] = (),
    from_stage: str | None = None,
    cache: str | Path | None = None,
    share: Share | None = None,
    prepare: bool = False,
    pictures: bool = True,
) -> Run:
    """Run all stages of a scene, reusing existing results.

    Args:
        scene: path of the scene.
        comm: processes of the run.
        directory: results folder; SCENE-results in the working directory if not given.
        overrides: "key=value" replacements in the scene.
        from_stage: recompute from this stage on.
        cache: folder of laws and reduced models that runs of similar scenes share; none if not
            given.
        share: compute this part of the samples alone, in a folder that was prepared.
        prepare: make what all samples share, and end before them.
        pictures: whether figures, mode shapes and the mesh are drawn.

    Returns:
        The run; its results are in the folder.

    Raises:
        SceneError: the scene is wrong; nothing was written.
        BrakeError: a stage failed, or every sample.
    """
    parsed = read_scene(scene, overrides)
    if not parsed.stages:
        raise SceneError(
            f"{parsed.file}: stages = []: nothing to run; name some of {', '.join(STAGES)}"
        )
    if directory is None:
        directory = Path.cwd() / f"{parsed.file.stem}-results"
    store = Store(Path(directory))
    store.share = share
    check_folder(store, result_digest(parsed), comm)
    if not (parsed.samples.approaches and "equilibrium" in parsed.stages) and (share or prepare):
        raise SceneError(f"{parsed.file}: has no samples to be shared; write `run`, no --share")
    stats = check(parsed, comm)
    shared = SharedCache(store, None if cache is None else Path(cache))
    this = Run(parsed, comm, store, shared, prepare=prepare, pictures=pictures)
    new = not store.directory.exists()
    try:
        if share is None:
            open_folder(store, parsed.file.read_text(), from_stage, comm)
        else:
            command = f"brake-fenicsx prepare {parsed.file} -o {store.directory}"
            enter_prepared(store, parsed.samples.approaches, command, comm)
        log = "log.txt" if share is None else f"log-{share.number}-of-{share.of}.txt"
        start_log(comm.rank, this.store.path(log) if comm.rank == 0 else None)
        logger.info("%s -> %s, %d process(es)", parsed.file, this.store.directory, comm.size)
        for text in remarks(parsed, comm):
            logger.info("%s", text)
        note_warnings(this, warnings(parsed))
        _finish(this, stats, new)
    finally:
        if store.lock is not None:
            store.lock.leave()
    if this.whole:
        refuse_if_all_failed(this)
    logger.info("%s", this.ending())
    return this


def _finish(this: Run, stats: SurfaceStatistics | None, new: bool) -> None:
    """All stages, in a folder that was opened and is ours until the samples begin."""
    store, comm = this.store, this.comm
    try:
        compute(this, stats)
    except SceneError:
        # What only the mesh or the laws could tell; a folder with samples is kept.
        if new and comm.rank == 0 and not any(store.path("samples").iterdir()):
            shutil.rmtree(store.directory)
        raise
    if "report" in this.scene.stages and this.whole:
        with this.stage("report"):
            report(store.directory, comm, this.pictures)
        if comm.rank == 0:
            write_summary(this)


def refuse_if_all_failed(this: Run) -> None:
    """A run without a single good sample is no result, whatever page it has; collective.

    Raises:
        BrakeError: how many failed, and where their errors are.
    """
    good = sum(about["good"] for about in this.facts.get("samples", {}).values())
    failed = this.comm.bcast(0 if good else this.facts.get("failed_samples", 0), root=0)
    if failed:
        raise BrakeError(
            f"all samples failed ({failed} of {failed}); {this.store.path('samples.csv')} names the"
            " error of each, and --from uncertainty computes them again"
        )


def before_samples(
    this: Run, stats: SurfaceStatistics | None
) -> tuple[Brake | None, LawLibrary | None]:
    """Brake and laws of a scene, as far as its stages ask for them; collective."""
    stages = this.scene.stages
    # First, since laws may be made for the mean contact element.
    brake = brake_stage(this) if "equilibrium" in stages else None
    this.scene = with_pixels(this.scene, stats)
    if stats is not None and this.store.share is None:
        surface_stage(this, stats)
    return brake, micro_stage(this, stats) if "micro" in stages and stats else None


def compute(this: Run, stats: SurfaceStatistics | None) -> None:
    """All stages but the report."""
    brake, library = before_samples(this, stats)
    if brake is not None:
        mechanics(this, stats, library, brake)
    if this.comm.rank == 0 and this.whole:
        write_summary(this)
    this.comm.Barrier()


def surface_stage(this: Run, stats: SurfaceStatistics) -> None:
    """Write what is known of the surface."""
    with this.stage("surface"):
        fit = stats.bifractal
        for one in stats.each:
            if one.missing + one.outliers:
                name = Path(one.topography.source).name if one.topography else ""
                found = name, one.missing, one.outliers
                logger.info("scan %s: %d points missing, %d outliers masked", *found)
        if stats.scans:
            logger.info("means over %d scans, each of %d x %d points", len(stats.scans),
                        *stats.topographies[0].shape)  # fmt: skip
        logger.info(
            "S_q %.2f um, S_sk %.3f, S_ku %.3f; slopes %.2f and %.2f, corner %.1f /mm",
            stats.S_q * 1e6, stats.S_sk, stats.S_ku, fit.c1, fit.c2, fit.q_c / 1e3,
        )  # fmt: skip
        note_warnings(this, surface_warnings(this.scene, stats))
        if this.comm.rank == 0:
            from brake_fenicsx.report.inputs import surface_arrays

            this.store.save("surface.npz", **surface_arrays(stats, law_recipe(this.scene, stats)))


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
    with this.stage("micro"), this.cache.shared("laws.npz", lambda: laws_key(scene), comm):
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
            what = "laws" if comm.size == 1 else "laws of the first process"
            progress = Progress(what, len(range(comm.rank, number, comm.size)))
            own = {}
            for i in range(comm.rank, number, comm.size):
                own[i] = recipe.law(micro.seed, i)
                progress.advance()
            steps = {i: law for part in comm.allgather(own) for i, law in part.items()}
            notes = comm.bcast(
                [*doubts(first), *beyond_elasticity(this, recipe)] if comm.rank == 0 else None
            )
            support = support_of_laws(this, recipe, stats)
            if support is not None and (doubt := support.warning()):
                notes.append(doubt)
            settings = {**recipe.record(), "seed": micro.seed, "notes": notes}
            if support is not None:
                settings["support"] = {k: v.tolist() for k, v in asdict(support).items()}
            library = make_library([steps[i] for i in range(number)], list(range(number)), settings)
            if comm.rank == 0:
                with whole_file(path) as part:
                    save_laws(part, library)
            comm.Barrier()
        library = load_laws(path)
        note_warnings(this, library.settings["notes"])
        return library


def support_of_laws(this: Run, recipe: LawRecipe, stats: SurfaceStatistics) -> LawSupport | None:
    """Pixels behind the laws and their scatter over scans; None without a scan or a band."""
    from brake_fenicsx.micro.support import PRESSURES, drawn_law, law_support

    micro, comm = this.scene.micro, this.comm
    highest = recipe.settings.highest
    if micro is None or not (micro.scans and stats.topographies and max(PRESSURES) < highest):
        return None
    draws: dict[int, NDArray[np.float64]] = {}
    for i in range(comm.rank, micro.scans, comm.size):
        with suppress(BrakeError):  # a scan drawn anew may be too poor for a fit
            draws[i] = drawn_law(recipe, stats, micro.seed, i)
    every = {i: law for part in comm.allgather(draws) for i, law in part.items()}
    if len(every) < 0.8 * micro.scans:
        logger.warning(
            "only %d of %d scans drawn anew gave a law: no band", len(every), micro.scans
        )
        return None
    return law_support([every[i] for i in sorted(every)])


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


def brake_stage(this: Run) -> Brake:
    """Operators of the brake; the side of the mean contact element where laws are to have it."""
    from brake_fenicsx.macro.brake import assemble_brake
    from brake_fenicsx.macro.inventory import brake_doubts

    with this.stage("brake"):
        brake = assemble_brake(this.scene, this.comm)
        doubts = brake_doubts(this.scene, brake)
        this.facts |= brake.size()
        this.facts |= {
            "face_area_mm2": 1e6 * float(brake.w.sum()),
            "uncovered_area_mm2": 1e6 * brake.contact.uncovered,
            "pressed_N": brake.pressed,
            "worst_cell_quality": brake.mesh.quality,
        }
        if brake.mesh.worst is not None:
            this.facts["smallest_dihedral_deg"] = float(np.degrees(brake.mesh.worst.dihedral))
        logger.info(
            "%(cells)d cells, %(dofs)d free dofs, %(contact_elements)d contact elements"
            " with a mean side of %(mean_patch_mm).3f mm; worst quality of a cell"
            " %(worst_cell_quality).3f",
            this.facts,
        )
    if this.comm.size > 1 or not this.whole:
        from brake_fenicsx.uncertainty.shared_matrices import with_shared_matrices

        brake = with_shared_matrices(brake, this.store, this.comm)
    mean_patch = 1e-3 * float(this.facts["mean_patch_mm"])
    this.scene = with_patch(this.scene, mean_patch)
    note_warnings(this, [*doubts, *warnings(this.scene, mean_patch)])
    this.facts["friction"] = friction_texts(this.scene)
    logger.info("friction: %s", listed(this.scene))
    return brake


def note_warnings(this: Run, lines: list[str]) -> None:
    """Log what is most probably not meant, each once, and keep it for the page."""
    known = this.facts.setdefault("warnings", [])
    for text in lines:
        if text not in known:
            logger.warning("%s", text)
            known.append(text)


def note_open_points(this: Run) -> None:
    """Log what the modes of the samples leave open; the page says it from the summary."""
    from brake_fenicsx.report.overview import open_points
    from brake_fenicsx.results.run import RunData

    summary = {**this.facts, "in_effect": in_effect(this.scene)}
    if text := open_points(RunData(this.store.directory, summary=summary)):
        logger.warning("%s", text)


def make_study(
    this: Run, stats: SurfaceStatistics | None, library: LawLibrary | None, brake: Brake
) -> Study:
    """What the samples of a scene share, made or read from the folder; collective."""
    from brake_fenicsx.uncertainty.study import Study

    hdf = stats.hdf if stats else None
    waviness, surface, micro = None, this.scene.surface, this.scene.micro
    named = any(c.gap == "waviness" for c in this.scene.contact.values())
    if named and stats and surface and micro:
        from brake_fenicsx.surface.waviness import Waviness

        waviness = Waviness(stats.spectrum, float(micro.patch), surface.low)
    study = Study(this.scene, brake, library, hdf, this.store, this.comm, this.cache, waviness)
    with this.stage("offline"):
        study.prepare()
        this.facts |= study.facts
    return study


def mechanics(
    this: Run, stats: SurfaceStatistics | None, library: LawLibrary | None, brake: Brake
) -> None:
    """Shared reduction, and every sample's equilibrium and modes."""
    from brake_fenicsx.results.blocks import prepare_blocks

    study = make_study(this, stats, library, brake)
    with this.stage("samples"):
        prepare_blocks(study)
        if this.store.share is None and this.comm.rank == 0:
            numbers = Counter(name for name, _ in study.tasks)
            this.store.save_json(PREPARED, numbers)
        if not this.prepare:
            study.run()
        this.store.samples.tabulate = None  # it holds the brake
    if this.prepare:
        return
    sweep = None
    if this.scene.sweep is not None:
        from brake_fenicsx.sweeps.study import SweepStudy

        with this.stage("sweep"):
            sweep = SweepStudy(study)
            sweep.run()
    if not this.whole:
        return
    with this.stage("results"):
        if this.comm.rank == 0:
            this.store.forget_tables()
        from brake_fenicsx.results.stored import write_results

        first = write_results(study)
        if sweep is not None:
            this.facts |= sweep.write()
        this.facts |= study.facts
        if "stuck_contact" in this.facts:
            from brake_fenicsx.uncertainty.forces import stuck_warnings

            note_warnings(this, stuck_warnings(this.scene, this.facts["stuck_contact"]))
        note_open_points(this)
        if "report" in this.scene.stages:
            from brake_fenicsx.report.mode_fields import write_mode_fields

            write_mode_fields(study, first, this.pictures)
            if this.comm.rank == 0 and this.pictures:
                draw_mesh(this, brake)


def draw_mesh(this: Run, brake: Brake) -> None:
    """Picture of the mesh, a colour for each layer."""
    from brake_fenicsx.report.render import render_mesh

    tags = brake.mesh.cell_tags
    layer = np.zeros(tags.indices.max(initial=-1) + 1, dtype=int)
    layer[tags.indices] = tags.values
    names = {tag: name for name, tag in brake.mesh.layers.items()}
    title = "Mesh: {cells} cells, {dofs} free dofs".format(**this.facts)
    path = this.store.path("figures") / "mesh.png"
    render_mesh(path, brake.elastic.free.V, layer, names, title)


def write_summary(this: Run) -> None:
    """summary.json: settings, sizes, times, versions."""
    # Once: the page, written after the first summary, carries this date.
    this.facts.setdefault("finished", f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC")
    seeds = {"samples": this.scene.samples.seed}
    if this.scene.micro is not None:
        seeds["laws"] = this.scene.micro.seed
    this.store.save_json(
        "summary.json",
        {
            "name": this.scene.file.stem,
            "scene_sha256": this.store.digest,
            **this.facts,
            "processes": this.comm.size,
            "seconds": {name: round(value, 3) for name, value in this.seconds.items()},
            "peak_memory_mb": {name: round(v) for name, v in this.peak_memory_mb.items()},
            "process_memory_mb": {name: round(v) for name, v in this.process_memory_mb.items()},
            "seeds": seeds,
            "versions": versions(),
            "settings": this.scene.table,
            "in_effect": in_effect(this.scene),
        },
    )


def report(directory: Path, comm: MPI.Comm = MPI.COMM_SELF, pictures: bool = True) -> None:
    """Figures, tables and the HTML page of a results folder; collective.

    Args:
        directory: the results folder.
        comm: processes that share the figures.
        pictures: whether figures are drawn; those of mode shapes and the mesh stay as they are.
    """
    from brake_fenicsx.report.figures import make_figures
    from brake_fenicsx.report.html import write_report
    from brake_fenicsx.report.inputs import contact_maps
    from brake_fenicsx.report.overview import summary_table
    from brake_fenicsx.report.surface_section import write_surface_tables
    from brake_fenicsx.results.answer import write_tables
    from brake_fenicsx.results.run import RunData, read_run

    if pictures:
        on_first(lambda: contact_maps(directory), comm)
    draws, held = min(comm.size, DRAWING), list[RunData]()

    def draw(i: int) -> None:
        held.append(read_run(directory))
        make_figures(held[0], slice(i, None, draws), pictures)

    list(in_turns(draws, draw, comm))
    if comm.rank > 0:
        return
    (data,) = held
    # Those of an earlier run with other stages or keys.
    shutil.rmtree(directory / "tables", ignore_errors=True)
    write_tables(data)
    write_surface_tables(data)
    write_report(data, redraw=False)
    if data.samples is None and any((directory / "samples").glob("*.*")):
        logger.warning(
            "%s: samples without tables; `run` of the scene, with -o %s, makes them", directory,
            directory,
        )  # fmt: skip
    elif data.modes is None and (data.summary or {}).get("in_effect", {}).get("stability"):
        logger.warning(
            "%s: modes.csv is missing, and the page has no modes; `run` makes it again", directory
        )
    if data.modes is not None:
        # Line by line: the time stamp of the file would shift the heading alone.
        for line in summary_table(data).splitlines():
            logger.info("%s", line)

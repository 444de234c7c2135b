"""The whole path, top to bottom: one function per stage, and only what the scene names.

scan -> statistics -> artificial surfaces -> laws -> brake -> equilibrium -> complex modes of every
sample -> tables, figures, fields.
"""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np

from brake_fenicsx import checks
from brake_fenicsx.arguments import with_its_arguments
from brake_fenicsx.build.law_stage import law_recipe, micro_stage
from brake_fenicsx.description import earlier_run
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import load, named
from brake_fenicsx.folder import files, lock, processes
from brake_fenicsx.folder.log import Progress, logger, spared, start_log
from brake_fenicsx.folder.store import PREPARED, Store, check_folder, enter_prepared, open_folder
from brake_fenicsx.libraries import differences, versions
from brake_fenicsx.results.answer import open_points, summary_table, write_tables
from brake_fenicsx.results.run import RunData, read_run
from brake_fenicsx.scene import STAGES, Scene, read_scene
from brake_fenicsx.scene.digest import in_effect, result_digest
from brake_fenicsx.scene.scene import friction_texts, listed, own_surface
from brake_fenicsx.stages import Run

if TYPE_CHECKING:
    from brake_fenicsx.build.brake import Brake
    from brake_fenicsx.micro import LawLibrary
    from brake_fenicsx.results.output import First
    from brake_fenicsx.samples.sampling import Roughness
    from brake_fenicsx.samples.study import Study
    from brake_fenicsx.surface import SurfaceStatistics
    from brake_fenicsx.surface.spectrum import Waviness
    from brake_fenicsx.sweeps.sweep_study import SweepStudy

    Surfaces = Mapping[str, SurfaceStatistics]  # by the section of each


@with_its_arguments
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

    Example:
        >>> brake = assemble("scripts/scenes/block_on_plate.toml", MPI.COMM_SELF)
        >>> round(1e6 * float(brake.w.sum()))  # [mm^2]: the block's face is 40 mm x 20 mm
        800
    """
    from brake_fenicsx.build.brake import assemble_brake

    return assemble_brake(read_scene(scene, overrides), comm)


@with_its_arguments
def run(
    scene: str | Path,
    comm: MPI.Comm,
    directory: str | Path | None = None,
    overrides: Sequence[str] = (),
    from_stage: str | None = None,
    cache: str | Path | None = None,
    share: lock.Share | None = None,
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

    Example:
        >>> with TemporaryDirectory() as folder:
        ...     facts = run(
        ...         "scripts/scenes/block_on_plate.toml", MPI.COMM_SELF, folder,
        ...         ["stages=['equilibrium']"], pictures=False,
        ...     ).facts
        >>> forces = facts["contact_forces"]["multi-scale"]["block_plate"]
        >>> round(forces["normal_N"]), round(forces["friction_N"])  # 5 bar on 800 mm^2; mu = 0.5
        (400, 200)
    """
    parsed = read_scene(scene, overrides)
    if not parsed.stages:
        raise SceneError(f"""{parsed.file}: stages = []: nothing to run; name some of
            {", ".join(STAGES)}""")
    if directory is None:
        directory = Path.cwd() / f"{parsed.file.stem}-results"
    store = Store(Path(directory))
    store.share = share
    check_folder(store, result_digest(parsed), comm)
    if not (parsed.samples.approaches and "equilibrium" in parsed.stages) and (share or prepare):
        raise SceneError(f"{parsed.file}: has no samples to be shared; write `run`, no --share")
    surfaces = checks.check(parsed, comm)
    shared = files.SharedCache(store, None if cache is None else Path(cache))
    this = Run(parsed, comm, store, shared, prepare=prepare, pictures=pictures)
    new = not store.directory.exists()
    try:
        if share is None:
            open_folder(store, parsed.file.read_text("utf-8"), from_stage, comm)
        else:
            command = f"brake-fenicsx prepare {parsed.file} -o {store.directory}"
            enter_prepared(store, parsed.samples.approaches, command, comm)
        log = "log.txt" if share is None else f"log-{share.number}-of-{share.of}.txt"
        start_log(comm.rank, this.store.path(log) if comm.rank == 0 else None)
        logger.info("%s -> %s, %d process(es)", parsed.file, this.store.directory, comm.size)
        for text in checks.remarks(parsed, comm):
            logger.info("%s", text)
        this.warn([*checks.warnings(parsed), *_made_otherwise(store)])
        _finish(this, surfaces, new)
    finally:
        if store.lock is not None:
            store.lock.leave()
    if this.whole:
        this.refuse_if_all_failed()
    logger.info("%s", this.ending())
    return this


def _made_otherwise(store: Store) -> list[str]:
    """A warning where the results of the folder were made with other programs or kernels."""
    before = (earlier_run(store.directory) or {}).get("versions", {})
    made = differences({"versions": before}, {"versions": versions()})
    return [f"results in {store.directory} and this run differ: {'; '.join(made)}"] * bool(made)


def _finish(this: Run, surfaces: Surfaces, new: bool) -> None:
    """All stages, in a folder that was opened and is ours until the samples begin."""
    store, comm = this.store, this.comm
    try:
        brake, library = before_samples(this, surfaces)
        if brake is not None:
            mechanics(this, surfaces, library, brake)
    except SceneError:
        # What only the mesh or the laws could tell; a folder with samples is kept.
        if new and comm.rank == 0 and not any(store.path("samples").iterdir()):
            shutil.rmtree(store.directory)
        raise
    if comm.rank == 0 and this.whole:
        this.write_summary()
    comm.Barrier()
    if "report" in this.scene.stages and this.whole:
        with this.stage("report"):
            if "pictures" not in this.seconds:
                report(store.directory, comm, this.pictures, this.scene.own.figures)
            elif comm.rank == 0:
                write_page(read_run(store.directory))  # with the verification
        if comm.rank == 0:
            this.write_summary()


def before_samples(this: Run, surfaces: Surfaces) -> tuple[Brake | None, LawLibrary | None]:
    """Brake and laws of a scene, as far as its stages ask for them; collective."""
    stages, stats = this.scene.stages, surfaces.get("surface")
    # First, since laws may be made for the mean contact element.
    brake = brake_stage(this) if "equilibrium" in stages else None
    this.scene = checks.with_pixels(this.scene, stats)
    if stats is not None and this.store.share is None:
        surface_stage(this, stats)
    return brake, micro_stage(this, stats) if "micro" in stages and stats else None


def surface_stage(this: Run, stats: SurfaceStatistics) -> None:
    """Write what is known of the surface."""
    with this.stage("surface"):
        for one in stats.each:
            if one.missing + one.outliers:
                name = Path(one.topography.source).name if one.topography else ""
                found = name, one.missing, one.outliers
                logger.info("scan %s: %d points missing, %d outliers masked", *found)
        if stats.scans:
            sizes = len(stats.scans), *stats.topographies[0].shape
            logger.info("means over %d scans, each of %d x %d points", *sizes)
        logger.info("surface: %s", stats.told)
        this.warn(checks.surface_warnings(this.scene, stats))
        if this.comm.rank == 0:
            from brake_fenicsx.report.figure_inputs import surface_arrays

            recipe, micro = law_recipe(this.scene, stats), this.scene.micro
            arrays = surface_arrays(stats, recipe, micro.seed if micro else 0)
            this.store.save("surface.npz", **arrays)


def brake_stage(this: Run) -> Brake:
    """Operators of the brake; the side of the mean contact element where laws are to have it."""
    from brake_fenicsx.build.brake import assemble_brake
    from brake_fenicsx.build.brake_doubts import brake_doubts

    with this.stage("brake"):
        brake = assemble_brake(this.scene, this.comm)
        doubts = brake_doubts(this.scene, brake)
        this.facts |= brake.size()
        this.facts |= {
            "face_area_mm2": 1e6 * float(brake.w.sum()),
            "uncovered_area_mm2": 1e6 * brake.contact.uncovered,
            "pressed_N": brake.pressed,
            "worst_cell_quality": brake.mesh.quality,
            "mesh_sha256": brake.mesh.digest,
        }
        if brake.mesh.worst is not None:
            this.facts["smallest_dihedral_deg"] = float(np.degrees(brake.mesh.worst.dihedral))
        logger.info(
            "%(cells)d finite elements, %(dofs)d free dofs; %(contact_elements)d contact elements"
            " of %(mean_patch_mm).3f mm mean side; worst quality of an element"
            " %(worst_cell_quality).3f (1: regular)",
            this.facts,
        )
    if this.comm.size > 1 or not this.whole:
        from brake_fenicsx.samples.numbering import with_shared_matrices

        brake = with_shared_matrices(brake, this.store, this.comm)
    mean_patch = 1e-3 * float(this.facts["mean_patch_mm"])
    this.scene = checks.with_patch(this.scene, mean_patch)
    this.warn([*doubts, *checks.warnings(this.scene, mean_patch)])
    this.facts["friction"] = friction_texts(this.scene)
    logger.info("friction: %s", listed(this.scene))
    return brake


def note_open_points(this: Run) -> None:
    """Log what the modes of the samples leave open; the page says it from the summary."""
    summary = {**this.facts, "in_effect": in_effect(this.scene)}
    if text := open_points(RunData(this.store.directory, summary=summary)):
        logger.warning("%s", text)


def make_study(this: Run, surfaces: Surfaces, library: LawLibrary | None, brake: Brake) -> Study:
    """What the samples of a scene share, made or read from the folder; collective."""
    from brake_fenicsx.samples.sampling import Roughness
    from brake_fenicsx.samples.study import Study

    stats = surfaces.get("surface")
    rough = Roughness(library, stats.hdf if stats else None, _waviness(this.scene, stats))
    zones = _zones(this, surfaces)
    study = Study(this.scene, brake, rough, this.store, this.comm, this.cache, zones)
    with this.stage("offline"):
        study.prepare()
        this.facts |= study.facts
    return study


def _waviness(scene: Scene, stats: SurfaceStatistics | None) -> Waviness | None:
    """Mean heights of patches of a surface, where gaps are drawn from them."""
    if not any(c.gap == "waviness" for c in scene.contact.values()):
        return None
    if stats is None or scene.surface is None or scene.micro is None:
        return None
    from brake_fenicsx.surface.spectrum import Waviness

    return Waviness(stats.spectrum, float(scene.micro.patch), scene.surface.low)


def _zones(this: Run, surfaces: Surfaces) -> dict[str, Roughness]:
    """Interfaces that have a surface of their own, and what is made of it; collective."""
    from brake_fenicsx.report.figure_inputs import surface_numbers
    from brake_fenicsx.samples.sampling import Roughness

    found: dict[str, Roughness] = {}
    for number, (name, own) in enumerate(this.scene.of_own_surface.items()):
        library: LawLibrary | None = None
        where = own_surface(name)
        stats = surfaces[where]
        logger.info("%s: %s", where, stats.told)
        if this.comm.rank == 0:
            this.facts.setdefault("own_surfaces", {})[where] = surface_numbers(stats)
        laws = checks.with_own_laws(own, name, stats)
        this.warn(checks.surface_warnings(laws, stats, where))
        if laws.micro is not None:
            library = micro_stage(replace(this, scene=laws), stats, f"zones/laws_{number}.npz")
        found[name] = Roughness(library, stats.hdf, _waviness(own, stats))
    return found


def mechanics(this: Run, surfaces: Surfaces, library: LawLibrary | None, brake: Brake) -> None:
    """Shared reduction, every sample's equilibrium and modes, tables, verification, pictures."""
    from brake_fenicsx.results.output import save_stage, verification

    study, drawn = make_study(this, surfaces, library, brake), "report" in this.scene.stages
    extras = [extra for extra in named(this.scene) if extra.stage]
    first: First | None = None
    all_share = extras or this.scene.sweep is not None
    if all_share or not (drawn and this.whole and study.few):
        first = tables_of_samples(this, study)
        if first is None:
            return
    for extra in extras:
        with this.stage(extra.name):
            save_stage(this.store, extra.name, load(extra.stage)(this, study) or {})
    if drawn:
        with this.stage("pictures"):
            draw_beside(this, study, first)
    elif study.verify:
        with this.stage("verification"):
            study.verified_beside(())
            this.facts["verification"] = processes.on_first(lambda: verification(study), this.comm)


def tables_of_samples(this: Run, study: Study) -> First | None:
    """Every sample that is not stored yet, the sweep and tables; none before the run is whole."""
    from brake_fenicsx.results.output import prepare_blocks

    with this.stage("samples"):
        prepare_blocks(study)
        if this.store.share is None:
            numbers = Counter(name for name, _ in study.tasks)
            processes.on_first(lambda: this.store.save_json(PREPARED, numbers), this.comm)
        if not this.prepare:
            study.run()
        this.store.samples.tabulate = None  # it holds the brake
    if this.prepare:
        return None
    sweep = None
    if this.scene.sweep is not None:
        from brake_fenicsx.sweeps.sweep_study import SweepStudy

        with this.stage("sweep"):
            sweep = SweepStudy(study)
            sweep.run()
    if not this.whole:
        return None
    with this.stage("results"):
        return _results(this, study, sweep)


def _results(this: Run, study: Study, sweep: SweepStudy | None) -> First:
    """Tables of the samples, and what they leave open; see ``write_results``."""
    from brake_fenicsx.results.output import write_results
    from brake_fenicsx.samples.forces import law_warnings, stuck_warnings

    processes.on_first(this.store.forget_tables, this.comm)
    first = write_results(study)
    if sweep is not None:
        this.facts |= sweep.write()
    this.facts |= study.facts
    this.warn(stuck_warnings(this.scene, this.facts.get("stuck_contact", {})))
    this.warn(law_warnings(this.scene, this.facts["samples"]))
    note_open_points(this)
    this.warn(this.facts.pop("lost_extras", []))
    return first


def draw_beside(this: Run, study: Study, first: First | None) -> None:
    """Samples of the verification, and beside them the pictures and figures of the page.

    Args:
        this: the run.
        study: its samples.
        first: what ``tables_of_samples`` gave; None where it is to be called, too, beside the
            samples of the verification. While it is, run and study have the communicator of the
            other processes alone.
    """
    from brake_fenicsx.report.mode_cards import ModeShape
    from brake_fenicsx.report.mode_fields import contact_faces, prepare_shapes, write_shapes
    from brake_fenicsx.results.output import verification

    faces, lost, comm = contact_faces(study), list[str](), this.comm

    def shapes(team: MPI.Comm) -> list[Callable[[], tuple[Any, list[str]]]]:
        """Tables, first page, fields and shapes of modes, and the works that draw."""
        this.comm = study.comm = team
        try:
            good = (tables_of_samples(this, study) or {}) if first is None else first
        finally:
            this.comm = study.comm = comm
        processes.on_first(this.write_summary, team)  # which pages and figures read
        found = prepare_shapes(study, good, faces, this.pictures, team)
        lost.extend(found.lost)
        if team.rank == 0:
            # Verification and pictures take longer than all samples do: nobody waits for them.
            lost.extend(spared("first page", lambda: _first_page(this))[1])
        mesh = partial(spared, "picture of the mesh", partial(draw_mesh, this, study.brake))
        return [*found.works, *([mesh] if this.pictures else [])]

    read = cache(lambda: read_run(this.store.directory))
    works = figure_works(this.store.directory, read, this.pictures, this.scene.own.figures)
    made = study.verified_beside(works, shapes)
    this.facts |= comm.bcast(this.facts)
    this.warn(lost)
    if study.verify:
        this.facts["verification"] = processes.on_first(lambda: verification(study), comm)
    this.warn([text for _, missing in made for text in missing])
    if comm.rank == 0:
        write_shapes(study, [row for row, _ in made if isinstance(row, ModeShape)])


def _first_page(this: Run) -> None:
    """Answer and page of the tables alone; what is read here is not held beside the figures."""
    found = read_run(this.store.directory)
    say_answer(found)
    write_page(found, first=True)
    logger.info("verification, pictures and figures follow: %s", this.page)


def draw_mesh(this: Run, brake: Brake) -> None:
    """Picture of the mesh, a colour for each layer."""
    from brake_fenicsx.report.mode_fields import tied_bodies
    from brake_fenicsx.report.render import render_mesh

    tags = brake.mesh.cell_tags
    layer = np.zeros(tags.indices.max(initial=-1) + 1, dtype=int)
    layer[tags.indices] = tags.values
    names = {tag: name for name, tag in brake.mesh.layers.items()}
    title = "Mesh: {cells} cells, {dofs} free dofs".format(**this.facts)
    path = this.store.path("figures") / "mesh.png"
    bodies = tied_bodies(this.scene, brake)
    render_mesh(path, brake.elastic.free.V, layer, names, title, bodies)


def report(
    directory: Path,
    comm: MPI.Comm = MPI.COMM_SELF,
    pictures: bool = True,
    own: Mapping[str, Callable[[RunData], Any]] = MappingProxyType({}),
) -> None:
    """Figures, tables and the HTML page of a results folder; collective.

    Args:
        directory: the results folder.
        comm: processes that share the figures.
        pictures: whether figures are drawn; those of mode shapes and the mesh stay as they are.
        own: figures of a user's own by name.
    """
    if not directory.is_dir():
        read_run(directory)  # says what it is
    read = cache(lambda: read_run(directory))
    works = figure_works(directory, read, pictures, own)
    progress = Progress("figures", len(works), processes=comm.size)
    for _, lost in processes.in_turns(len(works), lambda i: works[i](), comm):
        progress.advance()
        for text in lost:
            logger.warning("%s", text)
    if comm.rank == 0:
        write_page(read())
        say_answer(read())


def figure_works(
    directory: Path,
    read: Callable[[], RunData],
    pictures: bool,
    own: Mapping[str, Callable[[RunData], Any]],
) -> list[Callable[[], tuple[None, list[str]]]]:
    """Works that draw a figure of a results folder each, by any processes, begun in this order.

    Args:
        directory: the results folder.
        read: gives its results, which a process reads once.
        pictures: False removes the figures.
        own: figures of a user's own by name.

    Returns:
        Works, each of which gives what failed, a line each.
    """
    from brake_fenicsx.report.figure_inputs import contact_maps
    from brake_fenicsx.report.figures import PLOTS, make_figures

    names = [*(plot.name for plot in PLOTS), *own]
    maps = names.index("figure7_contact_maps")

    def draw(i: int) -> tuple[None, list[str]]:
        lost: list[str] = []
        if pictures and i == maps:  # before the results are read
            lost = spared("maps of the contact", lambda: contact_maps(directory))[1]
        make_figures(read(), slice(i, i + 1), pictures, own)
        return None, lost

    # The longest first: the last ones are to end at about the same time.
    return [partial(draw, i) for i in sorted(range(len(names)), key=lambda i: i != maps)]


def say_answer(data: RunData) -> None:
    """Log what squeals; on one process."""
    if data.modes is not None:
        # Line by line: the time stamp of the file would shift the heading alone.
        for line in summary_table(data).splitlines():
            logger.info("%s", line)


def write_page(data: RunData, first: bool = False) -> None:
    """Tables and the HTML page of results; on one process.

    Args:
        data: the results.
        first: whether verification, pictures and figures are still to come; the page says so.
    """
    from brake_fenicsx.report.html import write_report
    from brake_fenicsx.report.surface_page import write_surface_tables

    directory = data.directory
    # Those of an earlier run with other stages or keys.
    shutil.rmtree(directory / "tables", ignore_errors=True)
    write_tables(data)
    write_surface_tables(data)
    write_report(data, redraw=False, first=first)
    if data.samples is not None and not (directory / "samples.csv").is_file():
        logger.warning(
            "%(at)s: samples without tables; `run` of the scene, with -o %(at)s, makes them",
            {"at": directory},
        )
    elif data.modes is None and "stability" in data.summary.get("in_effect", {}).get("stages", ()):
        logger.warning(
            "%s: samples are missing, and the page has no modes; `run` makes them again", directory
        )

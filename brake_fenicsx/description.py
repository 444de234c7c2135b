"""What a run of a scene will build, and what it will cost, for the command ``check``.

A process holds 0.25 GB, and 9 kB n with factors of the bodies one by one, 10 kB n more to solve at
full order, 19 kB n more with damping there; pictures take 0.3 GB, when the samples are done. All
processes of a machine share 150 B m^2 + 3 kB n of a reduced model, 350 B m^2 more with damping, and
where d scalars of bodies are random or swept the values at the points of an interpolation, 15 B m^2
C(d + 4, 4); of moduli alone, and without damping, 15 B m^2 C(d + 3, 3). A process of run --share
holds beside that what a sample needs. Peaks of shipped brakes lie within a factor of 1.5 of these
figures.

The times are those of docs/benchmarks.md, scaled by the time that a second of work takes here.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import comb
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

from brake_fenicsx import checks
from brake_fenicsx.errors import lines
from brake_fenicsx.folder.log import time_text
from brake_fenicsx.scene import Scene, read_scene
from brake_fenicsx.scene.samples_section import is_constant
from brake_fenicsx.scene.scalars import changes_bodies
from brake_fenicsx.scene.scene import active_terms, listed, own_surface, reduced_approaches
from brake_fenicsx.scene.units import several

if TYPE_CHECKING:
    from brake_fenicsx.surface import SurfaceStatistics

# Degree of the interpolation over scalars of the bodies at the default tolerance, one more than
# that of moduli alone without damping, and the points between its anchors where it is checked.
DEGREE, CHECKED = 4, 2
# What else is made where a stage is named.
MADE_BY = {
    "equilibrium": ("brake", "offline", "samples", "sweep", "results", "verification"),
    "report": ("pictures", "report"),
}
# CPU seconds that ``work_of_a_second`` took where the runs of docs/benchmarks.md were measured.
REFERENCE = 1.3
BASE, PICTURES = 0.25, 0.3  # [GB]: the libraries, and VTK with Matplotlib


@dataclass(frozen=True, slots=True)
class Sizes:
    """Memory and disc of a run [GB].

    Attributes:
        process: peak of a process, with all that processes of a machine share.
        shared: part of it that a machine holds once.
        share: what a process of ``run --share`` holds beside that, unless it verifies a sample;
            0: where a sample is not solved by the reduced model.
        disc: the results folder.
    """

    process: float
    shared: float
    share: float
    disc: float


def count_solves(scene: Scene, samples: Mapping[str, int]) -> dict[str, int]:
    """How the modes of the samples are found, in words, and how many in each way.

    Args:
        scene: the scene.
        samples: number of samples of each approach.
    """
    if scene.stability is None or "stability" not in scene.stages:
        return {}
    reduced = [name for name in samples if name in reduced_approaches(scene, samples)]
    changing = {n for n in reduced if changing_scalars(scene) and scene.samples.takes_random(n)}
    at_full = [number for name, number in samples.items() if name not in reduced]
    return {
        "reduced": sum(samples[name] for name in reduced if name not in changing),
        "reduced with bodies of their own": sum(samples[name] for name in changing),
        "at full order": sum(at_full) + verified(scene, samples),
    }


def verified(scene: Scene, samples: Mapping[str, int]) -> int:
    """How many samples are solved at full order beside the reduced model."""
    if scene.stability is None:
        return 0
    reduced = [name for name in samples if name in reduced_approaches(scene, samples)]
    return sum(min(scene.stability.verify, samples[name]) for name in reduced[:1])


def changing_scalars(scene: Scene) -> list[str]:
    """Random and swept scalars of a scene that its bodies depend on."""
    return [name for name in scene.varied if changes_bodies(scene, name)]


def anchors(scene: Scene, samples: Mapping[str, int]) -> int:
    """Points where a body that depends on all changing scalars is reduced, at usual tolerance."""
    names = changing_scalars(scene)
    damped = any(active_terms(scene, name) for name in samples)
    degree = DEGREE - (not damped and all(map(is_constant, names)))
    return comb(len(names) + degree, degree) + CHECKED if names else 1


def run_sizes(scene: Scene, samples: Mapping[str, int], dofs: int, elements: int) -> Sizes:
    """Memory and disc of a run; see the head of this module."""
    n, m = dofs, elements
    solves = count_solves(scene, samples)
    at_full = solves.pop("at full order", 0)
    damped = any(active_terms(scene, name) for name in samples)
    process, shared, share = BASE + 9e-6 * n, 0.0, 0.0
    if any(solves.values()):
        shared = 150e-9 * m**2 + 3e-6 * n + (350e-9 * m**2 if damped else 0.0)
        if solves["reduced with bodies of their own"]:
            shared += 15e-9 * m**2 * anchors(scene, samples)
        if sum(solves.values()) == sum(samples.values()):
            share = 0.2 + max(2.2e-6 * n, 0.12e-6 * m**2 * (4 if damped else 1))
    else:
        process += 40e-9 * m**2
    if at_full:
        process += 10e-6 * n + (19e-6 * n if damped else 0.0)
    if "report" in scene.stages:
        process = max(process, BASE + PICTURES + 2e-6 * n)
    fields = 1e-6 * n if "report" in scene.stages else 0.0
    disc = 0.2e-6 * m * sum(samples.values()) + shared + 1.2e-6 * n + fields
    return Sizes(process + shared, shared, share, disc)


def calibrated_seconds(
    scene: Scene, samples: Mapping[str, int], dofs: float, elements: float, work: float
) -> dict[str, float]:
    """Seconds of the stages of a run on one process of this machine.

    By the seconds that a second of work and the runs of docs/benchmarks.md took on one machine, and
    the growth that they show.

    Args:
        scene: the scene.
        samples: number of its samples of each approach.
        dofs: its free dofs.
        elements: its contact elements.
        work: what ``work_of_a_second`` takes on this machine [s].
    """
    n, m = dofs / 40_745, elements / 1368
    solves, micro = count_solves(scene, samples), scene.micro
    laws = 0.0
    if micro is not None and not isinstance(micro.pixels, str):
        periodic = micro.boundary == "periodic"
        each = 0.23 * (micro.pixels / 128) ** (1.85 if periodic else 0.6)
        laws = each * (micro.laws + micro.scans)
    by_reduction = solves.get("reduced", 0) + solves.get("reduced with bodies of their own", 0)
    points = anchors(scene, samples) if by_reduction else 1
    beside, full = verified(scene, samples), 20 * n**1.5
    drawn = "pictures" * ("report" in scene.stages)  # one stage with the verification
    sample = 0.1 + 0.14 * m**2
    solving = sample * by_reduction
    solving += full * (solves.get("at full order", beside) - beside)
    seconds = {
        "surface": 0.2, "micro": laws, "brake": 1.1 * n,
        "offline": (11 if by_reduction else 1) * n**1.6 * points**0.5,
        "samples": solving or sample * sum(samples.values()),
        "results": 1 + n, drawn or "verification": full * beside + (16 + 10 * n) * bool(drawn),
        "report": 2.0,
    }  # fmt: skip
    kept = {name for stage in scene.stages for name in MADE_BY.get(stage, (stage,))}
    return {name: work / REFERENCE * s for name, s in seconds.items() if s and name in kept}


@cache
def work_of_a_second() -> float:
    """CPU seconds for products of matrices, transforms and a sparse factor, as a run has them."""
    import numpy as np
    import scipy.sparse as sp
    from scipy.sparse.linalg import splu

    A = np.random.default_rng(0).normal(size=(600, 600))
    line = sp.diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(120, 120))
    one = sp.identity(120)
    grid = (sp.kron(line, one) + sp.kron(one, line)).tocsc()
    began = time.process_time()
    for _ in range(16):
        np.linalg.svd(A[:200, :200] @ A[:200] @ A[:, :200])
        np.fft.rfft2(A)
        splu(grid)
    return time.process_time() - began


def earlier_run(folder: Path) -> dict[str, Any] | None:
    """Facts of a finished run in a folder, its summary.json; None where there is none."""
    try:
        facts = json.loads((folder / "summary.json").read_text("utf-8"))
    except (OSError, ValueError):
        return None
    return facts if {"seconds", "in_effect", "processes"} <= {*facts} else None


def cost_lines(sizes: Sizes, seconds: Mapping[str, float], processes: int) -> list[str]:
    """What a person reads of the costs: memory, disc, time, and how far to trust them.

    Args:
        sizes: memory and disc.
        seconds: of each stage, estimated.
        processes: number of processes that hold the memory.
    """
    whole = processes * (sizes.process - sizes.shared) + sizes.shared
    every = f", {whole:.1f} GB on {processes} processes" if processes > 1 else ""
    share = (
        f"; a process of run --share {sizes.share:.1f} GB, and {sizes.shared:.1f} GB once on each"
        " node"
    )
    return [
        f"memory: about {sizes.process:.1f} GB{every}{share if sizes.share else ''}",
        f"disc: about {sizes.disc:.1f} GB",
        f"time: about {stage_times(seconds)}, on one process, by a second of work on this machine",
        "these are estimates: memory within a factor of 1.5 as a rule, time of three",
    ]


def stage_times(seconds: Mapping[str, float]) -> str:
    """Seconds of stages for a person: their sum, then each."""
    each = ", ".join(f"{stage} {time_text(value)}" for stage, value in seconds.items())
    return f"{time_text(sum(seconds.values()))} ({each})"


def describe(
    scene: str | Path, comm: MPI.Comm, overrides: Sequence[str] = (), as_json: bool = False,
    quiet: bool = False,
) -> None:  # fmt: skip
    """Check a scene and print what a run of it will build; nothing is written.

    Args:
        scene: path of the scene.
        comm: processes of the run.
        overrides: "key=value" replacements in the scene.
        as_json: print the counts and costs as JSON in place of lines.
        quiet: print warnings alone.

    Raises:
        SceneError: the scene is wrong.
    """
    parsed = read_scene(scene, overrides)
    surfaces = checks.check(parsed, comm)
    stats = surfaces.get("surface")
    stages = ", ".join(parsed.stages) or "none: parts alone, for correlate and identify"
    said = [f"{parsed.file}: stages {stages}"]
    said += [line for where, one in surfaces.items() for line in _surface_lines(where, one)]
    built: dict[str, Any] = {}
    told, noted, samples, side = list[str](), list[str](), dict[str, int](), None
    if "equilibrium" in parsed.stages:
        from brake_fenicsx.build.brake import (
            assemble_brake,
            interfaces_of,
            inventory_lines,
            parts_of,
        )
        from brake_fenicsx.build.brake_doubts import brake_doubts
        from brake_fenicsx.samples.sampling import sample_count

        brake = assemble_brake(parsed, comm)
        noted, told = brake_doubts(parsed, brake), checks.remarks(parsed, comm)
        parts, interfaces = parts_of(parsed, brake), interfaces_of(parsed, brake)
        built = {**brake.size(), "mesh_sha256": brake.mesh.digest, "parts": parts}
        side = 1e-3 * float(built["mean_patch_mm"])
        parsed = checks.with_patch(parsed, side)
        samples = {name: sample_count(parsed, name) for name in parsed.samples.approaches}
        said.append(
            "brake: {cells} cells, {dofs} free dofs, {contact_elements} contact elements"
            " with a mean side of {mean_patch_mm:.3f} mm".format(**built)
        )
        built["contact"] = interfaces
        said += [*inventory_lines(parsed, parts, interfaces), *told]
        said += _sample_lines(parsed, samples)
    parsed = checks.with_pixels(parsed, stats)
    said += _law_lines(parsed, side, "laws")
    size = built.get("dofs", 0), built.get("contact_elements", 0)
    memory = run_sizes(parsed, samples, *size)
    seconds = calibrated_seconds(parsed, samples, *size, work_of_a_second())
    noted += [*checks.warnings(parsed, side), *checks.surface_warnings(parsed, stats)]
    for name, own in parsed.of_own_surface.items():
        where = own_surface(name)
        own = checks.with_own_laws(own, name, surfaces[where])
        said += _law_lines(own, side, f"{where}: laws")
        noted += checks.surface_warnings(own, surfaces[where], where)
        more = calibrated_seconds(own, samples, *size, work_of_a_second())
        seconds["micro"] = seconds.get("micro", 0.0) + more.get("micro", 0.0)
    if as_json:
        content = {
            "scene": str(parsed.file), "stages": parsed.stages, **built,
            "samples": samples, "remarks": told, "warnings": noted,
            "seconds": {stage: round(value, 3) for stage, value in seconds.items()},
            "gigabytes_of_a_share": round(memory.share, 3),
            "gigabytes_once_on_a_node": round(memory.shared, 3),
            "gigabytes_per_process": round(memory.process, 3),
            "gigabytes_on_disc": round(memory.disc, 3),
        }  # fmt: skip
        said = [json.dumps(content, indent=1)]
    else:
        expected = cost_lines(memory, seconds, comm.size) if seconds else []
        measured = _measured(Path.cwd() / f"{parsed.file.stem}-results")
        said = [] if quiet else [*said, *expected, *measured]
        said += [f"warning: {text}" for text in noted]
    if comm.rank == 0 and said:
        print("\n".join(said))


def _measured(folder: Path) -> list[str]:
    """What an earlier run of the scene took, as it was measured."""
    if (facts := earlier_run(folder)) is None:
        return []
    on = several(facts["processes"], "process", "processes")
    took = stage_times(facts["seconds"])
    return [f"measured: the run in {folder.name} took {took} on {on}"]


@lines
def _surface_lines(where: str, stats: SurfaceStatistics) -> Iterator[str]:
    yield f"{where}: {stats.told}"
    for one in stats.each:
        if (scan := one.topography) is None:
            continue
        (nx, ny), (lx, ly) = scan.shape, (1e3 * v for v in scan.size)
        masked = f"; {one.missing} points missing, {one.outliers} outliers masked"
        yield f"""scan: {nx} x {ny} points, {lx:.4g} x {ly:.4g} mm,
            {scan.source}{masked * bool(one.missing + one.outliers)}"""


@lines
def _sample_lines(scene: Scene, samples: Mapping[str, int]) -> Iterator[str]:
    ways = count_solves(scene, samples).items()
    modes = ", ".join(f"{number} {way}" for way, number in ways if number)
    named = ", ".join(f"{n} {scene.spoken(name)}" for name, n in samples.items())
    yield f"samples: {named}{modes and f'; modes: {modes}'}"
    changing = changing_scalars(scene) if "reduced" in modes else []
    if changing:
        yield f"""reduced model: bodies depend on {", ".join(changing)}; one that depends on all is
            reduced at {anchors(scene, samples)} points, one that depends on none at one"""
    if damped := {term: None for name in samples for term in active_terms(scene, name)}:
        yield f"damping: {', '.join(damped)}"
    yield f"friction: {listed(scene)}"


@lines
def _law_lines(scene: Scene, side: float | None, title: str) -> Iterator[str]:
    micro = scene.micro
    if micro is None or "micro" not in scene.stages:
        return
    patch = float(micro.patch)
    area = f"; mean area of a contact element / patch = {((side or 0.0) / patch) ** 2:.3g}"
    yield f"""{title}: {micro.laws} of {micro.pixels} x {micro.pixels} points, patches with a side
        of {1e3 * patch:.4g} mm{area * bool(side)}"""

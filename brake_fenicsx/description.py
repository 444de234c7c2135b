"""What a run of a scene will build, and what it will cost, for the command ``check``."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

from brake_fenicsx import checks, costs
from brake_fenicsx.errors import lines
from brake_fenicsx.scene import Scene, read_scene
from brake_fenicsx.scene.scene import active_terms, listed, own_surface
from brake_fenicsx.scene.units import several

if TYPE_CHECKING:
    from brake_fenicsx.surface import SurfaceStatistics


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
    memory = costs.run_sizes(parsed, samples, *size)
    seconds = costs.calibrated_seconds(parsed, samples, *size, costs.work_of_a_second())
    noted += [*checks.warnings(parsed, side), *checks.surface_warnings(parsed, stats)]
    for name, own in parsed.of_own_surface.items():
        where = own_surface(name)
        own = checks.with_own_laws(own, name, surfaces[where])
        said += _law_lines(own, side, f"{where}: laws")
        noted += checks.surface_warnings(own, surfaces[where], where)
        more = costs.calibrated_seconds(own, samples, *size, costs.work_of_a_second())
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
        expected = costs.cost_lines(memory, seconds, comm.size) if seconds else []
        measured = _measured(Path.cwd() / f"{parsed.file.stem}-results")
        said = [] if quiet else [*said, *expected, *measured]
        said += [f"warning: {text}" for text in noted]
    if comm.rank == 0 and said:
        print("\n".join(said))


def _measured(folder: Path) -> list[str]:
    """What an earlier run of the scene took, as it was measured."""
    if (facts := costs.earlier_run(folder)) is None:
        return []
    on = several(facts["processes"], "process", "processes")
    took = costs.stage_times(facts["seconds"])
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
    ways = costs.count_solves(scene, samples).items()
    modes = ", ".join(f"{number} {way}" for way, number in ways if number)
    named = ", ".join(f"{n} {scene.spoken(name)}" for name, n in samples.items())
    yield f"samples: {named}{modes and f'; modes: {modes}'}"
    changing = costs.changing_scalars(scene) if "reduced" in modes else []
    if changing:
        yield f"""reduced model: bodies depend on {", ".join(changing)}; one that depends on all is
            reduced at {costs.anchors(len(changing))} points, one that depends on none at one"""
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

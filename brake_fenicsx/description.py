"""What a run of a scene will build, and what it will cost, for the command ``check``."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

from brake_fenicsx.checks import (
    check,
    remarks,
    surface_warnings,
    warnings,
    with_patch,
    with_pixels,
)
from brake_fenicsx.costs import Counts, cost_lines, count_solves, estimate
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.damping import active_terms
from brake_fenicsx.scene.friction import listed


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
    stats = check(parsed, comm)
    lines = [f"{parsed.file}: stages {', '.join(parsed.stages)}"]
    for one in stats.each if stats else ():
        if (scan := one.topography) is None:
            continue
        nx, ny = scan.shape
        lx, ly = (1e3 * v for v in scan.size)
        lines.append(f"scan: {nx} x {ny} points, {lx:.4g} x {ly:.4g} mm, {scan.source}")
        if one.missing + one.outliers:
            lines[-1] += f"; {one.missing} points missing, {one.outliers} outliers masked"
    counts, mean_patch = Counts(), None
    sizes: dict[str, Any] = {}
    built: dict[str, Any] = {}
    told: list[str] = []
    doubts: list[str] = []
    samples: dict[str, int] = {}
    if "equilibrium" in parsed.stages:
        from brake_fenicsx.macro.brake import assemble_brake
        from brake_fenicsx.macro.inventory import (
            brake_doubts,
            interfaces_of,
            inventory_lines,
            parts_of,
        )
        from brake_fenicsx.uncertainty.sampling import sample_count

        brake = assemble_brake(parsed, comm)
        sizes = brake.size()
        doubts = brake_doubts(parsed, brake)
        told = [*remarks(parsed, comm), *brake.mesh.unread.other]
        built = {"parts": parts_of(parsed, brake), "contact": interfaces_of(parsed, brake)}
        mean_patch = 1e-3 * sizes["mean_patch_mm"]
        parsed = with_patch(parsed, mean_patch)
        samples = {name: sample_count(parsed, name) for name in parsed.samples.approaches}
        counts = replace(
            count_solves(parsed, samples),
            dofs=sizes["dofs"], elements=sizes["contact_elements"],
        )  # fmt: skip
        lines.append(
            f"brake: {sizes['cells']} cells, {sizes['dofs']} free dofs,"
            f" {sizes['contact_elements']} contact elements"
            f" with a mean side of {sizes['mean_patch_mm']:.3f} mm"
        )
        lines += inventory_lines(parsed, brake) + told
        ways = {
            "reduced": counts.reduced, "reduced with materials of their own": counts.changing,
            "at full order": counts.full,
        }  # fmt: skip
        said = ", ".join(f"{number} {way}" for way, number in ways.items() if number)
        how = f"; modes: {said}" if said else ""
        named = ", ".join(f"{n} {parsed.spoken(name)}" for name, n in samples.items())
        lines.append(f"samples: {named}{how}")
        if damped := {term: None for name in samples for term in active_terms(parsed, name)}:
            lines.append(f"damping: {', '.join(damped)}")
        lines.append(f"friction: {listed(parsed)}")
    parsed = with_pixels(parsed, stats)
    if parsed.micro and "micro" in parsed.stages:
        m = parsed.micro
        patch = float(m.patch)
        factor = "" if mean_patch is None else (
            f"; mean area of a contact element / patch = {(mean_patch / patch) ** 2:.3g}"
        )  # fmt: skip
        lines.append(
            f"laws: {m.laws} of {m.pixels} x {m.pixels} points, patches with"
            f" a side of {1e3 * patch:.4g} mm{factor}"
        )
    costs = estimate(parsed, counts)
    noted = [*doubts, *warnings(parsed, mean_patch), *surface_warnings(parsed, stats)]
    lines = [] if quiet else lines + cost_lines(costs, comm.size)
    lines += [f"warning: {text}" for text in noted]
    if comm.rank == 0 and as_json:
        content = {
            "scene": str(parsed.file), "stages": parsed.stages, **sizes, **built,
            "samples": samples, "remarks": told, "warnings": noted,
            "seconds": {cost.stage: round(cost.seconds, 3) for cost in costs},
            "gigabytes_of_a_share": max((round(c.lean, 3) for c in costs), default=0.0),
            "gigabytes_once_on_a_node": max((round(c.shared, 3) for c in costs), default=0.0),
            "gigabytes_per_process": max((round(c.gigabytes, 3) for c in costs), default=0.0),
        }  # fmt: skip
        print(json.dumps(content, indent=1))
    elif comm.rank == 0 and lines:
        print("\n".join(lines))

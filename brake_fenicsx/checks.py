"""What is read and refused before a run writes anything."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mpi4py import MPI

from brake_fenicsx.errors import BrakeError, SceneError
from brake_fenicsx.scene import Scene

if TYPE_CHECKING:
    from brake_fenicsx.surface import SurfaceStatistics


def check(scene: Scene, comm: MPI.Comm) -> SurfaceStatistics | None:
    """Everything that can be refused before anything is written.

    Returns:
        Statistics of the surface; None where the scene names none.
    """
    stats = read_surface(scene) if "surface" in scene.stages else None
    if "equilibrium" in scene.stages:
        from brake_fenicsx.macro.brake import check_brake

        check_brake(scene, comm)
    return stats


def remarks(scene: Scene, comm: MPI.Comm) -> list[str]:
    """What is right and still may surprise: a line each, on the first process."""
    if comm.rank or "equilibrium" not in scene.stages:
        return []
    from brake_fenicsx.macro.parts import cut_loads

    return cut_loads(scene)


def read_surface(scene: Scene) -> SurfaceStatistics:
    """Scan to statistics: height distribution, power spectrum, bi-fractal fit."""
    from brake_fenicsx.surface import characterise, given_statistics, read_topography

    table = scene.surface
    if table is None:
        raise SceneError(f"{scene.file}: surface: the section is missing")
    if table.statistics is not None:
        t = table.statistics
        return given_statistics(t.S_q, t.S_sk, t.S_ku, t.c1, t.c2, t.q_c)
    size = None if table.size is None else (table.size[0], table.size[-1])
    try:
        scan = read_topography(
            scene.path(str(table.scan)), size, table.height_unit, rows=table.rows
        )
        return characterise(scan, table.level, cutoff=table.cutoff)
    except BrakeError as error:
        raise SceneError(f"{scene.file}: surface.scan = {table.scan!r}: {error}") from None

"""What is read and refused before a run writes anything."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from mpi4py import MPI

from scipy.fft import next_fast_len

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.damping import active_terms
from brake_fenicsx.scene.friction import rubs, slides
from brake_fenicsx.scene.plausible import unusual
from brake_fenicsx.scene.scalars import changes_bodies
from brake_fenicsx.scene.surface import MAX_PIXELS
from brake_fenicsx.scene.tables import dotted

if TYPE_CHECKING:
    from brake_fenicsx.surface import SurfaceStatistics

MAX_AREA_RATIO = 2.0  # in area, between contact elements and the patches of their laws
MIN_PIXELS = 16  # along a side of a patch
MAX_PIXEL_RATIO = 2.0  # pixels of the laws over those that the scan resolves
MIN_ROUGHNESS = (1e-7, 1e-3)  # S_q [m] and rms slope of the smoothest linings
ROOM = 4.0  # side of a patch over that of the scan, beyond which waves are assumed
LARGE_SCAN = 0.05  # m, longest side of most scans


def check(scene: Scene, comm: MPI.Comm) -> SurfaceStatistics | None:
    """Everything that can be refused before anything is written.

    Returns:
        Statistics of the surface; None where the scene names none.
    """
    stats = None
    if "surface" in scene.stages:
        from brake_fenicsx.build.measured_surface import read_surface

        stats = read_surface(scene)
    if "equilibrium" in scene.stages:
        from brake_fenicsx.build.brake import check_brake

        check_brake(scene, comm)
        if any(changes_bodies(scene, name) for name in scene.varied):
            from brake_fenicsx.build.box import check_box

            check_box(scene)
    return stats


def remarks(scene: Scene, comm: MPI.Comm) -> list[str]:
    """What is right and still may surprise: a line each, on the first process."""
    if comm.rank or "equilibrium" not in scene.stages:
        return []
    from brake_fenicsx.build.part_builders import cut_loads

    return [*cut_loads(scene), *_undamped(scene, counted=True)]


def warnings(scene: Scene, mean_patch: float | None = None) -> list[str]:
    """What is allowed and most probably not meant: a line each.

    Args:
        scene: the scene.
        mean_patch: side of the mean contact element [m], once it is known.
    """
    lines = [*unusual(scene), *_clamped(scene), *_swapped(scene), *_undamped(scene)]
    if mean_patch is not None and scene.micro and "micro" in scene.stages:
        patch = mean_patch if scene.micro.patch == "mesh" else float(scene.micro.patch)
        area = (mean_patch / patch) ** 2
        if not 1 / MAX_AREA_RATIO <= area <= MAX_AREA_RATIO:
            lines.append(
                f"micro.patch = {1e3 * patch:g} mm: contact elements have {area:.3g} times the area"
                f" of the laws' patch (their mean side is {1e3 * mean_patch:.3g} mm); write"
                ' micro.patch = "mesh"'
            )
    return lines


def _clamped(scene: Scene) -> list[str]:
    """What faces that cannot move make idle, and loads that do not press contact faces."""
    held = {face for face, directions in scene.supports.items() if len({*directions}) == 3}
    to_ground = {f for f, spring in scene.springs.items() if spring.faces is None}
    sections = (("masses", {*scene.masses}), ("springs", to_ground), ("loads", _loaded(scene)))
    return [
        f"{dotted(section, face)}: the face is held in all directions by supports, so that this has"
        f" no effect; leave it out, or change {dotted('supports', face)}"
        for section, faces in sections
        for face in sorted(faces & held)
    ] + [
        f"{dotted('contact', name)}.faces: {face}, {why}"
        for name, table in scene.contact.items()
        for face in table.faces
        for why in _not_pressing(scene, face, held)
    ]


def _not_pressing(scene: Scene, face: str, held: set[str]) -> list[str]:
    """Why loads on a contact face or on its part do not press the faces together."""
    if face in scene.loads and scene.loads[face].pressure:
        return [
            f"has a pressure of its own, {dotted('loads', face)}, which pushes the faces apart;"
            " load another face"
        ]
    part = face.partition(".")[0]
    if face in held and any(other.partition(".")[0] == part for other in _loaded(scene)):
        return [
            f"is held in all directions by supports, so that the loads on {part} do not press the"
            f" faces together; change {dotted('supports', face)}"
        ]
    return []


def _loaded(scene: Scene) -> set[str]:
    """Faces with a pressure, a force or a moment."""
    return {f for f, load in scene.loads.items() if load.pressure or load.force or load.moment}


def _swapped(scene: Scene) -> list[str]:
    """Sliding interfaces whose second body is pressed and whose first is not."""
    if "equilibrium" not in scene.stages:
        return []
    of = {name: {name} for name in scene.parts}
    stuck = [one.faces for name, one in scene.contact.items() if not slides(scene, name)]
    sprung = [one.faces for one in scene.springs.values() if one.faces]
    for faces in (*stuck, *sprung, *(tie.faces for tie in scene.ties.values())):
        joined = set().union(*(of.get(face.partition(".")[0], set()) for face in faces))
        of |= dict.fromkeys(joined, joined)
    loaded = {face.partition(".")[0] for face in _loaded(scene)}
    lines = []
    for name, table in scene.contact.items():
        first, second = (face.partition(".")[0] for face in table.faces)
        pressed = [bool(of.get(part, {part}) & loaded) for part in (first, second)]
        if slides(scene, name) and pressed == [False, True]:
            lines.append(
                f"{dotted('contact', name)}.faces: the second face belongs to the body that moves,"
                f" here {second!r}, which has a load; write the pad's face first"
            )
    return lines


def surface_warnings(scene: Scene, stats: SurfaceStatistics | None) -> list[str]:
    """What is doubtful about scans and about the pixels of the laws: a line each.

    Args:
        scene: the scene, its patch in metres where it is known.
        stats: statistics of its surface.
    """
    if stats is None:
        return []
    lines = [*stats.warnings, *_too_smooth(scene, stats)]
    for one in stats.each:
        if one.topography is not None and one.topography.size.max() > LARGE_SCAN:
            x, y = 1e3 * one.topography.size
            lines.append(
                f"surface.scan: a scan of {x:.4g} x {y:.4g} mm: unusually large; `size` in an npz"
                " is in metres; correct it, or surface.size"
            )
    micro = scene.micro
    if micro is None or "micro" not in scene.stages or not stats.each:
        return lines
    if isinstance(micro.patch, str):
        return lines
    shortest = min((float(t.size.min()) for t in stats.topographies), default=float("inf"))
    if micro.patch > ROOM * shortest:
        lines.append(
            f"micro.patch = {1e3 * micro.patch:.4g} mm: {micro.patch / shortest:.2g} times the"
            f" shortest side of a scan, {1e3 * shortest:.4g} mm, and longer waves are assumed"
            f" (surface.low); take {ROOM * 1e3 * shortest:.4g} mm at most, or a larger scan"
        )
    if isinstance(micro.pixels, str):
        return lines
    pixel, fine = micro.patch / micro.pixels, stats.pixel
    if pixel > MAX_PIXEL_RATIO * fine:
        lines.append(
            f"micro.pixels = {micro.pixels}: pixels of {1e6 * pixel:.3g} um; the scan resolves"
            f" {1e6 * fine:.3g} um ({round(micro.patch / fine)} pixels, micro.pixels ="
            ' "scan"): the stiffness at low pressure may be several times wrong'
        )
    return lines


def _too_smooth(scene: Scene, stats: SurfaceStatistics) -> list[str]:
    """The pad of a brake that is smoother than any lining: heights in a wrong unit, as a rule."""
    from brake_fenicsx.surface.iso25178 import gradients

    slopes = [gradients(t.heights, t.pixel)[0] for t in stats.topographies]
    if not scene.contact or (
        stats.S_q >= MIN_ROUGHNESS[0] and min(slopes, default=1.0) >= MIN_ROUGHNESS[1]
    ):
        return []
    slope = f" and an rms slope of {min(slopes):.2g}" if slopes else ""
    return [
        f"surface: S_q of {1e6 * stats.S_q:.3g} um{slope}: smooth as a mirror, which no lining is;"
        " correct surface.height_unit or surface.size"
    ]


def _undamped(scene: Scene, counted: bool = False) -> list[str]:
    """Friction, modes, and nothing that takes energy from them.

    Args:
        scene: the scene.
        counted: the line of a scene whose threshold takes the place of damping, else the warning
            of one that has neither.
    """
    approaches, stability = scene.samples.approaches, scene.stability
    if stability is None or "stability" not in scene.stages:
        return []
    # These two take no energy.
    damped = any({*active_terms(scene, a)} - {"slope", "gyroscopic"} for a in approaches)
    if damped or not any(rubs(scene, a) for a in approaches):
        return []
    if counted != bool(stability.threshold):
        return []
    if counted:
        return [
            f"the model has no damping; squeal is counted below {-stability.threshold:g} instead"
        ]
    return [
        "no damping is named in the scene, and modes that hardly grow are unstable too; write"
        " [stability.damping], or a stability.threshold for what counts as squeal"
    ]


def with_patch(scene: Scene, mean_patch: float) -> Scene:
    """A scene whose laws have a patch in metres, where it names that of the mesh [m]."""
    if scene.micro is None or scene.micro.patch != "mesh":
        return scene
    # Few digits: sums over contact elements differ in the last ones with the number of processes.
    return replace(scene, micro=replace(scene.micro, patch=float(f"{mean_patch:.6g}")))


def with_pixels(scene: Scene, stats: SurfaceStatistics | None) -> Scene:
    """A scene whose laws have a number of pixels, where it names what the scan resolves.

    Raises:
        SceneError: more pixels than a law can be computed for.
    """
    micro = scene.micro
    if micro is None or stats is None or micro.pixels != "scan" or micro.patch == "mesh":
        return scene
    pixels = max(round(float(micro.patch) / stats.pixel), MIN_PIXELS)
    if pixels > MAX_PIXELS:
        raise SceneError(
            f'{scene.file}: micro.pixels = "scan": a patch of {1e3 * float(micro.patch):.3g} mm has'
            f" {pixels} of the scan's pixels of {1e6 * stats.pixel:.3g} um along a side, more than"
            f" {MAX_PIXELS}; write a number, or name surface.cutoff"
        )
    # A few more where their number has large prime factors: the transforms are faster.
    fast = int(next_fast_len(pixels, real=True))
    return replace(scene, micro=replace(micro, pixels=fast))

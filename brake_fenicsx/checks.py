"""What is read and refused before a run writes anything."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from mpi4py import MPI

from scipy.fft import next_fast_len

from brake_fenicsx.errors import SceneError, lines
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.contact_section import MAX_PIXELS
from brake_fenicsx.scene.keys import dotted
from brake_fenicsx.scene.scalars import changes_bodies
from brake_fenicsx.scene.scene import active_terms, own_surface, rubs, slides
from brake_fenicsx.scene.warnings import unusual

if TYPE_CHECKING:
    from brake_fenicsx.surface import SurfaceStatistics

MAX_AREA_RATIO = 2.0  # in area, between contact elements and the patches of their laws
MIN_PIXELS = 16  # along a side of a patch
MAX_PIXEL_RATIO = 2.0  # pixels of the laws over those that the scan resolves
MIN_ROUGHNESS = (1e-7, 1e-3)  # S_q [m] and rms slope of the smoothest linings
ROOM = 4.0  # side of a patch over that of the scan, beyond which waves are assumed
LARGE_SCAN = 0.05  # m, longest side of most scans


def check(scene: Scene, comm: MPI.Comm) -> dict[str, SurfaceStatistics]:
    """Everything that can be refused before anything is written.

    Returns:
        Statistics of the surfaces by their sections: ``surface``, and that of each interface with
        one of its own.
    """
    surfaces: dict[str, SurfaceStatistics] = {}
    if "surface" in scene.stages:
        from brake_fenicsx.build.measured_surface import read_surface

        surfaces["surface"] = read_surface(scene)
        for name, own in scene.of_own_surface.items():
            where = own_surface(name)
            surfaces[where] = read_surface(own, where)
    if "equilibrium" in scene.stages:
        from brake_fenicsx.build.brake import check_brake

        check_brake(scene, comm)
        if any(changes_bodies(scene, name) for name in scene.varied):
            from brake_fenicsx.build.values import check_box

            check_box(scene)
    return surfaces


@lines
def remarks(scene: Scene, comm: MPI.Comm) -> Iterator[str]:
    """What is right and still may surprise: a line each, on the first process."""
    if comm.rank or "equilibrium" not in scene.stages:
        return
    from brake_fenicsx.build.scene_mesh import cut_loads

    yield from cut_loads(scene)
    yield from _undamped(scene, True)


@lines
def warnings(scene: Scene, mean_patch: float | None = None) -> Iterator[str]:
    """What is allowed and most probably not meant: a line each.

    Args:
        scene: the scene.
        mean_patch: side of the mean contact element [m], once it is known.
    """
    for rule in (unusual, _clamped, _not_pressing, _swapped):
        yield from rule(scene)
    yield from _undamped(scene, False)
    yield from _other_patch(scene, mean_patch)


def _other_patch(scene: Scene, mean_patch: float | None) -> Iterator[str]:
    """Laws of patches that are no contact elements."""
    if mean_patch is None or scene.micro is None or "micro" not in scene.stages:
        return
    patch = mean_patch if scene.micro.patch == "mesh" else float(scene.micro.patch)
    area = (mean_patch / patch) ** 2
    if not 1 / MAX_AREA_RATIO <= area <= MAX_AREA_RATIO:
        yield f"""micro.patch = {1e3 * patch:g} mm: contact elements have {area:.3g} times the area
            of the laws' patch (their mean side is {1e3 * mean_patch:.3g} mm); write micro.patch =
            "mesh" """


def _held(scene: Scene) -> set[str]:
    """Faces that cannot move."""
    return {face for face, directions in scene.supports.items() if len({*directions}) == 3}


def _clamped(scene: Scene) -> Iterator[str]:
    """What faces that cannot move make idle."""
    to_ground = {f for f, spring in scene.springs.items() if spring.faces is None}
    sections = (("masses", {*scene.masses}), ("springs", to_ground), ("loads", _loaded(scene)))
    for section, faces in sections:
        for face in sorted(faces & _held(scene)):
            yield f"""{dotted(section, face)}: the face is held in all directions by supports, so
                that this has no effect; leave it out, or change {dotted("supports", face)}"""


def _not_pressing(scene: Scene) -> Iterator[str]:
    """Loads on a contact face or on its part that do not press the faces together."""
    for name, table in scene.contact.items():
        for face in table.faces:
            at, part = f"{dotted('contact', name)}.faces: {face},", _part(face)
            if face in scene.loads and scene.loads[face].pressure:
                yield f"""{at} has a pressure of its own, {dotted("loads", face)}, which pushes the
                    faces apart; load another face"""
            elif face in _held(scene) and part in map(_part, _loaded(scene)):
                yield f"""{at} is held in all directions by supports, so that the loads on {part} do
                    not press the faces together; change {dotted("supports", face)}"""


def _loaded(scene: Scene) -> set[str]:
    """Faces with a pressure, a force or a moment."""
    return {f for f, load in scene.loads.items() if load.pressure or load.force or load.moment}


def _part(face: str) -> str:
    return face.partition(".")[0]


def _swapped(scene: Scene) -> Iterator[str]:
    """Sliding interfaces whose second body is pressed and whose first is not."""
    if "equilibrium" not in scene.stages:
        return
    of = {name: {name} for name in scene.parts}
    stuck = [one.faces for name, one in scene.contact.items() if not slides(scene, name)]
    sprung = [one.faces for one in scene.springs.values() if one.faces]
    for faces in (*stuck, *sprung, *(tie.faces for tie in scene.ties.values())):
        joined = set().union(*(of.get(_part(face), set()) for face in faces))
        of |= dict.fromkeys(joined, joined)
    loaded = {*map(_part, _loaded(scene))}
    for name, table in scene.contact.items():
        first, second = map(_part, table.faces)
        pressed = [bool(of.get(part, {part}) & loaded) for part in (first, second)]
        if slides(scene, name) and pressed == [False, True]:
            yield f"""{dotted("contact", name)}.faces: the second face belongs to the body that
                moves, here {second!r}, which has a load; write the pad's face first"""


@lines
def surface_warnings(
    scene: Scene, stats: SurfaceStatistics | None, where: str = "surface"
) -> Iterator[str]:
    """What is doubtful about scans and about the pixels of the laws: a line each.

    Args:
        scene: the scene, its patch in metres where it is known.
        stats: statistics of its surface.
        where: the section of that surface.
    """
    if stats is None:
        return
    rules = (_too_smooth, _large_scans, _coarse_patch)
    for text in (*stats.warnings, *(text for rule in rules for text in rule(scene, stats))):
        own = text.removeprefix("surface: ").replace("surface.", f"{where}.")
        yield text if where == "surface" else f"{where}: {own}"


def _large_scans(_: Scene, stats: SurfaceStatistics) -> Iterator[str]:
    """Scans in a wrong unit."""
    for one in stats.each:
        if one.topography is not None and one.topography.size.max() > LARGE_SCAN:
            x, y = 1e3 * one.topography.size
            yield f"""surface.scan: a scan of {x:.4g} x {y:.4g} mm: unusually large; `size` in an
                npz is in metres; correct it, or surface.size"""


def _coarse_patch(scene: Scene, stats: SurfaceStatistics) -> Iterator[str]:
    """Patches beyond the scan, and pixels that leave out what it resolves."""
    micro = scene.micro
    if micro is None or "micro" not in scene.stages or not stats.each:
        return
    if isinstance(micro.patch, str):
        return
    shortest = min((float(t.size.min()) for t in stats.topographies), default=float("inf"))
    if micro.patch > ROOM * shortest:
        yield f"""micro.patch = {1e3 * micro.patch:.4g} mm: {micro.patch / shortest:.2g} times the
            shortest side of a scan, {1e3 * shortest:.4g} mm, and longer waves are assumed
            (surface.low); take {ROOM * 1e3 * shortest:.4g} mm at most, or a larger scan"""
    if isinstance(micro.pixels, str):
        return
    pixel, fine = micro.patch / micro.pixels, stats.pixel
    if pixel > MAX_PIXEL_RATIO * fine:
        yield f"""micro.pixels = {micro.pixels}: pixels of {1e6 * pixel:.3g} um; the scan resolves
            {1e6 * fine:.3g} um ({round(micro.patch / fine)} pixels, micro.pixels = "scan"): the
            stiffness at low pressure may be several times wrong"""


def _too_smooth(scene: Scene, stats: SurfaceStatistics) -> Iterator[str]:
    """The pad of a brake that is smoother than any lining: heights in a wrong unit, as a rule."""
    from brake_fenicsx.surface.hdf import gradients

    slopes = [gradients(t.heights, t.pixel)[0] for t in stats.topographies]
    rough = stats.S_q >= MIN_ROUGHNESS[0] and min(slopes, default=1.0) >= MIN_ROUGHNESS[1]
    if scene.contact and not rough:
        slope = f" and an rms slope of {min(slopes):.2g}" if slopes else ""
        yield f"""surface: S_q of {1e6 * stats.S_q:.3g} um{slope}: smooth as a mirror, which no
            lining is; correct surface.height_unit or surface.size"""


def _undamped(scene: Scene, counted: bool) -> Iterator[str]:
    """Friction, modes, and nothing that takes energy from them.

    Args:
        scene: the scene.
        counted: the line of a scene whose threshold takes the place of damping, else the warning
            of one that has neither.
    """
    approaches, stability = scene.samples.approaches, scene.stability
    if stability is None or "stability" not in scene.stages:
        return
    # These two take no energy.
    damped = any({*active_terms(scene, a)} - {"slope", "gyroscopic"} for a in approaches)
    rubbing = any(rubs(scene, a) for a in approaches)
    if damped or not rubbing or counted != bool(stability.threshold):
        return
    if counted:
        yield f"the model has no damping; squeal is counted below {-stability.threshold:g} instead"
    else:
        yield """no damping is named in the scene, and modes that hardly grow are unstable too;
            write [stability.damping], or a stability.threshold for what counts as squeal"""


def with_patch(scene: Scene, mean_patch: float) -> Scene:
    """A scene whose laws have a patch in metres, where it names that of the mesh [m]."""
    if scene.micro is None or scene.micro.patch != "mesh":
        return scene
    # Few digits: sums over contact elements differ in the last ones with the number of processes.
    return replace(scene, micro=replace(scene.micro, patch=float(f"{mean_patch:.6g}")))


def with_own_laws(own: Scene, interface: str, stats: SurfaceStatistics) -> Scene:
    """Scene of an interface's own surface with the pixels of its laws; no [micro] if it has none.

    Args:
        own: the scene with this surface as [surface].
        interface: whose surface it is.
        stats: statistics of the surface.
    """
    micro = own.micro
    if micro is None or "micro" not in own.stages or own.contact[interface].law != "library":
        return replace(own, micro=None)
    # As many as this scan resolves, not the other.
    pixels = own.table["micro"].get("pixels", "scan")
    return with_pixels(replace(own, micro=replace(micro, pixels=pixels)), stats)


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
        raise SceneError(f"""{scene.file}: micro.pixels = "scan": a patch of
            {1e3 * float(micro.patch):.3g} mm has {pixels} of the scan's pixels of
            {1e6 * stats.pixel:.3g} um along a side, more than {MAX_PIXELS}; write a number, or name
            surface.cutoff""")
    # A few more where their number has large prime factors: the transforms are faster.
    fast = int(next_fast_len(pixels, real=True))
    return replace(scene, micro=replace(micro, pixels=fast))

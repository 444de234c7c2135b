"""The surface that a scene names, as statistics."""

from contextlib import AbstractContextManager
from dataclasses import replace

import numpy as np

from brake_fenicsx.errors import BrakeError, SceneError, SurfaceError, located
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.contact_section import Surface
from brake_fenicsx.surface.readers import read_topography
from brake_fenicsx.surface.record import SurfaceStatistics
from brake_fenicsx.surface.statistics import averaged, characterise, given_statistics
from brake_fenicsx.surface.topography import Topography, on_grid_of

MAX_SCAN = 0.5  # m


def read_surface(scene: Scene, where: str = "surface") -> SurfaceStatistics:
    """Scan to statistics: height distribution, power spectrum, bi-fractal fit.

    Args:
        scene: the scene.
        where: the section of its surface, for messages.
    """
    try:
        return _read_surface(scene)
    except SceneError as error:
        own = str(error).replace(f"{scene.file}: surface", f"{scene.file}: {where}", 1)
        raise SceneError(own) from None


def _read_surface(scene: Scene) -> SurfaceStatistics:
    table = scene.surface
    if table is None:
        raise SceneError(f"{scene.file}: surface: the section is missing")
    if table.statistics is not None:
        t, shape = table.statistics, table.distribution or "johnson"
        with located(f"{scene.file}: surface", BrakeError):
            stats = given_statistics(t.S_q, t.S_sk, t.S_ku, t.c1, t.c2, t.q_c, distribution=shape)
    else:
        shape = table.distribution or "measured"
        each = _each_scan(scene, table, shape)
        with _key(scene, "scan", list(table.scans)):
            stats = averaged(each, table.cutoff, shape, table.spectrum)
        if (lay := stats.spectrum.lay) is not None and table.grooves is not None:
            turn = table.grooves - stats.direction - np.pi / 2.0
            lay = replace(lay, turn=turn)
            stats = replace(stats, spectrum=replace(stats.spectrum, lay=lay))
    return stats if table.form is None else _with_form(scene, table, table.form, stats)


def _with_form(
    scene: Scene, table: Surface, file: str, stats: SurfaceStatistics
) -> SurfaceStatistics:
    """Statistics of a surface whose longest waves are those of a longer scan."""
    with _key(scene, "form", file):
        scan = _read(scene, file, Surface())
        long = characterise(scan, table.level, distribution="johnson", spectrum=table.spectrum)
    where, band = f"{scene.file}: surface.form = {file!r}", stats.bifractal.band
    ends = (*long.bifractal.band[::-1], band[0])
    shortest, longest, limit = (2e3 * np.pi / q for q in ends)
    if shortest > limit:
        raise SceneError(f"""{where}: its shortest wave of {shortest:.3g} mm is longer than the
            longest of the scan, {limit:.3g} mm; name a finer one""")
    if not longest > limit:
        raise SceneError(f"""{where}: its longest wave of {longest:.3g} mm is not longer than that
            of the scan, {limit:.3g} mm; name a longer scan, or none""")
    return replace(stats, spectrum=replace(stats.spectrum, form=long.spectrum, band=band))


def _each_scan(scene: Scene, table: Surface, shape: str) -> list[SurfaceStatistics]:
    """Statistics of every scan; of several each has the fit, and all together the spectrum."""
    spectrum = table.spectrum if len(table.scans) == 1 else "fit"
    scans: list[Topography] = []
    each = []
    for file in table.scans:
        with _key(scene, "scan", file):
            scan = _read(scene, file, table)
            scans.append(on_grid_of(scans[0], scan) if scans else scan)
            one = characterise(
                scans[-1], table.level, cutoff=table.cutoff, distribution=shape, spectrum=spectrum
            )
            each.append(one)
    return each


def _read(scene: Scene, file: str, table: Surface) -> Topography:
    """A scan file whose heights and sides go together.

    Args:
        scene: the scene.
        file: name of the file.
        table: what says of the file what is not in it.

    Raises:
        SurfaceError: the two lengths, their ratio and the remedy.
    """
    size = None if table.size is None else (table.size[0], table.size[-1])
    scan = read_topography(scene.path(file), size, table.height_unit, rows=table.rows)
    low, high = np.nanpercentile(scan.heights, [0.5, 99.5])
    side = float(scan.size.max())
    if side > MAX_SCAN or high - low > side:
        wrong = "size" if side > MAX_SCAN else "height_unit"
        raise SurfaceError(f"""heights span {high - low:.3g} m, {(high - low) / side:.2g} times the
            longer side of {side:.3g} m: not plausible; correct surface.{wrong}""")
    return scan


def _key(scene: Scene, name: str, value: object) -> AbstractContextManager[None]:
    """What is wrong with a surface, with the scene's file, the key and its value."""
    return located(f"{scene.file}: surface.{name} = {value!r}", BrakeError)

"""Rules of [surface]: scans or statistics, and what belongs to either."""

from __future__ import annotations

import os
from itertools import combinations
from typing import TYPE_CHECKING

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene.tables import shown

if TYPE_CHECKING:
    from brake_fenicsx.scene.sections import Scene, Surface


def check_surface(s: Scene) -> None:
    """Refuse a surface whose keys contradict each other or name no file.

    Raises:
        SceneError: the key, its value and the remedy.
    """
    if s.surface is None:
        return
    if "surface" in s.stages:
        _check_scans(s, s.surface)
    if s.surface.S_q == "scan":
        if s.surface.form:
            raise SceneError(
                'surface.S_q = "scan": the variance is that of the scan, and surface.form adds'
                " longer waves; leave one out"
            )
        if any(c.gap == "waviness" for c in s.contact.values()):
            raise SceneError(
                'surface.S_q = "scan": gap = "waviness" shares the variance of the spectrum; write'
                ' surface.S_q = "spectrum", or gap = "hdf"'
            )
    if s.surface.statistics:
        for name in ("cutoff", "size", "height_unit"):
            if getattr(s.surface, name) is not None:
                raise SceneError(f"surface.{name}: there is no scan, but statistics; leave it out")


def _check_scans(s: Scene, surface: Surface) -> None:
    """Scans or statistics; every file is there, and named once."""
    scan, files = surface.scan, surface.scans
    if scan == ():
        raise SceneError("surface.scan = []: an empty list; name the file of a scan, or several")
    if not scan and not surface.statistics:
        raise SceneError("surface: name a scan or statistics")
    if scan and surface.statistics:
        named = shown(scan if isinstance(scan, str) else [*files])
        raise SceneError(f"surface.scan = {named}: give either surface.scan or surface.statistics")
    long = (surface.form,) if surface.form else ()
    for name, file in [*(("scan", f) for f in files), *(("form", f) for f in long)]:
        if not os.path.isfile(s.path(file)):
            raise SceneError(
                f"surface.{name} = {file!r}: no such file; paths start at the scene's folder"
            )
    for one, other in combinations(files, 2):
        if os.path.samefile(s.path(one), s.path(other)):
            raise SceneError(
                f"surface.scan: {other!r} is the same file as {one!r} and would count twice; leave"
                " it out"
            )

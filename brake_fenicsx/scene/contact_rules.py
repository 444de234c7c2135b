"""Rules between sections of a scene: surface, contact and what is swept."""

from __future__ import annotations

import os
from collections.abc import Iterator
from itertools import combinations

import numpy as np

from brake_fenicsx.scene.keys import dotted, shown
from brake_fenicsx.scene.samples_section import NO_ROUGH_SAMPLES, below_least
from brake_fenicsx.scene.scene import Scene
from brake_fenicsx.scene.surface_section import Surface
from brake_fenicsx.scene.sweep_section import Range


def surface_mistakes(s: Scene) -> Iterator[str]:
    """Files that are not there or count twice, and what gaps ask of the surface."""
    if s.surface is None:
        return
    if "surface" in s.stages:
        yield from _scans(s, s.surface)
    if s.surface.S_q == "scan" and any(c.gap == "waviness" for c in s.contact.values()):
        yield """surface.S_q = "scan": gap = "waviness" shares the variance of the spectrum; write
            surface.S_q = "spectrum", or gap = "hdf" """


def _scans(s: Scene, surface: Surface) -> Iterator[str]:
    """Scans or statistics; every file is there, and named once."""
    scan, files = surface.scan, surface.scans
    if scan == ():
        yield "surface.scan = []: an empty list; name the file of a scan, or several"
    if not scan and not surface.statistics:
        yield "surface: name a scan or statistics"
    if scan and surface.statistics:
        listed = shown(scan if isinstance(scan, str) else [*files])
        yield f"surface.scan = {listed}: give either surface.scan or surface.statistics"
    form = (surface.form,) if surface.form else ()
    for name, file in [*(("scan", f) for f in files), *(("form", f) for f in form)]:
        if not os.path.isfile(s.path(file)):
            yield f"surface.{name} = {file!r}: no such file; paths start at the scene's folder"
    for one, other in combinations(files, 2):
        if os.path.samefile(s.path(one), s.path(other)):
            yield f"""surface.scan: {other!r} is the same file as {one!r} and would count twice;
                leave it out"""


def contact_mistakes(s: Scene) -> Iterator[str]:
    """Laws and gaps that no stage provides; interfaces that divide the same faces differently."""
    for name, contact in s.contact.items():
        where = f"contact.{name}"
        if contact.law == "library" and "micro" not in s.stages and s.samples.rough:
            yield f'{where}.law = "library": needs the stages surface and micro'
        if contact.gap != "none" and "surface" not in s.stages:
            yield f'{where}.gap = "{contact.gap}": needs the stage surface'
        if contact.gap == "waviness" and s.micro is None:
            yield f"""{where}.gap = "waviness": needs micro.patch, the length from which waves are
                longer"""
    for (one, first), (two, second) in combinations(s.contact.items(), 2):
        for name in ("faces", "discretisation") if {*first.faces} == {*second.faces} else ():
            values = getattr(first, name), getattr(second, name)
            if values[0] != values[1]:
                yield f"""contact.{two}.{name} = {shown(values[1])}: contact.{one} is on the same
                    faces with {shown(values[0])}; write the same, for the two divide its
                    elements"""


def sweep_mistakes(s: Scene) -> Iterator[str]:
    """A sweep that has no values, nothing to follow, or samples it cannot follow."""
    sweep = s.sweep
    if sweep is None:
        return
    if "stability" not in s.stages:
        yield "sweep: follows complex modes; add the stage stability to stages"
    if not 1 <= len(sweep.parameters) <= 2:
        yield f"""sweep.parameters: {len(sweep.parameters)} keys; name one or two, such as
            "contact.NAME.friction" = {{ start = 0.0, stop = 0.8, steps = 41 }}"""
    for name, values in sweep.parameters.items():
        for text in _range_mistakes(name, values):
            yield f"{dotted('sweep', 'parameters', name)}: {text}"
    written = f"sweep.samples = {sweep.samples}"
    if sweep.samples and sweep.second:
        yield f"""{written}: samples are followed over one parameter; leave
            {dotted("sweep", "parameters", sweep.second)} or sweep.samples out"""
    if sweep.samples and not s.samples.rough:
        yield f"{written}: {NO_ROUGH_SAMPLES}"
    if sweep.samples and "uncertainty" not in s.stages:
        yield f"{written}: needs the stage uncertainty; add it to stages"


def _range_mistakes(name: str, values: Range) -> Iterator[str]:
    """Not two values or more, in order, and possible ones."""
    ends = values.start is not None, values.stop is not None
    if any(ends) == bool(values.values) or ends[0] != ends[1]:
        yield "write start, stop and steps, or values"
    x = np.array(values.points)
    step = np.diff(x)
    if x.size < 2 or not (np.all(step > 0) or np.all(step < 0)):
        yield "two values or more are needed, rising or falling"
    if x.size and (wanted := below_least(name, float(x.min()))):
        yield f"{x.min():g}: {wanted}"

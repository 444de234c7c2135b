"""Rules between sections of a scene: names, stages, approaches and what varies."""

import os
from collections.abc import Iterator
from itertools import combinations

from brake_fenicsx.errors import SceneError

from .body_rules import damping_mistakes, face_mistakes, part_mistakes
from .keys import dotted, shown
from .samples_section import APPROACHES, NO_ROUGH_SAMPLES, below_least, is_constant, split_key
from .scalars import check_scalar
from .scene import STAGES, Scene, own_surface, rubs

# Sections without which a stage has nothing to do, and stages that build on another one.
SECTIONS = dict(surface="surface", micro="micro", equilibrium="contact", stability="stability")
PREDECESSORS = {"micro": "surface", "stability": "equilibrium", "uncertainty": "equilibrium"}
LONGEST_NAME = 100
# Keys of [samples] that are about many of them.
MANY = ("n", "random", "design", "curves", "parametric", "joint", "limit")


def check_consistent(s: Scene) -> None:
    """Refuse scenes whose sections contradict each other.

    Raises:
        SceneError: the key, its value and the remedy.
    """
    rules = (
        _names, _stages, _surface, part_mistakes, _contact, face_mistakes, _motion,
        damping_mistakes, _varied, _sweep, _approaches,
    )  # fmt: skip
    for rule in rules:
        for text in rule(s):
            raise SceneError(text)


def _names(s: Scene) -> Iterator[str]:
    """Names of tables are words that a person, a file name and a dotted key can hold."""
    for section in ("parts", "materials", "contact", "ties"):
        for name in getattr(s, section):
            hidden = not name.replace(" ", "_").isprintable()
            if hidden or "." in name or not 0 < len(name.strip()) <= LONGEST_NAME:
                yield f"""{dotted(section, name[:LONGEST_NAME])}: write a name of 1 to
                    {LONGEST_NAME} visible characters without dots"""


def _stages(s: Scene) -> Iterator[str]:
    """Some are named; every one has its section and the stages it builds on."""
    if "stages" not in s.table:
        yield f"""stages: missing; name some of {", ".join(STAGES)}, or write stages = [] in a scene
            of parts alone, for correlate and identify"""
    for stage, section in SECTIONS.items():
        if stage in s.stages and not getattr(s, section):
            yield f"stages: {stage!r} needs a section [{section}]"
    for stage, before in PREDECESSORS.items():
        if stage in s.stages and before not in s.stages:
            yield f"stages: {stage!r} needs {before!r}"
    if s.micro and s.micro.patch == "mesh" and "equilibrium" not in s.stages:
        yield 'micro.patch = "mesh": needs the stage equilibrium; write a length'


def _surface(s: Scene) -> Iterator[str]:
    """Files that are not there or count twice, and what gaps ask of the surface."""
    own = {own_surface(n): c.surface for n, c in s.contact.items()}
    for where, surface in {"surface": s.surface, **own}.items():
        if surface is None or "surface" not in s.stages:
            continue
        scan, files = surface.scan, surface.scans
        if scan == ():
            yield f"{where}.scan = []: an empty list; name the file of a scan, or several"
        if not scan and not surface.statistics:
            yield f"{where}: name a scan or statistics"
        if scan and surface.statistics:
            yield f"{where}.scan = {shown(scan)}: give either {where}.scan or {where}.statistics"
        for name, file in [*(("scan", f) for f in files), ("form", surface.form)]:
            if file and not os.path.isfile(s.path(file)):
                yield f"{where}.{name} = {file!r}: no such file; paths start at the scene's folder"
        for one, other in combinations(files, 2):
            if os.path.samefile(s.path(one), s.path(other)):
                yield f"""{where}.scan: {other!r} is the same file as {one!r} and would count twice;
                    leave it out"""


def _contact(s: Scene) -> Iterator[str]:
    """Laws and gaps that no stage provides; interfaces that divide the same faces differently."""
    for name, contact in s.contact.items():
        where = f"contact.{name}"
        if contact.law == "library" and "micro" not in s.stages and s.samples.rough:
            yield f'{where}.law = "library": needs the stages surface and micro'
        if contact.gap != "none" and "surface" not in s.stages:
            yield f'{where}.gap = "{contact.gap}": needs the stage surface'
        if contact.gap == "waviness" and s.surface and s.surface.S_q == "scan":
            yield """surface.S_q = "scan": gap = "waviness" shares the variance of the spectrum;
                write surface.S_q = "spectrum", or gap = "hdf" """
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


def _sweep(s: Scene) -> Iterator[str]:
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
        if wanted := below_least(name, min(values.points)):
            yield f"{dotted('sweep', 'parameters', name)}: {min(values.points):g}: {wanted}"
    written = f"sweep.samples = {sweep.samples}"
    if sweep.samples and sweep.second:
        yield f"""{written}: samples are followed over one parameter; leave
            {dotted("sweep", "parameters", sweep.second)} or sweep.samples out"""
    if sweep.samples and not s.samples.rough:
        yield f"{written}: {NO_ROUGH_SAMPLES}"
    if sweep.samples and "uncertainty" not in s.stages:
        yield f"{written}: needs the stage uncertainty; add it to stages"


def _motion(s: Scene) -> Iterator[str]:
    """Friction has a direction."""
    sliding = any(rubs(s, approach) for approach in s.samples.approaches)
    if "equilibrium" in s.stages and sliding and s.motion is None:
        yield "motion: friction needs a section [motion]"


def _varied(s: Scene) -> Iterator[str]:
    """Scalars that may vary; no material is named in two ways."""
    for name in s.samples.random:
        check_scalar(s, f'samples.random."{name}"', name)
    for name in s.sweep.parameters if s.sweep else ():
        check_scalar(s, f'sweep.parameters."{name}"', name)
    constants = [split_key(name) for name in s.varied if is_constant(name)]
    by_stiffness = {table for _, table, last in constants if last[0] == "C"}
    for table in by_stiffness & {table for _, table, last in constants if last[0] != "C"}:
        yield f"""samples.random, sweep.parameters: materials.{table} by stiffnesses and by
            engineering constants; use one kind"""


def _approaches(s: Scene) -> Iterator[str]:
    """Approaches that live from random inputs have some, and many samples their stage."""
    if not s.samples.approaches:
        yield f"samples.approaches = []: name some of {', '.join(APPROACHES)}"
    many = "uncertainty" in s.stages
    for name in (a for a in ("parametric", "joint") if a in s.samples.approaches):
        if not s.samples.random:
            yield f"samples.approaches: {name!r} needs random inputs; write [samples.random]"
        if not many:
            yield f"samples.approaches: {name!r} needs the stage uncertainty"
    for name in MANY if "equilibrium" in s.stages and not many else ():
        if s.table.get("samples", {}).get(name, 1) not in (1, {}):
            yield f"""samples.{name}: without the stage uncertainty there is one sample; add it to
                stages, or leave samples.{name} out"""

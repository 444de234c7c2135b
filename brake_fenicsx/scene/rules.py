"""Rules between sections of a scene: names, stages, approaches and what varies."""

from __future__ import annotations

from collections.abc import Iterator
from unicodedata import category

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene.approaches import rubs
from brake_fenicsx.scene.body_rules import damping_mistakes, face_mistakes, part_mistakes
from brake_fenicsx.scene.contact_rules import contact_mistakes, surface_mistakes, sweep_mistakes
from brake_fenicsx.scene.keys import dotted
from brake_fenicsx.scene.samples_section import APPROACHES, split_key
from brake_fenicsx.scene.scalars import check_scalar
from brake_fenicsx.scene.scene import STAGES, Scene

# Sections without which a stage has nothing to do, and stages that build on another one.
SECTIONS = {
    "surface": "surface", "micro": "micro", "equilibrium": "contact", "stability": "stability",
}  # fmt: skip
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
        _names, _stages, surface_mistakes, part_mistakes, contact_mistakes, face_mistakes, _motion,
        damping_mistakes, _varied, sweep_mistakes, _approaches,
    )  # fmt: skip
    for rule in rules:
        for text in rule(s):
            raise SceneError(text)


def _names(s: Scene) -> Iterator[str]:
    """Names of tables are words that a person, a file name and a dotted key can hold."""
    for section in ("parts", "materials", "contact", "ties"):
        for name in getattr(s, section):
            hidden = any(category(c)[0] == "C" or category(c) in ("Zl", "Zp") for c in name)
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


def _motion(s: Scene) -> Iterator[str]:
    """Friction has a direction."""
    sliding = any(rubs(s, approach) for approach in s.samples.approaches)
    if "equilibrium" in s.stages and sliding and s.motion is None:
        yield "motion: friction needs a section [motion]"


def _varied(s: Scene) -> Iterator[str]:
    """Scalars that may vary; no material is named in two ways."""
    swept = [*s.sweep.parameters] if s.sweep else []
    scalars = {"samples.random": [*s.samples.random], "sweep.parameters": swept}
    for section, names in scalars.items():
        for name in names:
            check_scalar(s, f'{section}."{name}"', name)
    ways: dict[str, set[bool]] = {}
    for section, table, last in map(split_key, s.varied):
        if section == "materials" and last != "loss":
            ways.setdefault(table, set()).add(last[0] == "C")
    for table, kinds in ways.items():
        if len(kinds) > 1:
            yield f"""samples.random, sweep.parameters: materials.{table} by stiffnesses and by
                engineering constants; use one kind"""


def _approaches(s: Scene) -> Iterator[str]:
    """Approaches that live from random inputs have some, and many samples their stage."""
    if not s.samples.approaches:
        yield f"samples.approaches = []: name some of {', '.join(APPROACHES)}"
    many = "uncertainty" in s.stages
    for name in ("parametric", "joint"):
        if name not in s.samples.approaches:
            continue
        if not s.samples.random:
            yield f"""samples.approaches: {name!r} needs random inputs; write them in
                [samples.random]"""
        if not many:
            yield f"samples.approaches: {name!r} needs the stage uncertainty"
    for name in MANY if "equilibrium" in s.stages and not many else ():
        if s.table.get("samples", {}).get(name, 1) not in (1, {}):
            yield f"""samples.{name}: without the stage uncertainty there is one sample; add it to
                stages, or leave samples.{name} out"""

"""Rules that hold between the sections of a scene."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene.contact import contact_mistakes
from brake_fenicsx.scene.damping import damping_mistakes
from brake_fenicsx.scene.faces import face_mistakes
from brake_fenicsx.scene.friction import rubs
from brake_fenicsx.scene.parts import BUILDERS, part_lengths
from brake_fenicsx.scene.samples import APPROACHES, split_key
from brake_fenicsx.scene.scalars import check_scalar
from brake_fenicsx.scene.surface import surface_mistakes
from brake_fenicsx.scene.sweep import sweep_mistakes

if TYPE_CHECKING:
    from brake_fenicsx.scene.sections import Scene

# Sections without which a stage has nothing to do, and stages that build on another one.
SECTIONS = {
    "surface": "surface", "micro": "micro", "equilibrium": "contact", "stability": "stability",
}  # fmt: skip
PREDECESSORS = {"micro": "surface", "stability": "equilibrium", "uncertainty": "equilibrium"}

# Keys of [samples] that are about many of them.
MANY = ("n", "random", "design", "curves", "parametric", "joint", "limit")


def check_consistent(s: Scene) -> None:
    """Refuse scenes whose sections contradict each other.

    Raises:
        SceneError: the key, its value and the remedy.
    """
    rules = (
        _stages, surface_mistakes, _parts, contact_mistakes, face_mistakes, _motion,
        damping_mistakes, _varied, sweep_mistakes, _approaches, _limit_cycle,
    )  # fmt: skip
    for rule in rules:
        for text in rule(s):
            raise SceneError(text)


def _stages(s: Scene) -> Iterator[str]:
    """Every stage has its section and the stages it builds on."""
    for stage, section in SECTIONS.items():
        if stage in s.stages and not getattr(s, section):
            yield f"stages: {stage!r} needs a section [{section}]"
    for stage, before in PREDECESSORS.items():
        if stage in s.stages and before not in s.stages:
            yield f"stages: {stage!r} needs {before!r}"
    if s.micro and s.micro.patch == "mesh" and "equilibrium" not in s.stages:
        yield 'micro.patch = "mesh": needs the stage equilibrium; write a length'


def _parts(s: Scene) -> Iterator[str]:
    """Every part has cells, a possible length, and its material is there."""
    low, high = s.mesh.extent
    for name, part in s.parts.items():
        where = f"parts.{name}"
        if part.builder is None and part.matrices is None and s.mesh.file is None:
            yield (
                f"{where}.builder: missing; use one of {', '.join(BUILDERS)}, or name a mesh.file"
            )
        if part.parameters is not None:
            longest, length = max(part_lengths(part.parameters).items(), key=lambda item: item[1])
            if not low <= length <= high:
                yield (
                    f"{where}.{longest} = {length:.3g} m: the longest length of the part, not"
                    f" between {low:g} m and {high:g} m; correct the unit, or widen mesh.extent"
                )
        for material in part.materials:
            if material not in s.materials:
                yield f"{where}.material = {material!r}: there is no [materials.{material}]"


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
            yield (
                f"samples.random, sweep.parameters: materials.{table} by stiffnesses and by"
                " engineering constants; use one kind"
            )


def _approaches(s: Scene) -> Iterator[str]:
    """Approaches that live from random inputs have some, and many samples their stage."""
    if not s.samples.approaches:
        yield f"samples.approaches = []: name some of {', '.join(APPROACHES)}"
    many = "uncertainty" in s.stages
    for name in ("parametric", "joint"):
        if name not in s.samples.approaches:
            continue
        if not s.samples.random:
            yield (
                f"samples.approaches: {name!r} needs random inputs; write them in [samples.random]"
            )
        if not many:
            yield f"samples.approaches: {name!r} needs the stage uncertainty"
    for name in MANY if "equilibrium" in s.stages and not many else ():
        if s.table.get("samples", {}).get(name, 1) not in (1, {}):
            yield (
                f"samples.{name}: without the stage uncertainty there is one sample; add it to"
                f" stages, or leave samples.{name} out"
            )


def _limit_cycle(s: Scene) -> Iterator[str]:
    """Limit cycles are those of the reduced model."""
    if s.limit_cycle and (s.stability is None or s.stability.method != "reduced"):
        yield 'limit_cycle: needs [stability] with method = "reduced"'

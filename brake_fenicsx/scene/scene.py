"""The scene: its sections in SI units, each in the module that is about it; what acts in samples.

Every key is a field of a dataclass, or of a builder in ``geometry``: its default, and as metadata
unit, sign, choices, rule and usual values (``keys.key``); its meaning stands in the docstring. What
the keys of a table contradict in one another stands below them (``contradictions``), and what
sections contradict in ``rules``. What a scene does not name is None, and is neither built,
assembled nor imported. Friction, damping and the method of the modes are those of each approach.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, make_dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Self

from brake_fenicsx.extensions import Extensions, beside_samples, extras, load

from .contact_section import ContactTable, Friction, Micro, Surface
from .keys import dotted, key
from .parts_section import (
    HELD,
    AddedMass,
    Held,
    Load,
    MaterialTable,
    MeshTable,
    Motion,
    Part,
    Spring,
    Tie,
    parts_type,
)
from .samples_section import Samples, Sweep
from .stability_section import TERMS, Damping, EquilibriumTable, Stability

STAGES = ("surface", "micro", "equilibrium", "stability", "uncertainty", "report")

# Approaches of perfect contact.
PERFECT = frozenset({"classical", "parametric"})


def _names() -> Any:
    """Names -> "module:attribute", or a table with it under ``use`` beside arguments."""
    return dict[str, str | dict[str, Any]]


def own_surface(interface: str) -> str:
    """Section of the surface that an interface has of its own."""
    return f"{dotted('contact', interface)}.surface"


@dataclass(frozen=True, slots=True)
class ExtensionsTable:
    """[extensions]: classes of installed packages ([developer_guide.md](developer_guide.md)).

    Attributes:
        contact: interface -> contact law, "module:Class" or a table with ``use = "module:Class"``
            and the arguments of the class, in SI units.
        friction: sliding interface -> friction law.
        damping: any name -> damping term of the bodies.
        random: dotted key of a random input -> its law.
        builders: name for ``parts.NAME.builder`` -> dataclass of its parameters.
        figures: name of a figure of the page -> function that draws it.
        allow: code beside the scene may run; for the command line alone, ``--allow-extensions``.
    """

    contact: dict[str, Any] = key(default=dict, type=_names)
    friction: dict[str, Any] = key(default=dict, type=_names)
    damping: dict[str, Any] = key(default=dict, type=_names)
    random: dict[str, Any] = key(default=dict, type=_names)
    builders: dict[str, Any] = key(default=dict, type=_names)
    figures: dict[str, Any] = key(default=dict, type=_names)
    allow: bool = False


@dataclass(frozen=True, slots=True)
class Scene:
    """A checked scene, without the sections of extras (``scene_type``).

    Attributes:
        stages: stages to run, in order.
        file: the TOML file.
        table: its content with the overrides of the command line.
        own: objects of its section [extensions].
    """

    stages: tuple[str, ...] = key(default=(), choices=STAGES)
    surface: Surface | None = None
    micro: Micro | None = None
    mesh: MeshTable = key(default=MeshTable)
    parts: dict[str, Part] = key(default=dict, type=parts_type)
    materials: dict[str, MaterialTable] = key(default=dict)
    contact: dict[str, ContactTable] = key(default=dict)
    ties: dict[str, Tie] = key(default=dict)
    supports: dict[str, Held] = key(default=dict, write=HELD, rule=(bool, f"write {HELD}"))
    springs: dict[str, Spring] = key(default=dict)
    masses: dict[str, AddedMass] = key(default=dict)
    loads: dict[str, Load] = key(default=dict)
    motion: Motion | None = None
    equilibrium: EquilibriumTable = key(default=EquilibriumTable)
    stability: Stability | None = None
    samples: Samples = key(default=Samples)
    sweep: Sweep | None = None
    extensions: ExtensionsTable | None = None
    file: Path = key(default=Path, internal=True)
    table: dict[str, Any] = key(default=dict, internal=True)
    own: Extensions = key(default=Extensions, internal=True)
    # Dotted key -> values that an extra's own samples take, SI.
    spanned: dict[str, tuple[float, ...]] = key(default=dict, internal=True)

    def __reduce__(self) -> tuple[Any, ...]:
        """The values by name: the class is made anew where it is loaded."""
        return _made, ({f.name: getattr(self, f.name) for f in fields(self)},)

    @property
    def damping(self) -> Damping | None:
        """Terms of the damping."""
        return self.stability.damping if self.stability else None

    @property
    def varied(self) -> list[str]:
        """Dotted keys of the scalars that are random, swept or take other values for an extra."""
        swept = self.sweep.parameters if self.sweep else ()
        return sorted({*self.samples.random, *swept, *self.spanned})

    @property
    def of_own_surface(self) -> dict[str, Self]:
        """Interfaces with a surface of their own -> the scene with this one as [surface]."""
        own = {n: c.surface for n, c in self.contact.items() if c.surface is not None}
        tables = {name: self.table["contact"][name]["surface"] for name in own}
        return {
            name: replace(self, surface=surface, table={**self.table, "surface": tables[name]})
            for name, surface in own.items()
        }

    def section(self, name: str) -> Any:
        """A section of an extra; None where neither the scene nor the program has it."""
        return getattr(self, name, None)

    def path(self, name: str) -> Path:
        """A file named in the scene, relative to the scene's folder."""
        return self.file.parent / os.path.expanduser(name)

    def spoken(self, approach: str) -> str:
        """Name of an approach to a person: "multi-scale" is said of rough contact alone."""
        rough = any(c.law == "library" or c.gap != "none" for c in self.contact.values())
        return approach if rough or approach != "multi-scale" else "smooth contact"


def _made(values: dict[str, Any]) -> Scene:
    return scene_type(())(**values)


@cache
def scene_type(builders: tuple[tuple[str, Any], ...] = ()) -> type[Scene]:
    """``Scene`` with the sections of all extras as further fields; None or empty if not named.

    Args:
        builders: names and dataclasses of builders of a user's own.
    """
    parts = key(default=dict, type=partial(parts_type, dict(builders)))
    more: list[tuple[str, Any, Any]] = [("parts", dict[str, Part], parts)]
    for name, hint in ((k, load(n)) for extra in extras() for k, n in extra.sections.items()):
        one = is_dataclass(hint)
        more.append((name, hint | None if one else hint, key(default=None if one else ())))
    return make_dataclass("Scene", more, bases=(Scene,), frozen=True, slots=True)


def one_friction(scene: Scene, approach: str) -> bool:
    """Whether friction of an approach is samples.classical.friction, whatever the contact says."""
    return approach in PERFECT and scene.samples.classical.friction is not None


def slides(scene: Scene, interface: str) -> bool:
    """Whether the faces of an interface slide along the scene's motion, or else stick."""
    return scene.contact[interface].slip == "motion"


def friction_of(scene: Scene, approach: str, interface: str) -> float | Friction:
    """Friction of an interface in the samples of an approach, where it is not random.

    Faces that stick have none: it is no more than a limit there (``macro.contact_elements``).
    """
    if not slides(scene, interface):
        return 0.0
    classical = scene.samples.classical.friction if approach in PERFECT else None
    return scene.contact[interface].friction if classical is None else classical


def depends_on_speed(friction: Any) -> bool:
    """Whether a coefficient, a table of it or a law of a user's own may change with the speed."""
    if isinstance(friction, float | int):
        return False
    return bool(getattr(friction, "static", 1.0) != getattr(friction, "kinetic", 0.0))


def rubs(scene: Scene, approach: str) -> bool:
    """Whether some element of an approach's samples has friction."""
    other = [*scene.samples.random] if scene.samples.takes_random(approach) else []
    other += [*scene.sweep.parameters] if scene.sweep else []
    other += scene.spanned
    if any(name.endswith(".friction") for name in other):
        return True
    mu = (friction_of(scene, approach, name) for name in scene.contact)
    return any(f if isinstance(f, float | int) else depends_on_speed(f) or f.static for f in mu)


def friction_texts(scene: Scene) -> dict[str, str]:
    """Friction coefficient of each approach as text, by interface where they differ."""
    texts = {}
    for approach in scene.samples.approaches:
        each = {name: _text(scene, approach, name) for name in scene.contact}
        named = [f"{text} ({name})" for name, text in each.items()]
        texts[approach] = ", ".join(named if len({*each.values()}) > 1 else {*each.values()})
    return texts


def listed(scene: Scene) -> str:
    """Friction of each approach in one line."""
    texts = friction_texts(scene)
    return ", ".join(f"{scene.spoken(name)} {text or 'none'}" for name, text in texts.items())


def _text(scene: Scene, approach: str, interface: str) -> str:
    if not slides(scene, interface):
        return "stuck"
    law = scene.samples.random.get(f"contact.{interface}.friction")
    if law is not None and scene.samples.takes_random(approach):
        return "random"
    f = friction_of(scene, approach, interface)
    if isinstance(f, float | int):
        return f"{f:g}"
    return f"{f.static:g} to {f.kinetic:g}" if hasattr(f, "static") else repr(f)


def turning_parts(scene: Scene) -> list[str]:
    """Parts that turn: those named, or those of the second faces of all interfaces."""
    named = scene.damping.gyroscopic if scene.damping else False
    if not isinstance(named, bool):
        return list(named)
    second = (c.faces[1] for name, c in scene.contact.items() if slides(scene, name))
    return sorted({face.partition(".")[0] for face in second}) if named else []


def active_terms(scene: Scene, approach: str) -> tuple[str, ...]:
    """Names of the terms that act in the samples of an approach."""
    table = scene.damping
    if scene.stability is None or "stability" not in scene.stages:
        return ()
    there = {name: table and getattr(table, name) for name in (*TERMS, "own")}
    there |= {"springs": damped_springs(scene), "matrices": damped_bodies(scene)}
    idle = {"slope": one_friction(scene, approach), "sliding": not rubs(scene, approach)}
    return tuple(name for name, acts in there.items() if acts and not idle.get(name))


def damped_springs(scene: Scene) -> dict[str, tuple[float, ...]]:
    """Springs with dashpots, and the damping of these [N s/m]."""
    return {n: s.damping for n, s in scene.springs.items() if s.damping is not None}


def damped_bodies(scene: Scene) -> dict[str, str]:
    """Bodies given by matrices that have a damping, and the file of it."""
    given = {name: part.matrices for name, part in scene.parts.items()}
    return {name: m.damping for name, m in given.items() if m and m.damping is not None}


def reduced_approaches(scene: Scene, counts: Mapping[str, int]) -> set[str]:
    """Approaches whose modes a reduced model gives, if the bodies admit one.

    One serves all approaches whose samples something damps, and one all others. A sample alone
    does not pay for a reduced model, but takes that of other approaches; a sweep, and what only a
    reduced model has (damping ratios, what extras compute beside samples), pay for all.

    Args:
        scene: the scene.
        counts: number of samples of each approach.
    """
    if not _reduced(scene):
        return set()
    damped = {name: bool(active_terms(scene, name)) for name in counts}
    modal = bool(scene.damping and scene.damping.modal)
    asked = bool(scene.sweep or modal or beside_samples(scene))
    paid = {damped[name] for name, count in counts.items() if count > 1 or asked}
    return {name for name in counts if damped[name] in paid}


def lone_samples(scene: Scene, counts: Mapping[str, int]) -> list[str]:
    """Approaches with a single sample that full order takes although the scene says "reduced"."""
    reduced = reduced_approaches(scene, counts)
    return [name for name in counts if _reduced(scene) and name not in reduced]


def _reduced(scene: Scene) -> bool:
    """Whether the scene asks for modes of a reduced model."""
    stability = scene.stability if "stability" in scene.stages else None
    return stability is not None and stability.method == "reduced"


def used_materials(scene: Scene) -> set[str]:
    """Materials of the parts."""
    return {name for part in scene.parts.values() for name in part.materials}

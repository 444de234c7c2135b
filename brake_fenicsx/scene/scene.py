"""The scene: its sections in SI units, each in the module that is about it.

Every key is a field of a dataclass, or of a builder in ``geometry``: its default, and as metadata
unit, sign, choices, rule and usual values (``keys.key``); its meaning stands in the docstring. What
the keys of a table contradict in one another stands below them (``contradictions``), and what
sections contradict in ``rules``. What a scene does not name is None, and is neither built,
assembled nor imported.
"""

import os
from dataclasses import dataclass, fields, is_dataclass, make_dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Self

from brake_fenicsx.extensions import Extensions, extras, load

from .bodies_section import HELD, AddedMass, Held, Load, Motion, Spring, Tie
from .contact_section import ContactTable
from .keys import dotted, key
from .parts_section import MaterialTable, MeshTable, Part, parts_type
from .samples_section import Samples, Sweep
from .stability_section import Damping, EquilibriumTable, Stability
from .surface_section import Micro, Surface

STAGES = ("surface", "micro", "equilibrium", "stability", "uncertainty", "report")


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

"""The scene: its sections in SI units, each in the module that is about it.

Every key is a field of a dataclass, or of a builder in ``geometry``: its default, and as metadata
unit, sign, choices, rule and usual values (``keys.key``); its meaning stands in the docstring. What
the keys of a table contradict in one another stands below them (``contradictions``), and what
sections contradict in ``rules``. What a scene does not name is None, and is neither built,
assembled nor imported.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field, is_dataclass, make_dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

from brake_fenicsx.extensions import Extensions, extras, load
from brake_fenicsx.scene.bodies_section import AddedMass, Load, Motion, Spring, Tie, supports_type
from brake_fenicsx.scene.contact_section import ContactTable
from brake_fenicsx.scene.extensions_section import ExtensionsTable
from brake_fenicsx.scene.keys import key
from brake_fenicsx.scene.mesh_section import MeshTable
from brake_fenicsx.scene.parts_section import MaterialTable, Part, parts_type
from brake_fenicsx.scene.samples_section import Samples
from brake_fenicsx.scene.stability_section import Damping, EquilibriumTable, Stability
from brake_fenicsx.scene.surface_section import Micro, Surface
from brake_fenicsx.scene.sweep_section import Sweep

STAGES = ("surface", "micro", "equilibrium", "stability", "uncertainty", "report")


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
    mesh: MeshTable = field(default_factory=MeshTable)
    parts: dict[str, Part] = field(default_factory=dict, metadata={"type": parts_type})
    materials: dict[str, MaterialTable] = field(default_factory=dict)
    contact: dict[str, ContactTable] = field(default_factory=dict)
    ties: dict[str, Tie] = field(default_factory=dict)
    supports: dict[str, tuple[str, ...]] = field(
        default_factory=dict, metadata={"type": supports_type}
    )
    springs: dict[str, Spring] = field(default_factory=dict)
    masses: dict[str, AddedMass] = field(default_factory=dict)
    loads: dict[str, Load] = field(default_factory=dict)
    motion: Motion | None = None
    equilibrium: EquilibriumTable = field(default_factory=EquilibriumTable)
    stability: Stability | None = None
    samples: Samples = field(default_factory=Samples)
    sweep: Sweep | None = None
    extensions: ExtensionsTable | None = None
    file: Path = key(default=Path(), internal=True)  # noqa: RUF009
    table: dict[str, Any] = field(default_factory=dict, metadata={"internal": True})
    own: Extensions = field(default_factory=Extensions, metadata={"internal": True})
    # Dotted key -> values that an extra's own samples take, SI.
    spanned: dict[str, tuple[float, ...]] = field(default_factory=dict, metadata={"internal": True})

    @property
    def damping(self) -> Damping | None:
        """Terms of the damping."""
        return self.stability.damping if self.stability else None

    @property
    def varied(self) -> list[str]:
        """Dotted keys of the scalars that are random, swept or take other values for an extra."""
        swept = self.sweep.parameters if self.sweep else ()
        return sorted({*self.samples.random, *swept, *self.spanned})

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


@cache
def scene_type(builders: tuple[tuple[str, Any], ...] = ()) -> type[Scene]:
    """``Scene`` with the sections of all extras as further fields; None or empty if not named.

    Args:
        builders: names and dataclasses of builders of a user's own.
    """
    about = {"type": partial(parts_type, dict(builders))}
    parts: Any = field(default_factory=dict, metadata=about)
    more: list[tuple[str, Any, Any]] = [("parts", dict[str, Part], parts)]
    for key_, name in ((k, n) for extra in extras() for k, n in extra.sections.items()):
        hint = load(name)
        one = is_dataclass(hint)
        more.append((key_, hint | None if one else hint, field(default=None if one else ())))
    return make_dataclass("Scene", more, bases=(Scene,), frozen=True, slots=True)

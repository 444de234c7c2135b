"""The scene: its sections in SI units, each in the module that is about it.

Every key is a field of a dataclass, or of a builder in ``geometry``: its default, and as metadata
unit, sign, choices, rule and usual values (``keys.key``); its meaning stands in the docstring. What
the keys of a table contradict in one another stands below them (``contradictions``), and what
sections contradict in ``rules``. What a scene does not name is None, and is neither built,
assembled nor imported.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from brake_fenicsx.extras.variants.countermeasure_keys import Countermeasure
from brake_fenicsx.scene.bodies_section import AddedMass, Load, Motion, Spring, Tie, supports_type
from brake_fenicsx.scene.contact_section import ContactTable
from brake_fenicsx.scene.keys import key
from brake_fenicsx.scene.mesh_section import MeshTable
from brake_fenicsx.scene.parts_section import MaterialTable, Part, parts_type
from brake_fenicsx.scene.samples_section import Samples
from brake_fenicsx.scene.stability_section import Damping, EquilibriumTable, Stability
from brake_fenicsx.scene.surface_section import Micro, Surface
from brake_fenicsx.scene.sweep_section import Sweep

STAGES = ("surface", "micro", "equilibrium", "stability", "uncertainty", "report")


@dataclass(frozen=True, slots=True)
class LimitCycle:
    """[limit_cycle]: the amplitude at which a mode stops growing ([page](limit_cycle.md)).

    Attributes:
        harmonics: harmonics of the vibration beside its mean.
        points: points of time over a period, more than twice the harmonics.
        largest: amplitude at which a mode is followed no further, root mean square of the gap's
            first harmonic over the closed patches.
        damping_below: modes whose damping -2 alpha / |omega| lies below this are followed; 0: those
            that grow beyond ``stability.threshold``. Stable modes may grow from a kick.
        radiating: faces whose motion and sound are stated; those of the disc if not given.
    """

    harmonics: int = key(default=5)
    points: int = key(default=32)
    largest: float = key("m", default=20e-6, band=(1e-9, 1e-3))
    damping_below: float = key(default=0.0, sign="zero")
    radiating: tuple[str, ...] = key(default=())

    def contradictions(self) -> Iterator[str]:
        """Points of time tell the harmonics apart."""
        if self.points <= 2 * self.harmonics:
            yield f""".points = {self.points}: more than twice limit_cycle.harmonics =
                {self.harmonics} are needed; 6 times as many or more see patches open"""


@dataclass(frozen=True, slots=True)
class Scene:
    """A checked scene.

    Attributes:
        stages: stages to run, in order.
        file: the TOML file.
        table: its content with the overrides of the command line.
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
    limit_cycle: LimitCycle | None = None
    samples: Samples = field(default_factory=Samples)
    sweep: Sweep | None = None
    countermeasures: tuple[Countermeasure, ...] = ()
    file: Path = key(default=Path(), internal=True)  # noqa: RUF009
    table: dict[str, Any] = field(default_factory=dict, metadata={"internal": True})

    @property
    def damping(self) -> Damping | None:
        """Terms of the damping."""
        return self.stability.damping if self.stability else None

    @property
    def varied(self) -> list[str]:
        """Dotted keys of the scalars that are random or swept."""
        return sorted({*self.samples.random, *(self.sweep.parameters if self.sweep else ())})

    def path(self, name: str) -> Path:
        """A file named in the scene, relative to the scene's folder."""
        return self.file.parent / os.path.expanduser(name)

    def spoken(self, approach: str) -> str:
        """Name of an approach to a person: "multi-scale" is said of rough contact alone."""
        rough = any(c.law == "library" or c.gap != "none" for c in self.contact.values())
        return approach if rough or approach != "multi-scale" else "smooth contact"

"""The scene, with the sections that no other module is about: frozen settings in SI units.

Every key is a field of a dataclass, or of a builder in ``geometry``; its metadata says the unit
("unit"), the allowed sign ("sign": positive if absent, "zero", "any") and the choices ("choices").
What a table's keys contradict in one another stands below them (``contradictions``), and what
sections contradict in ``rules``. What a scene does not name is None, and is neither built,
assembled nor imported.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, is_dataclass, make_dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal

from brake_fenicsx.extensions import Extensions, extras, load
from brake_fenicsx.scene.contact import ContactTable
from brake_fenicsx.scene.damping import Damping
from brake_fenicsx.scene.faces import AddedMass, Load, Spring, Tie, supports_type
from brake_fenicsx.scene.mesh import MeshTable
from brake_fenicsx.scene.own import ExtensionsTable
from brake_fenicsx.scene.parts import Part, parts_type
from brake_fenicsx.scene.samples import Samples
from brake_fenicsx.scene.surface import Micro, Surface
from brake_fenicsx.scene.sweep import Sweep
from brake_fenicsx.scene.tables import below, between, key, rising_pair, shown, vector
from brake_fenicsx.scene.units import MODULI, to_si

STAGES = ("surface", "micro", "equilibrium", "stability", "uncertainty", "report")

# Least and largest tolerance of Newton's iterations [-].
NEWTON = (1e-13, 1e-3)

# Beyond about 1/sqrt(2) the squares of damped frequencies are no longer positive.
ZETA_LIMIT = 0.7


@dataclass(frozen=True, slots=True)
class MaterialTable:
    """[materials.NAME]: engineering constants or stiffnesses of the chosen model.

    Attributes:
        model: symmetry; which constants it takes: [meshes.md](meshes.md).
        rho: density.
        E: Young's modulus, or one for each axis.
        nu: Poisson's ratio, or one for each pair of axes.
        G: shear modulus, or one for each pair of axes.
        C11: stiffness, in place of engineering constants.
        C22: likewise.
        C33: likewise.
        C12: likewise.
        C13: likewise.
        C23: likewise.
        C44: likewise, shear 23.
        C55: likewise, shear 13.
        C66: likewise, shear 12.
        axis: additional rotation of axis 1, relative to axis 1 of the part.
        loss: loss factor.
    """

    model: str = key(choices=("isotropic", "transversely-isotropic", "orthotropic", "cubic"))
    rho: float = key("kg/m^3", band=(100.0, 25e3))
    E: float | tuple[float, ...] | None = key("Pa", default=None, band=MODULI)
    nu: float | tuple[float, ...] | None = key(default=None, sign="any")
    G: float | tuple[float, ...] | None = key("Pa", default=None, band=MODULI)
    C11: float | None = key("Pa", default=None, band=MODULI)
    C22: float | None = key("Pa", default=None, band=MODULI)
    C33: float | None = key("Pa", default=None, band=MODULI)
    C12: float | None = key("Pa", default=None, sign="any")
    C13: float | None = key("Pa", default=None, sign="any")
    C23: float | None = key("Pa", default=None, sign="any")
    C44: float | None = key("Pa", default=None, band=MODULI)
    C55: float | None = key("Pa", default=None, band=MODULI)
    C66: float | None = key("Pa", default=None, band=MODULI)
    axis: float = key("rad", default=0.0, sign="any")
    loss: float = key(default=0.0, sign="zero", band=(0.0, 1.0))


@dataclass(frozen=True, slots=True)
class Motion:
    """[motion]: rotation about an axis, or a direction.

    Attributes:
        axis: axis of the disc's rotation, "z" if neither it nor a direction is given; or its
            direction, as ``[0, 1, 1]``.
        point: a point of the axis [m]; the origin if not given.
        direction: direction in which the second body slides, in place of ``axis``.
        speed: angular speed about the axis, 1 rad/s if not given, or speed along the direction,
            1 m/s if not given.
    """

    axis: Literal["x", "y", "z"] | tuple[float, ...] | None = key(
        default=None, sign="any", rule=(vector, "write three numbers, not all zero")
    )
    point: tuple[float, ...] | None = key(
        "m", default=None, sign="any", rule=(lambda x: len(x) == 3, "write three numbers")
    )
    direction: tuple[float, ...] | None = key(
        default=None, sign="any", rule=(vector, "write three numbers, not all zero")
    )
    speed: str | None = key(default=None)

    @property
    def turns_about(self) -> tuple[float, ...]:
        """Direction of the axis of rotation."""
        if isinstance(self.axis, tuple):
            return self.axis
        return {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)}.get(self.axis or "z", (0.0, 0.0, 1.0))

    @property
    def rate(self) -> float:
        """Speed along the direction [m/s], or about the axis [rad/s]."""
        if self.speed is None:
            return 1.0
        return to_si(self.speed, "rad/s" if self.direction is None else "m/s")

    def contradictions(self) -> Iterator[str]:
        """An axis or a direction, and a speed about or along it."""
        for name in ("axis", "point") if self.direction is not None else ():
            if (value := getattr(self, name)) is not None:
                yield (
                    f".{name} = {shown(value)}: a disc turns about an axis or slides along a"
                    f" direction; leave motion.{name} or motion.direction out"
                )
        try:
            _ = self.rate
        except ValueError as error:
            turns, remedy = self.direction is None, ""
            with suppress(ValueError):
                to_si(self.speed, "m/s" if turns else "rad/s")
                written, other = ("direction", "axis") if turns else ("axis", "direction")
                remedy = f"; with this speed write motion.{written}, and no motion.{other}"
            yield f".speed = {self.speed!r}: {error}{remedy}"


@dataclass(frozen=True, slots=True)
class EquilibriumTable:
    """[equilibrium]: solution of the braking equilibrium.

    Attributes:
        tolerance: residual of Newton's iterations relative to the contact forces, from 1e-13 to
            1e-3.
    """

    tolerance: float = key(
        default=1e-8,
        rule=between(*NEWTON),
    )


@dataclass(frozen=True, slots=True)
class Stability:
    """[stability]: band and method of the eigenvalue analysis.

    Attributes:
        band: lowest and highest frequency.
        method: every sample at full order, or by one reduced model shared by all.
        cutoff: real modes of the bodies are kept up to here; 1.8 times the band if not given, more
            where materials change.
        tolerance: relative error of the eigenvalues for which the reduced model is built.
        on_tolerance: treatment of a sample with a mode whose estimated error is larger: it is
            counted in the log and in samples.csv ("warn"), or solved at full order ("full order").
        zeta_max: full order omits modes that decay with a larger damping ratio; below 0.7.
        verify: samples of the reduced model that are solved at full order as well.
        threshold: an unstable mode counts as squeal where its damping -2 alpha / |omega| lies below
            minus this; 0: every unstable mode.
        drivers: whether derivatives of the unstable modes with respect to friction, loads, contact
            and layers are computed ([stability.md](stability.md#what-drives-a-mode)).
        damping: terms of the damping; without the section there is no damping.
    """

    band: tuple[float, ...] = key(
        "Hz", sign="zero", band=(0.0, 1e5), rule=(rising_pair, "write [lowest, highest]")
    )
    method: str = key(default="full", choices=("full", "reduced"))
    cutoff: float | None = key("Hz", default=None, band=(0.0, 1e6))
    tolerance: float = key(default=1e-5, rule=between(1e-12, 0.01))
    on_tolerance: str = key(default="warn", choices=("warn", "full order"))
    zeta_max: float = key(default=0.1, rule=between(1e-6, ZETA_LIMIT))
    verify: int = key(default=0, sign="zero")
    threshold: float = key(
        default=0.0,
        sign="zero",
        rule=below(1, "no mode has so large a damping; write a fraction, such as 0.01"),
    )
    drivers: bool = False
    damping: Damping | None = None

    def contradictions(self) -> Iterator[str]:
        """The modes that are kept reach beyond the band."""
        if self.method == "reduced" and self.cutoff is not None and self.cutoff <= self.band[1]:
            yield (
                f".cutoff = {self.cutoff:g} Hz: must lie above the band's {self.band[1]:g} Hz;"
                " raise it, or leave it out"
            )


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

    @property
    def damping(self) -> Damping | None:
        """Terms of the damping."""
        return self.stability.damping if self.stability else None

    @property
    def varied(self) -> list[str]:
        """Dotted keys of the scalars that are random or swept."""
        return sorted({*self.samples.random, *(self.sweep.parameters if self.sweep else ())})

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
    parts = field(default_factory=dict, metadata=about)
    more: list[tuple[str, Any, Any]] = [("parts", dict[str, Part], parts)]
    for key_, name in ((k, n) for extra in extras() for k, n in extra.sections.items()):
        hint = load(name)
        one = is_dataclass(hint)
        more.append((key_, hint | None if one else hint, field(default=None if one else ())))
    return make_dataclass("Scene", more, bases=(Scene,), frozen=True, slots=True)

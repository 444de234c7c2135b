"""What acts on the bodies of a scene: supports, loads, ties, springs, added masses, motion."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal

from .keys import key, shown, two_names, vector
from .units import to_si

Axis = Literal["x", "y", "z"]
DIRECTIONS: tuple[Axis, ...] = ("x", "y", "z")
Held = Literal["clamped"] | tuple[Axis, ...]  # by a support
HELD = '"clamped" or a list of "x", "y", "z"'
TWO_FACES = (two_names, "write two faces")
DIRECTION = (vector, "write three numbers, not all zero")
ALONG = "along the part's axes 1 and 2 and along z"
ABOUT = ALONG.replace("along", "about")


def axes(unit: str, example: str, sign: str = "zero", about: str = ALONG) -> Any:
    """A key for one value along or about each axis."""
    rule = (vector, f"write three, {about}, such as {example}")
    return key(unit, default=None, sign=sign, rule=rule)


@dataclass(frozen=True, slots=True)
class Load:
    """[loads]: loads on a face, by its name "part.face".

    Attributes:
        pressure: the pressure, towards the body.
        force: total force, along axes 1 and 2 of the part and along z, spread evenly over the area.
        moment: total moment about axes through the area's centroid, parallel to axes 1 and 2 of the
            part and z, distributed linearly over the area.
        displacement: imposed displacement of a face that is supported in these directions; the face
            is also fixed in the modes: ``{ z = "-0.1 mm" }``.
        steps: equal load steps, taken only if the full load at once does not converge.
    """

    pressure: float | None = key("Pa", default=None, band=(1e3, 1e8))
    force: tuple[float, ...] | None = axes("N", '[0, 0, "-5 kN"]', "any")
    moment: tuple[float, ...] | None = axes("N m", '[0, 0, "50 N m"]', "any")
    displacement: dict[str, float] | None = key("m", default=None, sign="any")
    steps: int = key(default=1, most=10_000)

    @property
    def size(self) -> float:
        """What multiplies the load of the unit: the pressure [Pa], or 1 of any other one."""
        return 1.0 if self.pressure is None else self.pressure

    def contradictions(self) -> Iterator[str]:
        """A pressure, or a force and a moment, or a displacement of a support."""
        kinds = (self.pressure, self.force or self.moment, self.displacement)
        if kinds.count(None) != 2:
            yield ": write a pressure, or a force and a moment, or a displacement"


@dataclass(frozen=True, slots=True)
class Tie:
    """[ties.NAME]: two faces glued where they touch each other ([meshes.md](meshes.md)).

    Attributes:
        faces: two faces "part.face"; their meshes need not match.
        stiffness: stiffness of the layer between the faces; from the neighbouring materials if not
            given.
        search: largest distance at which the faces are glued; a twentieth of a facet's side if not
            given.
    """

    faces: tuple[str, ...] = key(rule=TWO_FACES)
    stiffness: float | None = key("Pa/m", default=None, band=(1e9, 1e17))
    search: float | None = key("m", default=None)


@dataclass(frozen=True, slots=True)
class Spring:
    """[springs]: springs from the face of this name to the ground, or between two faces.

    Springs to the ground are named "part.face" and are distributed evenly over the face. Springs
    between two faces have any name and connect the mean displacements of the faces
    ([meshes.md](meshes.md#springs-and-masses)). All act along axes 1 and 2 of the (first) face's
    part and along z.

    Attributes:
        faces: two faces connected by the springs, instead of a face and the ground.
        stiffness: total.
        stiffness_per_area: stiffness per area of an elastic foundation to the ground, in addition
            to the total.
        damping: total of dashpots parallel to the springs; they act in the complex modes.
    """

    faces: tuple[str, ...] | None = key(default=None, rule=TWO_FACES)
    stiffness: tuple[float, ...] | None = axes("N/m", '[0, 0, "20 kN/mm"]')
    stiffness_per_area: tuple[float, ...] | None = axes("Pa/m", '[0, 0, "1e9 Pa/m"]')
    damping: tuple[float, ...] | None = axes("N s/m", '[0, 0, "50 N s/m"]')

    def contradictions(self) -> Iterator[str]:
        """A stiffness or a damping; an area only to the ground."""
        if not (self.stiffness or self.stiffness_per_area or self.damping):
            yield ": neither stiffness nor damping; write stiffness, stiffness_per_area, damping"
        if self.faces and self.stiffness_per_area:
            yield """.stiffness_per_area: is for a face and the ground; write the total of the two
                faces as stiffness, or a tie with its stiffness"""


@dataclass(frozen=True, slots=True)
class AddedMass:
    """[masses]: a mass spread evenly over a face, by its name "part.face".

    Attributes:
        mass: total.
        inertia: moments of inertia of the added body about the face's centroid, about axes 1 and 2
            of the part and about z, in addition to the inertia of the distributed mass.
    """

    mass: float = key("kg")
    inertia: tuple[float, ...] | None = axes("kg m^2", '["2 kg mm^2", "2 kg mm^2", 0]', about=ABOUT)


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

    axis: Axis | tuple[float, ...] | None = key(default=None, sign="any", rule=DIRECTION)
    point: tuple[float, ...] | None = key(
        "m", default=None, sign="any", rule=(lambda x: len(x) == 3, "write three numbers")
    )
    direction: tuple[float, ...] | None = key(default=None, sign="any", rule=DIRECTION)
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
        for name, value in (("axis", self.axis), ("point", self.point)):
            if self.direction and value is not None:
                yield f""".{name} = {shown(value)}: a disc turns about an axis or slides along a
                    direction; leave motion.{name} or motion.direction out"""
        try:
            _ = self.rate
        except ValueError as error:
            turns, remedy = self.direction is None, ""
            with suppress(ValueError):
                to_si(self.speed, "m/s" if turns else "rad/s")
                written, other = ("direction", "axis") if turns else ("axis", "direction")
                remedy = f"; with this speed write motion.{written}, and no motion.{other}"
            yield f".speed = {self.speed!r}: {error}{remedy}"

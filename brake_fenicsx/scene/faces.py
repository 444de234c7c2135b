"""What acts on faces and nodes of a scene: supports, loads, ties, springs and added masses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, WithJsonSchema

from brake_fenicsx.scene.tables import key, two_names, vector

if TYPE_CHECKING:
    from brake_fenicsx.scene.sections import Scene

DIRECTIONS = ("x", "y", "z")
TWO_FACES = (two_names, "write two faces")
ALONG = "along the part's axes 1 and 2 and along z"


def axes(unit: str, example: str, sign: str = "zero", about: str = ALONG) -> Any:
    """A key for one value along or about each axis."""
    rule = (vector, f"write three, {about}, such as {example}")
    return key(unit, default=None, sign=sign, rule=rule)


def _held(value: Any) -> Any:
    """Directions held by a support."""
    if value == "clamped":
        return DIRECTIONS
    if isinstance(value, list) and value and all(v in DIRECTIONS for v in value):
        return value
    raise ValueError('write "clamped" or a list of "x", "y", "z"')


def supports_type() -> Any:
    """Type of [supports]: the directions that each holds."""
    some = {"type": "array", "items": {"enum": [*DIRECTIONS]}, "minItems": 1}
    schema = WithJsonSchema({"anyOf": [{"const": "clamped"}, some]})
    return dict[str, Annotated[tuple[str, ...], BeforeValidator(_held), schema]]


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
    displacement: dict[str, float] | None = key("m", default=None, sign="any")  # noqa: RUF009
    steps: int = key(default=1, most=10_000)

    def contradictions(self) -> Iterator[str]:
        """A pressure, or a force and a moment, or a displacement of a support."""
        total = self.force is not None or self.moment is not None
        if (self.pressure is not None) + total + (self.displacement is not None) != 1:
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
        kinds = ("stiffness", "stiffness_per_area", "damping")
        if all(getattr(self, kind) is None for kind in kinds):
            yield f": neither stiffness nor damping; write {', '.join(kinds)}"
        if self.faces is not None and self.stiffness_per_area is not None:
            yield (
                ".stiffness_per_area: is for a face and the ground; write the total of the two"
                " faces as stiffness, or a tie with its stiffness"
            )


@dataclass(frozen=True, slots=True)
class AddedMass:
    """[masses]: a mass spread evenly over a face, by its name "part.face".

    Attributes:
        mass: total.
        inertia: moments of inertia of the added body about the face's centroid, about axes 1 and 2
            of the part and about z, in addition to the inertia of the distributed mass.
    """

    mass: float = key("kg")
    inertia: tuple[float, ...] | None = axes(
        "kg m^2", '["2 kg mm^2", "2 kg mm^2", 0]', about="about the part's axes 1 and 2 and about z"
    )


def faces_by_area(s: Scene, part: str) -> dict[str, str]:
    """Faces of a part whose area or shape matters: key of the scene -> "part.face"."""
    found = {f"contact.{n}.faces": c.faces for n, c in s.contact.items()}
    found |= {f"ties.{n}.faces": tie.faces for n, tie in s.ties.items()}
    found |= {f"springs.{n}": spring.faces or (n,) for n, spring in s.springs.items()}
    found |= {f'loads."{face}"': (face,) for face in s.loads}
    found |= {f'masses."{face}"': (face,) for face in s.masses}
    return {
        key: face
        for key, faces in found.items()
        for face in faces
        if face.partition(".")[0] == part
    }


def face_mistakes(s: Scene) -> Iterator[str]:
    """Ties of faces in contact, masses of turning parts, and loads that their face cannot take."""
    touching = {face: name for name, contact in s.contact.items() for face in contact.faces}
    for name, tie in s.ties.items():
        for face in tie.faces:
            if face in touching:
                yield (
                    f"ties.{name}.faces: {face!r} is in contact.{touching[face]} as well, whose"
                    " faces the tie would glue; leave one out, or divide the face"
                )
    if s.masses and s.damping and s.damping.gyroscopic:
        yield (
            f"masses: {', '.join(s.masses)}: stability.damping.gyroscopic knows the density of the"
            " bodies alone; leave the masses or gyroscopic out"
        )
    for face, load in s.loads.items():
        where = f'loads."{face}"'
        if load.displacement is not None:
            yield from _displacement(s, face, load.displacement)
        part = s.parts.get(face.partition(".")[0])
        both = getattr(getattr(part, "parameters", None), "side", None) == "both"
        if both and (load.force or load.moment):
            yield (
                f"{where}: the face lies on both sides of the disc; write a pressure, or side ="
                ' "top" and a second part with side = "bottom"'
            )


def _displacement(s: Scene, face: str, moved: dict[str, float]) -> Iterator[str]:
    """Directions that the face's support holds, of a part whose stiffness is that of the scene."""
    where, held = f'loads."{face}".displacement', s.supports.get(face, ())
    if unknown := [c for c in moved if c not in DIRECTIONS]:
        yield f"{where}: {unknown[0]!r}: unknown direction; write x, y or z"
    if not moved or any(c not in held for c in moved):
        yield (
            f"{where} = {moved!r}: moves directions that a support holds; write"
            f' supports."{face}" = ["x", "y", "z"], or those of them that are meant'
        )
    part = s.parts.get(face.partition(".")[0])
    if part is None or part.matrices is not None:
        yield f"{where}: moves a face of a mesh; write a force on the set of nodes"
    else:
        for name in s.varied:
            if name.split(".")[1] in (*part.materials, face.partition(".")[0]):
                yield (
                    f"{where}: the force of the displacement would change with {name}; leave that"
                    " out, or write a force"
                )

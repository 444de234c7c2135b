"""Bodies of a scene: [parts] and [materials], and what acts on them.

A part is a builder with its parameters, or cells of a mesh file; supports, loads, ties, springs,
added masses and motion act on faces of parts.
"""

import importlib
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import partial
from types import MappingProxyType
from typing import Annotated, Any, Literal, Union

from pydantic import BeforeValidator, Discriminator, Tag

from .keys import KeyMistake, key, rising_pair, shown, table_type, two_names, value_type, vector
from .units import MODULI, to_si

# What a thickness and a displaced mesh of a part of the mesh file are called in it.
FILE_LAYER, MORPH = "layers.", "morph."
BUILDERS = {"disc": "Disc", "pad": "Pad", "block": "Block"}

Axis = Literal["x", "y", "z"]
DIRECTIONS: tuple[Axis, ...] = ("x", "y", "z")
Held = Literal["clamped"] | tuple[Axis, ...]  # by a support
HELD = '"clamped" or a list of "x", "y", "z"'
TWO_FACES = (two_names, "write two faces")
DIRECTION = (vector, "write three numbers, not all zero")
ALONG = "along the part's axes 1 and 2 and along z"
ABOUT = ALONG.replace("along", "about")


def _dotted(names: str | tuple[str, ...]) -> bool:
    """Whether one name, or each of several, is "part.name"."""
    parts = [name.split(".") for name in ((names,) if isinstance(names, str) else names)]
    return bool(parts) and all(len(p) == 2 and all(p) for p in parts)


NAMED = (_dotted, 'write "part.name"')


@dataclass(frozen=True, slots=True)
class MeshTable:
    """[mesh]: how parts are meshed, or the file that contains the mesh.

    Attributes:
        cells: kind of the builders' cells; hexahedra only for swept parts. The hexahedra of the
            reference disc take about half the unknowns of tetrahedra at equal error, and keep the
            frequencies of double modes equal to 1e-13 (tetrahedra of 12 mm: 4e-4 apart).
        order: order of the geometry. 1 (straight edges) is enough for flat contact; 2 puts mid-side
            nodes on curved faces, which curved contact (Hertz) needs.
        degree: polynomial degree of the displacements. 1 is for comparison with decks of linear
            elements: these elements are fully integrated, too stiff in bending and lock near nu =
            0.5.
        mass: consistent, or lumped (the sum of each row on the diagonal; linear elements only).
        growth: growth rate of the cell size away from finer cells, size per distance.
        quality: lowest accepted cell quality: 3 r / R of tetrahedra, scaled Jacobian of hexahedra.
        file: mesh file, relative to the scene's folder.
        unit: unit of the file's coordinates.
        groups: group of the file -> "part.layer" for cells, "part.face" for surfaces or nodes; a
            list of faces where it lies on several parts.
        split: face whose nodes are duplicated -> face of the other body with the original nodes.
        extent: smallest and largest accepted extent [m] of the mesh; other meshes are rejected as a
            mistake in the unit.
    """

    cells: str = key(default="tetrahedra", choices=("tetrahedra", "hexahedra"))
    order: int = key(default=1, choices=(1, 2))
    degree: int = key(default=2, choices=(1, 2))
    mass: str = key(default="consistent", choices=("consistent", "lumped"))
    growth: float = key(default=0.5)
    quality: float = key(default=0.01)
    file: str | None = key(default=None)
    unit: str | None = key(default=None)
    groups: dict[str, str | tuple[str, ...]] = key(default=dict, rule=NAMED)
    split: dict[str, str] = key(default=dict, rule=NAMED)
    extent: tuple[float, ...] = key(
        "m", default=(5e-3, 3.0), rule=(rising_pair, "write [smallest, largest]")
    )

    def contradictions(self) -> Iterator[str]:
        """Orders that go together; what is said of a mesh file needs one."""
        if self.degree == 1 and self.order == 2:
            yield ".order = 2: needs mesh.degree = 2, displacements of second order"
        if self.degree == 2 and self.mass == "lumped":
            yield """.mass = "lumped": corners of quadratic elements would have no or negative mass;
                write mesh.degree = 1 as well"""
        for name in ("unit", "groups", "split") if self.file is None else ():
            if getattr(self, name):
                yield f".{name}: needs mesh.file, the file that it is about"


@dataclass(frozen=True, slots=True)
class Matrices:
    """[parts.NAME.matrices]: a body of another code, by its matrices ([meshes.md](meshes.md)).

    Attributes:
        stiffness: file of the stiffness: Matrix Market, text of three or five columns (Abaqus,
            CalculiX), Nastran DMIG, or npz.
        mass: file of the mass.
        nodes: table of the nodes: number, x, y, z and the sets that each is in.
        units: consistent units of length, mass and time in all files: ``["mm", "t", "s"]``.
        damping: file of the damping.
        dofs: file with node and component of each row, if the matrix files do not contain them;
            without ``dofs``, the displacements of the nodes come first, in their order.
        modal: number of modal coordinates in the last rows, if no file gives the order of the rows.
    """

    stiffness: str
    mass: str
    nodes: str
    units: tuple[str, ...]
    damping: str | None = key(default=None)
    dofs: str | None = key(default=None)
    modal: int = key(default=0, sign="zero")


@dataclass(frozen=True, slots=True)
class Morph:
    """[parts.NAME.morph.LENGTH]: a length that a displaced mesh defines.

    Attributes:
        displaced: mesh file with the nodes and elements of ``mesh.file``, some nodes of this part
            at other places.
        ends: the length in ``mesh.file`` and in ``displaced``; between and beyond, nodes move in
            proportion ([studies.md](studies.md#displaced-meshes)).
        value: the length in this scene; the first of ``ends`` if not given.
    """

    displaced: str
    ends: tuple[float, ...] = key(
        "m", rule=(two_names, "write two lengths, that in mesh.file and that in the displaced mesh")
    )
    value: float | None = key("m", default=None)

    @property
    def length(self) -> float:
        """Its value in the scene [m]."""
        return self.ends[0] if self.value is None else self.value


@dataclass(frozen=True, slots=True)
class Part:
    """[parts.NAME]: a builder with its parameters, cells of the mesh file, or matrices.

    Attributes:
        material: one ``[materials]`` name, or one for each layer:
            ``{ lining = "..", plate = ".." }``.
        builder: shape to build; without it the cells come from the file in ``[mesh]``.
        axis: direction of the part's axis 1: angle from x about z; default for a pad: the tangent
            at mid pad; for other parts: 0.
        matrices: the files that hold it, in place of builder and material.
        layers: thickness of its layers along z, as meshed: flat layers named here may take other
            thicknesses in samples ([studies.md](studies.md#thicknesses)).
        morph: lengths that a second mesh file defines, by any name.
        parameters: the builder's parameters.
    """

    material: str | dict[str, str]
    builder: str | None = key(default=None, choices=tuple(BUILDERS))
    axis: float = key("rad", default=None, sign="any")
    matrices: Matrices | None = None
    layers: dict[str, float] = key("m", default=dict)
    morph: dict[str, Morph] = key(default=dict)
    parameters: Any = key(default=None, internal=True)

    @property
    def materials(self) -> tuple[str, ...]:
        """Names of its materials; none where it is given by matrices."""
        if self.matrices is not None:
            return ()
        return (self.material,) if isinstance(self.material, str) else (*self.material.values(),)

    @property
    def shape(self) -> Any:
        """Module of its builder; None without one."""
        if self.builder in BUILDERS:
            return importlib.import_module(f"brake_fenicsx.geometry.{self.builder}")
        return self.builder and sys.modules[type(self.parameters).__module__]


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


def builder_class(name: str) -> Any:
    """Dataclass of a builder's parameters."""
    return getattr(importlib.import_module(f"brake_fenicsx.geometry.{name}"), BUILDERS[name])


def length_key(name: str) -> tuple[str, str]:
    """Part and key: of "parts.PART.lining", "parts.PART.layers.LAYER" or "....morph.NAME.value"."""
    _, part, last = name.split(".", 2)
    return part, last


def length_in_scene(part: Part, name: str) -> float:
    """Length [m] that a part has in the scene; arguments as below."""
    if morph := morph_of(part, name):
        return morph.length
    if part.builder is None:
        return part.layers[name.removeprefix(FILE_LAYER)]
    return float(getattr(part.parameters, name))


def morph_of(part: Part, name: str) -> Morph | None:
    """What "morph.NAME.value" of a part is about; None for other keys."""
    kind, _, rest = name.partition(".")
    return part.morph.get(rest.removesuffix(".value")) if f"{kind}." == MORPH else None


def layers_of_thickness(part: Part, name: str) -> tuple[str, ...]:
    """Layers of a part that have one of its numbers for their thickness.

    Args:
        part: the part.
        name: a parameter of its builder, or "layers.LAYER" of a part from the mesh file.
    """
    if part.builder is None:
        layer = name.removeprefix(FILE_LAYER)
        return (layer,) if layer in part.layers and layer != name else ()
    lengths = getattr(part.shape, "thicknesses", None)
    named = {} if lengths is None else lengths(part.parameters)
    return tuple(named.get(name, ()))


def moved_planes(part: Part, name: str) -> tuple[list[float], list[float]] | None:
    """Planes across z that a length of a builder moves along z.

    Args:
        part: the part.
        name: a parameter of its builder.

    Returns:
        Heights of all planes [m], and their derivatives to the length; None where the
        length moves anything else, or nothing.
    """
    shape, table = part.shape, part.parameters
    moves = name in getattr(shape, "HEIGHTS", ()) or layers_of_thickness(part, name)
    if not moves or not hasattr(shape, "levels") or not getattr(table, name):
        return None
    step, here = 1e-3 * getattr(table, name), shape.levels(table)
    there = shape.levels(replace(table, **{name: getattr(table, name) - step}))
    if len(there) != len(here) or here == there:
        return None
    return here, [(a - b) / step for a, b in zip(here, there, strict=True)]


def moved_sideways(part: Part, name: str) -> Callable[[Any], Any] | None:
    """How a length of a builder moves points of the part at right angles to z.

    Args:
        part: the part.
        name: a parameter of its builder.

    Returns:
        Of points [m], shape (n, 3), their movement along x and y per length, shape (n, 2); None
        where the length moves anything else, or nothing.
    """
    shape, table = part.shape, part.parameters
    if not getattr(table, name, None) or name not in getattr(shape, "widths", lambda _: ())(table):
        return None
    return lambda points: shape.sideways(table, name, points)


def longest_length(parameters: Any) -> tuple[str, float]:
    """The longest length among a builder's parameters, without sign: its key, and it [m]."""
    names = [f.name for f in fields(parameters) if f.metadata.get("unit") == "m"]
    held = {name: value for name in names if (value := getattr(parameters, name)) not in (None, ())}
    sizes = {n: max(map(abs, v)) if isinstance(v, tuple) else abs(v) for n, v in held.items()}
    return max(sizes.items(), key=lambda item: item[1])


def _part(cls: Any = None, material: Any = "", builder: Any = None, **keys: Any) -> Part:
    """A part from what its table holds."""
    names = {f.name for f in fields(cls)} & keys.keys() if cls else ()
    parameters = cls(**{name: keys.pop(name) for name in names}) if cls else None
    keys = {"axis": getattr(parameters, "axis", 0.0), **keys}
    return Part(material, builder, parameters=parameters, **keys)


def _checked_builder(table: Any, known: Mapping[str, Any]) -> Any:
    """Refuse what says no builder's name, and parameters without one."""
    if not isinstance(table, dict):
        raise ValueError("write a table")
    if "matrices" in table:
        return table
    if "builder" in table and table["builder"] not in list(known):
        raise KeyMistake(f"use one of {', '.join(known)}", "builder")
    parameters = {*table} - {f.name for f in fields(Part)}
    if "builder" not in table and parameters:
        raise KeyMistake("has no meaning without a builder", min(parameters))
    return {**table, "shim": 0} if table.get("shim") is False else table


def parts_type(own: Mapping[str, Any] = MappingProxyType({})) -> Any:
    """Type of [parts]: one for each builder, one for cells of the mesh file, one for matrices.

    Args:
        own: name of a builder of a user's own -> dataclass of its parameters.
    """
    builders = {**{name: builder_class(name) for name in BUILDERS}, **own}
    of_file: Any = {"layers": None, "morph": None}
    matrices = {"builder": None, "material": None, "matrices": value_type(Matrices, {}), **of_file}
    kinds: dict[str | None, Any] = {
        None: table_type(_part, Part, builder=None, matrices=None),
        "matrices": table_type(_part, Part, **matrices),
    }
    for name, cls in builders.items():
        make, tag = partial(_part, cls), Literal[name]
        kinds[name] = table_type(make, Part, cls, builder=tag, matrices=None, **of_file)
    tagged = [Annotated[kind, Tag(f"({name})")] for name, kind in kinds.items()]
    choose = Discriminator(
        lambda table: f"({'matrices' if 'matrices' in table else table.get('builder')})"
    )
    union: Any = Union[tuple(tagged)]  # noqa: UP007
    return dict[
        str, Annotated[union, choose, BeforeValidator(partial(_checked_builder, known=builders))]
    ]


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

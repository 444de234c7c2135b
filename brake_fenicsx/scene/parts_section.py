"""[parts] and [materials] of a scene: a builder with its parameters, or cells of a mesh file."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import partial
from types import MappingProxyType
from typing import Annotated, Any, Literal, Union

from pydantic import BeforeValidator, Discriminator, Tag

from brake_fenicsx.scene.keys import KeyMistake, key, table_type, two_names
from brake_fenicsx.scene.units import MODULI

# What a thickness and a displaced mesh of a part of the mesh file are called in it.
FILE_LAYER, MORPH = "layers.", "morph."
BUILDERS = {"disc": "Disc", "pad": "Pad", "block": "Block"}


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
class MatricesKeys:
    """[parts.NAME]: keys of a part that is given by matrices.

    Attributes:
        matrices: the files.
        axis: direction of the part's axis 1 for springs: angle from x about z; 0 if not given.
    """

    matrices: Matrices
    axis: float = key("rad", default=0.0, sign="any")


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
    """[parts.NAME]: a builder with its parameters, or none if it comes from the mesh file.

    Attributes:
        builder: name of the builder; None: cells of the file in [mesh].
        parameters: the builder's parameters.
        material: one for the part, or one for each layer.
        axis: angle of the part's axis 1 from x about z [rad]; a material's own axis adds to it.
        matrices: the files that hold it, in place of builder and material.
        layers: thickness of layers of the mesh file along z [m].
        morph: lengths that move nodes of the mesh file.
    """

    builder: str | None
    parameters: Any
    material: str | dict[str, str]
    axis: float = 0.0
    matrices: Matrices | None = None
    layers: dict[str, float] = field(default_factory=dict)
    morph: dict[str, Morph] = field(default_factory=dict)

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
class PartKeys:
    """[parts.NAME]: keys of every part.

    Attributes:
        builder: shape to build; without it the cells come from the file in ``[mesh]``.
        material: one ``[materials]`` name, or one for each layer:
            ``{ lining = "..", plate = ".." }``.
        axis: direction of the part's axis 1: angle from x about z; default for a pad: the tangent
            at mid pad; for other parts: 0.
    """

    material: str | dict[str, str]
    builder: str | None = key(default=None, choices=tuple(BUILDERS))
    axis: float | None = key("rad", default=None, sign="any")


@dataclass(frozen=True, slots=True)
class FileKeys:
    """[parts.NAME]: keys of a part from the mesh file.

    Attributes:
        layers: thickness of its layers along z, as meshed: flat layers named here may take other
            thicknesses in samples ([studies.md](studies.md#thicknesses)).
        morph: lengths that a second mesh file defines, by any name.
    """

    layers: dict[str, float] = field(default_factory=dict, metadata={"unit": "m"})
    morph: dict[str, Morph] = field(default_factory=dict)


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


def part_lengths(parameters: Any) -> dict[str, float]:
    """Lengths among a builder's parameters [m], without sign; of a list the longest."""
    lengths = (f.name for f in fields(parameters) if f.metadata.get("unit") == "m")
    held = {name: getattr(parameters, name) for name in lengths}
    return {
        name: max(map(abs, value)) if isinstance(value, tuple) else abs(value)
        for name, value in held.items()
        if value not in (None, ())
    }


def _part(
    cls: Any, material: Any, builder: str | None = None, axis: Any = None, **keys: Any
) -> Part:
    """A part from what its table holds."""
    inside = {} if cls else {name: keys.pop(name, {}) for name in ("layers", "morph")}
    parameters = cls(**keys) if cls else None
    axis = getattr(parameters, "axis", 0.0) if axis is None else axis
    return Part(builder, parameters, material, axis, **inside)


def _checked_builder(table: Any, known: Mapping[str, Any]) -> Any:
    """Refuse what says no builder's name, and parameters without one."""
    if not isinstance(table, dict):
        raise ValueError("write a table")
    if "matrices" in table:
        return table
    builder = table.get("builder")
    if "builder" in table and builder not in list(known):
        raise KeyMistake(f"use one of {', '.join(known)}", "builder")
    parameters = set(table) - {f.name for cls in (PartKeys, FileKeys) for f in fields(cls)}
    if builder is None and parameters:
        raise KeyMistake("has no meaning without a builder", min(parameters))
    return {**table, "shim": 0} if table.get("shim") is False else table


def parts_type(own: Mapping[str, Any] = MappingProxyType({})) -> Any:
    """Type of [parts]: one for each builder, and one for cells of the mesh file.

    Args:
        own: name of a builder of a user's own -> dataclass of its parameters.
    """
    builders = {**{name: builder_class(name) for name in BUILDERS}, **own}
    kinds: dict[str | None, Any] = {
        None: table_type(partial(_part, None), PartKeys, FileKeys, builder=None)
    }
    kinds["matrices"] = table_type(partial(Part, None, None, ""), MatricesKeys)
    for name, cls in builders.items():
        kinds[name] = table_type(partial(_part, cls), PartKeys, cls, builder=Literal[name])
    tagged = [Annotated[kind, Tag(f"({name})")] for name, kind in kinds.items()]
    choose = Discriminator(
        lambda table: f"({'matrices' if 'matrices' in table else table.get('builder')})"
    )
    union: Any = Union[tuple(tagged)]  # noqa: UP007
    return dict[
        str, Annotated[union, choose, BeforeValidator(partial(_checked_builder, known=builders))]
    ]

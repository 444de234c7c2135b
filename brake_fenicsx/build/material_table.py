"""Materials of a scene: tables of constants to stiffnesses in the axes of each part.

Each model takes engineering constants or stiffnesses. Indices are Voigt's (44: 23, 55: 13, 66: 12);
nu_ij is the strain along j over that along i under a stress along i.

    isotropic               E, nu                  or C11, C12
    transversely-isotropic  E = [E_1, E_3], nu = [nu_12, nu_13], G = G_13
                                                   or C11, C12, C13, C33, C44     (about axis 3)
    orthotropic             E = [E_1, E_2, E_3], nu = [nu_12, nu_13, nu_23], G = [G_23, G_13, G_12]
                                                   or C11, C22, C33, C12, C13, C23, C44, C55, C66
    cubic                   E, nu, G               or C11, C12, C44

In a sample some constants of a table are replaced, all others kept. Engineering constants of any
material that is not isotropic are the nine E_1, E_2, E_3, nu_12, nu_31, nu_32, G_12, G_13, G_23
(nu_ij: strain along j over that along i under a stress along i), so that E_3 changes at fixed E_1,
nu_12, nu_31. A transversely isotropic material becomes orthotropic where they ask for it; a
stiffness C11, ... keeps the model of the table.
"""

from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import SceneError, located
from brake_fenicsx.macro.material import (
    Material,
    engineering_constants,
    isotropic,
    orthotropic,
    orthotropic_stiffness,
    rotate_about_z,
    transversely_isotropic,
)
from brake_fenicsx.scene import MaterialTable, Scene, samples_section, scalars
from brake_fenicsx.scene.samples_section import ENGINEERING as ENGINEERING_NAMES

Value = TypeVar("Value")
DIGITS = "0123456789"
# Number of values of E, nu and G, 0 for one that is left out.
ENGINEERING = {
    "isotropic": {"E": 1, "nu": 1},
    "transversely-isotropic": {"E": 2, "nu": 2, "G": 1},
    "orthotropic": {"E": 3, "nu": 3, "G": 3},
    "cubic": {"E": 1, "nu": 1, "G": 1},
}
STIFFNESSES = {
    "isotropic": ("C11", "C12"),
    "transversely-isotropic": ("C11", "C12", "C13", "C33", "C44"),
    "orthotropic": ("C11", "C22", "C33", "C12", "C13", "C23", "C44", "C55", "C66"),
    "cubic": ("C11", "C12", "C44"),
}
# Our names of the axes, and those of ``engineering_constants``.
AXES = str.maketrans("123", "xyz")


def scene_materials(scene: Scene) -> dict[str, Material]:
    """Materials of the scene, each in its own axes; a wrong one is named by its key."""
    found = {}
    for name, table in scene.materials.items():
        with located(f"{scene.file}: materials.{name}"):
            found[name] = Material(stiffness(table), table.rho, table.loss)
    return found


def layer_materials(
    scene: Scene, layers: Iterable[str], materials: Mapping[str, Material] | None = None
) -> dict[str, Material]:
    """Material of each layer in x, y, z: the axes of the part and of the material are added.

    Args:
        scene: the scene.
        layers: "part.layer" of the mesh.
        materials: material name -> material in its own axes; those of the scene if None.

    Raises:
        SceneError: a layer has no material.
    """
    materials, found = materials or scene_materials(scene), {}
    for layer in layers:
        name, _, inner = layer.partition(".")
        part = scene.parts[name]
        used = part.material
        key = layer_material(used, inner)
        if key is None:
            raise SceneError(f"""{scene.file}: parts.{name}.material: no material for layer
                {inner!r}; there are materials for {", ".join(used)}""")
        angle = part.axis + scene.materials[key].axis
        found[layer] = in_axes(materials[key], angle)
    return found


def layer_material(used: str | Mapping[str, str], layer: str) -> str | None:
    """Material of a layer; the layers shim1, shim2, ... of a shim may share that of "shim"."""
    if isinstance(used, str):
        return used
    return used.get(layer) or used.get(layer.rstrip(DIGITS))


def material_of(scene: Scene, layer: str) -> str:
    """Name of the material of a layer, "part.layer"."""
    part, _, inner = layer.partition(".")
    return str(layer_material(scene.parts[part].material, inner))


def in_axes(material: Material, angle: float) -> Material:
    """The material with its axis 1 at an angle [rad] from x about z.

    Half a turn about z changes no orthotropic stiffness and is left out.
    """
    angle = float(np.remainder(angle + 1e-12, np.pi) - 1e-12)
    if abs(angle) < 1e-11:
        return material
    return Material(rotate_about_z(material.C, angle), material.rho, material.loss)


def stiffness(t: MaterialTable) -> Array:
    """Stiffness [Pa] of a material table in the material's axes, shape (6, 6).

    Raises:
        SceneError: a constant is missing, too many, or has the wrong number of values.
    """
    given = [f.name for f in fields(t) if getattr(t, f.name) is not None]
    constants = [n for n in given if n in ("E", "nu", "G") or n[0] == "C"]
    by_stiffness = any(n[0] == "C" for n in constants)
    engineering, stiff = ENGINEERING[t.model], STIFFNESSES[t.model]
    needed = stiff if by_stiffness else tuple(engineering)
    for name in constants:
        if name not in needed:
            raise SceneError(f"""{name} has no place here; model = {t.model!r} takes
                {", ".join(engineering)} or {", ".join(stiff)}""")
    for name in needed:
        if name not in constants:
            raise SceneError(f"{name} is missing; model = {t.model!r} needs {', '.join(needed)}")
    if by_stiffness:
        return _from_stiffnesses(t.model, {n: float(getattr(t, n)) for n in needed})
    values = {n: np.atleast_1d(np.asarray(getattr(t, n), dtype=float)) for n in needed}
    for name, count in engineering.items():
        if values[name].size != count:
            raise SceneError(f"""{name} has {values[name].size} values; model = {t.model!r} needs
                {count}""")
    return _from_engineering(t.model, **values)


def _from_stiffnesses(model: str, c: Mapping[str, float]) -> Array:
    if model == "isotropic":
        return transversely_isotropic(
            c["C11"], c["C12"], c["C12"], c["C11"], 0.5 * (c["C11"] - c["C12"])
        )
    if model == "transversely-isotropic":
        return transversely_isotropic(*(c[name] for name in STIFFNESSES[model]))
    if model == "cubic":
        return orthotropic_stiffness(*[c["C11"]] * 3, *[c["C12"]] * 3, *[c["C44"]] * 3)
    return orthotropic_stiffness(**c)


def _from_engineering(model: str, E: Array, nu: Array, G: Array | None = None) -> Array:
    if model == "isotropic":
        return isotropic(float(E[0]), float(nu[0]))
    if model in ("orthotropic", "cubic") and G is not None:
        return orthotropic(*(np.broadcast_to(c, 3) for c in (E, nu, G)))
    if not nu[0] > -1:
        raise SceneError(f"nu_12 = {nu[0]:g}: must be above -1")
    shear = np.array([0.0, 0.0, E[0] / (2 * (1 + nu[0]))]) + (0 if G is None else G[0]) * np.array(
        [1.0, 1.0, 0.0]
    )
    return orthotropic(E[[0, 0, 1]], nu[[0, 1, 1]], shear)


def constants(table: MaterialTable) -> dict[str, float]:
    """Every constant that may be random, with its value in the scene [Pa or -]."""
    if table.model == "isotropic":
        names = ("E", "nu") if table.E is not None else ("C11", "C12")
        return {name: float(np.ravel(getattr(table, name))[0]) for name in names}
    C = stiffness(table)
    S = np.linalg.inv(C)
    found = engineering_constants(C) | {"nu_zy": -S[2, 1] / S[2, 2]}
    values = {name: float(found[name.translate(AXES)]) for name in ENGINEERING_NAMES}
    given = [n for n in MaterialTable.__dataclass_fields__ if n[0] == "C"]
    return values | {n: float(getattr(table, n)) for n in given if getattr(table, n) is not None}


def varied_stiffness(table: MaterialTable, values: Mapping[str, float]) -> Array:
    """Stiffness [Pa] of the table with some constants replaced, shape (6, 6), material axes.

    Args:
        table: the material of the scene.
        values: constant -> its value in the sample.

    Raises:
        SceneError: the compliance is not positive definite, or a modulus is not positive.
    """
    if table.model == "isotropic" or next(iter(values))[0] == "C":
        changed: dict[str, Any] = dict(values)
        return stiffness(replace(table, **changed))
    c = constants(table) | dict(values)
    E = np.array([c["E_1"], c["E_2"], c["E_3"]])
    nu = np.array([c["nu_12"], c["nu_31"] * E[0] / E[2], c["nu_32"] * E[1] / E[2]])
    return orthotropic(E, nu, np.array([c["G_23"], c["G_13"], c["G_12"]]))


def nominal_value(scene: Scene, name: str) -> float:
    """Value of a scalar in the scene, SI."""
    if samples_section.is_constant(name):
        _, table, last = samples_section.split_key(name)
        return constants(scene.materials[table])[last]
    return scalars.written_value(scene, name)


def by_material(values: Mapping[str, Value]) -> dict[str, dict[str, Value]]:
    """Those of some scalars that are constants of materials: material -> constant -> value."""
    groups: dict[str, dict[str, Value]] = {}
    for name in filter(samples_section.is_constant, values):
        _, material, constant = samples_section.split_key(name)
        groups.setdefault(material, {})[constant] = values[name]
    return groups

"""Scalars of a scene that are random or swept: what each acts on, and which are refused."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import Any

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene.approaches import (
    PERFECT,
    active_terms,
    one_friction,
    slides,
    turning_parts,
    used_materials,
)
from brake_fenicsx.scene.parts_section import (
    MORPH,
    MaterialTable,
    layers_of_thickness,
    length_in_scene,
    length_key,
    morph_of,
    moved_planes,
    moved_sideways,
)
from brake_fenicsx.scene.samples_section import ENGINEERING, is_constant, split_key, unit_of
from brake_fenicsx.scene.scene import Scene
from brake_fenicsx.scene.units import to_si

# Keys of a random or swept scalar that hold quantities of its unit.
QUANTITIES = ("mean", "sd", "min", "max", "start", "stop", "values")

# Key of a scalar that belongs to no table of several.
SPEED = "motion.speed"


def changes_bodies(scene: Scene, name: str) -> bool:
    """Whether a scalar, by its dotted key, enters the matrices of the bodies."""
    if name == "motion.speed":
        return bool(scene.damping and scene.damping.gyroscopic)
    return split_key(name)[0] in ("materials", "masses", "parts", "stability")


def is_length(name: str) -> bool:
    """Whether a scalar, by its dotted key, is a length of a part."""
    return split_key(name)[0] == "parts"


def is_inertia(name: str) -> bool:
    """Whether a scalar, by its dotted key, is the density of a material or a mass on a face."""
    return split_key(name)[2] in ("rho", "mass")


def written_value(scene: Scene, name: str) -> float:
    """Value of a scalar, by its dotted key, as the scene writes it, SI."""
    section, table, last = split_key(name)
    if name == "motion.speed":
        return 1.0 if scene.motion is None else scene.motion.rate
    if is_length(name):
        part, last = length_key(name)
        return length_in_scene(scene.parts[part], last)
    found = getattr(scene, section)
    for step in [*([table] if isinstance(found, dict) else table.split(".")), last]:
        if isinstance(found, tuple):
            found = found[("alpha", "beta").index(step)]
        else:
            found = found[step] if isinstance(found, dict) else getattr(found, step)
    return float(found)


def si_unit(scene: Scene, name: str) -> str:
    """SI unit of a scalar in this scene, by its dotted key; empty for a plain number."""
    if name != "motion.speed":
        return unit_of(name)
    return "rad/s" if scene.motion is None or scene.motion.direction is None else "m/s"


def check_scalar(s: Scene, where: str, name: str) -> None:
    """A scalar that is random or swept is there, is one number, and acts on something.

    Args:
        s: the scene.
        where: what names the scalar.
        name: its dotted key.

    Raises:
        SceneError: the key and the remedy.
    """
    for text in chain(_absent(s, name), _idle(s, name), _wrong_speeds(s, name)):
        raise SceneError(f"{where}: {text}")


def _absent(s: Scene, name: str) -> Iterator[str]:
    """Why a scalar is no number of the scene."""
    section, table, last = split_key(name)
    if section == "parts":
        table, last = length_key(name)
    tables = getattr(s, section)
    if tables is None:
        yield f"there is no section [{section}]; write it"
    elif not isinstance(tables, dict):
        return
    elif table not in tables:
        yield f"there is no [{section}.{table}]; there are {', '.join(tables) or 'none'}"
    elif is_constant(name):
        yield from _no_constant(tables[table], last)
    elif section == "parts":
        yield from _no_length(s, table, last)
    elif getattr(tables[table], last) is None:
        yield f"the scene has no {name}; write its own value there"
    elif not isinstance(getattr(tables[table], last), float | int):
        yield f"{name} is a table; write one number there"


def _no_constant(material: MaterialTable, constant: str) -> Iterator[str]:
    """Why a constant is none of the material."""
    by_stiffness = material.E is None
    if constant[0] == "C":
        if not by_stiffness or getattr(material, constant, None) is None:
            yield f"the material is not written by {constant}; name an engineering constant"
    elif material.model == "isotropic":
        if constant not in ("E", "nu") or by_stiffness:
            yield "of an isotropic material E and nu, or C11 and C12"
    elif constant not in ENGINEERING:
        yield f"use one of {', '.join(ENGINEERING)}"


def _no_length(s: Scene, part: str, name: str) -> Iterator[str]:
    """Why a length is none that may vary."""
    morph, layers = morph_of(s.parts[part], name), layers_of_thickness(s.parts[part], name)
    if name.startswith(MORPH) and morph is None:
        yield f"there is no such table; there are {', '.join(s.parts[part].morph) or 'none'}"
    elif morph is None and not (
        layers or moved_planes(s.parts[part], name) or moved_sideways(s.parts[part], name)
    ):
        yield f"""is no thickness of a layer of this part, and as the scene is written moves no
            planes of it along z and no edges at right angles; run the scene once for each value,
            with --set parts.{part}.{name}=VALUE"""
    if s.damping and s.damping.modal:
        yield "stability.damping.modal is of bodies of one shape; name rayleigh or loss instead"
    if layers and part in turning_parts(s) and s.motion and any(s.motion.turns_about[:2]):
        yield "stability.damping.gyroscopic needs the axis z beside it; leave one of the two out"


def _idle(s: Scene, name: str) -> Iterator[str]:
    """What a scalar acts on and the scene does not name, and the remedy."""
    section, table, last = split_key(name)
    if name == "motion.speed" and not _speed_acts(s):
        yield """nothing depends on the speed; name sliding, slope or gyroscopic in
            stability.damping, or write contact.NAME.friction = { static = .., kinetic = .., decay =
            .. }"""
    if section == "contact" and not slides(s, table):
        yield """the interface is stuck, and its friction moves no mode: it is a limit that is
            listed; leave it out, or write slip = "motion" """
    if section == "materials" and last != "loss" and table not in used_materials(s):
        yield "no part is made of the material; leave it out"
    if last == "loss" and not (s.damping and s.damping.loss and table in used_materials(s)):
        yield """needs stability.damping = { loss = true, omega_ref = "2 kHz" } and a part of the
            material"""
    if is_inertia(name) and s.damping and s.damping.modal:
        yield "stability.damping.modal is of bodies of one mass; name rayleigh or loss instead"
    if section == "masses" and s.parts[table.partition(".")[0]].matrices:
        yield "the mass is on a set of nodes, without an area: run the scene once for each value"
    if section == "stability" and not (s.damping and s.damping.rayleigh):
        yield 'needs the scene\'s own values, stability.damping.rayleigh = ["20 1/s", "1e-8 s"]'
    if name == "samples.classical.penalty" and not PERFECT & {*s.samples.approaches}:
        yield ("no approach has perfect contact; add classical or parametric to samples.approaches")


def _speed_acts(s: Scene) -> bool:
    """Whether friction or a term of the damping depends on the speed."""
    falls = any(
        not isinstance(c.friction, float | int) for n, c in s.contact.items() if slides(s, n)
    )
    return any(
        {"sliding", "slope", "gyroscopic"} & {*active_terms(s, a)}
        or (falls and not one_friction(s, a))
        for a in s.samples.approaches
    )


def _wrong_speeds(s: Scene, name: str) -> Iterator[str]:
    """Speeds without the unit of the scene's motion."""
    for section, key in (("samples", "random"), ("sweep", "parameters")):
        table: dict[str, Any] = s.table.get(section, {}).get(key, {}).get("motion.speed", {})
        values = [v for k in QUANTITIES for v in _listed(table.get(k))]
        values += [f"1 {table['unit']}"] if "unit" in table else []
        for value in values if name == "motion.speed" else ():
            try:
                to_si(value, si_unit(s, name))
            except ValueError as error:
                yield f"{value!r}: {error}"


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [] if value is None else [value]

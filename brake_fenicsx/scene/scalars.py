"""Scalars of a scene that are random or swept: what each acts on, and which are refused."""

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

from brake_fenicsx.arguments import likely
from brake_fenicsx.errors import SceneError

from . import parts_section as parts
from . import samples_section as samples
from . import scene as scenes
from .keys import KeyMistake, dotted
from .scene import Scene
from .units import to_si

# Key of a scalar that belongs to no table of several.
SPEED = "motion.speed"
# Least likeness of a wrong key to the one that was meant: they have sections in common.
ALIKE = 0.85


def changes_bodies(scene: Scene, name: str) -> bool:
    """Whether a scalar, by its dotted key, enters the matrices of the bodies."""
    if name == SPEED:
        return bool(scene.damping and scene.damping.gyroscopic)
    return samples.split_key(name)[0] in ("materials", "masses", "parts", "stability")


def is_length(name: str) -> bool:
    """Whether a scalar, by its dotted key, is a length of a part."""
    return samples.split_key(name)[0] == "parts"


def is_inertia(name: str) -> bool:
    """Whether a scalar, by its dotted key, is the density of a material or a mass on a face."""
    return samples.split_key(name)[2] in ("rho", "mass")


def written_value(scene: Scene, name: str) -> float:
    """Value of a scalar, by its dotted key, as the scene writes it, SI."""
    section, table, last = samples.split_key(name)
    if name == SPEED:
        return 1.0 if scene.motion is None else scene.motion.rate
    if is_length(name):
        part, last = parts.length_key(name)
        return parts.length_in_scene(scene.parts[part], last)
    found = getattr(scene, section)
    for step in [*([table] if isinstance(found, dict) else table.split(".")), last]:
        if isinstance(found, tuple):
            found = found[("alpha", "beta").index(step)]
        else:
            found = found[step] if isinstance(found, dict) else getattr(found, step)
    return float(found)


def si_unit(scene: Scene, name: str) -> str:
    """SI unit of a scalar in this scene, by its dotted key; empty for a plain number."""
    if name != SPEED:
        return samples.unit_of(name)
    return "rad/s" if scene.motion is None or scene.motion.direction is None else "m/s"


def meant(scene: Scene, name: str) -> str:
    """The scalar that a wrong key names, "; did you mean ...?"; empty where none is near it."""

    def keys(table: dict[str, Any], *path: str) -> Iterator[str]:
        for word, value in table.items():
            if isinstance(value, dict):
                yield from keys(value, *path, word)
            else:
                yield dotted(*path, word)

    written, known = [*keys(scene.table)], list[str]()
    for key in written:
        with suppress(SceneError, KeyMistake):
            samples.unit_of(key)
            check_scalar(scene, key, key)
            known.append(key)
    ends = [key for key in known if key.rpartition(".")[2] == name.rpartition(".")[2]]
    if name in written:
        return ""
    return f"; did you mean {ends[0]!r}?" if len(ends) == 1 else likely(name, known, ALIKE)


def check_scalar(s: Scene, where: str, name: str) -> None:
    """A scalar that is random or swept is there, is one number, and acts on something.

    Args:
        s: the scene.
        where: what names the scalar.
        name: its dotted key.

    Raises:
        SceneError: the key and the remedy.
    """
    for rule in (_absent, _idle, _without_damping, _wrong_speeds):
        for text in rule(s, name):
            raise SceneError(f"{where}: {text}")


def _absent(s: Scene, name: str) -> Iterator[str]:
    """Why a scalar is no number of the scene."""
    section, table, last = samples.split_key(name)
    if section == "parts":
        table, last = parts.length_key(name)
    tables = getattr(s, section)
    if tables is None:
        yield f"there is no section [{section}]; write it"
    elif not isinstance(tables, dict):
        return
    elif table not in tables:
        yield f"there is no [{section}.{table}]; there are {', '.join(tables) or 'none'}"
    elif samples.is_constant(name):
        yield from _no_constant(tables[table], last)
    elif section == "parts":
        yield from _no_length(s, table, last)
    elif getattr(tables[table], last) is None:
        yield f"the scene has no {name}; write its own value there"
    elif not isinstance(getattr(tables[table], last), float | int):
        yield f"{name} is a table; write one number there"


def _no_constant(material: parts.MaterialTable, constant: str) -> Iterator[str]:
    """Why a constant is none of the material."""
    by_stiffness = material.E is None
    if constant[0] == "C":
        if not by_stiffness or getattr(material, constant, None) is None:
            yield f"the material is not written by {constant}; name an engineering constant"
    elif material.model == "isotropic":
        if constant not in ("E", "nu") or by_stiffness:
            yield "of an isotropic material E and nu, or C11 and C12"
    elif constant not in samples.ENGINEERING:
        yield f"use one of {', '.join(samples.ENGINEERING)}"


def _no_length(s: Scene, name: str, length: str) -> Iterator[str]:
    """Why a length is none that may vary."""
    part = s.parts[name]
    morph, layers = (parts.morph_of(part, length), parts.layers_of_thickness(part, length))
    moves = (parts.moved_planes, parts.moved_sideways)
    if length.startswith(parts.MORPH) and morph is None:
        yield f"there is no such table; there are {', '.join(part.morph) or 'none'}"
    elif not (morph or layers or any(move(part, length) for move in moves)):
        yield f"""is no thickness of a layer of this part, and as the scene is written moves no
            planes of it along z and no edges at right angles; run the scene once for each value,
            with --set parts.{name}.{length}=VALUE"""
    if s.damping and s.damping.modal:
        yield "stability.damping.modal is of bodies of one shape; name rayleigh or loss instead"
    turns = layers and name in scenes.turning_parts(s)
    if turns and s.motion and any(s.motion.turns_about[:2]):
        yield "stability.damping.gyroscopic needs the axis z beside it; leave one of the two out"


def _idle(s: Scene, name: str) -> Iterator[str]:
    """What a scalar acts on and the scene does not name, and the remedy."""
    section, table, last = samples.split_key(name)
    if name == SPEED and not _speed_acts(s):
        yield """nothing depends on the speed; name sliding, slope or gyroscopic in
            stability.damping, or write contact.NAME.friction = { static = .., kinetic = .., decay =
            .. }"""
    if section == "contact" and not scenes.slides(s, table):
        yield """the interface is stuck, and its friction moves no mode: it is a limit that is
            listed; leave it out, or write slip = "motion" """
    if section == "materials" and last != "loss" and table not in scenes.used_materials(s):
        yield "no part is made of the material; leave it out"
    if section == "masses" and s.parts[table.partition(".")[0]].matrices:
        yield "the mass is on a set of nodes, without an area: run the scene once for each value"
    if name == "samples.classical.penalty" and not scenes.PERFECT & {*s.samples.approaches}:
        yield "no approach has perfect contact; add classical or parametric to samples.approaches"


def _without_damping(s: Scene, name: str) -> Iterator[str]:
    """Terms of the damping that a scalar needs, and those that do not allow it."""
    section, table, last = samples.split_key(name)
    loss, modal, rayleigh = (
        s.damping and getattr(s.damping, term) for term in ("loss", "modal", "rayleigh")
    )
    if last == "loss" and not (loss and table in scenes.used_materials(s)):
        yield """needs stability.damping = { loss = true, omega_ref = "2 kHz" } and a part of the
            material"""
    if is_inertia(name) and modal:
        yield "stability.damping.modal is of bodies of one mass; name rayleigh or loss instead"
    if section == "stability" and not rayleigh:
        yield 'needs the scene\'s own values, stability.damping.rayleigh = ["20 1/s", "1e-8 s"]'


def _speed_acts(s: Scene) -> bool:
    """Whether friction or a term of the damping depends on the speed."""
    falls = any(
        scenes.depends_on_speed(scenes.friction_of(s, a, interface))
        for a in s.samples.approaches
        for interface in s.contact
    )
    terms = {term for a in s.samples.approaches for term in scenes.active_terms(s, a)}
    return falls or not terms.isdisjoint(("sliding", "slope", "gyroscopic"))


def _wrong_speeds(s: Scene, name: str) -> Iterator[str]:
    """Speeds without the unit of the scene's motion."""
    kinds = (("samples", "random", samples.Distribution), ("sweep", "parameters", samples.Range))
    for section, key, cls in kinds if name == SPEED else ():
        table: dict[str, Any] = s.table.get(section, {}).get(key, {}).get(name, {})
        held = [table[k] for k in samples.quantities(cls) if k in table]
        values = [v for inner in held for v in (inner if isinstance(inner, list) else [inner])]
        for value in [*values, *([f"1 {table['unit']}"] if "unit" in table else [])]:
            try:
                to_si(value, si_unit(s, name))
            except ValueError as error:
                yield f"{value!r}: {error}"

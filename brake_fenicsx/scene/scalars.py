"""Scalars of a scene that are random or swept: what each acts on, and which are refused."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene.damping import active_terms, used_materials
from brake_fenicsx.scene.friction import PERFECT, one_friction, slides
from brake_fenicsx.scene.samples import ENGINEERING, is_constant, split_key, unit_of
from brake_fenicsx.scene.units import to_si

if TYPE_CHECKING:
    from brake_fenicsx.scene.sections import MaterialTable, Scene

# Keys of a random or swept scalar that hold quantities of its unit.
QUANTITIES = ("mean", "sd", "min", "max", "start", "stop", "values")


def changes_bodies(scene: Scene, name: str) -> bool:
    """Whether a scalar, by its dotted key, enters the matrices of the bodies."""
    damping = scene.stability.damping if scene.stability else None
    if name == "motion.speed":
        return bool(damping and damping.gyroscopic)
    return split_key(name)[0] in ("materials", "stability")


def si_unit(scene: Scene, name: str) -> str:
    """SI unit of a scalar in this scene, by its dotted key; empty for a plain number."""
    if name != "motion.speed":
        return unit_of(name)
    return "rad/s" if scene.motion is None or scene.motion.direction is None else "m/s"


def _speed_acts(s: Scene, name: str) -> bool:
    """Whether friction or a term of the damping depends on the speed."""
    falls = any(
        not isinstance(c.friction, float | int) for n, c in s.contact.items() if slides(s, n)
    )
    return any(
        {"sliding", "slope", "gyroscopic"} & {*active_terms(s, a)}
        or (falls and not one_friction(s, a))
        for a in s.samples.approaches
    )


def _friction_acts(s: Scene, name: str) -> bool:
    return slides(s, split_key(name)[1])


def _loss_acts(s: Scene, name: str) -> bool:
    damping = s.stability.damping if s.stability else None
    return bool(damping and damping.loss) and split_key(name)[1] in used_materials(s)


def _rayleigh_acts(s: Scene, name: str) -> bool:
    return bool(s.stability and s.stability.damping and s.stability.damping.rayleigh)


def _penalty_acts(s: Scene, name: str) -> bool:
    return bool(PERFECT & {*s.samples.approaches})


# Keys that act only where the scene names something else, which that is, and the remedy.
NEEDED: tuple[tuple[str, Callable[[Scene, str], bool], str], ...] = (
    (
        r"motion\.speed", _speed_acts,
        "nothing depends on the speed; name sliding, slope or gyroscopic in stability.damping, or"
        " write contact.NAME.friction = { static = .., kinetic = .., decay = .. }",
    ),
    (
        r"contact\..+\.friction", _friction_acts,
        "the interface is stuck, and its friction moves no mode: it is a limit that is listed;"
        ' leave it out, or write slip = "motion"',
    ),
    (
        r"materials\..+\.loss", _loss_acts,
        'needs stability.damping = { loss = true, omega_ref = "2 kHz" } and a part of the material',
    ),
    (
        r"stability\.damping\.rayleigh\..+", _rayleigh_acts,
        'needs the scene\'s own values, stability.damping.rayleigh = ["20 1/s", "1e-8 s"]',
    ),
    (
        r"samples\.classical\.penalty", _penalty_acts,
        "no approach has perfect contact; add classical or parametric to samples.approaches",
    ),
)  # fmt: skip


def check_scalar(s: Scene, where: str, name: str) -> None:
    """A scalar that is random or swept is there, is one number, and acts on something.

    Args:
        s: the scene.
        where: what names the scalar.
        name: its dotted key.

    Raises:
        SceneError: the key and the remedy.
    """
    section, table, last = split_key(name)
    tables = getattr(s, section)
    if tables is None:
        raise SceneError(f"{where}: there is no section [{section}]; write it")
    if isinstance(tables, dict):
        if table not in tables:
            known = ", ".join(tables) or "none"
            raise SceneError(f"{where}: there is no [{section}.{table}]; there are {known}")
        if is_constant(name):
            _check_constant(where, tables[table], last)
        elif getattr(tables[table], last) is None:
            raise SceneError(f"{where}: the scene has no {name}; write its own value there")
        elif not isinstance(getattr(tables[table], last), float | int):
            raise SceneError(f"{where}: {name} is a table; write one number there")
    for pattern, acts, remedy in NEEDED:
        if re.fullmatch(pattern, name) and not acts(s, name):
            raise SceneError(f"{where}: {remedy}")
    if name == "motion.speed":
        _check_speed(s, where)


def _check_constant(where: str, material: MaterialTable, constant: str) -> None:
    """The constant is one of the material."""
    by_stiffness = material.E is None
    if constant[0] == "C":
        if not by_stiffness or getattr(material, constant, None) is None:
            raise SceneError(
                f"{where}: the material is not written by {constant}; name an engineering constant"
            )
    elif material.model == "isotropic":
        if constant not in ("E", "nu") or by_stiffness:
            raise SceneError(f"{where}: of an isotropic material E and nu, or C11 and C12")
    elif constant not in ENGINEERING:
        raise SceneError(f"{where}: use one of {', '.join(ENGINEERING)}")


def _check_speed(s: Scene, where: str) -> None:
    """Speeds have the unit of the scene's motion."""
    unit = si_unit(s, "motion.speed")
    for section, key in (("samples", "random"), ("sweep", "parameters")):
        table: dict[str, Any] = s.table.get(section, {}).get(key, {}).get("motion.speed", {})
        values = [v for k in QUANTITIES for v in _listed(table.get(k))]
        values += [f"1 {table['unit']}"] if "unit" in table else []
        for value in values:
            try:
                to_si(value, unit)
            except ValueError as error:
                raise SceneError(f"{where}: {value!r}: {error}") from None


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [] if value is None else [value]

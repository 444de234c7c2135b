"""[[countermeasures]]: numbers of the scene that a user could change, and how far.

Each is one number that the scene writes. The farthest value is read as the scene would read it in
that number's place, so that units, signs and all rules are those of the scene.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene.friction import slides
from brake_fenicsx.scene.samples import NO_ROUGH_SAMPLES, is_constant, split_key
from brake_fenicsx.scene.scalars import check_scalar, may_vary, si_unit
from brake_fenicsx.scene.tables import dotted, key_parts
from brake_fenicsx.scene.tables import key as scene_key

if TYPE_CHECKING:
    from brake_fenicsx.scene.sections import Scene

RAYLEIGH = ["stability", "damping", "rayleigh"]


@dataclass(frozen=True, slots=True)
class Countermeasure:
    """[[countermeasures]]: a number of the scene that may change to stop the squeal.

    Attributes:
        key: dotted key of a number that the scene contains
            ([countermeasures.md](countermeasures.md)).
        to: farthest acceptable value, with its unit; the search starts at the value in the scene.
        start: value in the scene, SI.
        stop: farthest value, SI.
        unit: SI unit of both.
        is_scalar: whether samples take other values of it on one prepared brake.
    """

    key: str
    to: float | str = scene_key(write="a number, or a quantity with its unit", sign="any")
    start: float = scene_key(default=0.0, internal=True)
    stop: float = scene_key(default=0.0, internal=True)
    unit: str = scene_key(default="", internal=True)
    is_scalar: bool = scene_key(default=False, internal=True)

    def override(self, scene: Scene, value: float | str) -> str:
        """The replacement "key=value" that gives the scene another value.

        Args:
            scene: the scene.
            value: SI, or as a scene writes it.
        """
        parts = key_parts(self.key)
        written: Any = value
        if isinstance(value, float) and self.unit:
            written = f"{value!r} {self.unit}"
        if parts[:-1] == RAYLEIGH:
            both = list(scene.table["stability"]["damping"]["rayleigh"])
            both[("alpha", "beta").index(parts.pop())] = written
            written = both
        return f"{dotted(*parts)}={json.dumps(written)}"


def with_ends(scene: Scene, read: Callable[[str], Scene]) -> Scene:
    """A scene whose countermeasures are checked and know both ends in SI units.

    Args:
        scene: the scene, checked but for its countermeasures.
        read: gives the scene without countermeasures after a replacement "key=value".

    Raises:
        SceneError: the key, its value and the remedy.
    """
    if scene.countermeasures and not {"stability", "uncertainty"} <= {*scene.stages}:
        raise SceneError(
            "countermeasures: need modes of many samples; add stability and uncertainty to stages"
        )
    if scene.countermeasures and not scene.samples.rough:
        raise SceneError(f"countermeasures: {NO_ROUGH_SAMPLES}")
    changes: dict[str, Countermeasure] = {}
    for c in scene.countermeasures:
        try:
            name = dotted(*key_parts(c.key))
        except SceneError as error:
            raise SceneError(f"countermeasures.key = {error}") from None
        if name in changes:
            raise SceneError(f"countermeasures.key = {c.key!r}: named twice; leave one out")
        changes[name] = _with_ends(scene, c, read)
    return replace(scene, countermeasures=tuple(changes.values()))


def _with_ends(scene: Scene, c: Countermeasure, read: Callable[[str], Scene]) -> Countermeasure:
    where = f"countermeasures.key = {c.key!r}"
    start, unit = _number(scene, c.key, where)
    _check_not_random(scene, c.key, where)
    is_scalar = may_vary(scene, c.key)
    if is_scalar:
        check_scalar(scene, where, c.key)
    try:
        stop, _ = _number(read(c.override(scene, c.to)), c.key, where)
    except SceneError as error:
        raise SceneError(f"{where}, to = {c.to!r}: {error}") from None
    if math.isclose(stop, start):
        raise SceneError(f"{where}, to = {c.to!r}: is the scene's own value; write another one")
    return replace(c, start=start, stop=stop, unit=unit, is_scalar=is_scalar)


def _number(scene: Scene, name: str, where: str) -> tuple[float, str]:
    """Value of a key in the scene, SI, and its unit.

    Raises:
        SceneError: no such key, not a number, or a number that is no property of the brake.
    """
    parts = key_parts(name)
    holder: Any = None
    match parts:
        case ["parts", part, "morph", which, _] if which in getattr(
            scene.parts.get(part), "morph", {}
        ):
            holder = scene.parts[part].morph[which]
        case ["parts", part, last] if part in scene.parts and not last.endswith("size"):
            holder = scene.parts[part] if last == "axis" else scene.parts[part].parameters
        case ["materials", table, _] | ["loads", table, "pressure"] | ["masses", table, "mass"] if (
            table in getattr(scene, parts[0])
        ):
            holder = getattr(scene, parts[0])[table]
        case ["contact", interface, "friction", *below] if interface in scene.contact:
            if not slides(scene, interface):
                raise SceneError(
                    f"{where}: the interface is stuck, and its friction moves no mode; leave it"
                    ' out, or write slip = "motion"'
                )
            holder = scene.contact[interface].friction if below else scene.contact[interface]
        case ["motion", "speed"] if scene.motion is not None:
            return _written(scene, parts, where, scene.motion.rate), si_unit(scene, "motion.speed")
        case [*above, ("alpha" | "beta") as which] if above == RAYLEIGH:
            if scene.damping and scene.damping.rayleigh:
                i = ("alpha", "beta").index(which)
                return scene.damping.rayleigh[i], ("1/s", "s")[i]
        case _:
            raise SceneError(
                f"{where}: cannot be a countermeasure, or is not there; name a length or an angle"
                " of a part, a constant of a material, contact.NAME.friction,"
                ' loads."PART.FACE".pressure, masses."PART.FACE".mass, motion.speed, or'
                " stability.damping.rayleigh.alpha or .beta"
            )
    units = {f.name: f.metadata.get("unit", "") for f in fields(holder)} if holder else {}
    value = getattr(holder, parts[-1]) if parts[-1] in units else None
    unit = "rad" if parts[-1] == "axis" else units.get(parts[-1], "")
    return _written(scene, parts, where, value), unit


def _written(scene: Scene, parts: list[str], where: str, value: Any) -> float:
    """A value that the scene itself writes as one number."""
    table: Any = scene.table
    for step in parts:
        table = table.get(step) if isinstance(table, dict) else None
    if table is None:
        raise SceneError(f"{where}: the scene does not write it; write it with its present value")
    if not isinstance(value, float):
        raise SceneError(f"{where}: is not a number that can change by degrees; name one that is")
    return value


def _check_not_random(scene: Scene, name: str, where: str) -> None:
    """What is random has no single value to start from."""
    table = split_key(name)[1]
    for other in scene.samples.random:
        constants = is_constant(name) and is_constant(other) and split_key(other)[1] == table
        if constants or split_key(other) == split_key(name):
            raise SceneError(
                f'{where}: samples.random."{other}" is random; write the change of its distribution'
                " by hand, run both scenes and use brake-fenicsx compare"
            )

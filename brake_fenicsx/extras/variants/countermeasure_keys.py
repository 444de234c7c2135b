"""[[countermeasures]]: numbers of the scene that a user could change, and how far.

Each is a scalar that samples of one brake may take other values of, as random and swept ones are
(``samples``), and that the scene writes. The farthest value is read as the scene would read it in
that number's place, so that units, signs and all rules are those of the scene.
"""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene.keys import KeyMistake, dotted, key_parts
from brake_fenicsx.scene.keys import key as scene_key
from brake_fenicsx.scene.samples_section import (
    NO_ROUGH_SAMPLES,
    Distribution,
    is_constant,
    split_key,
)
from brake_fenicsx.scene.scalars import check_scalar, si_unit, written_value
from brake_fenicsx.scene.scene import Scene

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
    """

    key: str
    to: float | str = scene_key(write="a number, or a quantity with its unit", sign="any")
    start: float = scene_key(default=0.0, internal=True)
    stop: float = scene_key(default=0.0, internal=True)
    unit: str = scene_key(default="", internal=True)

    def override(self, scene: Scene, value: float | str) -> str:
        """The replacement "key=value" that gives the scene another value.

        Args:
            scene: the scene.
            value: SI, or as a scene writes it.
        """
        parts, written = key_parts(self.key), self._written(value)
        if parts[:-1] == RAYLEIGH:
            both = list(scene.table["stability"]["damping"]["rayleigh"])
            both[("alpha", "beta").index(parts.pop())] = written
            written = both
        return f"{dotted(*parts)}={json.dumps(written)}"

    def distribution(self, scene: Scene, value: float) -> list[str]:
        """Replacements that move the distribution of a random number by the factor of its value."""
        law, where = scene.samples.random.get(self.key), ("samples", "random", self.key)
        written, out = scene.table["samples"]["random"][self.key] if law else {}, []
        for name in ("mean", "sd", "min", "max", "values"):
            if name in written:
                moved = np.multiply(getattr(law, name), value / self.start).tolist()
                new = [*map(self._written, moved)] if name == "values" else self._written(moved)
                out.append(f"{dotted(*where, name)}={json.dumps(new)}")
        return out

    def _written(self, value: float | str) -> Any:
        """A value as a scene writes it."""
        return f"{value!r} {self.unit}" if isinstance(value, float) and self.unit else value


Countermeasures = tuple[Countermeasure, ...]


def with_ends(scene: Scene, read: Callable[[str], Scene]) -> Scene:
    """A scene whose countermeasures are checked and know both ends in SI units.

    Args:
        scene: the scene, checked but for its countermeasures.
        read: gives the scene without countermeasures after a replacement "key=value".

    Raises:
        SceneError: the key, its value and the remedy.
    """
    if not {"stability", "uncertainty"} <= {*scene.stages}:
        raise SceneError("""countermeasures: need modes of many samples; add stability and
            uncertainty to stages""")
    if not scene.samples.rough:
        raise SceneError(f"countermeasures: {NO_ROUGH_SAMPLES}")
    changes: dict[str, Countermeasure] = {}
    for c in scene.section("countermeasures"):
        try:
            name = dotted(*key_parts(c.key))
        except SceneError as error:
            raise SceneError(f"countermeasures.key = {error}") from None
        if name in changes:
            raise SceneError(f"countermeasures.key = {c.key!r}: named twice; leave one out")
        changes[name] = _with_ends(scene, replace(c, key=name), read)
    return replace(scene, countermeasures=tuple(changes.values()))  # type: ignore[call-arg]


def _with_ends(scene: Scene, c: Countermeasure, read: Callable[[str], Scene]) -> Countermeasure:
    where = f"countermeasures.key = {c.key!r}"
    try:
        unit = si_unit(scene, c.key)
    except KeyMistake as error:
        raise SceneError(f"{where}: {error}") from None
    if split_key(c.key)[0] == "samples":
        raise SceneError(f"{where}: is of perfect contact alone; leave it out")
    check_scalar(scene, where, c.key)
    _check_random(scene, c.key, where)
    _check_written(scene, c.key, where)
    try:
        stop = written_value(read(c.override(scene, c.to)), c.key)
    except SceneError as error:
        raise SceneError(f"{where}, to = {c.to!r}: {error}") from None
    start = written_value(scene, c.key)
    if c.key in scene.samples.random and not start:
        raise SceneError(
            f"{where}: is random about a value of zero, which no factor moves; write it"
        )
    if math.isclose(stop, start):
        raise SceneError(f"{where}, to = {c.to!r}: is the scene's own value; write another one")
    return replace(c, start=start, stop=stop, unit=unit)


def _check_written(scene: Scene, name: str, where: str) -> None:
    """Only what the scene writes can be replaced in it."""
    table: Any = scene.table
    parts = key_parts(name)
    for step in parts[:-1] if parts[:-1] == RAYLEIGH else parts:
        table = table.get(step) if isinstance(table, dict) else None
    if table is None:
        raise SceneError(f"{where}: the scene does not write it; write it with its present value")


def _check_random(scene: Scene, name: str, where: str) -> None:
    """A random number may change by a factor with its distribution, if the scene writes that."""
    table = split_key(name)[1]
    for other, law in scene.samples.random.items():
        if other == name and isinstance(law, Distribution) and not law.file:
            continue
        constants = is_constant(name) and is_constant(other) and split_key(other)[1] == table
        if constants or split_key(other) == split_key(name):
            raise SceneError(f"""{where}: samples.random."{other}" is random; leave this one out,
                change the distribution in a copy, run both and use brake-fenicsx compare""")

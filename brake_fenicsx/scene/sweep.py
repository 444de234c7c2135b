"""[sweep]: one or two scalars of the scene that take many values, and how many samples follow.

The scalars are named by the keys of [samples.random] (``samples``), and act on the scene's own
brake and on its rough samples. A sweep changes no result of the samples themselves.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene.samples import in_si_units, split_key
from brake_fenicsx.scene.tables import dotted, key, value_type

if TYPE_CHECKING:
    from brake_fenicsx.scene.sections import Scene

ROUGH = ("multi-scale", "joint")


@dataclass(frozen=True, slots=True)
class Range:
    """[sweep.parameters]: values of the scalar with that dotted key; with its unit.

    Attributes:
        start: first value.
        stop: last value; it may lie below ``start``.
        steps: number of values, equally spaced, both ends included.
        values: list of values, rising or falling, instead of ``start``, ``stop`` and ``steps``.
    """

    start: float | None = key("*", default=None, sign="any")
    stop: float | None = key("*", default=None, sign="any")
    steps: int = key(default=41)
    values: tuple[float, ...] = key("*", default=(), sign="any")

    @property
    def points(self) -> tuple[float, ...]:
        """All values, SI."""
        if self.start is None or self.stop is None:
            return self.values
        return tuple(float(x) for x in np.linspace(self.start, self.stop, self.steps))


@dataclass(frozen=True, slots=True)
class Sweep:
    """[sweep]: modes followed over parameters of the scene.

    Attributes:
        parameters: values of one or two scalars, by dotted key; the first one is followed, the
            second one makes a chart.
        samples: rough samples, the first ones of the scene, whose modes are also followed.
    """

    parameters: dict[str, Range] = field(
        default_factory=dict, metadata={"type": lambda: _ranges_type()}
    )
    samples: int = key(default=0, sign="zero")

    @property
    def first(self) -> str:
        """Key of the parameter that modes are followed over."""
        return next(iter(self.parameters))

    @property
    def second(self) -> str | None:
        """Key of the other parameter of a chart."""
        return [*self.parameters, None][1]


def _ranges_type() -> Any:
    convert = partial(in_si_units, names=("start", "stop", "values"))
    return Annotated[value_type(dict[str, Range], {}), BeforeValidator(convert)]


def check_sweep(s: Scene) -> None:
    """Refuse a sweep that has no values, nothing to follow, or samples it cannot follow.

    Raises:
        SceneError: the key, its value and the remedy.
    """
    sweep = s.sweep
    if sweep is None:
        return
    if "stability" not in s.stages:
        raise SceneError("sweep: follows complex modes; add the stage stability to stages")
    if not 1 <= len(sweep.parameters) <= 2:
        raise SceneError(
            f"sweep.parameters: {len(sweep.parameters)} keys; name one or two, such as"
            ' "contact.NAME.friction" = { start = 0.0, stop = 0.8, steps = 41 }'
        )
    for name, values in sweep.parameters.items():
        _check_range(dotted("sweep", "parameters", name), name, values)
    if sweep.samples and sweep.second:
        raise SceneError(
            f"sweep.samples = {sweep.samples}: samples are followed over one parameter; leave"
            f" {dotted('sweep', 'parameters', sweep.second)} or sweep.samples out"
        )
    if sweep.samples and not {*ROUGH} & {*s.samples.approaches}:
        raise SceneError(
            f"sweep.samples = {sweep.samples}: there are no rough samples; name multi-scale or"
            " joint in samples.approaches"
        )
    if sweep.samples and "uncertainty" not in s.stages:
        raise SceneError(
            f"sweep.samples = {sweep.samples}: needs the stage uncertainty; add it to stages"
        )


def _check_range(where: str, name: str, values: Range) -> None:
    """Two values or more, in order, and possible ones."""
    ends = values.start is not None, values.stop is not None
    if any(ends) == bool(values.values) or ends[0] != ends[1]:
        raise SceneError(f"{where}: write start, stop and steps, or values")
    x = np.array(values.points)
    step = np.diff(x)
    if x.size < 2 or not (np.all(step > 0) or np.all(step < 0)):
        raise SceneError(f"{where}: two values or more are needed, rising or falling")
    section, _, last = split_key(name)
    may_be_zero = last in ("friction", "loss", "alpha", "beta") or last.startswith("nu")
    signed = section == "materials" and (last.startswith("nu") or last[:1] == "C")
    if not signed and (x.min() < 0 or (x.min() == 0 and not may_be_zero)):
        limit = "zero or more" if may_be_zero else "positive"
        raise SceneError(f"{where}: {x.min():g}: must be {limit}")

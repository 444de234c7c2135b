"""[sweep]: one or two scalars of the scene that take many values, and how many samples follow.

The scalars are named by the keys of [samples.random] (``samples``), and act on the scene's own
brake and on its rough samples. A sweep changes no result of the samples themselves.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from brake_fenicsx.scene.samples import NO_ROUGH_SAMPLES, below_least, in_si_units
from brake_fenicsx.scene.tables import dotted, key, value_type

if TYPE_CHECKING:
    from brake_fenicsx.scene.sections import Scene

MAX_STEPS = 100_000


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
    steps: int = key(
        default=41, rule=(lambda steps: steps <= MAX_STEPS, f"write {MAX_STEPS} at most")
    )
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


def sweep_mistakes(s: Scene) -> Iterator[str]:
    """A sweep that has no values, nothing to follow, or samples it cannot follow."""
    sweep = s.sweep
    if sweep is None:
        return
    if "stability" not in s.stages:
        yield "sweep: follows complex modes; add the stage stability to stages"
    if not 1 <= len(sweep.parameters) <= 2:
        yield (
            f"sweep.parameters: {len(sweep.parameters)} keys; name one or two, such as"
            ' "contact.NAME.friction" = { start = 0.0, stop = 0.8, steps = 41 }'
        )
    for name, values in sweep.parameters.items():
        for text in _range_mistakes(name, values):
            yield f"{dotted('sweep', 'parameters', name)}: {text}"
    written = f"sweep.samples = {sweep.samples}"
    if sweep.samples and sweep.second:
        yield (
            f"{written}: samples are followed over one parameter; leave"
            f" {dotted('sweep', 'parameters', sweep.second)} or sweep.samples out"
        )
    if sweep.samples and not s.samples.rough:
        yield f"{written}: {NO_ROUGH_SAMPLES}"
    if sweep.samples and "uncertainty" not in s.stages:
        yield f"{written}: needs the stage uncertainty; add it to stages"


def _range_mistakes(name: str, values: Range) -> Iterator[str]:
    """Not two values or more, in order, and possible ones."""
    ends = values.start is not None, values.stop is not None
    if any(ends) == bool(values.values) or ends[0] != ends[1]:
        yield "write start, stop and steps, or values"
    x = np.array(values.points)
    step = np.diff(x)
    if x.size < 2 or not (np.all(step > 0) or np.all(step < 0)):
        yield "two values or more are needed, rising or falling"
    if x.size and (wanted := below_least(name, float(x.min()))):
        yield f"{x.min():g}: {wanted}"

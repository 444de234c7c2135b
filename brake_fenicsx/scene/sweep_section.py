"""[sweep]: one or two scalars of the scene that take many values, and how many samples follow.

The scalars are named by the keys of [samples.random] (``samples``), and act on the scene's own
brake and on its rough samples. A sweep changes no result of the samples themselves.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from brake_fenicsx.scene.keys import key, value_type
from brake_fenicsx.scene.samples_section import in_si_units

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

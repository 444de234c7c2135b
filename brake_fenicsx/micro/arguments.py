"""Checks of arguments: one line that names the argument, its value and a remedy."""

from __future__ import annotations

from numbers import Real
from typing import Any, get_args

import numpy as np

from brake_fenicsx.errors import SceneError


def number(name: str, value: Any, unit: str = "", least: float = -np.inf) -> float:
    """A finite real number, refused if it is anything else.

    Args:
        name: of the argument.
        value: what was given.
        unit: of the argument, for the message.
        least: smallest number allowed; of zero, more than it must be given.

    Raises:
        SceneError: no number, not finite, or too small.
    """
    real = isinstance(value, Real) or (isinstance(value, np.ndarray) and value.ndim == 0)
    if not (real and np.isfinite(float(value)) and (float(value) > least or least == -np.inf)):
        kind = "positive" if least == 0.0 else "finite"
        raise SceneError(f"{name} = {value!r}{unit and ' ' + unit}; give one {kind} number")
    return float(value)


def positive(**values: Any) -> None:
    """Refuse what is not a positive finite number."""
    for name, value in values.items():
        number(name, value, least=0.0)


def one_of(name: str, value: Any, choices: Any) -> None:
    """Refuse what is not among the words of a ``Literal``."""
    if value not in get_args(choices):
        raise SceneError(f"{name} = {value!r}; choose {' or '.join(map(repr, get_args(choices)))}")

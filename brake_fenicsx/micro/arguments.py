"""Checks of arguments: one line that names the argument, its value and a remedy."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np

from brake_fenicsx.errors import SceneError

REAL = int, float, np.integer, np.floating
LIMIT = 1e100  # numbers beyond overflow in products of two or three


def number(name: str, value: Any, unit: str = "", least: float = -np.inf) -> float:
    """A real number below 1e100, refused if it is anything else.

    Args:
        name: of the argument.
        value: what was given.
        unit: of the argument, for the message.
        least: smallest number allowed; of zero, more than it must be given.

    Raises:
        SceneError: no number, not finite, too small or too large.
    """
    scalar = value[()] if isinstance(value, np.ndarray) and value.ndim == 0 else value
    if not (isinstance(scalar, REAL) and -LIMIT < scalar < LIMIT and scalar > least):
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

"""Kinds of arrays, and checks of arguments: a line with the argument, its value and a remedy."""

import difflib
import inspect
from collections.abc import Iterable
from functools import wraps
from typing import Any, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError, SurfaceError

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.intp]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]
AnyArray = NDArray[Any]
F = TypeVar("F")

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


def quantity(name: str, value: Any, unit: str) -> float:
    """A number in SI, or a text with its unit as in a scene, "1 bar"."""
    if not isinstance(value, str):
        return number(name, value, unit)
    from brake_fenicsx.scene.units import to_si

    try:
        return to_si(value, unit)
    except ValueError as error:
        raise SceneError(f"{name} = {value!r}: {error}") from None


def positive(**values: Any) -> None:
    """Refuse what is not a positive finite number."""
    for name, value in values.items():
        number(name, value, least=0.0)


def one_of(name: str, value: Any, choices: Any) -> None:
    """Refuse what is not among the words of a ``Literal`` or a sequence."""
    words = get_args(choices) or choices
    if value not in words:
        raise SceneError(f"{name} = {value!r}; choose one of {', '.join(words)}")


def of_kind(name: str, value: Any, kinds: type | tuple[type, ...], wanted: str) -> None:
    """Refuse what is not an object of some classes."""
    if not isinstance(value, kinds):
        raise SceneError(f"{name}: an object of the type {type(value).__name__}; give {wanted}")


def listed(name: str, values: Any, unit: str = "") -> Array:
    """One or more real numbers below 1e100, SI or with their unit, shape (numbers,)."""
    given = np.asarray(values, object)
    if given.ndim != 1 or not given.size:
        raise SceneError(f"{name} = {given.tolist()!r}; give a list of numbers")
    return np.array([quantity(name, value, unit) for value in given])


def frequency_band(band: Any) -> tuple[float, float]:
    """Lowest and highest frequency [Hz]."""
    ends = listed("band", band)
    if ends.size != 2 or not 0 <= ends[0] < ends[1]:
        said = " to ".join(f"{f:g}" for f in ends)
        raise SceneError(f"band {said} Hz: from at least 0 up to a higher one")
    return float(ends[0]), float(ends[1])


def real(name: str, values: Any) -> Array:
    """Values as a new array of real numbers; masked, infinite and undefined ones are nan.

    Raises:
        SurfaceError: complex numbers, text or objects.
    """
    mask = getattr(values, "mask", False)
    try:
        given = np.asarray(values.data if np.any(mask) else values)
    except ValueError:  # rows of different lengths
        given = np.array(None)
    if given.dtype.kind not in "biuf":
        raise SurfaceError(f"{name}: values of type {given.dtype}; give real numbers")
    numbers = given.astype(float)
    return np.where(mask | ~np.isfinite(numbers), np.nan, numbers)


def likely(word: Any, words: Iterable[Any], alike: float = 0.6) -> str:
    """The name that was meant, as the end of a message; empty where none is so much alike."""
    near = difflib.get_close_matches(str(word), list(map(str, words)), 1, alike)
    return f"; did you mean {near[0]!r}?" if near else ""


def with_its_arguments(function: F) -> F:
    """A function of the Python interface that refuses other arguments than its own in one line."""
    call: Any = function
    signature = inspect.signature(call)
    names = [name for name in signature.parameters if name != "self"]

    def checked(*args: Any, **keys: Any) -> Any:
        try:
            signature.bind(*args, **keys)
        except TypeError as error:
            hint = "".join(likely(key, names) for key in keys if key not in names)
            raise SceneError(f"""{call.__name__}: {error}{hint}; its arguments are
                {", ".join(names)}""") from None
        return call(*args, **keys)

    same: Any = wraps(call)(checked)
    return same

"""Quantities with units at the border: "5 bar", "1983.3 MPa", "2.825 mm" to SI numbers."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

DIMENSIONS = {
    "m": "length [mm]", "rad": "angle [deg]", "Pa": "pressure or modulus [MPa]",
    "N": "force [kN]", "N m": "moment [N m]", "kg/m^3": "density [kg/m^3]", "kg": "mass [kg]",
    "kg m^2": "moment of inertia [kg mm^2]",
    "N/m": "stiffness [kN/mm]", "N s/m": "damping [N s/m]",
    "Pa/m": "contact stiffness [Pa/m]", "Hz": "frequency [Hz]",
    "rad/s": "angular speed [rad/s]", "m/s": "speed [m/s]", "1/m": "wave number [1/mm]",
    "1/s": "rate [1/s]", "s": "time [us]",
    "": "a number", "*": "number with the unit of that key [2 bar]",
}  # fmt: skip


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


def to_si(value: Any, unit: str) -> float:
    """Convert a value of a scene to SI.

    Args:
        value: a number with unit as a string, or a plain number where ``unit`` is "".
        unit: SI unit wanted, a key of ``DIMENSIONS``.

    Returns:
        The number in SI units.

    Raises:
        ValueError: not a number, no unit, or a unit of another dimension; the text says which.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"write {DIMENSIONS[unit]}")
    if unit in ("", "*"):
        if isinstance(value, str):
            raise ValueError("write a plain number")
    elif not isinstance(value, str) and value != 0:
        raise ValueError(f"the unit is missing; write {DIMENSIONS[unit]} as a string")
    try:
        number = _quantity(value, unit) if isinstance(value, str) else float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError("must be a finite number")
    return number


@cache
def _quantity(value: str, unit: str) -> float:
    """A number with a unit in SI."""
    import pint

    if "," in value:
        raise ValueError(
            'a comma in a quantity; write the decimal point, "2.5 bar", and no other separator'
        )
    try:
        quantity = _registry().Quantity(value)
        return _turns(quantity, unit) * float(quantity.to(_registry().Unit(unit)).magnitude)
    except pint.DimensionalityError:
        raise ValueError(f"wrong unit; a {DIMENSIONS[unit]} is needed") from None
    except OverflowError:
        raise
    except Exception:
        raise ValueError(f"not a quantity, write {DIMENSIONS[unit]}") from None


def with_unit(value: Any, unit: str) -> Any:
    """Numbers in SI units as quantities of the unit that ``DIMENSIONS`` names."""
    if isinstance(value, tuple):
        return tuple(with_unit(v, unit) for v in value)
    if unit in ("", "*") or isinstance(value, str | bool):
        return value
    usual = DIMENSIONS[unit].partition("[")[2].rstrip("]")
    number = _registry().Quantity(value, unit).to(_registry().Unit(usual)).magnitude
    return f"{number:.10g} {usual}"


def quantity_text(value: float, unit: str) -> str:
    """A number in SI units for a person: six digits, in the usual unit."""
    return str(with_unit(float(f"{value:.6g}"), unit))


def _turns(quantity: Any, unit: str) -> float:
    """2 pi between a frequency and an angular speed, which have the same dimension."""
    text = str(quantity.units)
    if unit == "Hz" and any(word in text for word in ("radian", "revolution", "turn", "degree")):
        return 0.5 / math.pi
    return 2 * math.pi if unit == "rad/s" and "hertz" in text else 1.0

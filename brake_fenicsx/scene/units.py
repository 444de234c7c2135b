"""Quantities with units at the border: "5 bar", "1983.3 MPa", "2.825 mm" to SI numbers."""

import math
import re
from contextlib import suppress
from difflib import SequenceMatcher
from functools import cache
from typing import Any

from brake_fenicsx.errors import SceneError

DIMENSIONS = {
    "m": "length [mm]", "rad": "angle [deg]", "Pa": "pressure or modulus [MPa]",
    "N": "force [kN]", "N m": "moment [N m]", "kg/m^3": "density [kg/m^3]", "kg": "mass [kg]",
    "kg m^2": "moment of inertia [kg mm^2]", "N/m": "stiffness [kN/mm]",
    "N s/m": "damping [N s/m]", "Pa/m": "contact stiffness [Pa/m]", "Hz": "frequency [Hz]",
    "rad/s": "angular speed [rad/s]", "m/s": "speed [m/s]", "1/m": "wave number [1/mm]",
    "1/s": "rate [1/s]", "s": "time [us]", "": "a number",
    "*": "number with the unit of that key [2 bar]",
}  # fmt: skip
# SI values of the units that most scenes are written in. To start pint, which knows all others,
# takes as long as to read a scene.
FACTORS: dict[str, dict[str, float]] = {
    "m": {"m": 1.0, "mm": 1e-3, "um": 1e-6}, "rad": {"rad": 1.0, "deg": math.pi / 180},
    "Pa": {"Pa": 1.0, "MPa": 1e6, "GPa": 1e9, "bar": 1e5}, "N": {"N": 1.0, "kN": 1e3},
    "N m": {"N m": 1.0}, "kg/m^3": {"kg/m^3": 1.0}, "kg": {"kg": 1.0},
    "kg m^2": {"kg m^2": 1.0, "kg mm^2": 1e-6}, "N/m": {"N/m": 1.0, "kN/mm": 1e6},
    "N s/m": {"N s/m": 1.0}, "Pa/m": {"Pa/m": 1.0}, "Hz": {"Hz": 1.0, "kHz": 1e3},
    "rad/s": {"rad/s": 1.0}, "m/s": {"m/s": 1.0}, "1/m": {"1/m": 1.0, "1/mm": 1e3},
    "1/s": {"1/s": 1.0}, "s": {"s": 1.0, "us": 1e-6},
}  # fmt: skip
USUAL = re.compile(r"([-+]?\d+\.?\d*(?:[eE][-+]?\d+)?) (\S.*)", re.ASCII)
MODULI = (1e6, 2e12)  # usual ones, rubber to diamond [Pa]


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


def to_si(value: Any, unit: str) -> float:
    """Convert a value of a scene to SI.

    Args:
        value: a number with unit as a string, or a plain number where ``unit`` is "".
        unit: SI unit wanted, a key of ``DIMENSIONS``, or two, as "rad/s or m/s".

    Returns:
        The number in SI units.

    Raises:
        ValueError: not a number, no unit, or a unit of another dimension; the text says which.
    """
    first, _, second = unit.partition(" or ")
    if second:
        try:
            return to_si(value, first)
        except ValueError:
            return to_si(value, second)
    text = isinstance(value, str)
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"write {DIMENSIONS[unit]}")
    if text and unit in ("", "*"):
        raise ValueError("write a plain number")
    if not text and value != 0 and unit not in ("", "*"):
        raise ValueError(f"the unit is missing; write {DIMENSIONS[unit]} as a string")
    try:
        number = _quantity(value, unit) if text else float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError("must be a finite number")
    return number


def factor_to_si(name: str, unit: str, where: str) -> float:
    """SI value of one unit of a file, by its name.

    Args:
        name: the unit, "um".
        unit: SI unit wanted.
        where: the key that names it.

    Raises:
        SceneError: no unit, or one of another dimension.
    """
    try:
        return to_si(f"1 {name}", unit)
    except ValueError as error:
        raise SceneError(f"{where}: {error}") from None


@cache
def _quantity(value: str, unit: str) -> float:
    """A number with a unit in SI."""
    if (usual := USUAL.fullmatch(value)) and usual[2] in FACTORS[unit]:
        return float(usual[1]) * FACTORS[unit][usual[2]]
    import pint

    wanted = DIMENSIONS[unit]
    if "," in value:
        raise ValueError("""a comma in a quantity; write the decimal point, "2.5 bar", and no other
            separator""")
    text = f"not a quantity, write {wanted}"
    if re.match(r"\s*(?!nan\b|inf)[A-Za-z]", value):  # "GPa" would be 1 GPa
        raise ValueError(text)
    try:
        quantity = _registry().Quantity(value)
        return _turns(quantity, unit) * float(quantity.to(_registry().Unit(unit)).magnitude)
    except OverflowError:
        raise
    except pint.DimensionalityError:
        text = f"wrong unit; a {wanted} is needed"
        with suppress(ValueError):
            float(value)
            text = f"""no unit; write a {wanted.partition(" [")[0]} with its unit, such as
                '{value.strip()} {usual_unit(unit)}'"""
    except pint.UndefinedUnitError as error:
        names = error.unit_names
        name = names if isinstance(names, str) else next(iter(names))
        if any(c.isdigit() for c in value):
            text = f"unknown unit {name!r}; {_nearest(name, unit)}"
    except Exception:  # whatever pint's parser stumbles over
        pass
    raise ValueError(text)


def _nearest(name: str, unit: str) -> str:
    """A unit of the quantity that is written almost so, or what to write."""
    registry, factors = _registry(), " " in unit or "/" in unit
    symbols = {part for text in (unit, usual_unit(unit)) for part in re.split(r"[\s/^\d]+", text)}
    symbols |= {"m", "g", "s", "N", "Pa", "Hz", "bar", "rad", "deg"}
    known = {f"{p}{s}" for p in ("", "n", "u", "m", "c", "k", "M", "G") for s in symbols if s}
    likeness = {
        k: SequenceMatcher(None, name, k).ratio() + (name.lower() == k.lower())
        for k in sorted(known)
        if k in registry and (factors or registry.Unit(k).is_compatible_with(registry.Unit(unit)))
    }
    best = max(likeness, key=likeness.__getitem__, default="")
    like = likeness.get(best, 0.0) >= 0.6
    return f"did you mean {best!r}?" if like else f"write {DIMENSIONS[unit]}"


def usual_unit(unit: str) -> str:
    """The unit that ``DIMENSIONS`` names for an SI unit; empty for a plain number."""
    return DIMENSIONS[unit].partition("[")[2].rstrip("]")


def with_unit(value: Any, unit: str) -> Any:
    """Numbers in SI units as quantities of the unit that ``DIMENSIONS`` names."""
    if isinstance(value, tuple):
        return tuple(with_unit(v, unit) for v in value)
    if unit in ("", "*") or isinstance(value, str | bool):
        return value
    usual = usual_unit(unit)
    return f"{value / FACTORS[unit][usual]:.10g} {usual}"


def quantity_text(value: float, unit: str) -> str:
    """A number in SI units for a person: six digits, in the usual unit."""
    return str(with_unit(float(f"{value:.6g}"), unit))


def in_unit_of(value: float, written: Any, unit: str) -> float | str:
    """A number in SI units as a scene would write it, six digits: in the unit of another quantity.

    Args:
        value: the number, SI.
        written: the other one, "70 GPa", or a plain number.
        unit: SI unit of both.
    """
    name = re.sub(r"^[-+\s]*[\d._]+([eE][-+]?\d+)?\s*", "", str(written)).strip()
    number = float(f"{value / (to_si(f'1 {name}', unit) if name else 1.0):.6g}")
    return f"{number:.6g} {name}" if name else number


def _turns(quantity: Any, unit: str) -> float:
    """2 pi between a frequency and an angular speed, which have the same dimension."""
    text = str(quantity.units)
    if unit == "Hz" and any(word in text for word in ("radian", "revolution", "turn", "degree")):
        return 0.5 / math.pi
    return 2 * math.pi if unit == "rad/s" and "hertz" in text else 1.0


def several(number: int, one: str, more: str = "") -> str:
    """A number of things in words: "1 line", "2 lines"."""
    return f"{number} {one if number == 1 else more or one + 's'}"

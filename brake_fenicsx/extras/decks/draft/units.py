"""Units of a mesh file: guessed where nobody says them, and its numbers as values of a scene."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import numpy as np

from brake_fenicsx.errors import SceneError
from brake_fenicsx.meshing.filemesh import FileMesh
from brake_fenicsx.scene.keys import dotted
from brake_fenicsx.scene.units import MODULI, factor_to_si, quantity_text

from .statements import Deck, Quantity

# Consistent units of length, mass and time; densities of solids [kg/m^3], lengths of brakes [m].
SYSTEMS = ("mm t s", "m kg s", "mm kg ms", "mm g ms", "inch slinch s")
DENSITIES, LENGTHS = (300.0, 25e3), (5e-3, 3.0)
# Exponents of length, mass and time.
_POWERS = {
    "m": (1, 0, 0), "kg": (0, 1, 0), "kg/m^3": (-3, 1, 0), "Pa": (-1, 1, -2), "N": (1, 1, -2),
    "N m": (2, 1, -2), "N/m": (0, 1, -2), "Pa/m": (-2, 1, -2), "Hz": (0, 0, -1),
    "rad/s": (0, 0, -1), "m/s": (1, 0, -1),
}  # fmt: skip


def si(q: Quantity, units: str) -> float:
    """A number of a file in SI units.

    Args:
        q: number and SI unit.
        units: units of length, mass and time of the file, "mm t s".
    """
    pairs = zip(units.split(), ("m", "kg", "s"), _POWERS[q.unit], strict=True)
    return float(q.value * np.prod([factor_to_si(u, s, "--units") ** n for u, s, n in pairs]))


def toml(value: Any, units: str) -> str:
    """A value of a file as TOML in one line."""
    if isinstance(value, Quantity):
        if not value.unit or not value.value:
            return f"{value.value:.8g}"
        return json.dumps(quantity_text(si(value, units), value.unit))
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{dotted(k)} = {toml(v, units)}' for k, v in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(toml(v, units) for v in value)}]"
    return json.dumps(value)


def moduli(materials: Iterable[dict[str, Any]]) -> list[float]:
    """All moduli of some materials, in the file's unit."""
    values = (v for own in materials for v in own.values())
    flat = (q for v in values for q in (v if type(v) is list else [v]))
    return [q.value for q in flat if isinstance(q, Quantity) and q.unit == "Pa"]


def guessed_units(found: FileMesh, deck: Deck) -> tuple[str, str]:
    """Units with which densities, moduli and extent are usual ones, and what says so."""
    extent = float(np.ptp(found.points[np.unique(found.cells)], axis=0).max())
    own = deck.tables["materials"].items()
    rho = {name: c["rho"].value for name, c in own if c.get("rho", (0,))[0]}
    E = moduli(c for _, c in own)
    for units in SYSTEMS if rho else SYSTEMS[:2]:
        pairs = zip(units.split(), ("m", "kg", "s"), strict=True)
        m, kg, s = (factor_to_si(*pair, "--units") for pair in pairs)
        usual = LENGTHS[0] <= extent * m <= LENGTHS[1]
        usual &= all(DENSITIES[0] <= r * kg / m**3 <= DENSITIES[1] for r in rho.values())
        if usual and all(MODULI[0] <= e * kg / m / s**2 <= MODULI[1] for e in E):
            for name, r in rho.items():
                return units, f"the density {r:g} of {name}: {r * kg / m**3:.6g} kg/m^3"
            return units, f"the extent of {extent:g}"
    raise SceneError(
        f"--units: missing; no usual ones fit an extent of {extent:g} and the densities"
        f" {', '.join(f'{r:g}' for r in rho.values()) or '(none)'}; write such as --units mm t s"
    )

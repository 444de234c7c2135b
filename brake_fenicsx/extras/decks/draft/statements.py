"""What a deck says of a brake beside its mesh: tables of a scene on groups of the file.

Its numbers are in consistent units, which are guessed where nobody names them.
"""

import json
import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from brake_fenicsx.arguments import Array, Ints
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.decks.abaqus_scope import find
from brake_fenicsx.meshing.filemesh import DeckKeyword, FileMesh
from brake_fenicsx.scene.keys import dotted
from brake_fenicsx.scene.units import MODULI, factor_to_si, with_unit

from .shell_surface import ShellSection

# Consistent units of length, mass and time; densities of solids [kg/m^3], lengths of brakes [m].
SYSTEMS = ("mm t s", "m kg s", "mm kg ms", "mm g ms", "inch slinch s")
DENSITIES, LENGTHS = (300.0, 25e3), (5e-3, 3.0)
# Exponents of length, mass and time.
_POWERS = {
    "m": (1, 0, 0), "kg": (0, 1, 0), "kg/m^3": (-3, 1, 0), "Pa": (-1, 1, -2), "N": (1, 1, -2),
    "N m": (2, 1, -2), "N/m": (0, 1, -2), "Pa/m": (-2, 1, -2), "Hz": (0, 0, -1),
    "rad/s": (0, 0, -1), "m/s": (1, 0, -1),
}  # fmt: skip


class Quantity(NamedTuple):
    """A number in the file's unit, and its SI unit."""

    value: float
    unit: str


@dataclass(slots=True)
class Deck:
    """Statements of a deck.

    Attributes:
        mesh: the file.
        tables: section of a scene -> name, or group of a face -> its keys.
        sections: group of cells -> material.
        laws: name of an interaction -> keys of a contact.
        constants: material of Ansys -> its constants by their labels.
        interaction: that of general contact.
        general: whether all faces that touch are in contact.
        apart: pairs of faces that are not.
        motion: set of nodes that moves, and keys of [motion].
        shells: sections of shells that become solid.
        couplings: place of a reference node -> group of the face.
        rigid: group of a face that is rigid -> what makes it so.
        levers: group of a face -> places of reference nodes, and the force at each.
        ends: set of springs or masses -> faces that the nodes of each are coupled to.
        zoffs: property of shells of Nastran -> distances of their middle from the grid points.
        about: material or interaction that the next keywords are about.
        unread: keyword that is not taken over, and why; "" without a reason.
    """

    mesh: FileMesh
    tables: dict[str, dict[str, Any]] = field(default_factory=lambda: defaultdict(dict))
    sections: dict[str, str] = field(default_factory=dict)
    laws: dict[str, dict[str, Any]] = field(default_factory=lambda: defaultdict(dict))
    constants: dict[str, dict[str, Quantity]] = field(default_factory=lambda: defaultdict(dict))
    interaction: str = ""
    general: bool = False
    apart: list[list[str]] = field(default_factory=list)
    motion: tuple[str, dict[str, Any]] | None = None
    shells: list[ShellSection] = field(default_factory=list)
    couplings: dict[int, str] = field(default_factory=dict)
    rigid: dict[str, DeckKeyword] = field(default_factory=dict)
    levers: dict[str, list[tuple[int, Array]]] = field(default_factory=lambda: defaultdict(list))
    ends: dict[str, list[list[str]]] = field(default_factory=lambda: defaultdict(list))
    zoffs: dict[str, set[float]] = field(default_factory=lambda: defaultdict(set))
    about: str = ""
    unread: list[tuple[DeckKeyword, str]] = field(default_factory=list)

    def add(self, section: str, name: str, **keys: Any) -> None:
        """Write keys of a table of a scene."""
        self.tables[section].setdefault(name, {}).update(keys)

    def add_shells(self, section: ShellSection) -> None:
        """Sections of shells, with the material of each layer's cells."""
        thin = not all(0.0 < t < math.inf for t, _ in section.layers) or not section.layers
        if thin or not math.isfinite(section.offset):
            raise SceneError(f"{section.said}: no thickness above 0; write one for each layer")
        self.shells.append(section)
        pairs = zip(section.sets, section.layers, strict=True)
        self.sections |= {name: material for name, (_, material) in pairs}

    def forget(self, *keys: str) -> dict[str, Any]:
        """Keys of the interaction that the next keywords are about, without some of them."""
        own = self.laws[self.about.upper()]
        for key in keys:
            own.pop(key, None)
        return own

    def nodes(self, name: str) -> Ints:
        """Nodes of a set, or the one of a number."""
        if name.isdigit():
            return np.array([self.mesh.numbers[int(name)]])
        return self.mesh.node_groups[find(self.mesh.node_groups, name) or name]

    def coupled(self, name: str) -> str | None:
        """The face that is coupled to a reference node."""
        nodes = self.nodes(name)
        return self.couplings.get(int(nodes[0])) if nodes.size == 1 else None


def numbers(block: DeckKeyword) -> list[float]:
    """All numbers below a keyword."""
    return [float(word) for row in block.rows for word in row if word]


def axis_key(axis: Sequence[float]) -> str | list[float]:
    """An axis as a scene has it: "x", "y", "z", or a direction whose largest component is 1."""
    x = np.round(np.asarray(axis) / np.abs(axis).max(), 6) + 0.0
    return "xyz"[int(np.argmax(x))] if sorted(x) == [0.0, 0.0, 1.0] else [float(v) for v in x]


def _factors(units: str) -> list[float]:
    """Units of length [m], mass [kg] and time [s]."""
    pairs = zip(units.split(), ("m", "kg", "s"), strict=True)
    return [factor_to_si(*pair, "--units") for pair in pairs]


def si(q: Quantity, units: str) -> float:
    """A number of a file in SI units.

    Args:
        q: number and SI unit.
        units: units of length, mass and time of the file, "mm t s".
    """
    return float(q.value * np.prod(np.power(_factors(units), _POWERS[q.unit])))


def toml(value: Any, units: str) -> str:
    """A value of a file as TOML in one line."""
    if isinstance(value, Quantity):
        if not value.unit or not value.value:
            return f"{value.value:.8g}"
        return json.dumps(with_unit(si(value, units), value.unit))
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
        m, kg, s = _factors(units)
        usual = LENGTHS[0] <= extent * m <= LENGTHS[1]
        usual &= all(DENSITIES[0] <= r * kg / m**3 <= DENSITIES[1] for r in rho.values())
        if usual and all(MODULI[0] <= e * kg / m / s**2 <= MODULI[1] for e in E):
            for name, r in rho.items():
                return units, f"the density {r:g} of {name}: {r * kg / m**3:.6g} kg/m^3"
            return units, f"the extent of {extent:g}"
    raise SceneError(f"""--units: missing; no usual ones fit an extent of {extent:g} and the
        densities {", ".join(f"{r:g}" for r in rho.values()) or "(none)"}; write such as --units mm
        t s""")

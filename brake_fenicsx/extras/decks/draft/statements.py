"""What a deck says of a brake beside its mesh: tables of a scene on groups of the file."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.decks.abaqus_scope import find
from brake_fenicsx.meshing.filemesh import DeckKeyword, FileMesh

from .shell_surface import ShellSection


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

    def nodes(self, name: str) -> NDArray[np.int64]:
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

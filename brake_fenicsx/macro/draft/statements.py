"""What a deck says of a brake beside its mesh, in the deck's own names and units."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.macro.meshing.abaqus_scope import find
from brake_fenicsx.macro.meshing.filemesh import Block, FileMesh

Ints = NDArray[np.int64]


@dataclass(slots=True)
class Deck:
    """Statements of a deck; groups are named as in the file.

    Attributes:
        mesh: the file.
        materials: name -> key of a scene -> number or numbers.
        sections: group of cells -> material, and angle of the material axis 1 [deg].
        ties: name -> two faces and the largest distance, if the deck has one.
        pairs: two faces in contact and their interaction.
        interactions: name -> "friction", and "linear" stiffness of the contact.
        held: group -> directions.
        loads: group -> "pressure", "force", "moment" -> number or three numbers.
        springs: one or two faces -> stiffness along x, y, z.
        masses: face -> mass.
        axis: a point of the axis of rotation, its direction, and the speed; None if not said.
        couplings: place of a reference node -> face.
        ends: set of springs or masses -> faces that the nodes of each are coupled to.
        orientations: name -> keyword.
        about: the material or interaction that the next keywords are about.
        turned: whether nodes have axes of their own.
        unread: keyword that is not taken over -> why; "" without a reason.
    """

    mesh: FileMesh
    materials: dict[str, dict[str, Any]] = field(default_factory=dict)
    sections: dict[str, tuple[str, float]] = field(default_factory=dict)
    ties: dict[str, tuple[str, str, float | None]] = field(default_factory=dict)
    pairs: list[tuple[str, str, str]] = field(default_factory=list)
    interactions: dict[str, dict[str, float]] = field(default_factory=dict)
    held: dict[str, str] = field(default_factory=dict)
    loads: dict[str, dict[str, Any]] = field(default_factory=dict)
    springs: dict[tuple[str, ...], list[float]] = field(default_factory=dict)
    masses: dict[str, float] = field(default_factory=dict)
    axis: tuple[list[float], list[float], float] | None = None
    couplings: dict[int, str] = field(default_factory=dict)
    ends: dict[str, list[list[str | None]]] = field(default_factory=dict)
    orientations: dict[str, Block] = field(default_factory=dict)
    about: str = ""
    turned: bool = False
    unread: list[tuple[Block, str]] = field(default_factory=list)

    def groups(self, name: str, scope: str) -> list[str]:
        """Sets of the file that a name in a part, an instance or the assembly means."""
        owners = [
            instance
            for instance, (part, _) in self.mesh.instances.items()
            if scope and scope.upper() in (part.upper(), instance.upper())
        ]
        return [f"{owner}.{name}" for owner in owners] if owners else [name]

    def nodes(self, name: str) -> Ints:
        """Nodes of a set, or the one of a number."""
        if name.isdigit():
            return np.array([self.mesh.numbers[int(name)]])
        return self.mesh.node_groups[find(self.mesh.node_groups, name) or name]

    def coupled(self, name: str) -> str | None:
        """The face that is coupled to a reference node."""
        nodes = self.nodes(name)
        return self.couplings.get(int(nodes[0])) if nodes.size == 1 else None

    def angle(self, name: str, group: str) -> tuple[float, str | None]:
        """Angle of axis 1 of an orientation from x about z [deg], and why it has none."""
        block = self.orientations[name.upper()]
        turn = self.mesh.instances.get(group.rpartition(".")[0], ("", np.eye(3)))[1]
        x = [float(word) for word in block.rows[0]]
        a, b = turn @ x[:3], turn @ x[3:6]
        axis, more = [*map(float, block.rows[1]), 0.0][:2] if block.rows[1:] else (3.0, 0.0)
        flat = abs(a[2]) + abs(b[2]) < 1e-6 * np.abs(x).max() and np.cross(a, b)[2] > 0
        if block.options.get("SYSTEM", "R").upper()[0] != "R" or not flat or (more and axis != 3):
            return 0.0, f"its *ORIENTATION {name} has not axis 3 = z: write parts.NAME.axis"
        return round(float(np.degrees(np.arctan2(a[1], a[0])) + more), 6) + 0.0, None


def numbers(block: Block) -> list[float]:
    """All numbers below a keyword."""
    return [float(word) for row in block.rows for word in row if word]

"""A part, an instance or the assembly of an Abaqus deck: nodes, elements, sets and surfaces.

Numbers are those of the scope. The assembly takes those of its instances in, each moved by an
offset; what belongs to an instance is named "INSTANCE.NAME", and "NAME" stands for all instances.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import SceneError
from brake_fenicsx.meshing.filemesh import FAR, SOLIDS, corners_of, listed

# Corners of faces S1, S2, ...
FACES = {
    "tetrahedron": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    "hexahedron": (
        (0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0),
    ),
}  # fmt: skip
# Kinds of cells by their nodes.
KINDS = {
    4: "tetra", 5: "pyramid", 6: "wedge", 8: "hexahedron", 10: "tetra10", 13: "pyramid13",
    15: "wedge15", 20: "hexahedron20", 27: "hexahedron27",
}  # fmt: skip
Rows = list[list[str]]
Sets = dict[str, list[int]]


@dataclass(slots=True)
class Scope:
    """What one part, instance or assembly holds, by the numbers of the deck.

    Attributes:
        name: of the part or instance; "" for the assembly, or a deck without parts.
        nodes: number -> position.
        solids: number -> kind and nodes.
        skins: number -> kind and nodes of shells and membranes, which mark faces.
        others: kind of any other element -> number of them.
        nsets: name -> numbers of nodes.
        elsets: name -> numbers of elements.
        surfaces: name -> corner nodes of each facet.
        offsets: instance -> what its numbers were moved by.
    """

    name: str = ""
    nodes: dict[int, list[float]] = field(default_factory=dict)
    solids: dict[int, tuple[str, list[int]]] = field(default_factory=dict)
    skins: dict[int, tuple[str, list[int]]] = field(default_factory=dict)
    others: Counter[str] = field(default_factory=Counter)
    nsets: dict[str, list[int]] = field(default_factory=dict)
    elsets: dict[str, list[int]] = field(default_factory=dict)
    surfaces: dict[str, list[list[int]]] = field(default_factory=dict)
    offsets: dict[str, int] = field(default_factory=dict)

    def add(self, sets: dict[str, list[int]], name: str, numbers: Sequence[int]) -> None:
        """Add to a set; a second block of the same name extends the first."""
        sets.setdefault(find(sets, name) or name, []).extend(numbers)

    def members(self, sets: dict[str, list[int]], row: Sequence[str], instance: str) -> list[int]:
        """Numbers that a row of a set names, of its own or of an instance: "7", "SET", "I-1.7"."""
        found: list[int] = []
        for word in row:
            owner, dot, inner = word.rpartition(".")
            if inner.isdigit() and (not dot or find(self.offsets, owner)):
                found.append(int(inner) + self.offset(owner or instance))
            elif word:
                found += self.named(sets, word, instance)
        return found

    def offset(self, instance: str) -> int:
        """What the numbers of an instance were moved by; 0 without its name.

        Raises:
            SceneError: there is no such instance.
        """
        if not instance:
            return 0
        name = find(self.offsets, instance)
        if name is None:
            known = ", ".join(self.offsets) or "none"
            raise SceneError(f"instance {instance!r} is not defined before; there are: {known}")
        return self.offsets[name]

    def named(self, sets: dict[str, list[int]], name: str, instance: str = "") -> list[int]:
        """Numbers of a set by its name, which is not sensitive to case."""
        key = find(sets, f"{instance}.{name}") if instance else None
        key = key or find(sets, name)
        if key is None:
            raise SceneError(f"set {name!r} is used before it is defined")
        return sets[key]

    def facets(self, name: str, rows: Rows) -> list[list[int]]:
        """Corner nodes of a surface's facets.

        Args:
            name: of the surface, for messages.
            rows: a set or number of elements, and their face S1, S2, ..., or none for all that are
                on the boundary; of shells SPOS or SNEG, whose nodes are in the opposite order, or
                none for both.
        """
        found: list[list[int]] = []
        free = self._free() if any(not (row[1:] or [""])[0] for row in rows) else {}
        for member, *sides in rows:
            side = sides[0].upper() if sides else ""
            for number in self.members(self.elsets, [member], ""):
                if number in self.skins:
                    corners = corners_of(self.skins[number][1])
                    # A pressure on the element, "S", acts along the normal: on SNEG.
                    found += [corners] * (side in ("", "SPOS")) + [corners[::-1]] * (side != "SPOS")
                elif number in self.solids:
                    found += [self._facet(name, number, side)] if side else free.get(number, [])
        return found

    def _free(self) -> dict[int, list[list[int]]]:
        """Facets on the boundary of the solids, by element."""
        facets = [
            (number, [nodes[i] for i in face])
            for number, (kind, nodes) in self.solids.items()
            for face in _faces(kind)
        ]
        seen = Counter(frozenset(corners) for _, corners in facets)
        found: dict[int, list[list[int]]] = {}
        for number, corners in facets:
            if seen[frozenset(corners)] == 1:
                found.setdefault(number, []).append(corners)
        return found

    def _facet(self, name: str, number: int, side: str) -> list[int]:
        kind, nodes = self.solids[number]
        faces = {f"S{i}": face for i, face in enumerate(_faces(kind), 1)}
        if side not in faces:
            said = f"write S1 to S{len(faces)}" if faces else f"no scene has cells of kind {kind}"
            raise SceneError(f"surface {name!r}: face {side!r}; {said}")
        return [nodes[i] for i in faces[side]]

    def take(self, other: Scope, turn: Array, shift: Array) -> None:
        """Put an instance in its place.

        Args:
            other: the instance.
            turn: rotation, shape (3, 3).
            shift: x becomes ``turn @ x + shift``, shape (3,).
        """
        # The assembly has numbers of its own, as of reference points.
        by = self.offsets[other.name] = FAR * (1 + len(self.offsets))

        def moved(numbers: Iterable[int]) -> list[int]:
            return [number + by for number in numbers]

        x = np.array([*other.nodes.values()]).reshape(-1, 3) @ turn.T + shift
        self.nodes |= zip(moved(other.nodes), listed(x), strict=True)
        for cells, own in ((self.solids, other.solids), (self.skins, other.skins)):
            cells |= {n + by: (kind, moved(nodes)) for n, (kind, nodes) in own.items()}
        self.others += other.others
        for sets, of in ((self.nsets, other.nsets), (self.elsets, other.elsets)):
            sets |= {f"{other.name}.{name}": moved(numbers) for name, numbers in of.items()}
        for name, facets in other.surfaces.items():
            self.surfaces[f"{other.name}.{name}"] = [moved(facet) for facet in facets]
        if other.solids:
            self.elsets.setdefault(other.name, moved(other.solids))

    def share(self) -> None:
        """Name sets and surfaces of instances without the instance, where there is no such name."""
        tables: tuple[dict[str, Any], ...] = (self.nsets, self.elsets, self.surfaces)
        for table in tables:
            shared: dict[str, list[Any]] = {}
            for name, own in table.items():
                owner = next((o for o in self.offsets if name.startswith(f"{o}.")), None)
                if owner is not None:
                    plain = name[len(owner) + 1 :]
                    shared.setdefault(find(shared, plain) or plain, []).extend(own)
            table |= {name: own for name, own in shared.items() if find(table, name) is None}


def _faces(kind: str) -> Sequence[Sequence[int]]:
    """Corners of the faces of a kind of cell; none of one that no scene has."""
    return FACES.get(SOLIDS[kind][0] if kind in SOLIDS else "", ())


def find(names: Mapping[str, object], name: str) -> str | None:
    """The key that a name stands for: neither case nor quotation marks matter."""
    if name in names:
        return name
    wanted = name.replace('"', "").upper()
    return next((key for key in names if key.replace('"', "").upper() == wanted), None)


def placement(rows: Rows) -> tuple[Array, Array]:
    """Rotation and shift of an instance from its data lines.

    Args:
        rows: a translation, then two points of an axis and the angle about it [degrees]; the
            translation comes first, the axis stands in the assembly.

    Returns:
        The rotation, shape (3, 3), and the shift, shape (3,).
    """
    numbers = [[float(word) for word in row if word] for row in rows]
    shift = np.array(numbers[0] if numbers else [0.0, 0.0, 0.0])
    if shift.shape != (3,) or any(len(row) != 7 for row in numbers[1:]) or len(numbers) > 2:
        raise SceneError("an *INSTANCE has a line of 3 numbers, then one of 7: not so here")
    if len(numbers) < 2:
        return np.eye(3), shift
    a, b, angle = np.array(numbers[1][:3]), np.array(numbers[1][3:6]), np.radians(numbers[1][6])
    length = np.linalg.norm(b - a)
    if length == 0.0:
        raise SceneError("the axis of an *INSTANCE's rotation has two equal points")
    turn = Rotation.from_rotvec(angle / length * (b - a)).as_matrix()
    return turn, turn @ (shift - a) + a

"""Meshes of Abaqus and CalculiX: nodes, solid elements, sets and surfaces of an .inp file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError

from .filemesh import SOLIDS, FileMesh, numbered

Ints = NDArray[np.int64]

# Start of an element type -> kind of cell; shells and membranes only mark faces.
_KINDS = {
    "C3D4": "tetra", "C3D10": "tetra10", "C3D8": "hexahedron", "C3D20": "hexahedron20",
    "C3D27": "hexahedron27", "C3D6": "wedge", "C3D15": "wedge15",
}  # fmt: skip
_NODES = {"wedge": 6, "wedge15": 15, "hexahedron27": 27} | {k: n for k, (_, n) in SOLIDS.items()}
# gmsh writes faces as elements of plane stress, CPS.
_SKINS = {"S3": 3, "S4": 4, "S6": 6, "S8": 8, "M3D3": 3, "M3D4": 4, "M3D6": 6, "M3D8": 8,
          "CPS3": 3, "CPS4": 4, "CPS6": 6, "CPS8": 8,
          "SFM3D3": 3, "SFM3D4": 4, "SFM3D6": 6, "SFM3D8": 8, "STRI3": 3, "STRI65": 6}  # fmt: skip
# Corners of faces S1, S2, ...
_FACES = {
    "tetrahedron": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    "hexahedron": (
        (0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0),
    ),
}  # fmt: skip


@dataclass(slots=True)
class _Deck:
    """What has been read so far, by the file's own numbers."""

    nodes: dict[int, list[float]] = field(default_factory=dict)
    solids: dict[int, tuple[str, list[int]]] = field(default_factory=dict)
    skins: dict[int, list[int]] = field(default_factory=dict)
    nsets: dict[str, list[int]] = field(default_factory=dict)
    elsets: dict[str, list[int]] = field(default_factory=dict)
    surfaces: dict[str, list[tuple[str, str]]] = field(default_factory=dict)
    parts: int = 0


def read_abaqus(path: Path) -> FileMesh:
    """Read an .inp file: *NODE, *ELEMENT, *NSET, *ELSET, *SURFACE and *INCLUDE.

    Args:
        path: the file.

    Returns:
        Cells, with element sets as cell groups, surfaces and sets of shells as facet groups, and
        node sets as node groups.

    Raises:
        SceneError: the file is no flat mesh of one kind of solid elements.
    """
    deck = _Deck()
    for keyword, options, rows in _blocks(path):
        _take(deck, keyword, options, rows)
    return _mesh(deck)


def _blocks(path: Path) -> Iterator[tuple[str, dict[str, str], list[list[str]]]]:
    """Keyword, options and data rows of every block of a file, included files in their place."""
    keyword = ""
    options: dict[str, str] = {}
    rows: list[list[str]] = []
    try:
        lines = path.read_text(errors="replace").splitlines()
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from None
    for line in [*lines, "*END"]:
        if line.startswith("**") or not line.strip():
            continue
        if not line.startswith("*"):
            rows.append([word.strip() for word in line.strip().rstrip(",").split(",")])
            continue
        if keyword:
            yield keyword, options, rows
        first, *words = line[1:].split(",")
        keyword, rows = first.strip().upper(), []
        pairs = (word.partition("=") for word in words)
        options = {name.strip().upper(): value.strip() for name, _, value in pairs}
        if keyword == "INCLUDE":
            yield from _blocks(path.parent / options.get("INPUT", ""))
            keyword = ""


def _take(deck: _Deck, keyword: str, options: dict[str, str], rows: list[list[str]]) -> None:
    """Add one block to the deck."""
    if keyword == "PART":
        deck.parts += 1
        if deck.parts > 1:
            raise SceneError("the file has several *PART; export it without parts and assemblies")
    elif keyword == "NODE":
        for row in rows:
            deck.nodes[int(row[0])] = [float(v) for v in row[1:4]]
        if "NSET" in options:
            deck.nsets.setdefault(options["NSET"], []).extend(int(row[0]) for row in rows)
    elif keyword == "ELEMENT":
        _elements(deck, options, rows)
    elif keyword in ("NSET", "ELSET"):
        sets = deck.nsets if keyword == "NSET" else deck.elsets
        if keyword not in options:
            raise SceneError(f"a *{keyword} has no name; write *{keyword}, {keyword}=NAME")
        sets.setdefault(options[keyword], []).extend(_members(sets, rows, "GENERATE" in options))
    elif keyword == "SURFACE" and "NAME" in options:
        if options.get("TYPE", "ELEMENT").upper() == "NODE":
            numbers = _members(deck.nsets, [row[:1] for row in rows], False)
            deck.nsets.setdefault(options["NAME"], []).extend(numbers)
        else:
            deck.surfaces[options["NAME"]] = [(r[0], r[1] if len(r) > 1 else "") for r in rows]


def _elements(deck: _Deck, options: dict[str, str], rows: list[list[str]]) -> None:
    """Solids, and shells that mark faces; other elements are no part of the mesh."""
    name = options.get("TYPE", "").upper()
    kind = _KINDS.get(name.rstrip("HIMRTSEF"))
    skin = _SKINS.get(name) or _SKINS.get(name.rstrip("RSW5"))
    count = _NODES[kind] if kind else skin
    if count is None:
        return
    words = [int(word) for row in rows for word in row if word]
    if len(words) % (count + 1):
        raise SceneError(f"*ELEMENT, TYPE={name}: a row has not {count} nodes")
    table = np.array(words, dtype=np.int64).reshape(-1, count + 1)
    for number, *nodes in table.tolist():
        if kind:
            deck.solids[number] = (kind, nodes)
        else:
            deck.skins[number] = nodes[: 3 if count in (3, 6) else 4]
    if "ELSET" in options:
        deck.elsets.setdefault(options["ELSET"], []).extend(map(int, table[:, 0]))


def _members(sets: dict[str, list[int]], rows: list[list[str]], generate: bool) -> list[int]:
    """Numbers of a set: listed, generated, or those of other sets."""
    found: list[int] = []
    for row in rows:
        if generate:
            first, last, *step = (int(word) for word in row)
            found += range(first, last + 1, step[0] if step else 1)
            continue
        for word in row:
            if word.lstrip("-").isdigit():
                found.append(int(word))
            elif word:
                found += _named(sets, word)
    return found


def _named(sets: dict[str, list[int]], name: str) -> list[int]:
    """A set by its name, which is not sensitive to case and may carry its instance's name."""
    inner = name.rpartition(".")[2].strip('"').upper()
    for key, numbers in sets.items():
        if key.strip('"').upper() == inner:
            return numbers
    raise SceneError(f"set {name!r} is used before it is defined")


def _mesh(deck: _Deck) -> FileMesh:
    """The deck with nodes and cells numbered from 0."""
    mesh, cells, node, cell = numbered(deck.nodes, deck.solids, deck.elsets, deck.nsets)
    for name, numbers in deck.elsets.items():
        skins = [[node[i] for i in deck.skins[n]] for n in numbers if n in deck.skins]
        if skins:
            mesh.facet_groups[name] = np.array(skins)
    for name, places in deck.surfaces.items():
        mesh.facet_groups[name] = _surface(deck, name, places, cell, cells, mesh.shape)
    return mesh


def _surface(
    deck: _Deck, name: str, places: list[tuple[str, str]], cell: dict[int, int], cells: Ints,
    shape: str,
) -> Ints:  # fmt: skip
    """Corner nodes of a surface's facets."""
    faces = _FACES[shape]
    found = []
    for member, side in places:
        numbers = [int(member)] if member.isdigit() else _named(deck.elsets, member)
        index = int(side[1:]) if side[:1].upper() == "S" and side[1:].isdigit() else 0
        if not 1 <= index <= len(faces):
            raise SceneError(f"surface {name!r}: face {side!r}; write S1 to S{len(faces)}")
        own = cells[[cell[n] for n in numbers if n in cell]]
        found.append(own[:, np.array(faces[index - 1])])
    return np.concatenate(found)

"""Meshes of Ansys: nodes, solid elements and components of a blocked .cdb file."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from operator import length_hint
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError

from .filemesh import DeckKeyword, FileMesh, held_nodes, numbered

Ints = NDArray[np.int64]

# Solid elements by their routine number; others, as of contact, are counted and left out.
_SOLIDS = {45, 64, 65, 73, 92, 95, 185, 186, 187, 285}
_NAMES = {
    14: "COMBIN14", 21: "MASS21", 61: "SHELL61", 63: "SHELL63", 154: "SURF154", 169: "TARGE169",
    170: "TARGE170", 172: "CONTA172", 173: "CONTA173", 174: "CONTA174", 175: "CONTA175",
    178: "CONTA178", 179: "PRETS179", 180: "LINK180", 181: "SHELL181", 184: "MPC184",
    188: "BEAM188", 189: "BEAM189", 190: "SOLSH190", 214: "COMBI214", 250: "COMBI250",
    281: "SHELL281",
}  # fmt: skip
# Meshing facets, which only gmsh's and Ansys' own meshers use.
_FACETS = 200
# Commands that join, hold or load nodes and elements; materials and options.
_COMMANDS = ("CE", "CP", "D", "F", "SF", "SFE", "BF", "BFE", "MPTEMP", "MPDATA", "MP", "TB", "R",
             "RLBLOCK", "SECTYPE")  # fmt: skip
# Places of a tetrahedron's nodes in a brick that is degenerate, corners and middles.
_TETRA_IN_BRICK = (0, 1, 2, 4, 8, 9, 11, 16, 17, 18)
_BY_CORNERS = {8: "hexahedron", 6: "wedge", 5: "pyramid", 4: "tetra"}


@dataclass(slots=True)
class _AnsysDeck:
    """What has been read so far, by the file's own numbers."""

    routine: dict[int, int] = field(default_factory=dict)
    nodes: dict[int, list[float]] = field(default_factory=dict)
    solids: dict[int, tuple[str, list[int]]] = field(default_factory=dict)
    elements: dict[str, list[int]] = field(default_factory=dict)
    nodesets: dict[str, list[int]] = field(default_factory=dict)
    others: Counter[str] = field(default_factory=Counter)
    blocks: list[DeckKeyword] = field(default_factory=list)


def read_ansys(path: Path) -> FileMesh:
    """Read a .cdb file written with CDWRITE in blocked format.

    Args:
        path: the file.

    Returns:
        Cells; element components, MAT1, MAT2, ... and TYPE1, TYPE2, ... as cell groups; node
        components as node groups.

    Raises:
        SceneError: the file is not blocked, or its solids are not of one kind.
    """
    deck = _AnsysDeck()
    every = path.read_text(errors="replace").splitlines()
    lines = iter(every)
    for line in lines:
        words = [word.strip() for word in line.split("!")[0].split(",")]
        command = words[0].upper()
        if command == "ET" and len(words) > 2 and words[2].isdigit():
            deck.routine[int(words[1])] = int(words[2])
        elif command == "NBLOCK":
            _nodes(deck, lines)
        elif command == "EBLOCK":
            _elements(deck, lines)
        elif command == "CMBLOCK":
            _component(deck, words, lines)
        elif command in _COMMANDS:
            at = f"{path.name}:{len(every) - length_hint(lines)}"
            deck.blocks.append(DeckKeyword(command, {}, [words], line.strip(), at))
    if not deck.nodes:
        raise SceneError("no NBLOCK; write the file with CDWRITE in blocked format")
    return _mesh(deck)


def _widths(line: str) -> tuple[int, int, int]:
    """Number and width of the integers, and width of the reals, of a Fortran format."""
    whole = re.search(r"(\d+)i(\d+)", line.lower())
    real = re.search(r"\d*e(\d+)", line.lower())
    if whole is None:
        raise SceneError(f"format {line.strip()!r} of a block is not understood")
    return int(whole[1]), int(whole[2]), int(real[1]) if real else 0


def _fields(line: str, width: int, start: int = 0) -> list[str]:
    """Words of fixed width."""
    return [line[i : i + width].strip() for i in range(start, len(line.rstrip()), width)]


def _nodes(deck: _AnsysDeck, lines: Iterator[str]) -> None:
    """Nodes; coordinates that are left out are zero."""
    count, width, real = _widths(next(lines))
    for line in lines:
        first = line[:width].strip()
        if not first.isdigit():
            return
        words = _fields(line, real, count * width)[:3]
        x = [float(word) if word else 0.0 for word in words]
        deck.nodes[int(first)] = x + [0.0] * (3 - len(x))


def _elements(deck: _AnsysDeck, lines: Iterator[str]) -> None:
    """Elements: eleven attributes, up to eight nodes, and the rest on the next line."""
    _, width, _ = _widths(next(lines))
    for line in lines:
        row = [int(word) for word in _fields(line, width) if word]
        if not row or row[0] == -1:
            return
        material, kind, count, number, nodes = row[0], row[1], row[8], row[10], row[11:]
        while len(nodes) < count:
            nodes += [int(word) for word in _fields(next(lines), width) if word]
        routine = deck.routine.get(kind, 185)
        if routine not in _SOLIDS and routine != _FACETS:
            deck.others[_NAMES.get(routine, f"type {routine}")] += 1
        elif routine in _SOLIDS:
            deck.solids[number] = _solid(nodes[:count])
            for name in (f"MAT{material}", f"TYPE{kind}"):
                deck.elements.setdefault(name, []).append(number)


def _solid(nodes: list[int]) -> tuple[str, list[int]]:
    """Kind and nodes of an element; bricks with equal corners are tetrahedra or worse."""
    if len(nodes) in (4, 10):
        return ("tetra" if len(nodes) == 4 else "tetra10"), nodes
    kind = _BY_CORNERS.get(len(set(nodes[:8])), "cells of few corners")
    if kind == "tetra":
        second = len(nodes) == 20
        places = _TETRA_IN_BRICK if second else _TETRA_IN_BRICK[:4]
        return ("tetra10" if second else "tetra"), [nodes[i] for i in places]
    return (f"{kind}20" if kind == "hexahedron" and len(nodes) == 20 else kind), nodes


def _component(deck: _AnsysDeck, words: list[str], lines: Iterator[str]) -> None:
    """A component; -n stands for all numbers after the one before, up to n."""
    name, kind, count = words[1], words[2].upper(), int(words[3])
    _, width, _ = _widths(next(lines))
    numbers: list[int] = []
    read = 0
    while read < count:
        row = [int(word) for word in _fields(next(lines), width) if word]
        read += len(row)
        for number in row:
            numbers += [number] if number > 0 else range(numbers[-1] + 1, -number + 1)
    sets = deck.nodesets if kind.startswith("NODE") else deck.elements
    sets.setdefault(name, []).extend(numbers)


def _mesh(deck: _AnsysDeck) -> FileMesh:
    """The deck with nodes and cells numbered from 0."""
    held = [
        (int(row[1]), row[2][1:].lower())
        for row in (block.rows[0] for block in deck.blocks if block.keyword == "D")
        if row[1].isdigit() and row[2] in ("UX", "UY", "UZ") and not float(row[3] or 0)
    ]
    mesh = numbered(deck.nodes, deck.solids, deck.elements, deck.nodesets | held_nodes("D", held))[
        0
    ]
    mesh.elements, mesh.blocks = deck.others, deck.blocks
    mesh.keywords = Counter(block.keyword for block in deck.blocks)
    return mesh

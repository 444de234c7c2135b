"""Meshes of Ansys: nodes, solid elements and components of a blocked .cdb file.

Reference: Ansys Mechanical APDL Command Reference 2024 R1, CDWRITE, NBLOCK, EBLOCK, ETBLOCK.
Mapdl-archive 0.4.2 agrees in nodes, elements and components, in a 25th of the seconds (0.2 s for
200,000 nodes), and takes a file that is cut off, or a number with a letter in it, without an error.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from operator import length_hint
from pathlib import Path

from scipy.spatial.transform import Rotation

from brake_fenicsx.errors import SceneError
from brake_fenicsx.meshing.filemesh import DeckKeyword, FileMesh, held_nodes, numbered

from . import abaqus_scope, keywords, node_axes

_SOLIDS = {*keywords.TABLES["elements"]["solids"]}
_NAMES = {int(re.sub(r"\D", "", name)): name for name in keywords.TABLES["elements"]["others"]}
# Meshing facets, which only gmsh's and Ansys' own meshers use.
_FACETS = 200
_SILENT, _IDLE = ({*keywords.TABLES[kind]["ansys"]} for kind in ("silent", "idle"))
# A command, as opposed to rows of numbers within a block.
_COMMAND = re.compile(r"[/*~]?[A-Z][A-Z0-9_]*$")
# Places of a tetrahedron's nodes in a brick that is degenerate, corners and middles.
_TETRA_IN_BRICK = (0, 1, 2, 4, 8, 9, 11, 16, 17, 18)


@dataclass(slots=True)
class _AnsysDeck:
    """What has been read so far, by the file's own numbers."""

    types: dict[int, int] = field(default_factory=dict)
    nodes: dict[int, list[float]] = field(default_factory=dict)
    angles: dict[int, list[float]] = field(default_factory=dict)
    turned: set[int] = field(default_factory=set)
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
        if command == "ET" and len(words) > 2:
            deck.types[int(words[1])] = _routine(words[2])
        elif command == "ETBLOCK":
            _types(deck, _rows(lines, command))
        elif command == "NBLOCK":
            _nodes(deck, _rows(lines, command))
        elif command == "EBLOCK":
            _elements(deck, words, _rows(lines, command))
        elif command == "CMBLOCK":
            _component(deck, words, _rows(lines, command))
        elif command not in _SILENT and _COMMAND.match(command):
            if command in _IDLE and not any(word.strip("0.+-Ee") for word in words[1:]):
                continue
            at = f"{path.name}:{len(every) - length_hint(lines)}"
            deck.blocks.append(DeckKeyword(command, {}, [words], line.strip(), at))
    if not deck.nodes:
        raise SceneError("no NBLOCK; write the file with CDWRITE in blocked format")
    return _mesh(deck)


def _rows(lines: Iterator[str], block: str) -> Iterator[str]:
    """Lines of a block, which end before the file does."""
    yield from lines
    raise SceneError(f"the file ends within its {block}: it is cut off; write it once more")


def _routine(name: str) -> int:
    """Number of an element type by its number or name, 185 of SOLID185; 0 of none."""
    found = re.search(r"\d+$", name.strip())
    return int(found[0]) if found else 0


def _widths(line: str) -> tuple[list[int], int]:
    """Widths of the integers, one for each, and of the reals of a Fortran format.

    "(3i9,6e21.13e3)" and "(1i7,2i9,6e21.13)" are among those that Ansys and others write.
    """
    whole = [int(w) for n, w in re.findall(r"(\d+)i(\d+)", line.lower()) for _ in range(int(n))]
    real = re.search(r"\d*e(\d+)", line.lower())
    if not whole:
        raise SceneError(f"format {line.strip()!r} of a block is not understood")
    return whole, int(real[1]) if real else 0


def _fields(line: str, width: int, start: int = 0) -> list[str]:
    """Words of fixed width."""
    return [line[i : i + width].strip() for i in range(start, len(line.rstrip()), width)]


def _types(deck: _AnsysDeck, lines: Iterator[str]) -> None:
    """Types and their routines, a line for each."""
    (width, *_), _ = _widths(next(lines))
    for line in lines:
        row = _fields(line, width)
        if len(row) < 2 or row[0] == "-1":
            return
        deck.types[int(row[0])] = _routine(row[1])


def _nodes(deck: _AnsysDeck, lines: Iterator[str]) -> None:
    """Nodes; coordinates and angles that are left out are zero."""
    widths, real = _widths(next(lines))
    for line in lines:
        first = line[: widths[0]].strip()
        if not first.isdigit():
            return
        words = _fields(line, real, sum(widths))[:6]
        x = [float(word) if word else 0.0 for word in words] + [0.0] * (6 - len(words))
        deck.nodes[int(first)] = x[:3]
        if any(x[3:]):
            deck.angles[int(first)] = x[3:]


def _elements(deck: _AnsysDeck, words: list[str], lines: Iterator[str]) -> None:
    """Elements: eleven attributes, up to eight nodes, and the rest on the next line.

    Without SOLID in its command a block has number, type, three attributes and up to ten nodes;
    Workbench writes elements of contact and of loads on faces so.
    """
    (width, *_), _ = _widths(next(lines))
    attributes = [word.upper() for word in words[2:3]] == ["SOLID"]
    for line in lines:
        row = [int(word) for word in _fields(line, width) if word]
        if not row or row[0] == -1:
            return
        if not attributes:
            if (routine := deck.types.get(row[1], 0)) in _SOLIDS or len(row) < 6:
                raise SceneError("solids in an EBLOCK without SOLID; write the file with CDWRITE")
            deck.others[_NAMES.get(routine, f"type {routine or row[1]}")] += 1
            continue
        material, kind, count, number, nodes = row[0], row[1], row[8], row[10], row[11:]
        while len(nodes) < count:
            nodes += [int(word) for word in _fields(next(lines), width) if word]
        routine = deck.types.get(kind, 0)
        if routine in _SOLIDS:
            deck.solids[number] = _solid(number, nodes[:count])
            for name in (f"MAT{material}", f"TYPE{kind}"):
                deck.elements.setdefault(name, []).append(number)
            deck.turned |= {row[4]} - {0}
        elif routine != _FACETS:
            deck.others[_NAMES.get(routine, f"type {routine or kind}")] += 1


def _solid(number: int, nodes: list[int]) -> tuple[str, list[int]]:
    """Kind and nodes of an element; bricks with equal corners are tetrahedra or worse.

    Middle nodes that are left out are 0: without any of them an element is a linear one.
    """
    corners = 4 if len(nodes) in (4, 10) else 8
    nodes = nodes if any(nodes[corners:]) else nodes[:corners]
    if 0 in nodes:
        raise SceneError(f"element {number} lacks middle nodes; write all of them, or none")
    if len(nodes) in (4, 10):
        return ("tetra" if len(nodes) == 4 else "tetra10"), nodes
    kind = abaqus_scope.KINDS.get(len(set(nodes[:8])), "cells of few corners")
    if kind == "tetra":
        second = len(nodes) == 20
        places = _TETRA_IN_BRICK if second else _TETRA_IN_BRICK[:4]
        return ("tetra10" if second else "tetra"), [nodes[i] for i in places]
    return (f"{kind}20" if kind == "hexahedron" and len(nodes) == 20 else kind), nodes


def _component(deck: _AnsysDeck, words: list[str], lines: Iterator[str]) -> None:
    """A component; -n stands for all numbers after the one before, up to n."""
    name, kind, count = words[1], words[2].upper(), int(words[3])
    (width, *_), _ = _widths(next(lines))
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
    held, lost = list[tuple[int, str]](), list[tuple[DeckKeyword, str]]()
    for block in (b for b in deck.blocks if b.keyword == "D"):
        try:
            held += _held(deck, block.rows[0])
        except SceneError as error:
            lost.append((block, str(error)))
    sets = deck.nodesets | held_nodes("D", held)
    mesh = numbered(deck.nodes, deck.solids, {}, deck.elements, sets)
    mesh.elements, mesh.lost = deck.others, lost
    mesh.blocks = [block for block in deck.blocks if block.keyword != "D"]
    if deck.turned:
        names = ", ".join(map(str, sorted(deck.turned)))
        why = f"solids have element coordinate systems {names}: write the axis of the part"
        mesh.lost.append((DeckKeyword("EBLOCK", {}, [], "EBLOCK", "ESYS"), why))
    return mesh


def _held(deck: _AnsysDeck, words: list[str]) -> list[tuple[int, str]]:
    """Node and directions of a D, NODE, LABEL, VALUE that holds them."""
    _, node, label, value, *more = [*words, "", ""]
    if not node.isdigit() or any(word.strip("0.+-Ee") for word in more):
        raise SceneError("not one node by its number and one direction")
    along = {"ALL": "XYZ", "UX": "X", "UY": "Y", "UZ": "Z"}.get(label, "")
    if not along or value.strip("0.+-Ee"):
        raise SceneError("not a displacement of zero")
    if len(along) == 1 and int(node) in deck.angles:
        # Turned about z, then about the new x, then about the new y.
        turn = Rotation.from_euler("ZXY", deck.angles[int(node)], degrees=True)
        found = node_axes.component_along(turn.as_matrix().T, "XYZ".index(along))
        if found is None:
            raise SceneError(node_axes.TURNED)
        along = "XYZ"[found[0]]
    return [(int(node), c.lower()) for c in along]

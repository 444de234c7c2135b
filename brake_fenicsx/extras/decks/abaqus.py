"""Meshes of Abaqus and CalculiX: nodes, solid elements, sets and surfaces of an .inp file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import reading
from brake_fenicsx.meshing.filemesh import (
    SOLIDS,
    DeckKeyword,
    FileMesh,
    held_nodes,
    numbered,
    same_length,
)

from .abaqus_keywords import keyword_of
from .abaqus_scope import Rows, Scope, find, placement
from .abaqus_steps import in_force
from .node_axes import along_global

Ints = NDArray[np.int64]
Options = dict[str, str]

# Start of an element type -> kind of cell; shells and membranes mark faces, or become solids.
_KINDS = {
    "C3D4": "tetra", "C3D10": "tetra10", "C3D8": "hexahedron", "C3D20": "hexahedron20",
    "C3D27": "hexahedron27", "C3D6": "wedge", "C3D15": "wedge15", "SC6": "wedge",
    "SC8": "hexahedron",
}  # fmt: skip
# Places of the nodes of a C3D27 in the order of VTK: the body is its 21st, faces S1 to S6 follow.
_VTK27 = (*range(20), 26, 24, 23, 25, 21, 22, 20)
_NODES = {"wedge": 6, "wedge15": 15, "hexahedron27": 27} | {k: n for k, (_, n) in SOLIDS.items()}
# gmsh writes faces as elements of plane stress, CPS.
_SKINS = {"S3": 3, "S4": 4, "S6": 6, "S8": 8, "M3D3": 3, "M3D4": 4, "M3D6": 6, "M3D8": 8,
          "CPS3": 3, "CPS4": 4, "CPS6": 6, "CPS8": 8,
          "SFM3D3": 3, "SFM3D4": 4, "SFM3D6": 6, "SFM3D8": 8, "STRI3": 3, "STRI65": 6}  # fmt: skip
# Elements without stiffness or mass in a deck of solids: they mark faces and edges at most.
_MARKS = ("CPS", "SFM")
_DATA = ("NODE", "ELEMENT", "NSET", "ELSET", "SURFACE")
# Files that a deck may include, and numbers that a range of a set may have.
MOST_FILES, MOST_NUMBERS = 1000, 10**7
# Their options; with another one they would be another mesh.
_OPTIONS = {
    "NODE": {"NSET", "SYSTEM"}, "ELEMENT": {"TYPE", "ELSET"},
    "NSET": {"NSET", "ELSET", "GENERATE", "INSTANCE", "INTERNAL", "UNSORTED"},
    "ELSET": {"ELSET", "GENERATE", "INSTANCE", "INTERNAL", "UNSORTED"},
    "SURFACE": {"NAME", "TYPE", "INTERNAL", "COMBINE"},
    "PART": {"NAME"}, "INSTANCE": {"NAME", "PART"}, "ASSEMBLY": {"NAME"},
}  # fmt: skip
# Blocks with an end of their own.
_CLOSED = ("PART", "INSTANCE", "ASSEMBLY")
# What makes or moves nodes and elements, and would be missing in the mesh.
_MAKERS = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM")


@dataclass(slots=True)
class _AbaqusDeck:
    """What has been read so far.

    Attributes:
        whole: the assembly, or all of a deck without parts.
        parts: name -> part.
        open: part or instance being read.
        place: rotation and shift of the instance being read.
        surfaces: of the scope being read, name -> rows; sets they name may follow.
        blocks: what is no part of the mesh.
        lost: what is left out of it, and why.
        instances: name -> part.
    """

    whole: Scope = field(default_factory=Scope)
    parts: dict[str, Scope] = field(default_factory=dict)
    open: Scope | None = None
    place: Rows = field(default_factory=list)
    surfaces: dict[str, Rows] = field(default_factory=dict)
    blocks: list[DeckKeyword] = field(default_factory=list)
    lost: list[tuple[DeckKeyword, str]] = field(default_factory=list)
    instances: dict[str, str] = field(default_factory=dict)

    @property
    def scope(self) -> Scope:
        """Where nodes, elements and sets go now."""
        return self.whole if self.open is None else self.open


def read_abaqus(path: Path) -> FileMesh:
    """Read an .inp file: parts, instances, nodes, elements, sets, surfaces and included files.

    Args:
        path: the file.

    Returns:
        Cells, with element sets and instances as cell groups, surfaces and sets of shells as facet
        groups, and node sets as node groups. A set of an instance is "INSTANCE.SET", and "SET" is
        that of all instances that have one.

    Raises:
        SceneError: the mesh is not of one kind of solid elements, or the file ends within a block.
    """
    deck = _AbaqusDeck()
    within: list[str] = []
    for block in _blocks(path):
        if block.keyword in _CLOSED:
            within.append(block.said)
        elif block.keyword.startswith("END ") and block.keyword[4:] in _CLOSED and within:
            within.pop()
        try:
            _take(deck, block)
        except (SceneError, ValueError, IndexError) as error:
            raise SceneError(f"{block.said}: {error}") from None
    if within:
        raise SceneError(f"the file ends within {within[-1]}; is it whole?")
    _close(deck)
    if not deck.whole.offsets:
        for part in deck.parts.values():
            deck.whole.take(part, np.eye(3), np.zeros(3))
            deck.instances[part.name] = part.name
    deck.whole.share()
    found = in_force(deck.blocks)
    deck.blocks, lost = along_global(deck.whole, found.blocks)
    lost += _unnamed(deck)
    mesh = _mesh(deck.whole)
    mesh.blocks, mesh.instances, mesh.lost = (
        deck.blocks,
        deck.instances,
        [*deck.lost, *found.lost, *lost],
    )
    mesh.step, mesh.band, mesh.apart = found.step, found.band, [*found.removed.values()]
    return mesh


def _blocks(
    path: Path, block: DeckKeyword | None = None, chain: tuple[Path, ...] = (), opened: Any = None
) -> Iterator[DeckKeyword]:
    """Every block, included files in their place.

    Args:
        path: the file.
        block: the one whose data lines go on in it.
        chain: files that include it, one in the other.
        opened: number of each file that was opened.
    """
    opened = count() if opened is None else opened
    if path.resolve() in chain or next(opened) > MOST_FILES:
        raise SceneError(f"{path}: includes itself, or more than {MOST_FILES} files")
    chain = (*chain, path.resolve())
    with reading(path, "as text"):
        text = path.read_text("utf-8", "replace")
    lines = enumerate([*text.splitlines(), "*END"], 1)
    for number, line in lines:
        if line.startswith("**") or not line.strip():
            continue
        if not line.startswith("*"):
            if block:
                words = line.strip().rstrip(",").split(",")
                block.rows.append([word.strip() for word in words])
            continue
        while line.rstrip().endswith(","):
            line = line.rstrip() + next(lines)[1]
        first, *words = line[1:].split(",")
        keyword = keyword_of(first)
        if block and keyword != "INCLUDE":
            last = line == "*END" and not text.endswith(("\n", "\r"))
            if last and block.keyword in _DATA:
                raise SceneError(
                    f"the file ends within {block.said}, amid a line; is it whole? If so, end its"
                    " last line"
                )
            yield block
        pairs = (word.partition("=") for word in words)
        options = {"".join(n.split()).upper(): value.strip().strip('"') for n, _, value in pairs}
        if keyword == "INCLUDE":
            yield from _blocks(path.parent / options.get("INPUT", ""), block, chain, opened)
            block = None
            continue
        block = DeckKeyword(keyword, options, [], line.strip(), f"{path.name}:{number}")


def _take(deck: _AbaqusDeck, block: DeckKeyword) -> None:
    """Add one block to the deck."""
    keyword, options, rows, scope = block.keyword, block.options, block.rows, deck.scope
    if unknown := sorted(options.keys() - _OPTIONS.get(keyword, options.keys())):
        said = f"its option {unknown[0]} is not understood"
        if keyword not in ("NODE", "NSET", "ELSET") or "INPUT" in unknown:
            raise SceneError(f"{said}; write it without")
        deck.lost.append((block, said))
    if keyword in _MAKERS or (keyword == "NODE" and options.get("SYSTEM", "R").upper() != "R"):
        raise SceneError("nodes and elements must be written one by one in Cartesian axes")
    if keyword == "PART":
        _close(deck)
        deck.open = deck.parts[options["NAME"]] = Scope(options["NAME"])
    elif keyword == "INSTANCE":
        _close(deck)
        deck.open, deck.place = _instance(deck, options), rows
        deck.instances[deck.open.name] = options.get("PART", deck.open.name)
    elif keyword in ("END PART", "END INSTANCE", "END ASSEMBLY"):
        _close(deck)
        if keyword == "END INSTANCE" and deck.open is not None:
            deck.whole.take(deck.open, *placement(deck.place))
        deck.open = None
    elif keyword == "NODE":
        for row in rows:
            if len(row) < 4:
                raise SceneError(f"node {row[0]} has not 3 coordinates; is the file whole?")
            scope.nodes[int(row[0])] = [float(v or 0.0) for v in row[1:4]]
        if "NSET" in options:
            scope.add(scope.nsets, options["NSET"], [int(row[0]) for row in rows])
    elif keyword == "ELEMENT":
        if not _elements(scope, options, rows):
            deck.blocks.append(replace(block, scope=scope.name))
    elif keyword in ("NSET", "ELSET"):
        _set(scope, keyword, options, rows)
    elif keyword == "SURFACE" and "NAME" in options:
        if options.get("TYPE", "ELEMENT").upper() == "NODE":
            numbers = [n for row in rows for n in scope.members(scope.nsets, row[:1], "")]
            scope.add(scope.nsets, options["NAME"], numbers)
        elif "COMBINE" in options:
            raise SceneError("combined surfaces are not read; write their faces")
        else:
            if options.get("TYPE", "ELEMENT").upper() != "ELEMENT":
                raise SceneError(f"surfaces of type {options['TYPE']} are not read; write faces")
            deck.surfaces[options["NAME"]] = rows
    elif not keyword.startswith("END ") and keyword != "ASSEMBLY":
        deck.blocks.append(replace(block, scope=scope.name))


def _unnamed(deck: _AbaqusDeck) -> list[tuple[DeckKeyword, str]]:
    """Sets of nodes and faces that supports and pressures name by their numbers alone.

    Returns:
        Rows that name nothing, and why.
    """
    held, whole, lost = [], deck.whole, list[tuple[DeckKeyword, str]]()
    for block in deck.blocks:
        if block.scope or block.keyword not in ("BOUNDARY", "DLOAD"):
            continue
        for word, *row in block.rows:
            try:
                if block.keyword == "DLOAD":
                    name = f"*DLOAD {float(row[1]):g}"
                    facets = whole.facets(name, [[word, row[0].upper().replace("P", "S")]])
                    whole.surfaces.setdefault(name, []).extend(facets)
                elif word.rpartition(".")[2].isdigit():
                    along = held_along(row)
                    held += [(n, along) for n in whole.members(whole.nsets, [word], "")]
            except SceneError as error:
                lost.append((block, f"{', '.join((word, *row))}: {error}"))
    whole.nsets |= held_nodes("*BOUNDARY", held)
    return lost


def held_along(row: Sequence[str]) -> str:
    """Direction that a row of *BOUNDARY holds in the modes, also where it moves: x, y, z or r.

    Args:
        row: component twice and value.
    """
    return "xyzrrr"[int(row[0]) - 1]


def _instance(deck: _AbaqusDeck, options: Options) -> Scope:
    """A copy of the part of an instance, or nothing yet where the instance has its own mesh."""
    name, wanted = options["NAME"], options.get("PART", "")
    key = find(deck.parts, wanted)
    if key is None:
        if wanted:
            known = ", ".join(deck.parts) or "none"
            raise SceneError(f"part {wanted!r} is not defined before; there are: {known}")
        return Scope(name)
    part = deck.parts[key]
    # Sets may be added to within the instance.
    nsets, elsets = ({n: [*m] for n, m in sets.items()} for sets in (part.nsets, part.elsets))
    return Scope(
        name, dict(part.nodes), dict(part.solids), dict(part.skins), Counter(part.others), nsets,
        elsets, dict(part.surfaces),
    )  # fmt: skip


def _close(deck: _AbaqusDeck) -> None:
    """Surfaces of what was read, whose sets are all there now."""
    scope = deck.scope
    for name, rows in deck.surfaces.items():
        scope.surfaces[name] = scope.facets(name, rows)
    deck.surfaces = {}


def _elements(scope: Scope, options: Options, rows: Rows) -> bool:
    """Solids, and shells that may mark faces; others are counted and are no part of the mesh."""
    name = options.get("TYPE", "").upper()
    kind = _KINDS.get(name.rstrip("HIMRTSEF"))
    skin = _SKINS.get(name) or _SKINS.get(name.rstrip("RSW5"))
    count = _NODES[kind] if kind else skin
    if count is None:
        # Sets may name this one.
        scope.add(scope.elsets, options.get("ELSET", ""), [])
        # gmsh writes the curves of its geometry as trusses.
        curve = name.startswith("T3D") and options.get("ELSET", "").startswith("Line")
        if not curve:
            scope.others[name] += len(rows)
        return curve
    words = [int(word) for row in rows for word in row if word]
    if len(words) % (count + 1):
        raise SceneError(f"a row has not {count} nodes; is the file whole?")
    table = np.array(words, dtype=np.int64).reshape(-1, count + 1)
    for number, *nodes in table.tolist():
        if kind == "hexahedron27":
            nodes = [nodes[i] for i in _VTK27]
        if kind:
            scope.solids[number] = (kind, nodes)
        else:
            scope.skins[number] = name, nodes
    if "ELSET" in options:
        scope.add(scope.elsets, options["ELSET"], [int(n) for n in table[:, 0]])
    return True


def _set(scope: Scope, keyword: str, options: Options, rows: Rows) -> None:
    """A set of nodes or elements: listed, generated, or made of other sets."""
    sets = scope.nsets if keyword == "NSET" else scope.elsets
    if keyword not in options:
        raise SceneError(f"a *{keyword} has no name; write *{keyword}, {keyword}=NAME")
    found: list[int] = []
    instance = options.get("INSTANCE", "")
    for row in rows:
        if "GENERATE" in options:
            first, last, *step = (int(word) for word in row)
            by = scope.offset(instance)
            numbers = range(first + by, last + by + 1, step[0] if step else 1)
            if len(numbers) > MOST_NUMBERS:
                raise SceneError(f"{', '.join(row)}: more than {MOST_NUMBERS} numbers")
            found += numbers
        else:
            found += scope.members(sets, row, instance)
    if keyword == "NSET" and "ELSET" in options:
        for number in scope.named(scope.elsets, options["ELSET"], instance):
            if number in scope.solids:
                found += scope.solids[number][1]
    scope.add(sets, options[keyword], found)


def _mesh(scope: Scope) -> FileMesh:
    """The assembly with nodes and cells numbered from 0."""
    shells = {frozenset(scope.corners(n)): len(own) for n, (_, own) in scope.skins.items()}
    args = scope.nodes, scope.solids, scope.elsets, scope.nsets, shells.values()
    mesh, _, node, _ = numbered(*args)
    for name, numbers in scope.elsets.items():
        skins = [[node[i] for i in scope.corners(n)] for n in numbers if n in scope.skins]
        if skins:
            mesh.facet_groups[name] = same_length(skins)
            mesh.shell_sets[name] = True
    for name, facets in scope.surfaces.items():
        if facets:
            if shells.keys() >= {*map(frozenset, facets)}:
                mesh.shell_sets[name] = False
            mesh.facet_groups[name] = same_length([node[i] for i in facet] for facet in facets)
    mesh.elements = scope.others
    for kind in dict.fromkeys(kind for kind, _ in scope.skins.values()):
        if not kind.startswith(_MARKS):
            own = [nodes for one, nodes in scope.skins.values() if one == kind]
            mesh.shells[kind] = np.array([[node[i] for i in nodes] for nodes in own])
    return mesh

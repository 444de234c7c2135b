"""Meshes of Abaqus and CalculiX: nodes, solid elements, sets and surfaces of an .inp file."""

import re
from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field, fields, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import reading
from brake_fenicsx.meshing import filemesh

from . import abaqus_steps, keywords, node_axes
from .abaqus_scope import KINDS, Rows, Scope, find, placement

# Types of solid elements, which end with their number of nodes and letters of the integration.
_SOLID = re.compile(r"(?:C3D|SC)(\d+)[HIMRTSEF]*")
# Shells and membranes mark faces, or become solids; gmsh writes faces as elements of plane stress.
_SKIN = re.compile(r"(?:S|M3D|CPS|SFM3D|STRI)([3468])[RSW5]*")
# Elements without stiffness or mass in a deck of solids: they mark faces and edges at most.
_MARKS = ("CPS", "SFM")
_DATA = ("NODE", "ELEMENT", "NSET", "ELSET", "SURFACE")
# A keyword or numbers, which do not go on with the keyword of the line before.
_DATA_LINE = re.compile(r"\*|\s*[-+.,\d]")
# Files that a deck may include, and numbers that a range of a set may have.
MOST_FILES, MOST_NUMBERS = 1000, 10**7
# Blocks with an end of their own.
_CLOSED = ("PART", "INSTANCE", "ASSEMBLY")


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
    blocks: list[filemesh.DeckKeyword] = field(default_factory=list)
    lost: list[tuple[filemesh.DeckKeyword, str]] = field(default_factory=list)
    instances: dict[str, str] = field(default_factory=dict)

    @property
    def scope(self) -> Scope:
        """Where nodes, elements and sets go now."""
        return self.whole if self.open is None else self.open

    def close(self) -> None:
        """Make the surfaces of what was read, whose sets are all there now."""
        for name, rows in self.surfaces.items():
            self.scope.surfaces[name] = self.scope.facets(name, rows)
        self.surfaces = {}


def read_abaqus(path: Path) -> filemesh.FileMesh:
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
        elif within and block.keyword.removeprefix("END ") in _CLOSED:
            within.pop()
        try:
            _take(deck, block)
        except (SceneError, ValueError, IndexError) as error:
            raise SceneError(f"{block.said}: {error}") from None
    if within:
        raise SceneError(f"the file ends within {within[-1]}; is it whole?")
    deck.close()
    if not deck.whole.offsets:
        for part in deck.parts.values():
            deck.whole.take(part, np.eye(3), np.zeros(3))
            deck.instances[part.name] = part.name
    deck.whole.share()
    found = abaqus_steps.in_force(deck.blocks)
    blocks, turned = node_axes.along_global(deck.whole, found.blocks)
    lost = [*deck.lost, *found.lost, *turned, *_unnamed(deck.whole, blocks)]
    return replace(
        _mesh(deck.whole), blocks=blocks, instances=deck.instances, lost=lost, step=found.step,
        band=found.band, apart=[*found.removed.values()],
    )  # fmt: skip


def _lines(path: Path, chain: tuple[Path, ...] = (), opened: Any = None) -> Iterator[list[str]]:
    """Lines of a deck with their places, those of included files in their place.

    Args:
        path: the file.
        chain: files that include it, one in the other.
        opened: number of each file that was opened.

    Yields:
        Place and line, a keyword with all of its lines; "" as the line where a file ends amid one.
    """
    opened = count() if opened is None else opened
    if path.resolve() in chain or next(opened) > MOST_FILES:
        raise SceneError(f"{path}: includes itself, or more than {MOST_FILES} files")
    with reading(path, "as text"):
        text = path.read_text("utf-8", "replace")
    for number, line in _whole_keywords(text):
        if line[0] == "*" and (block := _block(line, "")).keyword == "INCLUDE":
            named = path.parent / block.options.get("INPUT", "")
            yield from _lines(named, (*chain, path.resolve()), opened)
        else:
            yield [f"{path.name}:{number}", line]
    if not text.endswith(("\n", "\r")):
        yield ["", ""]


def _whole_keywords(text: str) -> list[tuple[int, str]]:
    """Lines that say something, with their numbers, and each keyword in one.

    After a comma it goes on in the next line in Abaqus, not in CalculiX 2.20.
    What begins as a number is data in both.
    """
    lines = list[tuple[int, str]]()
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("**") or not line.strip():
            continue
        first, word = lines[-1] if lines else (0, "")
        if word[:1] == "*" and word.endswith(",") and not _DATA_LINE.match(line):
            lines[-1] = first, word + line.strip()
        else:
            lines.append((number, line.rstrip()))
    return lines


def _block(line: str, at: str) -> filemesh.DeckKeyword:
    """A keyword and its options."""
    first, *words = line[1:].rstrip(" ,").split(",")
    pairs = (word.partition("=") for word in words)
    options = {"".join(n.split()).upper(): value.strip().strip('"') for n, _, value in pairs}
    return filemesh.DeckKeyword(keywords.keyword_of(first), options, [], line.strip(), at)


def _blocks(path: Path) -> Iterator[filemesh.DeckKeyword]:
    """Every keyword with its data lines."""
    block: filemesh.DeckKeyword | None = None
    for at, line in _lines(path):
        if line[:1] == "*":
            if block:
                yield block
            block = _block(line, at)
        elif line and block:
            block.rows.append([word.strip() for word in line.strip().rstrip(",").split(",")])
        elif block and block.keyword in _DATA:
            raise SceneError(f"""the file ends within {block.said}, amid a line; is it whole? If so,
                end its last line""")
    if block:
        yield block


def _take(deck: _AbaqusDeck, block: filemesh.DeckKeyword) -> None:
    """Add one block to the deck."""
    if block.keyword in keywords.TABLES["makers"]:
        raise SceneError("nodes and elements must be written one by one in Cartesian axes")
    take = _TAKEN.get(block.keyword)
    if take is None:
        if not block.keyword.startswith("END "):
            deck.blocks.append(replace(block, scope=deck.scope.name))
        return
    if unknown := sorted(block.options.keys() - {*keywords.TABLES["mesh"].get(block.keyword, ())}):
        said = f"its option {unknown[0]} is not understood"
        if block.keyword not in ("NODE", "NSET", "ELSET") or "INPUT" in unknown:
            raise SceneError(f"{said}; write it without")
        deck.lost.append((block, said))
    take(deck, block)


def _part(deck: _AbaqusDeck, block: filemesh.DeckKeyword) -> None:
    deck.close()
    if block.keyword == "PART":
        deck.open = deck.parts[block.options["NAME"]] = Scope(block.options["NAME"])


def _instance(deck: _AbaqusDeck, block: filemesh.DeckKeyword) -> None:
    """A copy of the part of an instance, or nothing yet where the instance has its own mesh."""
    deck.close()
    name, wanted = block.options["NAME"], block.options.get("PART", "")
    deck.open, deck.place, deck.instances[name] = Scope(name), block.rows, wanted or name
    key = find(deck.parts, wanted)
    if key is not None:
        part = deck.parts[key]
        own = {f.name: copy(getattr(part, f.name)) for f in fields(part)} | {"name": name}
        for sets in ("nsets", "elsets"):  # which may be added to within the instance
            own[sets] = {n: [*numbers] for n, numbers in own[sets].items()}
        deck.open = Scope(**own)
    elif wanted:
        known = ", ".join(deck.parts) or "none"
        raise SceneError(f"part {wanted!r} is not defined before; there are: {known}")


def _end(deck: _AbaqusDeck, block: filemesh.DeckKeyword) -> None:
    deck.close()
    if block.keyword == "END INSTANCE" and deck.open is not None:
        deck.whole.take(deck.open, *placement(deck.place))
    deck.open = None


def _nodes(deck: _AbaqusDeck, block: filemesh.DeckKeyword) -> None:
    scope, options = deck.scope, block.options
    if options.get("SYSTEM", "R").upper() != "R":
        raise SceneError("nodes and elements must be written one by one in Cartesian axes")
    for row in block.rows:
        if len(row) < 3:
            raise SceneError(f"node {row[0]} has not 3 coordinates; is the file whole?")
        scope.nodes[int(row[0])] = [float(v or 0.0) for v in [*row, ""][1:4]]
    if "NSET" in options:
        scope.add(scope.nsets, options["NSET"], [int(row[0]) for row in block.rows])


def _surface(deck: _AbaqusDeck, block: filemesh.DeckKeyword) -> None:
    scope, options = deck.scope, block.options
    name, kind = options.get("NAME"), options.get("TYPE", "ELEMENT").upper()
    if name is None:
        deck.blocks.append(replace(block, scope=scope.name))
    elif kind == "NODE":
        numbers = [n for row in block.rows for n in scope.members(scope.nsets, row[:1], "")]
        scope.add(scope.nsets, name, numbers)
    elif "COMBINE" in options:
        raise SceneError("combined surfaces are not read; write their faces")
    elif kind != "ELEMENT":
        raise SceneError(f"surfaces of type {options['TYPE']} are not read; write faces")
    else:
        deck.surfaces[name] = block.rows


def _unnamed(
    whole: Scope, blocks: Sequence[filemesh.DeckKeyword]
) -> list[tuple[filemesh.DeckKeyword, str]]:
    """Sets of nodes and faces that supports and pressures name by their numbers alone.

    Returns:
        Rows that name nothing, and why.
    """
    held, lost = list[tuple[int, str]](), list[tuple[filemesh.DeckKeyword, str]]()
    # Reference nodes are on no face of their own.
    references = {block.options.get("REFNODE") for block in blocks}
    for block in (b for b in blocks if not b.scope and b.keyword in ("BOUNDARY", "DLOAD")):
        for word, *row in block.rows:
            try:
                if block.keyword == "DLOAD":
                    name = f"*DLOAD {float(row[1]):g}"
                    facets = whole.facets(name, [[word, row[0].upper().replace("P", "S")]])
                    whole.surfaces.setdefault(name, []).extend(facets)
                elif word.rpartition(".")[2].isdigit() and word not in references:
                    along = held_along(row)
                    held += [(n, along) for n in whole.members(whole.nsets, [word], "")]
            except SceneError as error:
                lost.append((block, f"{', '.join((word, *row))}: {error}"))
    whole.nsets |= filemesh.held_nodes("*BOUNDARY", held)
    return lost


def held_along(row: Sequence[str]) -> str:
    """Direction that a row of *BOUNDARY holds in the modes, also where it moves: x, y, z or r.

    Args:
        row: component twice and value.
    """
    return "xyzrrr"[int(row[0]) - 1]


def _elements(deck: _AbaqusDeck, block: filemesh.DeckKeyword) -> None:
    """Solids, and shells that may mark faces; others are counted and are no part of the mesh."""
    scope, options = deck.scope, block.options
    name = options.get("TYPE", "").upper()
    solid, skin = _SOLID.fullmatch(name), _SKIN.fullmatch(name)
    kind = KINDS.get(int(solid[1])) if solid else None
    if kind is None and skin is None:
        # Sets may name this one.
        scope.add(scope.elsets, options.get("ELSET", ""), [])
        # gmsh writes the curves of its geometry as trusses.
        if not (name.startswith("T3D") and options.get("ELSET", "").startswith("Line")):
            scope.others[name] += len(block.rows)
            deck.blocks.append(replace(block, scope=scope.name))
        return
    nodes = int((solid or skin)[1])  # type: ignore[index]
    rows = list[list[int]]()
    for row in block.rows:
        own = [int(word) for word in row if word]
        if rows and len(rows[-1]) <= nodes:
            rows[-1] += own
        else:  # numbers after the nodes mean nothing
            rows.append(own[: nodes + 1])
    if any(len(row) != nodes + 1 for row in rows):
        raise SceneError(f"a row has not {nodes} nodes; is the file whole?")
    table = np.array(rows, dtype=np.int64).reshape(-1, nodes + 1)
    cells = scope.solids if kind else scope.skins
    cells |= {number: (kind or name, own) for number, *own in table.tolist()}
    if "ELSET" in options:
        scope.add(scope.elsets, options["ELSET"], [*map(int, table[:, 0])])


def _set(deck: _AbaqusDeck, block: filemesh.DeckKeyword) -> None:
    """A set of nodes or elements: listed, generated, or made of other sets."""
    scope, keyword, options = deck.scope, block.keyword, block.options
    sets = scope.nsets if keyword == "NSET" else scope.elsets
    if keyword not in options:
        raise SceneError(f"a *{keyword} has no name; write *{keyword}, {keyword}=NAME")
    found: list[int] = []
    instance = options.get("INSTANCE", "")
    for row in block.rows:
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


_TAKEN: dict[str, Callable[[_AbaqusDeck, filemesh.DeckKeyword], None]] = {
    "PART": _part, "ASSEMBLY": _part, "INSTANCE": _instance, "END PART": _end, "END INSTANCE": _end,
    "END ASSEMBLY": _end, "NODE": _nodes, "ELEMENT": _elements, "NSET": _set, "ELSET": _set,
    "SURFACE": _surface,
}  # fmt: skip


def _mesh(scope: Scope) -> filemesh.FileMesh:
    """The assembly with nodes and cells numbered from 0."""
    mesh = filemesh.numbered(scope.nodes, scope.solids, scope.skins, scope.elsets, scope.nsets)
    shells = {frozenset(filemesh.corners_of(own)) for _, own in scope.skins.values()}
    for name, facets in scope.surfaces.items():
        if facets:
            if shells >= {*map(frozenset, facets)}:
                mesh.shell_sets[name] = False
            mesh.facet_groups[name] = filemesh.same_length(mesh.placed(facets))
    mesh.elements = scope.others
    mesh.shells = {k: own for k, own in mesh.shells.items() if not k.startswith(_MARKS)}
    return mesh

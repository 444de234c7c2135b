"""What a mesh file holds beside its mesh: what no reader takes, and what a scene should have."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.extras.decks.abaqus_keywords import KNOWN, doubts
from brake_fenicsx.extras.decks.abaqus_scope import find
from brake_fenicsx.meshing.filemesh import DeckKeyword, FileMesh, corners_of
from brake_fenicsx.meshing.rawmesh import RawMesh, Stated, Unread, cell_facets, facet_keys

from .deck import read_deck

Ints = NDArray[np.int64]
_SECTIONS = ("ties", "contact", "supports", "loads", "springs", "masses")


def beside(
    file: Path, found: FileMesh, mesh: RawMesh, faces: Mapping[str, Ints],
    used: Iterable[tuple[str, str]],
) -> Unread:  # fmt: skip
    """Keywords and elements of a mesh file beside its bodies and faces.

    Args:
        file: its path.
        found: the file.
        mesh: its cells that the scene has.
        faces: face of the scene -> corner nodes of its facets.
        used: kind and name of each group that the scene names; shells of these mark faces.
    """
    deck = read_deck(found, file.suffix, solid=True)
    sets = [name for kind, name in used if kind == "facets" and name in found.shell_sets]
    marks = [facet_keys(found.facet_groups[name]) for name in sets]
    marked = np.concatenate([np.zeros(0, dtype=np.uint64), *marks])
    elements = {
        kind: int(np.count_nonzero(~np.isin(facet_keys(corners_of(shells)), marked)))
        for kind, shells in found.shells.items()
    }
    # What an option adds to a keyword that is read has its line in the scene alone.
    unread = [block for block, why in deck.unread if not _is_aside(block, why)]
    lost = {id(block) for block in unread}
    own = [block for block in found.blocks if block.keyword == "ELEMENT" and id(block) not in lost]
    read = {block.options.get("TYPE", "").upper() for block in own}
    elements |= {kind: n for kind, n in found.elements.items() if kind not in read}
    sign = "*" * (file.suffix == ".inp")
    words = Counter(sign + block.keyword for block in unread if block.keyword != "ELEMENT")
    texts = [*_elements({kind: n for kind, n in elements.items() if n}), *_keywords(words)]
    page = "howto_abaqus_deck" if sign else "coming_from_other_codes"
    line = f"{file.name}: not read: {', '.join(texts)}; docs/{page}.md says what to write instead"
    keys = {name: facet_keys(facets) for name, facets in faces.items()}
    stated = []
    for section in _SECTIONS:
        for name, table in deck.tables[section].items():
            groups = table.get("faces", [name])
            on = tuple(frozenset(_faces_on(found, mesh, group, keys)) for group in groups)
            stated.append((file.name, Stated(section, f"[{section}] {name}", on)))
    return Unread((line,) if texts else (), tuple(stated))


def _is_aside(block: DeckKeyword, why: str) -> bool:
    """Whether no more than an option of a keyword is left out."""
    return block.keyword in KNOWN and why in doubts(block)[1]


def _faces_on(
    found: FileMesh, mesh: RawMesh, group: str, keys: Mapping[str, NDArray[np.uint64]]
) -> list[str]:
    """Faces of the scene all of whose facets are in a group."""
    if surface := find(found.facet_groups, group):
        own = facet_keys(found.facet_groups[surface])
    elif nodes := find(found.node_groups, group):
        inside = np.isin(np.arange(len(found.points)), found.node_groups[nodes])
        facets = cell_facets(mesh)
        own = facet_keys(facets[inside[facets].all(axis=2)])
    else:
        return []
    return [name for name, mine in keys.items() if mine.size and np.isin(mine, own).all()]


def _elements(numbers: Mapping[str, int]) -> list[str]:
    """Numbers of elements of each kind: "1 S3, 1 MASS and 2 SPRINGA elements"; none of none."""
    if not numbers:
        return []
    *first, last = (f"{n} {kind}" for kind, n in numbers.items())
    word = "element" if sum(numbers.values()) == 1 else "elements"
    return [f"{', '.join(first)} and {last} {word}" if first else f"{last} {word}"]


def _keywords(numbers: Mapping[str, int]) -> list[str]:
    """Keywords, with their number where there are several."""
    return [name if n == 1 else f"{n} {name}" for name, n in numbers.items()]

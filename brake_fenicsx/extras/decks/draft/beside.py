"""What a mesh file holds beside its mesh: what no reader takes, and what a scene should have."""

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from brake_fenicsx.arguments import Ints
from brake_fenicsx.extras.decks.abaqus_scope import find
from brake_fenicsx.extras.decks.keywords import KNOWN, doubts
from brake_fenicsx.meshing import filemesh, rawmesh

from .deck import read_deck
from .statements import Deck

_SECTIONS = ("ties", "contact", "supports", "loads", "springs", "masses")


def beside(
    file: Path, found: filemesh.FileMesh, faces: Mapping[str, Ints], used: Iterable[tuple[str, str]]
) -> rawmesh.Unread:
    """Keywords and elements of a mesh file beside its bodies and faces.

    Args:
        file: its path.
        found: the file.
        faces: face of the scene -> corner nodes of its facets.
        used: kind and name of each group that the scene names; shells of these mark faces.
    """
    deck, sign = read_deck(found, file.suffix, solid=True), "*" * (file.suffix == ".inp")
    sets = [name for kind, name in used if kind == "facets" and name in found.shell_sets]
    texts = _texts(found, deck, sets, sign)
    page = "howto_abaqus_deck" if sign else "coming_from_other_codes"
    line = f"{file.name}: not read: {', '.join(texts)}; docs/{page}.md says what to write instead"
    stated = []
    for section in _SECTIONS:
        for name, table in deck.tables[section].items():
            groups = table.get("faces", [name])
            on = tuple(frozenset(_faces_on(found, faces, group)) for group in groups)
            stated.append((file.name, rawmesh.Stated(section, f"[{section}] {name}", on)))
    return rawmesh.Unread((line,) if texts else (), tuple(stated))


def _texts(found: filemesh.FileMesh, deck: Deck, sets: Iterable[str], sign: str) -> list[str]:
    """Elements, but for shells of some sets, and keywords that are not read, with their numbers."""
    marks = [rawmesh.facet_keys(found.facet_groups[name]) for name in sets]
    marked = np.concatenate([np.zeros(0, dtype=np.uint64), *marks])
    elements = Counter[str]()
    for kind, shells in found.shells.items():
        keys = rawmesh.facet_keys(np.array([*map(filemesh.corners_of, shells)]))
        elements[kind] = int(np.count_nonzero(~np.isin(keys, marked)))
    # What an option adds to a keyword that is read has its line in the scene alone.
    unread = [b for b, why in deck.unread if b.keyword not in KNOWN or why not in doubts(b)[1]]
    lost = {id(block) for block in unread}
    own = [block for block in found.blocks if block.keyword == "ELEMENT" and id(block) not in lost]
    read = {block.options.get("TYPE", "").upper() for block in own}
    elements |= {kind: n for kind, n in found.elements.items() if kind not in read}
    words = Counter(sign + block.keyword for block in unread if block.keyword != "ELEMENT")
    texts = [name if n == 1 else f"{n} {name}" for name, n in words.items()]
    if counts := [f"{n} {kind}" for kind, n in elements.items() if n]:
        *first, last = counts
        said = f"{', '.join(first)} and {last}" if first else last
        texts.insert(0, f"{said} element{'s' * (elements.total() > 1)}")
    return texts


def _faces_on(found: filemesh.FileMesh, faces: Mapping[str, Ints], group: str) -> list[str]:
    """Faces of the scene all of whose facets are in a group."""
    for kind, table in (("facets", found.facet_groups), ("nodes", found.node_groups)):
        if name := find(table, group):
            every = faces.items()
            return [n for n, own in every if own.size and found.inside(kind, name, own).all()]
    return []

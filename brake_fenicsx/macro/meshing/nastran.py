"""Cards of a Nastran deck that are not read: meshio reads its nodes and elements, and no others."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

# Shells by meshio's name; they may mark faces.
SHELLS = {"triangle": "CTRIA3", "triangle6": "CTRIA6", "quad": "CQUAD4", "quad8": "CQUAD8"}
SUFFIXES = (".bdf", ".nas", ".fem")
_READ = {
    "GRID", "CTETRA", "CHEXA", "CPENTA", "CPYRA", "CPYRAM", "CTRIAR", "CQUADR", "ENDDATA",
    *SHELLS.values(),
}  # fmt: skip
# Elements beside solids and shells.
_ELEMENTS = ("CONM", "CMASS", "CELAS", "CDAMP", "CVISC", "CBUSH", "CBAR", "CBEAM", "CROD", "CONROD",
             "CTUBE", "CGAP", "CSHEAR", "CFAST", "CWELD", "CHBDY", "PLOTEL", "GENEL")  # fmt: skip


def unread_cards(path: Path) -> tuple[Counter[str], Counter[str]]:
    """Cards of the bulk data that are no nodes, solids or shells.

    Args:
        path: the deck.

    Returns:
        Number of elements of each kind, and of other cards.
    """
    lines = path.read_text(errors="replace").splitlines()
    begins = (i for i, line in enumerate(lines, 1) if line.upper().split()[:2] == ["BEGIN", "BULK"])
    elements: Counter[str] = Counter()
    cards: Counter[str] = Counter()
    for line in lines[next(begins, 0) :]:
        word = line.split("$")[0][:8].split(",")[0].rstrip("* ").upper()
        # A blank, + or * begins the continuation of a card.
        if word[:1].isalpha() and word not in _READ:
            (elements if word.startswith(_ELEMENTS) else cards)[word] += 1
    return elements, cards

"""What is understood of the keywords of decks, from ``keywords.toml`` beside this module.

What is not in this table is named with its line and left out; nothing is read by half.
"""

import re
import tomllib
from collections.abc import Mapping
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

from brake_fenicsx.meshing.filemesh import DeckKeyword

TABLES: dict[str, Any] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))


class Known(NamedTuple):
    """What is understood of a keyword of Abaqus or CalculiX.

    Attributes:
        options: "NAME", or "NAME=PATTERN" of its values.
        aside: option that is named, but without which the rest holds -> what to do.
        words: fewest and most words of a data line.
        lines: fewest and most data lines.
        opens: whether the next keywords belong to it, so that it is never left out.
    """

    options: str = ""
    aside: Mapping[str, str] = {}
    words: tuple[int, int] = (0, 0)
    lines: tuple[int, float] = (0, inf)
    opens: bool = False

    @property
    def patterns(self) -> dict[str, str]:
        """Pattern of the values of each option."""
        given = (word.partition("=") for word in self.options.split())
        return {option: pattern if sign else ".*" for option, sign, pattern in given}


KNOWN = {name: Known(**row) for name, row in TABLES["abaqus"].items()}
KNOWN["SHELL GENERAL SECTION"] = KNOWN["SHELL SECTION"]
HARMLESS = {program: frozenset(words) for program, words in TABLES["silent"].items()}
_ENDS = ("END STEP", "END PART", "END INSTANCE", "END ASSEMBLY")
_PLAIN = {name.replace(" ", ""): name for name in (*KNOWN, *HARMLESS["abaqus"], *_ENDS)}


def keyword_of(text: str) -> str:
    """A keyword in capitals; without its blanks it is the same one."""
    word = " ".join(text.split()).upper()
    return _PLAIN.get(word.replace(" ", ""), word)


def doubts(block: DeckKeyword) -> tuple[str | None, list[str]]:
    """What of a block is not understood.

    Args:
        block: of a keyword of ``KNOWN``.

    Returns:
        Why the whole block is left out, or None; and what else of it is left out.
    """
    known, aside, lost = KNOWN[block.keyword], list[str](), list[str]()
    for name, value in block.options.items():
        pattern = known.patterns.get(name)
        if pattern is not None and re.fullmatch(pattern, "".join(value.split()).upper()):
            continue
        said = f"{name} = {value}" if value else name
        if name in known.aside:
            aside.append(f"{said}: {known.aside[name]}")
        else:
            lost.append(f"{said} is not understood")
    (fewest, most), (low, high) = known.words, known.lines
    wrong = [row for row in block.rows if not fewest <= len(row) <= most]
    if wrong:
        lost.append(f"its line {', '.join(wrong[0])!r} is not understood")
    elif not low <= len(block.rows) <= high:
        lost.append(f"{len(block.rows)} data lines are not understood")
    return (None, aside + lost) if known.opens else (next(iter(lost), None), aside)

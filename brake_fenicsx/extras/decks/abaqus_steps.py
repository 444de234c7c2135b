"""The steps of a deck of Abaqus or CalculiX in their order: what is in force at its modes.

A step changes what those before it left: ``OP=NEW`` removes all of a keyword first, otherwise what
names the same nodes and component takes the place of the former. The first step of complex modes
ends the walk, else the first one of real modes, else the last step.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from brake_fenicsx.errors import SceneError
from brake_fenicsx.meshing.filemesh import DeckKeyword

from .keywords import TABLES, doubts

_LOADS = ("CLOAD", "DLOAD", "DSLOAD")
_MODES = ("FREQUENCY", "COMPLEX FREQUENCY")
_OF_STEPS = (*_MODES, "STATIC", "AMPLITUDE", "MODEL CHANGE")
Row = list[str]
Key = tuple[str, ...]


def in_force(blocks: Sequence[DeckKeyword]) -> History:
    """Walk the steps of a deck.

    Args:
        blocks: its keywords that are no part of the mesh, in their order.

    Returns:
        What is in force at the modes, or at the end of a deck without modes.
    """
    model, *steps = _steps(blocks)
    modes = [next((b for b in step if b.keyword in _MODES), None) for step in steps]
    wanted = [i for i, b in enumerate(modes) if b and b.keyword == "COMPLEX FREQUENCY"]
    wanted += [i for i, b in enumerate(modes) if b] or [len(steps) - 1]
    found = History()
    for block in model:
        found.take(block)
    for step, kind in zip(steps[: wanted[0] + 1], modes, strict=False):
        found.begin(step[0], kind is not None)
        for block in step[1:]:
            found.take(block)
    found.lost += [(s[0], "it comes after the scene's step") for s in steps[wanted[0] + 1 :]]
    if steps:
        at = modes[wanted[0]] or steps[-1][0]
        found.step = f"step {wanted[0] + 1} of {len(steps)} ({at.said}, {at.at})"
    found.blocks += found.state()
    return found


def _steps(blocks: Iterable[DeckKeyword]) -> list[list[DeckKeyword]]:
    """What stands before the first step, and in each of them."""
    parts: list[list[DeckKeyword]] = [[]]
    for block in blocks:
        if block.keyword == "STEP":
            parts.append([])
        parts[-1].append(block)
    return parts


@dataclass(slots=True)
class History:
    """What the steps leave.

    Attributes:
        blocks: what is in force, supports and loads with a row for each component.
        lost: keyword that is not taken over, and why.
        step: the step that the state is of, in words; "" of a deck without steps.
        band: lowest and highest frequency that its modes are asked for.
        removed: names of two surfaces -> the pair that a step takes out of contact.
        own: keyword -> what it names -> where it stands, and its row.
        amplitudes: name -> keyword, and why it is not understood.
        period: time of the step.
        before: time of the steps before it.
        equilibrium: whether a step before it was one.
        started: whether a step has begun.
        modes: whether the step has modes.
        left: whether the step is left out.
        seen: keywords of the step, and what it names.
    """

    blocks: list[DeckKeyword] = field(default_factory=list)
    lost: list[tuple[DeckKeyword, str]] = field(default_factory=list)
    step: str = ""
    band: tuple[float, float] | None = None
    removed: dict[frozenset[str], Row] = field(default_factory=dict)
    own: dict[str, dict[Key, tuple[DeckKeyword, Row]]] = field(
        default_factory=lambda: {name: {} for name in ("BOUNDARY", *_LOADS)}
    )
    amplitudes: dict[str, tuple[DeckKeyword, str | None]] = field(default_factory=dict)
    period: float = 1.0
    before: float = 0.0
    equilibrium: bool = False
    started: bool = False
    modes: bool = False
    left: bool = False
    seen: set[Key] = field(default_factory=set)

    def begin(self, step: DeckKeyword, modes: bool) -> None:
        """Begin a step."""
        if self.started:
            self.before += self.period
            self.equilibrium |= not (self.modes or self.left)
        self.started, self.modes, self.period, self.seen = True, modes, 1.0, set()
        self.left = not modes and "PERTURBATION" in step.options
        if self.left:
            self.lost.append((step, "it is about the state before it, and left out"))
        else:
            self.lost += [(step, said) for said in doubts(step)[1]]

    def take(self, block: DeckKeyword) -> None:
        """Apply a block."""
        word = block.keyword
        if self.left:
            return
        if word not in (*_OF_STEPS, *self.own):
            self.blocks.append(block)
            return
        why, aside = doubts(block)
        if word == "AMPLITUDE":  # what uses it says so
            self.amplitudes[block.options.get("NAME", "").upper()], why = (block, why), None
        self.lost += [(block, said) for said in aside]
        if word in _LOADS and self.modes:
            why = "it stands in the step of the modes, and is no load of the equilibrium"
        elif word in self.own and block.options.get("OP", "").upper() == "NEW":
            if (word,) not in self.seen:
                self.own[word].clear()
            self.seen.add((word,))
            other = {"DLOAD": "DSLOAD", "DSLOAD": "DLOAD"}.get(word, word)
            if other != word and self.own[other]:
                self.lost.append((block, f"CalculiX removes *{other} too, which stays here"))
        if why is not None:
            self.lost.append((block, why))
        elif word in self.own:
            self._rows(block)
        elif word == "MODEL CHANGE":
            for row in block.rows:
                pair = frozenset(map(str.upper, row))
                self.removed.pop(pair, None)
                if "REMOVE" in block.options:
                    self.removed[pair] = row
        else:
            _, low, high, *_ = [*(block.rows or [[]])[0], "", "", ""]
            if word == "STATIC":
                self.period = float(low or 1.0)
            elif high and word != "AMPLITUDE":
                self.band = float(low or 0.0), float(high)

    def _rows(self, block: DeckKeyword) -> None:
        """Supports or loads of one block."""
        word = block.keyword
        own, before = self.own[word], {*self.own[word]}
        for row in block.rows:
            try:
                for key, value in self._entries(block, row):
                    old = own.pop(key, None)
                    if (word, *key) in self.seen and (
                        word in _LOADS or old is None or old[1] != value
                    ):
                        raise SceneError("it stands twice in one step, and is left out")
                    self.seen.add((word, *key))
                    own[key] = block, value
            except (ValueError, IndexError) as error:
                why = error if isinstance(error, SceneError) else "not understood"
                self.lost.append((block, f"{', '.join(row)}: {why}"))
        if self.modes and self.equilibrium and before != {*own}:
            why = "it changes supports for the modes; the scene has them in the equilibrium too"
            self.lost.append((block, why))

    def _entries(self, block: DeckKeyword, row: Row) -> Iterator[tuple[Key, Row]]:
        """What a row names, and the row of each component."""
        name, kind, *rest = row
        if block.keyword == "BOUNDARY":
            held = TABLES["held"].get(kind.upper())
            if held is None:
                last = rest[0] if rest and rest[0] else kind
                held = range(int(kind), int(last) + 1)
            value = self._value(block, rest[1] if len(rest) > 1 else "")
            if not held or not 1 <= held[0] <= held[-1] <= 6:
                raise SceneError("these are no displacements")
            for c in map(str, held):
                yield (name.upper(), c), [name, c, c, value]
            return
        force = block.keyword == "CLOAD"
        if not re.fullmatch("[1-6]" if force else r"P\d?", kind.upper()) or len(rest) != 1:
            raise SceneError("no force along an axis" if force else "no pressure on a face")
        yield (name.upper(), kind.upper()), [name, kind, self._value(block, rest[0])]

    def _value(self, block: DeckKeyword, word: str) -> str:
        """A number times the amplitude of its block at the end of the step."""
        value, name = float(word or 0), block.options.get("AMPLITUDE")
        if not value or name is None:
            return repr(value)
        given, why = self.amplitudes.get(name.upper(), (None, "is not there"))
        if given is None or why is not None:
            raise SceneError(f"its amplitude {name}: {why}")
        flat = [float(word) for row in given.rows for word in row if word]
        total = "".join(given.options.get("TIME", "").split()).upper() == "TOTALTIME"
        time = self.period + (self.before if total else 0.0)
        return repr(value * float(np.interp(time, flat[::2], flat[1::2])))

    def state(self) -> list[DeckKeyword]:
        """Supports and loads that are left, in the blocks that they stand in."""
        blocks: dict[str, DeckKeyword] = {}
        for block, row in (pair for own in self.own.values() for pair in own.values()):
            blocks.setdefault(block.at, replace(block, rows=[], options={})).rows.append(row)
        return [*blocks.values()]

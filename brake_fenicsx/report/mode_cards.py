"""Pictures of mode shapes on the page, each with the numbers of its family."""

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.extensions import load, shown
from brake_fenicsx.results.answer import share_text
from brake_fenicsx.results.run import RunData, read_tables
from brake_fenicsx.results.squeal import Family
from brake_fenicsx.results.tables import Row, Value

SHAPES = "mode_shapes.npz"  # what the pictures of modes show
CLEAR = 0.5  # share of a harmonic above which a mode is named by it alone
LEAST = 0.1  # shares of the kinetic energy that are named


@dataclass(frozen=True, slots=True)
class ModeShape(Row):
    """A row of mode_shapes.csv: what the picture of a mode shows."""

    approach: str
    family: int
    sample: int
    mode: int
    frequency_hz: float
    damping: float
    picture: str
    rotor: str | None
    nodal_diameters: int | None
    direction: str | None
    nodal_share: float | None


@dataclass(frozen=True, slots=True)
class Card:
    """A mode shape with a few facts.

    Attributes:
        frequency: heading of the card.
        facts: names and values.
        key: name of its picture; empty without one.
        still: the picture; None without one.
        moving: the animated picture; None without one.
        rank: "1" of the most severe family; empty outside the first screen.
    """

    frequency: str
    facts: list[tuple[str, str]]
    key: str = ""
    still: Path | None = None
    moving: Path | None = None
    rank: str = ""


class ModePictures:
    """Pictures of mode shapes in a results folder.

    Attributes:
        paths: still picture of each key; an animated WebP where the run has drawn it, or a PNG.
        by_mode: key of the picture of (approach, sample, mode).
    """

    def __init__(self, run: RunData):
        folder = run.directory / "figures"
        self.paths = {p.stem: p for p in sorted(folder.glob("mode_*.png"))}
        self.paths |= {p.stem: p for p in sorted(folder.glob("mode_*.webp"))}
        table = read_tables(run.directory / SHAPES).get("shapes", {})
        every = (dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True))
        self._facts = {str(row["picture"]): row for row in every if row["picture"] in self.paths}
        self._family: dict[tuple[str, int], str] = {}
        self.by_mode: dict[tuple[str, int, int], str] = {}
        for approach in run.approaches:
            for m in run.squeal.representatives(approach):
                key = f"mode_{approach}_{m.name}"
                if key in self.paths:
                    self._family[approach, m.family.key] = key
                    self.by_mode[approach, m.sample, m.mode] = key

    def of_family(self, family: Family) -> str:
        """Key of the picture of a family; empty if none was drawn."""
        return self._family.get((family.approach, family.key), "")

    def pattern(self, key: str) -> tuple[str, str, str] | None:
        """Nodal diameters of the rotor in a picture; None if they are not known.

        Args:
            key: of the picture.

        Returns:
            Name of the rotor, a short text and a long one.
        """
        row = self._facts.get(key)
        if row is None or not np.isfinite(row["nodal_diameters"]):
            return None
        number, share = int(row["nodal_diameters"]), float(row["nodal_share"])
        said = f"{number or 'no'} nodal diameter{'' if number == 1 else 's'}, {row['direction']}"
        percent = f"({100 * share:.0f} % of the rim's motion)"
        if share < CLEAR:
            return str(row["rotor"]), "mixed", f"mixed; strongest: {said} {percent}"
        return str(row["rotor"]), f"{number}, {row['direction']}", f"{said} {percent}"

    def moving(self, key: str) -> Path | None:
        """The animated picture of a key, where there is one."""
        path = self.paths.get(key)
        return path if path is not None and path.suffix == ".webp" else None


def family_card(run: RunData, family: Family, pictures: ModePictures, rank: int = 0) -> Card:
    """Picture and numbers of a family.

    Args:
        run: the results.
        family: the family.
        pictures: of the run.
        rank: its place in the order of severity, 0 if it is not shown.
    """
    key = pictures.of_family(family)
    facts = [("approach", run.label(family.approach)), ("damping", _damping_text(family))]
    if family.share.n > 1:
        facts.append(("samples", often_text(family)))
    if parts := _parts(run, family):
        facts.append(("moving parts", ", ".join(parts)))
    more = {fact: text for extra in shown(run) for fact, text in extra.cards.items()}
    told = {fact: load(text)(run, family.approach, family.key) for fact, text in more.items()}
    facts += [(fact, text) for fact, text in told.items() if text]
    if (pattern := pictures.pattern(key)) is not None:
        facts.append((pattern[0], pattern[2]))
    still, moving, place = pictures.paths.get(key), pictures.moving(key), str(rank or "")
    return Card(f"{family.kilohertz} kHz", facts, key, still, moving, place)


def other_cards(pictures: ModePictures, shown: set[str]) -> list[Card]:
    """Cards of the pictures that belong to no card so far."""
    left = {key: path for key, path in pictures.paths.items() if path and key not in shown}
    return [Card(heading_of(p), [], key, p, pictures.moving(key)) for key, p in left.items()]


def _parts(run: RunData, family: Family) -> list[str]:
    """Parts that carry the kinetic energy of a family's squeal modes, the largest share first.

    Mean shares of at least 10 % are named, such as "disc 84 %".
    """
    modes = run.squeal.squeal_modes(family.approach, family.key)
    shares = {n.removeprefix("share_"): modes[n].mean() for n in modes if n.startswith("share_")}
    layers = [layer.partition(".")[0] for layer in shares]
    parts = [
        (share, part if layers.count(part) == 1 else layer.replace(".", " "))
        for part, (layer, share) in zip(layers, shares.items(), strict=True)
        if share >= LEAST
    ]
    parts.sort(key=lambda pair: -pair[0])
    return [f"{part} {100 * share:.0f} %" for share, part in parts]


def mode_text(run: RunData, family: Family, pictures: ModePictures) -> str:
    """The part that moves most and its nodal diameters, as words that follow a frequency."""
    parts, pattern = _parts(run, family), pictures.pattern(pictures.of_family(family))
    words = [part.removesuffix(" %").rpartition(" ")[0] for part in parts[:1]]
    if pattern is not None and "mixed" not in pattern[1]:
        words.append(pattern[2].partition(",")[0])
    return "".join(f", {word}" for word in words)


def family_table_cells(run: RunData, family: Family, pictures: ModePictures) -> list[Value]:
    """Moving parts and nodal diameters of a family, as cells of a table."""
    pattern = pictures.pattern(pictures.of_family(family))
    return [", ".join(_parts(run, family)) or None, None if pattern is None else pattern[1]]


def often_text(family: Family) -> str:
    """In how many samples a family squeals, with the interval of the share."""
    share = family.share
    often = f"{share.hits} of {share.n}"
    return f"{often}: {share_text(*share.cells)}" if share.n > 1 else often


def _damping_text(family: Family) -> str:
    if family.share.n == 1 or family.median == family.worst:
        return f"{family.median:.2g}"
    return f"median {family.median:.2g}, lowest {family.worst:.2g}"


def heading_of(path: Path) -> str:
    """The heading drawn in a picture, or the name of its file."""
    pillow: Any = import_module("PIL.Image")  # comes with matplotlib
    with pillow.open(path) as drawn:
        return str(drawn.info.get("Title", path.stem.replace("_", " ")))

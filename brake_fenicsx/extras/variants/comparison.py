"""Two runs compared: families matched by shape, change of probability, frequency and damping.

The interval of a change is that of paired shares where both runs have samples of the same random
numbers, and of independent ones elsewhere. Approaches of a single sample have no interval: nothing
of them is left to chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import read_npz, reading
from brake_fenicsx.report.page_blocks import Table, Text
from brake_fenicsx.results.ensemble_statistics import difference
from brake_fenicsx.results.families import same_families
from brake_fenicsx.results.run import RunData, read_run
from brake_fenicsx.results.tables import Value, text_table, write_rows
from brake_fenicsx.results.versions import differences

from .page import (
    ShareChange,
    change_of,
    frequency_text,
    interval_of,
    page_of_changes,
    picture_of,
    share_of,
)
from .surfaces import COLUMNS as SURFACE_COLUMNS
from .surfaces import of_surfaces, surface_blocks, surface_rows, surface_text

Row = dict[str, Value]
Shapes = dict[str, NDArray]
COLUMNS = (
    "approach", "family_a", "family_b", "mac", "frequency_a_hz", "frequency_b_hz", "samples_a",
    "samples_b", "probability_a", "probability_b", "change", "change_low", "change_high", "paired",
    "median_damping_a", "median_damping_b",
)  # fmt: skip
HEADS = (
    "approach", "family", "frequency in A [kHz]", "in B [kHz]", "samples that squeal in A",
    "in B", "change (95 % interval)", "median damping in A", "in B", "MAC",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Side:
    """A family in one run.

    Attributes:
        number: of the family; None for all modes together, and where the run has no such family.
        squeal: whether it squeals in each sample that ended well.
        frequency: mean over its squeal modes [Hz]; None where there are none.
        damping: median of the lowest one in each sample in which it squeals [-]; likewise.
    """

    number: int | None
    squeal: NDArray[np.bool_]
    frequency: float | None = None
    damping: float | None = None


def compare_runs(
    a: str | Path | RunData, b: str | Path | RunData, may_pair: bool = True
) -> list[Row]:
    """Rows of the comparison, with the columns COLUMNS; all modes together first.

    Args:
        a: results folder of the first run, or its results.
        b: of the second one.
        may_pair: False where samples of the same seed are known to have other laws or gaps.

    Raises:
        SceneError: a folder holds no modes, or the runs have no approach in common.
    """
    one, two = read_run(a), read_run(b)
    for run in (one, two):
        if run.modes is None or run.samples is None:
            raise SceneError(
                f"{run.directory}: contains no modes to compare; run the scene with the stage"
                " stability, or both with a surface"
            )
    common = [name for name in one.approaches if name in two.approaches]
    if not common:
        raise SceneError(
            f"{one.directory}, {two.directory}: no approach in common"
            f" ({', '.join(one.approaches)}; {', '.join(two.approaches)})"
        )
    rows = []
    for approach in common:
        paired = may_pair and _paired(one, two, approach)
        rows.append(_row(approach, _side(one, approach), _side(two, approach), None, paired))
        rows += [_row(approach, *pair, paired) for pair in _matched(one, two, approach)]
    return rows


def _paired(one: RunData, two: RunData, approach: str) -> bool:
    """Whether both runs have samples with the same random numbers."""
    seeds = []
    for table in (one.samples, two.samples):
        if table is None:
            return False
        own = (table["approach"] == approach) & (table["status"] == "ok")
        seeds.append((list(table["sample"][own]), list(table["seed"][own])))
    return seeds[0] == seeds[1] and len(seeds[0][0]) > 1


def _side(run: RunData, approach: str, family: int | None = None) -> Side:
    """A family of a run, or all modes together."""
    loud = run.squeal.squeal_modes(approach, family)
    squeal = np.isin(run.squeal.good(approach), loud["sample"])
    if not len(loud):
        return Side(family, squeal)
    lowest = loud.groupby("sample").damping.min()
    return Side(family, squeal, float(loud.frequency_hz.mean()), float(lowest.median()))


def _matched(one: RunData, two: RunData, approach: str) -> list[tuple[Side, Side, float | None]]:
    """Pairs of families that are the same mode; one that a run lacks does not squeal there."""
    first, second = (
        sorted(f.key for f in run.squeal.families(approach) if f.key >= 0) for run in (one, two)
    )
    a, b = ([_side(run, approach, n) for n in own] for run, own in ((one, first), (two, second)))
    shapes, pairs = (_shapes(one), _shapes(two)), []
    if first and second and shapes[0] is not None and shapes[1] is not None:
        X, Y = _at_common_nodes(shapes[0], first, shapes[1], second)
        f, g = (np.array([side.frequency for side in own], float) for own in (a, b))
        pairs = same_families(X, f, Y, g)
    rows: list[tuple[Side, Side, float | None]] = [(a[i], b[j], mac) for i, j, mac in pairs]
    silent = [Side(None, np.zeros(run.squeal.good(approach).size, bool)) for run in (one, two)]
    rows += [(s, silent[1], None) for i, s in enumerate(a) if i not in {p[0] for p in pairs}]
    rows += [(silent[0], s, None) for j, s in enumerate(b) if j not in {p[1] for p in pairs}]
    return sorted(rows, key=lambda row: row[0].frequency or row[1].frequency or 0.0)


def _shapes(run: RunData) -> Shapes | None:
    path = run.directory / "shapes.npz"
    if not path.is_file():
        return None
    with reading(path, "as an npz file", "`run` of the scene makes it again"):
        return read_npz(path)


def _at_common_nodes(
    one: Shapes, first: list[int], two: Shapes, second: list[int]
) -> tuple[NDArray, NDArray]:
    """Shapes of families at those nodes of the first run that the second one has too."""
    size = np.ptp(one["points"], axis=0).max()
    places = [np.column_stack([s["points"], s["body"]]) for s in (one, two)]
    distance, nearest = KDTree(places[1]).query(places[0])
    near = distance <= 0.05 * size
    X, Y = _vectors(one, first)[:, near], _vectors(two, second)[:, nearest[near]]
    return X.reshape(len(X), -1).T, Y.reshape(len(Y), -1).T


def _vectors(shapes: Shapes, numbers: list[int]) -> NDArray[np.complex128]:
    """Shapes of some families; zero where one was not kept."""
    kept = {int(n): i for i, n in enumerate(shapes["families"])}
    out = np.zeros((len(numbers), *shapes["shapes"].shape[1:]), complex)
    for row, number in enumerate(numbers):
        if number in kept:
            out[row] = shapes["shapes"][kept[number]]
    return out


def _row(approach: str, a: Side, b: Side, mac: float | None, paired: bool) -> Row:
    """One line of the comparison."""
    change, low, high = difference(a.squeal, b.squeal, paired and a.squeal.size == b.squeal.size)
    chance = min(a.squeal.size, b.squeal.size) > 1
    cells = (
        approach, a.number, b.number, mac, a.frequency, b.frequency, a.squeal.size, b.squeal.size,
        float(a.squeal.mean()), float(b.squeal.mean()), change, low if chance else None,
        high if chance else None, "yes" if paired else "no", a.damping, b.damping,
    )  # fmt: skip
    return dict(zip(COLUMNS, cells, strict=True))


def write_comparison(a: str | Path, b: str | Path, directory: str | Path) -> Path:
    """Compare two runs; compare.csv, compare_surface.csv and compare.html in a folder.

    Runs without modes are compared by their surfaces and laws, others by these too where they
    differ.

    Args:
        a: results folder of the first run.
        b: of the second one.
        directory: where the comparison is written, made if it is not there.

    Returns:
        The page.

    Raises:
        SceneError: nothing of them can be compared, or the runs have no approach in common.
    """
    one, two = read_run(a), read_run(b)
    surfaces, alone = _surfaces(one, two)
    rows = [] if alone else compare_runs(one, two)
    folder = Path(directory)
    folder.mkdir(parents=True, exist_ok=True)
    if surfaces:
        write_rows(folder / "compare_surface.csv", SURFACE_COLUMNS, surfaces)
    where = [f"{name}: {run.directory.resolve()}" for name, run in (("A", one), ("B", two))]
    blocks = surface_blocks((one, two)) if surfaces else []
    if alone:
        title = "Two surfaces compared"
        return page_of_changes(folder / "compare.html", title, where, None, blocks)
    write_rows(folder / "compare.csv", COLUMNS, rows)
    paired = any(row["paired"] == "yes" for row in rows)
    how = (
        "Samples of the same number have the same random numbers in both runs: the interval is that"
        " of paired shares." if paired else "The intervals are those of independent samples."
    )  # fmt: skip
    lines = [
        ShareChange(
            f"{row['approach']}, {_name(row, rows)}", float(row["probability_a"] or 0),
            float(row["probability_b"] or 0), change=interval_of(row),
        ) for row in rows
    ]  # fmt: skip
    text = "Share of samples in which a family squeals, with the 95 % interval of its change."
    return page_of_changes(
        folder / "compare.html", "Two runs compared",
        [f"{text} ({run.criterion})" for text, run in zip(where, (one, two), strict=True)]
        + [f"Warning: {text}." for text in _doubts(one, two)],
        picture_of(lines, ("A", "B"), text),
        [
            Text(
                "Families are matched by shape (modal assurance criterion at the nodes); a family"
                f" without a match does not squeal in the other run. {how}"
            ),
            Table(HEADS, _shown(rows)),
            *blocks,
        ],
    )  # fmt: skip


def comparison_text(a: str | Path | RunData, b: str | Path | RunData) -> str:
    """The comparison of two runs for the terminal, see `write_comparison`."""
    one, two = read_run(a), read_run(b)
    surfaces, alone = _surfaces(one, two)
    text = [surface_text((one, two))] if surfaces else []
    if alone:
        return "\n".join(text)
    rows = compare_runs(one, two)
    return "\n".join([text_table(HEADS, _shown(rows)), *_doubts(one, two), *text])


def _surfaces(one: RunData, two: RunData) -> tuple[list[list[Value]], bool]:
    """Rows of two surfaces that differ, and whether they are all that can be compared."""
    rows = surface_rows((one, two)) if of_surfaces((one, two)) else []
    alone = bool(rows) and any(run.modes is None or run.samples is None for run in (one, two))
    return (rows if alone or any(row[7] not in (None, 1.0) for row in rows) else []), alone


def _doubts(one: RunData, two: RunData) -> list[str]:
    """A warning where the runs are one, were made with other programs, or count other modes."""
    lines = []
    if one.directory.resolve() == two.directory.resolve():
        lines.append("A and B are the same folder; name two")
    if made := differences(one.summary, two.summary):
        lines.append(f"A and B were made differently: {'; '.join(made)}")
    if one.threshold == two.threshold:
        return lines
    a, b = (f"{-run.threshold if run.threshold else 0:g}" for run in (one, two))
    return [
        *lines,
        f"A counts squeal below {a}, B below {b}; set one stability.threshold and run both again"
        " (no sample is computed again)",
    ]


def _all(row: Row) -> bool:
    """Whether a row is that of all modes together."""
    return row["family_a"] is None and row["family_b"] is None


def _frequency(row: Row, rows: Sequence[Row], name: str) -> str:
    """Frequency of a family, with the digits that tell it from others of its approach."""
    own = [r[name] for r in rows if r["approach"] == row["approach"] and not _all(r)]
    return frequency_text(row[name], own)


def _name(row: Row, rows: Sequence[Row]) -> str:
    name = "frequency_a_hz" if row["frequency_a_hz"] is not None else "frequency_b_hz"
    return "any" if _all(row) else f"{_frequency(row, rows, name)} kHz"


def _shown(rows: Sequence[Row]) -> list[list[Value]]:
    return [_cells(row, rows) for row in rows]


def _cells(row: Row, rows: Sequence[Row]) -> list[Value]:
    family = row["family_a"] if row["family_a"] is not None else row["family_b"]
    return [
        row["approach"], "any" if _all(row) else family,
        *("-" if _all(row) else _frequency(row, rows, f"frequency_{r}_hz") for r in "ab"),
        *(share_of(row[f"probability_{r}"], row[f"samples_{r}"]) for r in "ab"),
        change_of(row),
        *("-" if (d := row[f"median_damping_{r}"]) is None else f"{float(d):.3g}" for r in "ab"),
        "-" if row["mac"] is None else f"{float(row['mac']):.2f}",
    ]  # fmt: skip

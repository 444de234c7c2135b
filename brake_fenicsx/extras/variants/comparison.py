"""Two runs compared: families matched by shape, change of probability, frequency and damping.

The interval of a change is that of paired shares where both runs have samples of the same random
numbers, and of independent ones elsewhere. Approaches of a single sample have no interval: nothing
of them is left to chance.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from brake_fenicsx.arguments import AnyArray, Complex, Mask
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import read_npz, reading
from brake_fenicsx.libraries import differences
from brake_fenicsx.report.page_blocks import Table, Text
from brake_fenicsx.results.ensemble_statistics import difference
from brake_fenicsx.results.families import SHAPES, same_families
from brake_fenicsx.results.run import RunData, read_run
from brake_fenicsx.results.tables import Value, text_table, write_rows

from . import page
from .surfaces import COLUMNS as SURFACE_COLUMNS
from .surfaces import surface_blocks, surface_rows, surface_text

Shapes = dict[str, AnyArray]
BOTH = "frequency_a_hz", "frequency_b_hz", "samples_a", "samples_b", "probability_a"
CHANGE = "probability_b", "change", "change_low", "change_high", "paired"
DAMPING = "median_damping_a", "median_damping_b"
COLUMNS = "approach", "family_a", "family_b", "mac", *BOTH, *CHANGE, *DAMPING
SHOWN = "frequency in A [kHz]", "in B [kHz]", "samples that squeal in A", "in B"
LAST = "change (95 % interval)", "median damping in A", "in B", "MAC"
HEADS = "approach", "family", *SHOWN, *LAST


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
    squeal: Mask
    frequency: float | None = None
    damping: float | None = None


def compare_runs(
    a: str | Path | RunData, b: str | Path | RunData, may_pair: bool = True
) -> list[page.Row]:
    """Rows of the comparison, with the columns COLUMNS; all modes together first.

    Args:
        a: results folder of the first run, or its results.
        b: of the second one.
        may_pair: False where samples of the same seed are known to have other laws or gaps.

    Raises:
        SceneError: a folder holds no modes, or the runs have no approach in common.
    """
    runs = read_run(a), read_run(b)
    for run in runs:
        if not _has_modes(run):
            raise SceneError(f"""{run.directory}: contains no modes to compare; run the scene with
                the stage stability, or both with a surface""")
    one, two = runs
    common = [name for name in one.approaches if name in two.approaches]
    if not common:
        raise SceneError(f"""{one.directory}, {two.directory}: no approach in common
            ({", ".join(one.approaches)}; {", ".join(two.approaches)})""")
    rows = []
    for approach in common:
        seeds = [_seeds(run, approach) for run in runs]
        paired = may_pair and seeds[0] == seeds[1] and len(seeds[0]) > 1
        whole = _side(one, approach), _side(two, approach), None
        rows += [_row(approach, *pair, paired) for pair in [whole, *_matched(one, two, approach)]]
    return rows


def _has_modes(run: RunData) -> bool:
    return run.modes is not None and run.samples is not None


def _seeds(run: RunData, approach: str) -> list[tuple[int, int]]:
    """Number and seed of every sample that ended well: those of paired samples are the same."""
    table = run.samples or {}
    own = (table["approach"] == approach) & (table["status"] == "ok")
    return list(zip(table["sample"][own], table["seed"][own], strict=True))


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
    runs = one, two
    numbers = [sorted(f.key for f in r.squeal.families(approach) if f.key >= 0) for r in runs]
    a, b = ([_side(run, approach, n) for n in own] for run, own in zip(runs, numbers, strict=True))
    shapes, pairs = [shapes_of(run) for run in runs], []
    if a and b and shapes[0] is not None and shapes[1] is not None:
        X, Y = _at_common_nodes(shapes[0], numbers[0], shapes[1], numbers[1])
        f, g = (np.array([side.frequency for side in own], float) for own in (a, b))
        pairs = same_families(X, f, Y, g)
    rows: list[tuple[Side, Side, float | None]] = [(a[i], b[j], mac) for i, j, mac in pairs]
    silent = [Side(None, np.zeros(run.squeal.good(approach).size, bool)) for run in runs]
    of_one, of_two, _ = zip(*pairs, strict=True) if pairs else ((), (), ())
    rows += [(s, silent[1], None) for i, s in enumerate(a) if i not in of_one]
    rows += [(silent[0], s, None) for j, s in enumerate(b) if j not in of_two]
    return sorted(rows, key=lambda row: row[0].frequency or row[1].frequency or 0.0)


def shapes_of(run: RunData) -> Shapes | None:
    """Shapes of the families of a run, see ``results.families``; None if it has none."""
    path = run.directory / SHAPES
    if not path.is_file():
        return None
    with reading(path, "as an npz file", "`run` of the scene makes it again"):
        return read_npz(path)


def _at_common_nodes(
    one: Shapes, first: list[int], two: Shapes, second: list[int]
) -> tuple[AnyArray, AnyArray]:
    """Shapes of families at those nodes of the first run that the second one has too."""
    size = np.ptp(one["points"], axis=0).max()
    places = [np.column_stack([s["points"], s["body"]]) for s in (one, two)]
    distance, nearest = KDTree(places[1]).query(places[0])
    near = distance <= 0.05 * size
    X, Y = _vectors(one, first)[:, near], _vectors(two, second)[:, nearest[near]]
    return X.reshape(len(X), -1).T, Y.reshape(len(Y), -1).T


def _vectors(shapes: Shapes, numbers: list[int]) -> Complex:
    """Shapes of some families; zero where one was not kept."""
    kept = {int(n): i for i, n in enumerate(shapes["families"])}
    out = np.zeros((len(numbers), *shapes["shapes"].shape[1:]), complex)
    for row, number in enumerate(numbers):
        if number in kept:
            out[row] = shapes["shapes"][kept[number]]
    return out


def _row(approach: str, a: Side, b: Side, mac: float | None, paired: bool) -> page.Row:
    """One line of the comparison."""
    change, low, high = difference(a.squeal, b.squeal, paired and a.squeal.size == b.squeal.size)
    chance = min(a.squeal.size, b.squeal.size) > 1
    both = a.number, b.number, mac, a.frequency, b.frequency, a.squeal.size, b.squeal.size
    ends = (low, high) if chance else (None, None)
    shares = float(a.squeal.mean()), float(b.squeal.mean()), change, *ends
    cells = approach, *both, *shares, "yes" if paired else "no", a.damping, b.damping
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
    runs = read_run(a), read_run(b)
    rows, surfaces = _compared(*runs)
    folder = Path(directory)
    folder.mkdir(parents=True, exist_ok=True)
    if surfaces:
        write_rows(folder / "compare_surface.csv", SURFACE_COLUMNS, surfaces)
    where = [f"{name}: {run.directory.resolve()}" for name, run in zip("AB", runs, strict=True)]
    blocks, title = surface_blocks(runs, surfaces) if surfaces else [], "Two surfaces compared"
    if rows:
        write_rows(folder / "compare.csv", COLUMNS, rows)
        title, shown = "Two runs compared", _shown(rows)
        how = (
            "Samples of the same number have the same random numbers in both runs: the interval is"
            " that of paired shares."
            if any(row["paired"] == "yes" for row in rows)
            else "The intervals are those of independent samples."
        )
        lines = [
            page.ShareChange(
                f"{row['approach']}, {_label(cells)}", row["probability_a"], row["probability_b"],
                change=page.interval_of(row),
            ) for row, cells in zip(rows, shown, strict=True)
        ]  # fmt: skip
        text = "Share of samples in which a family squeals, with the 95 % interval of its change."
        how = (
            "Families are matched by shape (modal assurance criterion at the nodes); a family"
            f" without a match does not squeal in the other run. {how}"
        )
        blocks = [page.picture_of(lines, ("A", "B"), text), Text(how), Table(HEADS, shown), *blocks]
        where = [f"{text} ({run.criterion})" for text, run in zip(where, runs, strict=True)]
    where += [f"Warning: {text}." for text in _doubts(*runs)]
    return page.page_of_changes(folder / "compare.html", title, where, blocks)


def comparison_text(a: str | Path | RunData, b: str | Path | RunData) -> str:
    """The comparison of two runs for the terminal, see `write_comparison`."""
    runs = read_run(a), read_run(b)
    rows, surfaces = _compared(*runs)
    text = [text_table(HEADS, _shown(rows))] if rows else []
    return "\n".join([*text, *([surface_text(surfaces)] if surfaces else []), *_doubts(*runs)])


def _compared(one: RunData, two: RunData) -> tuple[list[page.Row], list[list[Value]]]:
    """Rows of the families, and of the surfaces where they differ or nothing else is there."""
    surfaces = surface_rows((one, two))
    if surfaces and not (_has_modes(one) and _has_modes(two)):
        return [], surfaces
    differ = any(row[7] not in (None, 1.0) for row in surfaces)
    return compare_runs(one, two), surfaces if differ else []


def _doubts(one: RunData, two: RunData) -> list[str]:
    """A warning where the runs are one, were made with other programs, or count other modes."""
    lines = []
    if one.directory.resolve() == two.directory.resolve():
        lines.append("A and B are the same folder; name two")
    if made := differences(one.summary, two.summary):
        lines.append(f"A and B were made differently: {'; '.join(made)}")
    if one.threshold != two.threshold and _has_modes(one) and _has_modes(two):
        a, b = (f"{-run.threshold if run.threshold else 0:g}" for run in (one, two))
        lines.append(
            f"A counts squeal below {a}, B below {b}; set one stability.threshold and run both"
            " again (no sample is computed again)"
        )
    return lines


def _shown(rows: Sequence[page.Row]) -> list[list[Value]]:
    """Cells of the rows as a person reads them, in the order of HEADS."""
    return [_cells(row, [r for r in rows if r["approach"] == row["approach"]]) for row in rows]


def _cells(row: page.Row, among: Sequence[page.Row]) -> list[Value]:
    """Those of a row; frequencies have the digits that tell them from others of the approach."""
    number = row["family_b"] if row["family_a"] is None else row["family_a"]
    frequency = ["-", "-"]
    if number is not None:
        hertz = ([r[f"frequency_{side}_hz"] for r in (row, *among[1:])] for side in "ab")
        frequency = [page.frequency_text(own, others) for own, *others in hertz]
    damping = (row[f"median_damping_{side}"] for side in "ab")
    return [
        row["approach"], "any" if number is None else number, *frequency,
        *(page.share_of(row[f"probability_{side}"], row[f"samples_{side}"]) for side in "ab"),
        page.change_of(row), *("-" if d is None else f"{d:.3g}" for d in damping),
        "-" if row["mac"] is None else f"{row['mac']:.2f}",
    ]  # fmt: skip


def _label(cells: Sequence[Value]) -> str:
    """Name of a line of the picture, of its cells in the table."""
    _, family, a, b, *_ = cells
    return "any" if family == "any" else f"{b if a == '-' else a} kHz"

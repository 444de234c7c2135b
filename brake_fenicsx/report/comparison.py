"""Two runs compared: families matched by shape, change of probability, frequency and damping.

The interval of a change of probability is Newcombe's hybrid score interval, of two independent
shares (Statistics in Medicine 17, 1998, 873) or, where both runs have samples of the same random
numbers, of paired ones (the same volume, 2635).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import KDTree

from brake_fenicsx.errors import SceneError
from brake_fenicsx.squeal import squeals, wilson
from brake_fenicsx.tables import Value

from .counts import good_modes
from .rundata import RunData, read_run

Array = NDArray[np.float64]

# Least MAC of two families that are the same one, and largest relative distance of frequencies.
SAME, NEAR = 0.5, 0.3

COLUMNS = (
    "approach", "family_a", "family_b", "mac", "frequency_a_hz", "frequency_b_hz", "samples_a",
    "samples_b", "probability_a", "probability_b", "change", "change_low", "change_high", "paired",
    "median_damping_a", "median_damping_b",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Family:
    """A family in one run.

    Attributes:
        number: of the family; -1 for all modes together.
        samples: numbers of the samples that ended well.
        squeal: whether it squeals in each of them.
        frequency: median over the samples in which it squeals [Hz]; nan if none.
        damping: likewise [-].
    """

    number: int
    samples: NDArray[np.intp]
    squeal: NDArray[np.bool_]
    frequency: float
    damping: float


def compare_runs(
    a: str | Path | RunData, b: str | Path | RunData, may_pair: bool = True
) -> list[list[Value]]:
    """Rows of the comparison, in the order of COLUMNS; all modes together first.

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
                f"{run.directory}: contains no modes; run the scene with stability first"
            )
    common = [name for name in one.approaches if name in two.approaches]
    if not common:
        raise SceneError(
            f"{one.directory}, {two.directory}: no approach in common"
            f" ({', '.join(one.approaches)}; {', '.join(two.approaches)})"
        )
    shapes = _shapes(one), _shapes(two)
    rows = []
    for approach in common:
        paired = may_pair and _paired(one, two, approach)
        rows.append(_row(approach, _all(one, approach), _all(two, approach), None, paired))
        first, second = _families(one, approach), _families(two, approach)
        for i, j, mac in _matched(first, second, shapes):
            rows.append(_row(approach, i, j, mac, paired))
    return rows


def difference(
    first: NDArray[np.bool_], second: NDArray[np.bool_], paired: bool
) -> tuple[float, float, float]:
    """Difference of two shares, second minus first, with its 95 % interval.

    Args:
        first: outcome of each sample of the first run.
        second: of the second one; of the same samples where they are paired.
        paired: whether the outcomes belong together one by one.
    """
    p, q = wilson(int(first.sum()), first.size), wilson(int(second.sum()), second.size)
    phi = _correlation(first, second) if paired else 0.0
    change = q.value - p.value
    down, up = (q.value - q.low, p.high - p.value), (q.high - q.value, p.value - p.low)
    low, high = (np.sqrt(max(x * x - 2 * phi * x * y + y * y, 0.0)) for x, y in (down, up))
    return change, float(change - low), float(change + high)


def _correlation(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> float:
    """Newcombe's phi of a table of four fields, with its correction for continuity."""
    a, b = int(np.sum(first & second)), int(np.sum(first & ~second))
    c, d = int(np.sum(~first & second)), int(np.sum(~first & ~second))
    sums = (a + b) * (c + d) * (a + c) * (b + d)
    if sums == 0:
        return 0.0
    cross = float(a * d - b * c)
    if cross > 0:
        cross = max(cross - first.size / 2, 0.0)
    return float(cross / np.sqrt(sums))


def _paired(one: RunData, two: RunData, approach: str) -> bool:
    """Whether both runs have samples with the same random numbers."""
    seeds = []
    for run in (one, two):
        table = run.samples
        if table is None:
            return False
        own = (table["approach"] == approach) & (table["status"] == "ok")
        seeds.append((list(table["sample"][own]), list(table["seed"][own])))
    return seeds[0] == seeds[1] and len(seeds[0][0]) > 1


def _all(run: RunData, approach: str) -> Family:
    return _family(run, approach, -1)


def _families(run: RunData, approach: str) -> list[Family]:
    modes = good_modes(run, approach, squeal=True)
    numbers = np.unique(modes["family"][modes["family"] >= 0])
    return [_family(run, approach, int(n)) for n in numbers]


def _family(run: RunData, approach: str, number: int) -> Family:
    table, modes = run.samples, good_modes(run, approach, squeal=True)
    if table is None:
        raise SceneError(f"{run.directory}: samples.csv is missing")
    own = (table["approach"] == approach) & (table["status"] == "ok")
    samples = np.sort(table["sample"][own]).astype(np.intp)
    chosen = np.ones(modes["family"].size, bool) if number < 0 else modes["family"] == number
    chosen &= squeals(modes, run.threshold)
    loud = np.isin(samples, modes["sample"][chosen])
    if not chosen.any():
        return Family(number, samples, loud, float("nan"), float("nan"))
    lowest = [modes["damping"][chosen & (modes["sample"] == s)].min() for s in samples[loud]]
    return Family(
        number, samples, loud, float(np.median(modes["frequency_hz"][chosen])),
        float(np.median(lowest)),
    )  # fmt: skip


def _shapes(run: RunData) -> dict[str, NDArray] | None:
    path = run.directory / "shapes.npz"
    if not path.is_file():
        return None
    with np.load(path, allow_pickle=False) as data:
        return {name: data[name] for name in data.files}


def _matched(
    first: list[Family],
    second: list[Family],
    shapes: tuple[dict[str, NDArray] | None, dict[str, NDArray] | None],
) -> list[tuple[Family | None, Family | None, float | None]]:
    """Pairs of families that are the same mode; those of one run alone with None."""
    left, right = list(range(len(first))), list(range(len(second)))
    found: list[tuple[Family | None, Family | None, float | None]] = []
    if first and second and shapes[0] is not None and shapes[1] is not None:
        mac = _mac([f.number for f in first], shapes[0], [f.number for f in second], shapes[1])
        apart = [[abs(np.log(f.frequency / g.frequency)) for g in second] for f in first]
        mac = np.where(np.array(apart) < NEAR, mac, 0.0)
        for i, j in zip(*linear_sum_assignment(-mac), strict=True):
            if mac[i, j] >= SAME:
                found.append((first[i], second[j], float(mac[i, j])))
                left.remove(int(i))
                right.remove(int(j))
    found += [(first[i], None, None) for i in left] + [(None, second[j], None) for j in right]
    return sorted(found, key=lambda row: (row[0] or row[1] or first[0]).frequency)


def _mac(
    numbers: list[int], one: dict[str, NDArray], others: list[int], two: dict[str, NDArray]
) -> Array:
    """Modal assurance criterion of families at the nodes of the first run."""
    size = np.ptp(one["points"], axis=0).max()
    places = [np.column_stack([s["points"], s["body"]]) for s in (one, two)]
    distance, nearest = KDTree(places[1]).query(places[0])
    near = distance <= 0.05 * size
    X = _vectors(one, numbers)[:, near]
    Y = _vectors(two, others)[:, nearest[near]]
    X, Y = X.reshape(len(X), -1), Y.reshape(len(Y), -1)
    X = X / np.maximum(np.linalg.norm(X, axis=1), 1e-300)[:, None]
    Y = Y / np.maximum(np.linalg.norm(Y, axis=1), 1e-300)[:, None]
    return np.asarray(np.abs(X.conj() @ Y.T) ** 2)


def _vectors(shapes: dict[str, NDArray], numbers: list[int]) -> NDArray[np.complex64]:
    """Shapes of some families; zero where one was not kept."""
    kept = {int(n): i for i, n in enumerate(shapes["families"])}
    out = np.zeros((len(numbers), *shapes["shapes"].shape[1:]), np.complex64)
    for row, number in enumerate(numbers):
        if number in kept:
            out[row] = shapes["shapes"][kept[number]]
    return out


def _row(
    approach: str, a: Family | None, b: Family | None, mac: float | None, paired: bool
) -> list[Value]:
    """One line of the comparison; a family that one run lacks does not squeal there."""
    known = a if a is not None else b
    if known is None:
        raise ValueError("no family")
    silent = np.zeros(known.squeal.size, bool)
    p = a.squeal if a is not None else silent
    q = b.squeal if b is not None else silent
    change = difference(p, q, paired and p.size == q.size)
    return [
        approach,
        *(f.number if f is not None and f.number >= 0 else None for f in (a, b)), mac,
        *(_number(f.frequency if f is not None else np.nan) for f in (a, b)),
        p.size, q.size, float(p.mean()), float(q.mean()), *change, "yes" if paired else "no",
        *(_number(f.damping if f is not None else np.nan) for f in (a, b)),
    ]  # fmt: skip


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None

"""How many modes squeal, how often, how strongly, where: counts with Wilson intervals.

A mode squeals where it is unstable and its damping lies below minus the threshold of the scene.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.squeal import Share, squeals, wilson
from brake_fenicsx.tables import MODES, TEXT, Columns

from .rundata import RunData

WIDTH = 200.0  # [Hz] of the bands that gather modes of no family
REAL = frozenset({"frequency_hz", "real_1_s", "damping"})


@dataclass(frozen=True, slots=True)
class ApproachCount:
    """Counts of one approach over its samples that ended well.

    Attributes:
        approach: its name.
        samples: samples that ended well.
        failed: samples that ended in an error.
        modes: modes in the band, all samples.
        unstable: unstable modes, all samples.
        neutral: modes of which the computation cannot tell, all samples.
        squeal: modes that squeal, all samples.
        squeal_samples: samples with at least one mode that squeals.
        per_sample: squeal modes of each sample, shape (samples,), in the order of the samples.
    """

    approach: str
    samples: int
    failed: int
    modes: int
    unstable: int
    neutral: int
    squeal: int
    squeal_samples: int
    per_sample: NDArray


@dataclass(frozen=True, slots=True)
class FamilyCount:
    """One family of squeal modes: the same mode recognised in many samples.

    Attributes:
        approach: its approach.
        family: number of the family; -1 for modes of no family, gathered by frequency.
        frequency: mean frequency of its squeal modes [Hz].
        spread: standard deviation of that frequency [Hz].
        share: share of samples in which it squeals.
        median: median over those samples of the lowest damping in each [-].
        worst: lowest damping (most unstable) [-].
    """

    approach: str
    family: int
    frequency: float
    spread: float
    share: Share
    median: float
    worst: float

    @property
    def severity(self) -> float:
        """Share of samples that squeal, times their median damping without its sign."""
        return self.share.value * abs(self.median)


@dataclass(frozen=True, slots=True)
class ModeKey:
    """One mode of the tables: approach, sample, mode, frequency [Hz], damping [-], its family."""

    approach: str
    sample: int
    mode: int
    frequency: float
    damping: float
    family: FamilyCount


def good_modes(run: RunData, approach: str, squeal: bool = False) -> Columns:
    """Modes of one approach over its samples that ended well.

    Args:
        run: the results.
        approach: name of the approach.
        squeal: only modes that squeal.

    Returns:
        The columns of ``modes.csv``, arrays of shape (n,).
    """
    if run.modes is None:
        return {
            name: np.empty(0, dtype=str if name in TEXT else float if name in REAL else int)
            for name in MODES
        }
    chosen = run.modes["approach"] == approach
    if run.samples is not None:
        chosen &= np.isin(run.modes["sample"], good_samples(run, approach)[0])
    if squeal:
        chosen &= squeals(run.modes, run.threshold)
    return {name: values[chosen] for name, values in run.modes.items()}


def count(run: RunData, approach: str) -> ApproachCount:
    """Count samples, modes, and modes that are unstable or squeal, of one approach.

    Args:
        run: the results.
        approach: name of the approach.

    Returns:
        The counts; without ``samples.csv`` the samples are those that have modes.
    """
    good, failed = good_samples(run, approach)
    modes = good_modes(run, approach)
    squeal = squeals(modes, run.threshold)
    per_sample = np.zeros(good.size, dtype=int)
    np.add.at(per_sample, np.searchsorted(good, modes["sample"][squeal]), 1)
    return ApproachCount(
        approach=approach,
        samples=good.size,
        failed=failed,
        modes=squeal.size,
        unstable=int((modes["verdict"] == "unstable").sum()),
        neutral=int((modes["verdict"] == "neutral").sum()),
        squeal=int(squeal.sum()),
        squeal_samples=int(np.count_nonzero(per_sample)),
        per_sample=per_sample,
    )


def band_edges(run: RunData, most: int = 20) -> NDArray:
    """Edges [Hz] of equal frequency bands over all modes: at most ``most``, of a round width."""
    top = 1.0
    if run.modes is not None and run.modes["frequency_hz"].size:
        top = float(np.max(run.modes["frequency_hz"]))
    decades = 10.0 ** np.arange(-3, 7)[:, None] * np.array([1.0, 2.0, 5.0])
    width = float(decades[decades * most >= top].min())
    return width * np.arange(int(np.ceil(top / width * (1 - 1e-12))) + 1)


def probability_per_band(run: RunData, approach: str, edges: NDArray) -> list[Share]:
    """Share of samples with a squeal mode in each band.

    Args:
        run: the results.
        approach: name of the approach.
        edges: band edges [Hz], shape (n + 1,); the last band includes its upper edge.

    Returns:
        One share per band.
    """
    good, _ = good_samples(run, approach)
    modes = good_modes(run, approach, squeal=True)
    frequency, sample = modes["frequency_hz"], modes["sample"]
    band = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, len(edges) - 2)
    return [wilson(np.unique(sample[band == j]).size, good.size) for j in range(len(edges) - 1)]


def families(run: RunData, approach: str, width: float = WIDTH) -> list[FamilyCount]:
    """Families of squeal modes of one approach, the most severe first.

    Args:
        run: the results.
        approach: name of the approach.
        width: modes of no family (number below zero) are gathered in bands of this width [Hz].

    Returns:
        One record per family with at least one mode that squeals.
    """
    good, _ = good_samples(run, approach)
    table = good_modes(run, approach, squeal=True)
    family = table["family"].astype(int)
    key = np.where(family >= 0, family, -1 - (table["frequency_hz"] // width).astype(int))
    found = []
    for number in np.unique(key):
        own = key == number
        f = table["frequency_hz"][own]
        samples, place = np.unique(table["sample"][own], return_inverse=True)
        lowest = np.zeros(samples.size)
        np.minimum.at(lowest, place, table["damping"][own])
        record = FamilyCount(
            approach, max(int(number), -1), float(f.mean()), float(f.std()),
            wilson(samples.size, good.size), float(np.median(lowest)), float(lowest.min()),
        )  # fmt: skip
        found.append(record)
    return sorted(found, key=lambda r: (-r.severity, r.frequency))


def representative_modes(run: RunData, approach: str, most: int = 4) -> list[ModeKey]:
    """Which modes to draw: of each of the most severe families the squeal mode of median damping.

    Args:
        run: the results.
        approach: name of the approach.
        most: number of families.

    Returns:
        At most ``most`` modes, the most severe family first.
    """
    modes = good_modes(run, approach, squeal=True)
    chosen = []
    for record in families(run, approach)[:most]:
        if record.family >= 0:
            own = np.flatnonzero(modes["family"] == record.family)
        else:
            own = np.flatnonzero(np.abs(modes["frequency_hz"] - record.frequency) <= WIDTH)
        row = own[np.argsort(modes["damping"][own], kind="stable")[own.size // 2]]
        numbers = int(modes["sample"][row]), int(modes["mode"][row])
        frequency, damping = float(modes["frequency_hz"][row]), float(modes["damping"][row])
        chosen.append(ModeKey(approach, *numbers, frequency, damping, record))
    return chosen


def good_samples(run: RunData, approach: str) -> tuple[NDArray, int]:
    """Numbers of the samples that ended well, and how many did not."""
    if run.samples is not None:
        mine = run.samples["approach"] == approach
        good = mine & (run.samples["status"] == "ok")
        return np.unique(run.samples["sample"][good]), int(mine.sum() - good.sum())
    if run.modes is not None:
        return np.unique(run.modes["sample"][run.modes["approach"] == approach]), 0
    return np.empty(0, dtype=int), 0

"""Squeal of a run as one table, from which every count, rank and share follows.

A mode squeals where it is unstable and its damping lies below minus the threshold of the scene. A
family is the same mode recognised in many samples; squeal modes of no family are gathered by
frequency. Families are ranked by severity: the share of samples in which the family squeals, times
the median of its damping there. Samples that failed do not count.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from brake_fenicsx.arguments import AnyArray, Array, Index, Ints, Mask

from .ensemble_statistics import Proportion, wilson
from .tables import MODES, TEXTS, Columns, rows_of

if TYPE_CHECKING:
    import pandas as pd

WIDTH = 200.0  # [Hz] of the bands that gather squeal modes of no family
MOST_BANDS = 20  # bands of frequency in which probabilities are given
SAME = 0.01  # [Hz] below which two frequencies are printed alike

T = TypeVar("T")


def squeals(modes: Mapping[str, Any], threshold: float) -> Any:
    """Which modes count as squeal: unstable, and the damping below minus the threshold."""
    return (modes["verdict"] == "unstable") & (modes["damping"] < -threshold)


def kilohertz(hertz: Sequence[float]) -> list[str]:
    """Frequencies in kHz with three decimals, and more where two would read the same.

    Args:
        hertz: frequencies [Hz], such as those of all families of a table.

    Returns:
        A text for each; those that differ by 0.01 Hz have different ones.
    """
    chosen = []
    for f in hertz:
        near = [x for x in hertz if SAME <= abs(x - f) < 1.0]
        texts = ([f"{x / 1e3:.{digits}f}" for x in (f, *near)] for digits in (3, 4, 5))
        chosen.append(next((text for text, *rest in texts if text not in rest), f"{f / 1e3:.5f}"))
    return chosen


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
    per_sample: AnyArray


@dataclass(frozen=True, slots=True)
class Family:
    """One family of squeal modes.

    Attributes:
        approach: its approach.
        key: number of the family; below zero one for each band of modes of no family.
        frequency: mean frequency of its squeal modes [Hz].
        spread: standard deviation of that frequency [Hz].
        share: share of samples in which it squeals.
        median: median over those samples of the lowest damping in each [-].
        worst: lowest damping (most unstable) [-].
        kilohertz: the frequency [kHz] as text, with the digits that tell it from other families.
    """

    approach: str
    key: int
    frequency: float
    spread: float
    share: Proportion
    median: float
    worst: float
    kilohertz: str

    @property
    def number(self) -> int:
        """Number of the family; -1 for modes of no family."""
        return max(self.key, -1)

    @property
    def severity(self) -> float:
        """Share of samples that squeal, times their median damping without its sign."""
        return self.share.value * abs(self.median)


@dataclass(frozen=True, slots=True)
class ModeKey:
    """One mode of the tables: approach, sample, mode, frequency [Hz], damping [-], its family.

    Files and fields are called by ``name``: its frequency, with its family where two are alike.
    """

    approach: str
    sample: int
    mode: int
    frequency: float
    damping: float
    family: Family
    name: str


class SquealTable:
    """Samples that ended well, their modes, and which of these squeal; tables have pandas' form."""

    def __init__(self, modes: Columns | None, samples: Columns | None, threshold: float):
        """Take the tables of a run.

        Args:
            modes: columns of modes.csv; there are none if None.
            samples: columns of samples.csv; without it the samples are those that have modes.
            threshold: a mode squeals where its damping lies below minus this.
        """
        import pandas as pd

        if modes is None:
            modes = {name: np.empty(0, str if name in TEXTS else float) for name in MODES}
        self.threshold = threshold
        self._modes = modes
        if samples is None:
            self._samples = pd.DataFrame({n: modes[n] for n in ("approach", "sample")})
            self._samples = self._samples.drop_duplicates().assign(status="ok")
        else:
            self._samples = pd.DataFrame({n: samples[n] for n in ("approach", "sample", "status")})
        self._known: dict[tuple[str, ...], Any] = {}

    def _once(self, key: tuple[str, ...], make: Callable[[], T]) -> T:
        if key not in self._known:
            self._known[key] = make()
        return self._known[key]

    def good(self, approach: str) -> Ints:
        """Numbers of the samples that ended well, ascending."""
        rows = self._samples[self._samples.approach == approach]
        return np.unique(rows["sample"][rows.status == "ok"]).astype(np.int64)

    def of_good(self, approach: str) -> Mask:
        """Which rows of modes.csv are modes of samples that ended well, shape (modes,)."""

        def chosen() -> Mask:
            good, sample = self.good(approach), np.asarray(self._modes["sample"])
            sample = sample if sample.dtype.kind == "i" else sample.astype(np.int64)
            known = np.zeros(1 + max(sample.max(initial=0), good.max(initial=0)), dtype=bool)
            known[good] = True
            return known[sample] & np.asarray(self._modes["approach"] == approach)

        return self._once(("good", approach), chosen)

    def modes(self, approach: str) -> pd.DataFrame:
        """All modes of the samples that ended well, with the columns of modes.csv."""
        import pandas as pd

        return pd.DataFrame(rows_of(self._modes, np.flatnonzero(self.of_good(approach))))

    def squeal_modes(self, approach: str, family: int | None = None) -> pd.DataFrame:
        """Modes that squeal, with the column ``key`` of their family beside those of modes.csv.

        Args:
            approach: name of the approach.
            family: key of one family; all of them if None.
        """

        def chosen() -> pd.DataFrame:
            import pandas as pd

            rows = np.flatnonzero(self.of_good(approach) & squeals(self._modes, self.threshold))
            modes = pd.DataFrame(rows_of(self._modes, rows))
            band = -1 - (modes.frequency_hz // WIDTH).astype(int)
            return modes.assign(key=modes.family.where(modes.family >= 0, band).astype(int))

        modes = self._once(("squeal", approach), chosen)
        return modes if family is None else modes[modes.key == family].reset_index(drop=True)

    def count(self, approach: str) -> ApproachCount:
        """Count samples, modes, and modes that are unstable or squeal, of one approach."""
        return self._once(("count", approach), lambda: self._counted(approach))

    def _counted(self, approach: str) -> ApproachCount:
        good, rows = self.good(approach), self.of_good(approach)
        squealing = self.squeal_modes(approach)
        verdict = self._modes["verdict"]
        per_sample = squealing.groupby("sample").size().reindex(good, fill_value=0).to_numpy()
        unstable, neutral = (int((rows & (verdict == v)).sum()) for v in ("unstable", "neutral"))
        failed = int((self._samples.approach == approach).sum()) - good.size
        modes = int(rows.sum()), unstable, neutral, len(squealing)
        counted = int(np.count_nonzero(per_sample)), per_sample
        return ApproachCount(approach, good.size, failed, *modes, *counted)

    def families(self, approach: str) -> list[Family]:
        """Families with at least one mode that squeals, the most severe first."""

        def ranked() -> list[Family]:
            modes, n = self.squeal_modes(approach), self.good(approach).size
            ranked_families = []
            texts = kilohertz(modes.groupby("key").frequency_hz.mean().tolist())
            for text, (key, family) in zip(texts, modes.groupby("key"), strict=True):
                f, lowest = family.frequency_hz, family.groupby("sample").damping.min()
                numbers = float(f.mean()), float(f.std(ddof=0)), wilson(lowest.size, n)
                ends = float(lowest.median()), float(lowest.min())
                ranked_families.append(Family(approach, int(key), *numbers, *ends, text))
            return sorted(ranked_families, key=lambda r: (-r.severity, r.frequency))

        return self._once(("families", approach), ranked)

    def representatives(self, approach: str, most: int = 4) -> list[ModeKey]:
        """Of each of the most severe families, at most ``most``, the squeal mode of median damping.

        These are the modes that are drawn.
        """
        chosen = list[ModeKey]()
        for family in self.families(approach)[:most]:
            modes = self.squeal_modes(approach, family.key).sort_values("damping", kind="stable")
            row = modes.iloc[len(modes) // 2]
            numbers = int(row["sample"]), int(row["mode"])
            values = float(row["frequency_hz"]), float(row["damping"])
            name = f"{values[0]:05.0f}Hz"
            name += f"_family{family.key}" * any(name == other.name for other in chosen)
            chosen.append(ModeKey(approach, *numbers, *values, family, name))
        return chosen

    @cached_property
    def edges(self) -> Array:
        """Edges [Hz] of equal frequency bands over all modes: at most 20, of a round width."""
        f = self._modes["frequency_hz"]
        top = float(f.max()) if len(f) else 1.0
        decades = 10.0 ** np.arange(-3, 7)[:, None] * np.array([1.0, 2.0, 5.0])
        width = float(decades[decades * MOST_BANDS >= top].min())
        return width * np.arange(np.ceil(top / width * (1 - 1e-12)) + 1.0, dtype=float)

    def bands(self, approach: str) -> Index:
        """Band of each squeal mode, between the edges; the last one includes its upper edge."""
        edges = self.edges
        place = np.searchsorted(edges, self.squeal_modes(approach).frequency_hz, side="right") - 1
        return np.clip(place, 0, len(edges) - 2)

    def share_per_band(self, approach: str) -> list[Proportion]:
        """Share of samples with a squeal mode in each band."""
        hits = self.squeal_modes(approach)["sample"].groupby(self.bands(approach)).nunique()
        hits = hits.reindex(range(len(self.edges) - 1), fill_value=0)
        n = self.good(approach).size
        return [wilson(int(k), n) for k in hits]


def least_damped(modes: pd.DataFrame) -> pd.DataFrame:
    """Of some modes that of lowest damping in each sample, by number of the sample."""
    known = modes.dropna(subset="damping")
    return known.loc[known.groupby("sample").damping.idxmin()].set_index("sample")

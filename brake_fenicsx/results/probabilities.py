"""Tables of a study: which input moves what, what squeals how often, how both settle.

Each sample is asked whether the whole band, one part of it or one family squeals:

    squeal     1 or 0
    growth     largest real part [1/s] of the modes that squeal there, 0 if none does

Any other mode counts as growth 0: without damping the real part of a stable one is zero but for
round-off, and with damping how fast it decays says nothing about noise. Indices of growth thus
answer for crossing the border and for the strength beyond it, those of squeal for the border alone.
A family that has no mode in a sample does not squeal there.

sensitivity.csv   first-order and total indices of every outcome for every random input, and for
                  the roughness where the design gives them
probabilities.csv probability of squeal of every band and family, its median damping and severity
                  (the product of both), who moves it, and the shares of the variance of its growth
convergence.csv   the probabilities after so many samples

Shares of the variance are sums of first-order indices: friction, materials, loads; what is left is
roughness together with all interactions. Without rough contact it is interactions alone. Indices of
correlated inputs contain what comes with them and may exceed one together: no shares then.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np

from brake_fenicsx.arguments import Array, Mask
from brake_fenicsx.folder.processes import in_turns
from brake_fenicsx.samples.designs import RIGID
from brake_fenicsx.scene.samples_section import Samples

from .ensemble_statistics import Correlation, Indices, indices, rank_correlation, wilson
from .run import RunData
from .tables import Row, RowTable

if TYPE_CHECKING:
    import pandas as pd


MOST_FAMILIES = 20  # looked at, the most severe first
ROUGHNESS = "roughness"  # as an input: laws and critical gaps

SHARES = ("contact.", "materials.", "loads.")  # kinds of inputs: friction, materials, loads


@dataclass(frozen=True, slots=True)
class Place(Row):
    """The outcome that a row is of."""

    approach: str
    threshold: float
    scope: str
    where: str
    frequency_hz: float


@dataclass(frozen=True, slots=True)
class Sensitivity(Place):
    """A row of sensitivity.csv."""

    outcome: str
    input: str
    first: float | None
    first_low: float | None
    first_high: float | None
    total: float | None
    total_low: float | None
    total_high: float | None
    method: str
    samples: int
    filled: int


@dataclass(frozen=True, slots=True)
class Probability(Place):
    """A row of probabilities.csv.

    ``above_limit`` says whether the probability lies above ``samples.limit``: yes or no where its
    whole interval does, else open. ``dominant_input`` is the input with the strongest rank
    correlation with squeal; a negative one means that larger values make stable.
    """

    samples: int
    squeal_samples: int
    probability: float | None
    low: float | None
    high: float | None
    median_damping: float | None
    severity: float
    above_limit: str
    dominant_input: str | None
    correlation: float | None
    correlation_low: float | None
    correlation_high: float | None
    share_friction: float | None
    share_materials: float | None
    share_loads: float | None
    share_rest: float | None


@dataclass(frozen=True, slots=True)
class Convergence(Place):
    """A row of convergence.csv."""

    samples: int
    probability: float | None
    low: float | None
    high: float | None


@dataclass(frozen=True, slots=True)
class Outcome:
    """One thing that may happen in every sample of an approach.

    Attributes:
        scope: "band" or "family".
        where: "low-high" of the band [Hz], or the number of the family.
        frequency: middle of the band, or mean frequency of the family's squeal modes [Hz].
        growth: largest real part where it squeals, else 0 [1/s], shape (samples,).
        damping: lowest damping where it squeals, else 0 [-], shape (samples,).
    """

    scope: str
    where: str
    frequency: float
    growth: Array
    damping: Array

    @classmethod
    def of(
        cls, scope: str, where: str, frequency: float, modes: pd.DataFrame, samples: Array
    ) -> Outcome:
        """From the modes that squeal there, in samples of some numbers."""
        each = modes.groupby("sample")
        growth, damping = (
            column.reindex(samples, fill_value=0.0).to_numpy(float)
            for column in (each.real_1_s.max(), each.damping.min())
        )
        return cls(scope, where, frequency, growth, damping)

    @property
    def squeal(self) -> Array:
        """1 where it squeals, else 0."""
        return (self.growth > 0).astype(float)

    @property
    def median_damping(self) -> float | None:
        """Median of the damping where it squeals; None where it never does."""
        damping = self.damping[self.growth > 0]
        return float(np.median(damping)) if damping.size else None


@dataclass(frozen=True, slots=True)
class Ensemble:
    """Samples of one approach: inputs and outcomes.

    Attributes:
        approach: its name.
        names: random inputs.
        x: their values, shape (samples, inputs); nan where a sample failed.
        good: samples that ended well, shape (samples,).
        outcomes: bands, the whole one first, then families, the most severe first.
        threshold: a mode squeals where its damping lies below minus this.
        causes: what moves each outcome, in their order, once ``find_causes`` has filled it.
    """

    approach: str
    names: tuple[str, ...]
    x: Array
    good: Mask
    outcomes: tuple[Outcome, ...]
    threshold: float = 0.0
    causes: list[Causes] = field(default_factory=list)

    def place(self, o: Outcome) -> list[Any]:
        """First cells of a row of an outcome, see ``Place``."""
        return [self.approach, self.threshold, o.scope, o.where, o.frequency]


@dataclass(frozen=True, slots=True)
class Causes:
    """Which random inputs move an outcome.

    Attributes:
        growth: indices of its growth.
        squeal: indices of whether it squeals; None where that never changes.
        dominant: the input with the strongest rank correlation with squeal, or None.
        correlation: that correlation.
    """

    growth: Indices
    squeal: Indices | None
    dominant: str | None
    correlation: Correlation


def ensembles(run: RunData, band: Sequence[float]) -> list[Ensemble]:
    """Approaches of a run that have several samples with modes.

    Args:
        run: its samples and modes.
        band: the scene's band [Hz].
    """
    table, approaches = run.samples or {}, []
    for approach in dict.fromkeys(map(str, table["approach"])):
        rows = table["approach"] == approach
        numbers, good = table["sample"][rows], table["status"][rows] == "ok"
        if len(numbers) < 2 or not good.any():
            continue
        # Random inputs have the dotted keys of the scene; another approach may have more of them.
        inputs = {name: column[rows] for name, column in table.items() if "." in name}
        names = sorted(name for name, x in inputs.items() if np.isfinite(x).any())
        x = np.array([inputs[name] for name in names], float).T.reshape(good.size, len(names))
        outcomes = tuple(_outcomes(run, approach, band, numbers))
        approaches.append(Ensemble(approach, tuple(names), x, good, outcomes, run.threshold))
    return approaches


def _outcomes(
    run: RunData, approach: str, band: Sequence[float], samples: Array
) -> Iterator[Outcome]:
    """The whole band, its parts, and the most severe families."""
    table, modes = run.squeal, run.squeal.squeal_modes(approach)
    place, edges = table.bands(approach), table.edges
    whole = f"{band[0]:.0f}-{band[1]:.0f}"
    yield Outcome.of("band", whole, 0.5 * (band[0] + band[1]), modes, samples)
    for j, (low, high) in enumerate(pairwise(map(float, edges))):
        where = f"{low:.0f}-{high:.0f}"
        yield Outcome.of("band", where, 0.5 * (low + high), modes[place == j], samples)
    known = [f for f in table.families(approach) if f.key >= 0]
    for f in known[:MOST_FAMILIES]:
        family_modes = table.squeal_modes(approach, f.key)
        yield Outcome.of("family", str(f.key), f.frequency, family_modes, samples)


def find_causes(samples: Samples, approaches: Sequence[Ensemble], comm: MPI.Comm) -> None:
    """Fill in what moves each outcome, the outcomes shared by the processes; collective.

    Args:
        samples: the scene's [samples].
        approaches: samples of each approach.
        comm: the processes.
    """
    every = [(e, o) for e in approaches for o in e.outcomes]
    for e in approaches:
        e.causes.clear()
    causes = in_turns(len(every), lambda i: _causes(samples, *every[i]), comm)
    for (e, _), cause in zip(every, causes, strict=True):
        e.causes.append(cause)


def _causes(samples: Samples, e: Ensemble, o: Outcome) -> Causes:
    plan, hits = samples.plan(e.approach), o.squeal[e.good]
    squeal = None if np.ptp(hits) == 0 else indices(plan, e.x, o.squeal, e.good)
    best, strongest = None, Correlation(np.nan, np.nan, np.nan)
    for name, values in zip(e.names, e.x[e.good].T, strict=True):
        c = rank_correlation(values, hits)
        if np.isfinite(c.rho) and (best is None or abs(c.rho) > abs(strongest.rho)):
            best, strongest = name, c
    return Causes(indices(plan, e.x, o.growth, e.good), squeal, best, strongest)


def cause_tables(samples: Samples, approaches: Sequence[Ensemble]) -> dict[str, RowTable]:
    """The three tables by name; sensitivity only where some approach has random inputs.

    Args:
        samples: the scene's [samples].
        approaches: samples of each approach, with their causes.
    """
    tables = {
        "probabilities": RowTable.of(Probability, probability_rows(samples, approaches)),
        "convergence": RowTable.of(Convergence, convergence_rows(samples, approaches)),
    }
    if any(e.names for e in approaches):
        tables["sensitivity"] = RowTable.of(Sensitivity, sensitivity_rows(approaches))
    return tables


def sensitivity_rows(approaches: Sequence[Ensemble]) -> Iterator[Sensitivity]:
    """Rows of sensitivity.csv; outcomes that never change have none.

    Args:
        approaches: samples of each approach, with their causes.
    """
    for e in approaches:
        for o, cause in zip(e.outcomes, e.causes, strict=True):
            for name, x in (("growth", cause.growth), ("squeal", cause.squeal)):
                if x is None or np.ptp(o.growth[e.good]) == 0:
                    continue
                for i, key in enumerate((*e.names, ROUGHNESS)[: x.first.size]):
                    first = _interval(x.first[i], x.first_half[i])
                    total = _interval(x.total[i], x.total_half[i])
                    counts = [x.method, x.used, x.filled]
                    yield Sensitivity.of(*e.place(o), name, key, *first, *total, *counts)


def _interval(value: float, half: float) -> list[float | None]:
    """Value and interval; empty cells where there is none."""
    numbers = (value, value - half, value + half)
    return [float(v) if np.isfinite(v) else None for v in numbers]


def probability_rows(samples: Samples, approaches: Sequence[Ensemble]) -> Iterator[Probability]:
    """Rows of probabilities.csv.

    Args:
        samples: the scene's [samples].
        approaches: samples of each approach, with their causes.
    """
    for e in approaches:
        for o, cause in zip(e.outcomes, e.causes, strict=True):
            hits = o.squeal[e.good]
            share = wilson(int(hits.sum()), hits.size)
            above = "yes" if share.low > samples.limit else "open"
            above = "no" if share.high < samples.limit else above
            severity = share.value * abs(o.median_damping or 0.0)
            c = cause.correlation
            rho = (None, None, None) if cause.dominant is None else (c.rho, c.low, c.high)
            cells = (*share.cells, o.median_damping, severity, above, cause.dominant, *rho)
            counts = share.n, share.hits
            yield Probability.of(*e.place(o), *counts, *cells, *_shares(samples, cause.growth, e))


def _shares(samples: Samples, x: Indices, e: Ensemble) -> list[float | None]:
    """Shares of the variance by kind of input, and the rest; none of correlated inputs."""
    first = x.first[: len(e.names)]
    correlated = any(getattr(law, "correlation", ()) for law in samples.random.values())
    if not e.names or correlated or not np.isfinite(first).all():
        return [None] * (len(SHARES) + 1)
    kinds = [[n.startswith(start) for n in e.names] for start in SHARES]
    shares = [float(first[np.array(chosen)].sum()) for chosen in kinds]
    return [*shares, 1.0 - sum(shares)]


def convergence_rows(samples: Samples, approaches: Sequence[Ensemble]) -> Iterator[Convergence]:
    """Rows of convergence.csv: the first samples, twice as many, ...

    Rigid designs have no such beginnings: their samples mean something only all together.
    """
    for e in approaches:
        rigid = bool(e.names) and samples.plan(e.approach).design in RIGID
        whole = e.good.size
        counts = [10 * 2**k for k in range(32) if 10 * 2**k < whole and not rigid] + [whole]
        for o in e.outcomes:
            for n in counts:
                hits = o.squeal[:n][e.good[:n]]
                share = wilson(int(hits.sum()), hits.size)
                yield Convergence.of(*e.place(o), share.n, *share.cells)


def probability_facts(samples: Samples, approaches: Sequence[Ensemble]) -> dict[str, Any]:
    """Figures for the summary."""
    facts: dict[str, Any] = {
        "stable_modes": "count as growth 0 in every index",
        "limit": samples.limit,
    }
    for e in approaches:
        rows = [o for o in e.outcomes if o.scope == "family"]
        above = [o.where for o in rows if o.squeal[e.good].mean() > samples.limit]
        whole = e.outcomes[0].squeal[e.good]
        share = wilson(int(whole.sum()), whole.size)
        facts[e.approach] = {
            "threshold": e.threshold,
            "probability_of_any": share.value,
            "interval": share.cells[1:],
            "families_above_limit": above,
        }
    return facts

"""Tables of a study: which input moves what, what squeals how often, how both settle.

sensitivity.csv   first-order and total indices of every outcome for every random input
probabilities.csv probability of squeal of every band and family, its median damping and severity
                  (the product of both), who moves it, and the shares of the variance of its growth
convergence.csv   the probabilities after so many samples

Shares of the variance are sums of first-order indices: friction, materials, loads; what is left is
roughness (which has its own seed in every sample) together with all interactions. Without rough
contact it is interactions alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.scene.samples import Plan, Samples
from brake_fenicsx.squeal import wilson
from brake_fenicsx.tables import write_rows

from .designs import RIGID
from .outcomes import Ensemble, Outcome
from .sensitivity import Indices, indices, rank_correlation

Array = NDArray[np.float64]

WHERE = ("approach", "threshold", "scope", "where", "frequency_hz")
SENSITIVITY = (
    *WHERE, "outcome", "input", "first", "first_low", "first_high", "total", "total_low",
    "total_high", "method", "samples", "filled",
)  # fmt: skip
SHARES = {"friction": "contact.", "materials": "materials.", "loads": "loads."}
PROBABILITIES = (
    *WHERE, "samples", "squeal_samples", "probability", "low", "high", "median_damping", "severity",
    "above_limit", "dominant_input", "correlation", "correlation_low", "correlation_high",
    *(f"share_{name}" for name in SHARES), "share_rest",
)  # fmt: skip
CONVERGENCE = (*WHERE, "samples", "probability", "low", "high")


def write_causes(folder: Path, samples: Samples, found: Sequence[Ensemble]) -> dict[str, Any]:
    """Write the three tables; sensitivity.csv only where some approach has random inputs.

    Args:
        folder: the results folder.
        samples: the scene's [samples].
        found: samples of each approach.

    Returns:
        Figures for the summary.
    """
    write_rows(folder / "probabilities.csv", PROBABILITIES, probability_rows(samples, found))
    write_rows(folder / "convergence.csv", CONVERGENCE, convergence_rows(samples, found))
    if any(e.names for e in found):
        write_rows(folder / "sensitivity.csv", SENSITIVITY, sensitivity_rows(samples, found))
    return probability_facts(samples, found)


def _place(e: Ensemble, o: Outcome) -> list[Any]:
    return [e.approach, e.threshold, o.scope, o.where, o.frequency]


def _plan(samples: Samples, e: Ensemble) -> Plan:
    return samples.plan(e.approach)


def _indices(samples: Samples, e: Ensemble, y: Array) -> Indices:
    return indices(_plan(samples, e), e.x, y, e.good)


def _growth_indices(samples: Samples, e: Ensemble, o: Outcome) -> Indices:
    """Two tables need them, and their intervals take most of the time of both."""
    key = o.scope, o.where
    if key not in e.indices:
        e.indices[key] = _indices(samples, e, o.growth)
    return e.indices[key]


def sensitivity_rows(samples: Samples, found: Sequence[Ensemble]) -> Iterator[list[Any]]:
    """Rows of sensitivity.csv; outcomes that never change have none.

    Args:
        samples: the scene's [samples].
        found: samples of each approach.
    """
    for e in found:
        for o in e.outcomes:
            for name, y in (("growth", o.growth), ("squeal", o.squeal)):
                if not e.names or np.ptp(y[e.good]) == 0:
                    continue
                x = _growth_indices(samples, e, o) if name == "growth" else _indices(samples, e, y)
                for i, key in enumerate(e.names):
                    first = _interval(x.first[i], x.first_half[i])
                    total = _interval(x.total[i], x.total_half[i])
                    counts = [x.method, x.used, x.filled]
                    yield [*_place(e, o), name, key, *first, *total, *counts]


def _interval(value: float, half: float) -> list[float | None]:
    """Value and interval; empty cells where there is none."""
    numbers = (value, value - half, value + half)
    return [float(v) if np.isfinite(v) else None for v in numbers]


def probability_rows(samples: Samples, found: Sequence[Ensemble]) -> Iterator[list[Any]]:
    """Rows of probabilities.csv.

    ``above_limit`` says whether the probability lies above ``samples.limit``: yes or no where its
    whole interval does, else open. ``dominant_input`` is the input with the strongest rank
    correlation with squeal; a negative one means that larger values make stable.

    Args:
        samples: the scene's [samples].
        found: samples of each approach.
    """
    for e in found:
        for o in e.outcomes:
            hits = o.squeal[e.good]
            share = wilson(int(hits.sum()), hits.size)
            above = (
                "yes" if share.low > samples.limit else "no" if share.high < samples.limit
                else "open"
            )  # fmt: skip
            yield [
                *_place(e, o), share.n, share.hits, share.value, share.low, share.high,
                o.median_damping, o.severity(share.n), above,
                *_dominant_input(e, hits),
                *_shares(_growth_indices(samples, e, o), e),
            ]  # fmt: skip


def _dominant_input(e: Ensemble, hits: Array) -> list[Any]:
    best: list[Any] = [None, None, None, None]
    for i, name in enumerate(e.names):
        c = rank_correlation(e.x[e.good, i], hits)
        if np.isfinite(c.rho) and (best[0] is None or abs(c.rho) > abs(best[1])):
            best = [name, c.rho, c.low, c.high]
    return best


def _shares(x: Indices, e: Ensemble) -> list[float | None]:
    """Shares of the variance by kind of input, and the rest."""
    if not e.names or not np.isfinite(x.first).all():
        return [None] * (len(SHARES) + 1)
    own = [[n.startswith(start) for n in e.names] for start in SHARES.values()]
    shares = [float(x.first[np.array(chosen)].sum()) for chosen in own]
    return [*shares, 1.0 - sum(shares)]


def convergence_rows(samples: Samples, found: Sequence[Ensemble]) -> Iterator[list[Any]]:
    """Rows of convergence.csv: the first samples, twice as many, ...

    Rigid designs have no such beginnings: their samples mean something only all together.
    """
    for e in found:
        rigid = bool(e.names) and _plan(samples, e).design in RIGID
        for o in e.outcomes:
            for n in [e.good.size] if rigid else _beginnings(e.good.size):
                hits = o.squeal[:n][e.good[:n]]
                share = wilson(int(hits.sum()), hits.size)
                value = share.value if share.n else None
                yield [*_place(e, o), share.n, value, share.low, share.high]


def _beginnings(n: int) -> list[int]:
    """10, 20, 40, ... and all."""
    found = []
    m = 10
    while m < n:
        found.append(m)
        m *= 2
    return [*found, n]


def probability_facts(samples: Samples, found: Sequence[Ensemble]) -> dict[str, Any]:
    """Figures for the summary."""
    facts: dict[str, Any] = {
        "stable_modes": "count as growth 0 in every index",
        "limit": samples.limit,
    }
    for e in found:
        rows = [o for o in e.outcomes if o.scope == "family"]
        above = [o.where for o in rows if o.squeal[e.good].mean() > samples.limit]
        whole = e.outcomes[0].squeal[e.good]
        share = wilson(int(whole.sum()), whole.size)
        facts[e.approach] = {
            "threshold": e.threshold,
            "probability_of_any": share.value, "interval": [share.low, share.high],
            "families_above_limit": above,
        }  # fmt: skip
    return facts

"""How much squeals at several limits of the damping -2 alpha / |omega|.

The limits are that of the scene (``stability.threshold``), the customary one of Abaqus, and zero:
every unstable mode, with nothing but the damping that the scene names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .ensemble_statistics import Proportion, wilson
from .run import RunData
from .squeal import squeals
from .tables import Row

USUAL = 0.01  # of the damping ratio -2 Re / |Im| that Abaqus prints


@dataclass(frozen=True, slots=True)
class LimitRow(Row):
    """A row of limits.csv: what squeals of an approach at a limit of the damping."""

    approach: str
    limit: str
    damping_below: float
    squeal_modes: int
    squeal_samples: int
    samples: int
    share: float | None
    share_low: float | None
    share_high: float | None


def share_cells(share: Proportion) -> list[float | None]:
    """A share and its interval; a single sample has a verdict, no share."""
    return share.cells if share.n > 1 else [None] * 3


def limits(run: RunData) -> dict[float, str]:
    """Limits of the damping without their minus, and what each one is; equal ones once.

    Args:
        run: the results; its threshold and the damping of the scene are read.
    """
    named = run.damping
    own = f" (damping of the scene: {named})" if named else " (the model has no damping)"
    texts: dict[float, list[str]] = {}
    for limit, text in (
        (run.threshold, "limit of the scene"),
        (USUAL, "customary limit in Abaqus"),
        (0.0, f"every unstable mode{own if named is not None else ''}"),
    ):
        texts.setdefault(limit, []).append(text)
    return {limit: "; ".join(said) for limit, said in texts.items()}


def limit_rows(run: RunData, approaches: Sequence[str] | None = None) -> list[LimitRow]:
    """One row for each approach and limit.

    Args:
        run: the results.
        approaches: names; all if None. One without a sample that ended well has no rows.
    """
    rows, modes = list[LimitRow](), run.modes
    for approach in run.approaches if approaches is None else approaches:
        n = run.squeal.good(approach).size
        if n == 0 or modes is None:
            continue
        for limit, text in limits(run).items():
            loud = run.squeal.of_good(approach) & squeals(modes, limit)
            hits = np.unique(modes["sample"][loud]).size
            share = share_cells(wilson(hits, n))
            counts = int(loud.sum()), hits, n
            rows.append(LimitRow.of(approach, text, -limit or 0.0, *counts, *share))
    return rows

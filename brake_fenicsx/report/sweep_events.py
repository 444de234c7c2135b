"""Events of a sweep as the figures show them: points of the branches, and windows of squeal."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.tables import Columns

# Kinds of lock_in.csv, as in sweeps.events, which the report does not import: it needs the solver.
MERGING, SPLITTING = "merging", "splitting"
ONSET, END, FROM_FIRST = "onset of squeal", "end of squeal", "squeals from the first value"
MOST = 3  # windows of one branch that are named

Curve = tuple[NDArray, NDArray, NDArray]


class SweepEvents:
    """Events of the scene's own brake in one approach.

    Attributes:
        threshold: a mode squeals where its damping lies below minus this.
    """

    def __init__(self, run: RunData, approach: str):
        """Choose the events of ``lock_in.csv``; none where the table is missing.

        Args:
            run: the results.
            approach: its name.
        """
        table = run.sweep.get("lock_in") or {}
        own = np.isnan(table["sample"]) & (table["approach"] == approach) if table else []
        self._table: Columns = {name: column[own] for name, column in table.items()}
        self.threshold = run.threshold

    def of(self, kind: str) -> Curve:
        """Values, frequencies [Hz] and branches of all events of a kind, shape (n,) each."""
        if not self._table:
            return np.empty(0), np.empty(0), np.empty(0, dtype=int)
        own = self._table["kind"] == kind
        return tuple(self._table[n][own] for n in ("value", "frequency_hz", "branch"))

    def curve(self, rows: Columns, branch: int) -> Curve:
        """Values, frequencies [Hz] and dampings of a branch, with those at its events.

        A branch passes minus the threshold where it begins or ends to squeal, and has the damping
        of its partner where both merge or split.

        Args:
            rows: of ``sweep.csv``, of one approach.
            branch: its number.

        Returns:
            Arrays of shape (n,), in the order of the sweep.
        """
        one = rows["branch"] == branch
        columns = [rows[name][one] for name in ("value", "frequency_hz", "damping")]
        falling = columns[0][-1] < columns[0][0]
        if self._table:
            kind, f = self._table["kind"], self._table["frequency_hz"]
            own = self._table["branch"] == branch
            crossing = own & np.isin(kind, (ONSET, END))
            merging = (own | (self._table["with_branch"] == branch)) & np.isin(
                kind, (MERGING, SPLITTING)
            )
            mean = -2 * self._table["real_1_s"] / (2 * np.pi * f)
            damping = np.where(crossing, -self.threshold, mean)
            new = crossing | merging
            added = (self._table["value"][new], f[new], damping[new])
            columns = [np.append(a, b) for a, b in zip(columns, added, strict=True)]
        order = np.argsort(-columns[0] if falling else columns[0], kind="stable")
        x, f, damping = (column[order] for column in columns)
        return x, f, damping

    def windows(self, branch: int, factor: float = 1.0) -> str:
        """Where a branch squeals, such as "14.88 kHz from 0.44 to 0.61"; empty without an event.

        Args:
            branch: its number.
            factor: of the values that are shown.

        Returns:
            The frequency at the first event, and the windows of values.
        """
        if not self._table:
            return ""
        own = (self._table["branch"] == branch) & np.isin(
            self._table["kind"], (ONSET, END, FROM_FIRST)
        )
        if not own.any():
            return ""
        windows: list[list[float]] = []
        for kind, x in zip(self._table["kind"][own], self._table["value"][own], strict=True):
            if kind != END:
                windows.append([factor * x])
            elif windows:
                windows[-1].append(factor * x)
            else:  # the branch entered the band with squeal
                windows.append([np.nan, factor * x])
        said = ", ".join(map(_window, windows[:MOST]))
        more = f" and {len(windows) - MOST} more" if len(windows) > MOST else ""
        return f"{self._table['frequency_hz'][own][0] / 1e3:.3f} kHz {said}{more}"


def _window(ends: list[float]) -> str:
    """One window, with as many digits as tell its ends apart."""
    digits = next(d for d in (3, 5, 7) if d == 7 or len({f"{x:.{d}g}" for x in ends}) == len(ends))
    words = ("from", "to")[: len(ends)]
    told = zip(words, ends, strict=True)
    return " ".join(f"{word} {x:.{digits}g}" for word, x in told if np.isfinite(x))

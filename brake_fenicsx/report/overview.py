"""The answer in words: the summary for the terminal, and what moves the probabilities."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.results.answer import approach_rows
from brake_fenicsx.results.limits import limit_rows
from brake_fenicsx.results.run import RunData, read_run
from brake_fenicsx.results.squeal import kilohertz
from brake_fenicsx.results.tables import Value, text_table


def cause_rows(run: RunData, most: int = 12) -> list[tuple[str, str, dict[str, Any]]]:
    """What is known of the squeal of the whole band and of the families, the most severe first.

    Args:
        run: the results.
        most: rows of each approach.

    Returns:
        Approach, where, and a row of probabilities.csv by its names; nan of an empty cell.
    """
    table = run.causes.get("probabilities")
    if table is None:
        return []
    every = [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]
    rows: list[tuple[str, str, dict[str, Any]]] = []
    for approach in run.approaches:
        own = [row for row in every if row["approach"] == approach]
        whole = [row for row in own if row["scope"] == "band"][:1]
        families = [row for row in own if row["scope"] == "family" and row["squeal_samples"]]
        families.sort(key=lambda row: -row["severity"])
        texts = kilohertz([row["frequency_hz"] for row in families])
        names = ["whole band" for _ in whole]
        names += [f"{f} kHz, family {row['where']}" for f, row in zip(texts, families, strict=True)]
        pairs = zip(names, [*whole, *families], strict=True)
        rows += [(approach, where, row) for where, row in pairs][:most]
    return rows


def summary_table(run: RunData | str | Path) -> str:
    """The answer of a run as text for the terminal.

    Args:
        run: the results, or the run directory.

    Returns:
        What counts as squeal, a table with one line per approach, and one with what squeals at
        other limits of the damping.
    """
    run = read_run(run)
    said = f"squeal: unstable modes with {run.criterion} (stability.threshold)"
    heads = (
        "approach", "samples", "failed", "modes", "unstable", "neutral", "squeal modes",
        "squeal samples", "share", "most severe (squeal samples, median damping)",
    )  # fmt: skip
    rows: list[list[Value]] = [
        [run.label(r.approach), r.samples, r.failed, r.modes, r.unstable_modes, r.neutral_modes,
         r.squeal_modes, r.squeal_samples, share_text(r.share, r.share_low, r.share_high),
         r.most_severe]
        for r in approach_rows(run)
    ]  # fmt: skip
    limits: list[list[Value]] = [
        [run.label(r.approach), r.limit, r.damping_below, r.squeal_modes, r.squeal_samples,
         r.samples, share_text(r.share, r.share_low, r.share_high)]
        for r in limit_rows(run)
    ]  # fmt: skip
    names = "approach", "limit", "damping below", "squeal modes", "squeal samples", "samples"
    more = f"\n\n{text_table((*names, 'share'), limits)}" if limits else ""
    return f"{said}\n{text_table(heads, rows)}{more}"


def open_points(run: RunData) -> str:
    """What the computation itself leaves open, in one line; empty where it leaves nothing.

    Args:
        run: the results; ``samples`` of its summary is read, see ``uncertainty.results``.
    """
    facts = run.summary.get("samples")
    found = []
    for name, about in facts.items() if isinstance(facts, Mapping) else ():
        said = []
        if missed := about.get("tolerance_missed"):
            said.append(
                f"tolerance not reached: {missed} of {about['modes']} modes have an error estimate"
                f" above stability.tolerance, the largest {about['largest_error']:.1e} of |lambda|"
            )
        if unproven := about.get("not_complete"):
            said.append(
                f"in {unproven} of {about['good']} samples the number of modes is not proven, one"
                " may be missing"
            )
        if said:
            found.append(f"{run.label(name)}: {', '.join(said)}")
    return "; ".join(found) + " (samples.csv)" if found else ""


def share_text(*interval: Value) -> str:
    """A share with its interval in per cent, or a dash where there is none."""
    known = [100 * v for v in interval if isinstance(v, float) and np.isfinite(v)]
    return "{:.0f} % ({:.0f} to {:.0f} %)".format(*known) if len(known) == 3 else "-"

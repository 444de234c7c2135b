"""The answer in words: the summary for the terminal, and what moves the probabilities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from brake_fenicsx.results.answer import approach_rows
from brake_fenicsx.results.limits import limit_rows
from brake_fenicsx.results.run import RunData, read_run
from brake_fenicsx.results.squeal import kilohertz
from brake_fenicsx.results.tables import Value, read_columns, read_rows, text_table

CAUSE_COLUMNS = (
    "probability", "low", "high", "median_damping", "above_limit", "dominant_input", "correlation",
    "correlation_low", "correlation_high",
)  # fmt: skip


def cause_rows(run: RunData, most: int = 12) -> list[list[Value]]:
    """What probabilities.csv says of the whole band and of the families, the most severe first.

    Args:
        run: the results.
        most: rows of each approach.

    Returns:
        Approach, where, probability with its interval, median damping of the samples that squeal,
        whether the probability is above the limit, the input that moves it most, its rank
        correlation with interval, shares of the variance of growth by friction, materials, loads
        and the rest.

    Raises:
        SceneError: a column is missing.
    """
    path = run.directory / "probabilities.csv"
    if not path.is_file():
        return []
    read_columns(path, (*CAUSE_COLUMNS, "squeal_samples", "severity"))
    found = [row for row in read_rows(path) if row["scope"] in ("band", "family")]
    rows: list[list[Value]] = []
    for approach in run.approaches:
        own = [row for row in found if row["approach"] == approach]
        whole = [row for row in own if row["scope"] == "band"][:1]
        families = [row for row in own if row["scope"] == "family" and row["squeal_samples"]]
        families.sort(key=lambda row: -_number(row["severity"]))
        texts = kilohertz([_number(row["frequency_hz"]) for row in families])
        names = ["whole band" for _ in whole]
        names += [f"{f} kHz, family {row['where']}" for f, row in zip(texts, families, strict=True)]
        for row, where in list(zip([*whole, *families], names, strict=True))[:most]:
            chosen = (*CAUSE_COLUMNS, *(name for name in row if name.startswith("share_")))
            rows.append([approach, where, *(row[name] for name in chosen)])
    return rows


def _number(value: Value) -> float:
    return float(value) if isinstance(value, int | float) else 0.0


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
    rows = [
        [run.label(str(row[0])), *row[1:6], *row[7:9], share_text(row[9:12]), row[12]]
        for row in approach_rows(run)
    ]
    limits = [[run.label(str(r[0])), *r[1:6], share_text(r[6:])] for r in limit_rows(run)]
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


def share_text(interval: Sequence[Value]) -> str:
    """A share with its interval in per cent, or a dash where there is none."""
    numbers = [float(v) for v in interval if isinstance(v, float)]
    if len(numbers) < 3:
        return "-"
    return f"{100 * numbers[0]:.0f} % ({100 * numbers[1]:.0f} to {100 * numbers[2]:.0f} %)"

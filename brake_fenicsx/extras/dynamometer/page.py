"""States on the page: the likeliest in a sentence, the matrix, occurrence and scores."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from brake_fenicsx.report.page_blocks import Block, Table, Text
from brake_fenicsx.report.style import new_figure
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.tables import Columns, rows_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NOTE = (
    "The same random samples stand in every state; a share is that of the samples with a mode that"
    " squeals. Stops with squeal are counted in per cent of all stops, as a dynamometer test does."
)
# Heading -> how a row of the table is written there.
OCCURRENCE = {
    "section": "{section}", "band [kHz]": "{from_hz:.3g} to {to_hz:.3g}", "stops": "{stops}",
    "predicted [%]": "{predicted_percent:.1f}", "measured [%]": "{measured_percent:.1f}",
}  # fmt: skip
SCORES = {
    "family": "{family}", "stops with squeal": "{events}", "hits": "{hits}", "misses": "{misses}",
    "false alarms": "{false_alarms}",
    "Brier score": "{brier:.3f} ({brier_low:.3f} to {brier_high:.3f})",
    "area of the ROC": "{roc_area:.2f} ({roc_area_low:.2f} to {roc_area_high:.2f})",
    "best threshold": "{threshold:.3g} ({threshold_low:.3g} to {threshold_high:.3g})",
    "note": "{said}",
}  # fmt: skip
PANELS = 8  # at most


def blocks(run: RunData) -> list[Block]:
    """The likeliest state in a sentence, states without modes, occurrence and scores."""
    states = _shown(run, "states")
    if not states["state"].size:
        return []
    failed = [
        f"state {row['state']} ({row['failed']}: {row['first_failure']})"
        for row in _rows(states) if row["failed"]
    ]  # fmt: skip
    said = f" Samples without modes: {', '.join(failed)}." if failed else ""
    found: list[Block] = [Text(f"{_likeliest(run, states)} {NOTE}{said}")]
    for name, heads in (("states_occurrence", OCCURRENCE), ("states_scores", SCORES)):
        if name in run.extras:
            rows = [_scaled(row) for row in _rows(_shown(run, name))]
            texts = [[form.format(**row) for form in heads.values()] for row in rows]
            cells = [["-" if "nan" in text else text for text in row] for row in texts]
            found.append(Table.without_empty([*heads], cells))
    return found


def draw_matrix(run: RunData) -> Figure | None:
    """Shares over temperature and pressure, a panel for each speed and direction."""
    if "states" not in run.extras or not run.extras["states"]["state"].size:
        return None
    states = _rows(_shown(run, "states"))
    for row in states:
        row |= {n: np.nan_to_num(row[n]) for n in ("pressure_pa", "speed", "temperature_degc")}
    speeds = [f"speed {row['speed']:g}, " if row["speed"] else "" for row in states]
    titles = [speed + row["direction"] for speed, row in zip(speeds, states, strict=True)]
    names = [*dict.fromkeys(titles)][:PANELS]
    ends = {n: sorted({row[n] for row in states}) for n in ("pressure_pa", "temperature_degc")}
    p, T = ends.values()
    figure, grid = new_figure(1, len(names), sharey=True)
    for axis, name in zip(grid[0], names, strict=True):
        values = np.full((len(p), len(T)), np.nan)
        for row in (row for row, title in zip(states, titles, strict=True) if title == name):
            i, j = p.index(row["pressure_pa"]), T.index(row["temperature_degc"])
            values[i, j] = 100 * row["share"]
            measured = 100 * row["measured_stops"] / row["stops"]
            text = f"{values[i, j]:.0f}" + ("" if np.isnan(measured) else f"\n({measured:.0f})")
            colour = "white" if values[i, j] > 60 else "black"
            axis.text(j, i, text, ha="center", va="center", fontsize=6.5, color=colour)
        image = axis.imshow(values, origin="lower", aspect="auto", vmin=0, vmax=100, cmap="Reds")
        axis.set_xticks(range(len(T)), [f"{t:g}" for t in T])
        axis.set_yticks(range(len(p)), [f"{x / 1e5:g}" for x in p])
        axis.set(title=name, xlabel="temperature [degC]")
    grid[0, 0].set_ylabel("pressure [bar]")
    figure.colorbar(image, ax=grid[0].tolist(), label="samples that squeal [%]")
    return figure


def _shown(run: RunData, name: str) -> Columns:
    """Rows of a table of the last approach, the one with most scatter."""
    table = run.extras[name]
    last = [a for a in run.approaches if a in run.extras["states"]["approach"]][-1:]
    return rows_of(table, np.isin(table["approach"], last))


def _rows(table: Columns) -> list[dict[str, Any]]:
    """Rows as mappings; a number that is not there is nan."""
    columns = (column.tolist() for column in table.values())
    return [dict(zip(table, row, strict=True)) for row in zip(*columns, strict=True)]


def _scaled(row: dict[str, Any]) -> dict[str, Any]:
    """A row for the page: frequencies in kHz, and all families by their name."""
    row = {n: v / 1e3 if n.endswith("_hz") else v for n, v in row.items()}
    return row | ({"family": "all"} if row.get("family", 0) < 0 else {})


def _likeliest(run: RunData, states: Columns) -> str:
    """The state in which most samples squeal, beside what was measured there."""
    row = max(_rows(states), key=lambda row: np.nan_to_num(row["share"]))
    if not row["share"] > 0:
        return "No state squeals."
    families = _rows(_shown(run, "states_families"))
    here = (family for family in families if family["state"] == row["state"])
    f = max(here, key=lambda family: family["squeal_samples"])["frequency_hz"] / 1e3
    axes = ("pressure_pa", 1e-5, "bar"), ("temperature_degc", 1.0, "degC")
    at = [f"{row[n] * x:.4g} {unit}" for n, x, unit in axes if np.isfinite(row[n])]
    text = (
        f"Squeal is likeliest at {', '.join([*at, row['direction']])} (state {row['state']}):"
        f" {f:.3f} kHz, {row['share']:.0%} ({row['share_low']:.0%} to {row['share_high']:.0%}) of"
        f" {row['samples']} samples"
    )
    stops = row["measured_stops"]
    return text + ("." if np.isnan(stops) else f"; {stops:.0f} of {row['stops']} stops measured.")

"""States on the page: where squeal is likeliest in a sentence, the matrix, the ROC, scores."""

from typing import Any

import numpy as np
import pandas as pd

from brake_fenicsx.report.page_blocks import Block, Table, Text
from brake_fenicsx.report.style import finish, new_figure
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.tables import show

from .outcomes import ALL, NONE, cells_of
from .states import Frame

NOTE = (
    " The same random samples stand in every state; a share is that of the samples with a mode that"
    " squeals. Stops with squeal are counted in per cent of all stops, as a dynamometer test does."
)
AXES = PRESSURE, SPEED, TEMPERATURE = "pressure_pa", "speed", "temperature_degc"
PANELS, ROWS, LINES = 4, 3, 6  # of the figures at most


def blocks(run: RunData) -> list[Block]:
    """Where squeal is likeliest in a sentence, states without modes, occurrence and scores."""
    states = _shown(run, "states")
    if states.empty:
        return []
    unit = "m/s" if run.in_effect("motion").get("direction") else "rad/s"
    lost = states[(states.family == ALL) & (states.failed > 0)].itertuples()
    texts = (f" State {s.state} fails {s.failed} times: {s.first_failure}" for s in lost)
    found: list[Block] = [Text(_likeliest(states, unit) + NOTE + "".join(texts))]
    for table in (_shown(run, "states_occurrence"), _shown(run, "states_scores")):
        for name in [n for n in table if f"{n}_low" in table]:
            ends = table[name], table.pop(f"{name}_low"), table.pop(f"{name}_high")
            cells = ["{} ({} to {})".format(*map(show, row)) for row in zip(*ends, strict=True)]
            table[name] = np.where(ends[0].isna(), "", cells)
        heads = [name.replace("_", " ") for name in table]
        found.append(Table.without_empty(heads, cells_of(table)))
    return found


def draw_matrix(run: RunData) -> Any:
    """Shares over temperature and pressure: a panel for each speed and direction, and family."""
    states = _shown(run, "states").fillna(dict.fromkeys(AXES, 0.0))
    if states.share.isna().all():
        return None
    states["measured"] = states.measured_stops / states.stops
    # All modes first: no family has a larger share.
    families = states.groupby("family", sort=False).share.max().nlargest(ROWS).index
    panels = [*states.groupby([SPEED, "direction"])][:PANELS]
    figure, grid = new_figure(len(families), len(panels), 1.1 + 1.9 * len(families), sharey=True)
    p, T = np.unique(states[PRESSURE]), np.unique(states[TEMPERATURE])
    for (i, j), axis in np.ndenumerate(grid):
        (speed, direction), own = panels[j]
        cells = own[own.family == families[i]].groupby([PRESSURE, TEMPERATURE])
        means = 100 * cells[["share", "measured"]].mean()
        share = means.share.unstack().reindex(index=p, columns=T)
        image = axis.imshow(share, origin="lower", aspect="auto", vmin=0, vmax=100, cmap="Reds")
        for at, predicted, measured in means.dropna(subset="share").itertuples():
            text = f"{predicted:.0f}" + f"\n({measured:.0f})" * (measured == measured)
            place = np.searchsorted(T, at[1]), np.searchsorted(p, at[0])
            colour = "white" if predicted > 60 else "black"
            axis.text(*place, text, ha="center", va="center", fontsize=6.5, color=colour)
        title = f"{_named(families[i])}, {direction}" + f", speed {speed:g}" * bool(speed)
        axis.set(title=title, xlabel="temperature [degC]", ylabel="pressure [bar]")
        axis.set_xticks(range(len(T)), [f"{t:g}" for t in T])
        axis.set_yticks(range(len(p)), [f"{x / 1e5:g}" for x in p])
        axis.label_outer()
    figure.colorbar(image, ax=grid, label="samples that squeal [%]")
    return figure


def draw_roc(run: RunData) -> Any:
    """The receiver operating characteristic of all modes, and of the families heard most."""
    states = _shown(run, "states")
    if states.measured_stops.isna().all():
        return None
    states["quiet"] = states.stops - states.measured_stops
    heard = states.groupby("family")[["quiet", "measured_stops"]].sum()
    figure, ((axis,),) = new_figure(1, 1, 3.6, 4.6)
    for family in heard[heard.min(axis=1) > 0].measured_stops.nlargest(LINES).index:
        own = states[states.family == family].groupby("share")[["quiet", "measured_stops"]].sum()
        x, y = (own[::-1].cumsum() / own.sum()).to_numpy().T
        axis.plot([0, *x], [0, *y], ".-", label=_named(family))
    axis.plot([0, 1], [0, 1], ":", color="grey", label="by chance")
    finish(axis, xlabel="share of quiet stops", ylabel="share of stops with squeal")
    axis.legend()
    return figure


def _named(family: str) -> str:
    return f"family {family}".replace("family all", "all modes")


def _shown(run: RunData, name: str) -> Frame:
    """Rows of a table of the approach that the verdict is about."""
    table = pd.DataFrame(run.extras.get(name, {"approach": []}))
    return table[table.approach == run.lead].drop(columns="approach")


def _likeliest(states: Frame, turns: str) -> str:
    """Where the likeliest family squeals at half its largest share or more: predicted, measured."""
    families = states[~states.family.isin([ALL, NONE])]
    if not families.share.max() > 0:
        return "No state squeals."
    own = families[families.family == families.family[families.share.idxmax()]]
    most, where = own[own.share >= own.share.max() / 2], list[str]()
    inside = own.direction.isin(most.direction)
    for name, size, unit in zip(AXES, (1e5, 1, 1), ("bar", turns, "degC"), strict=True):
        ends = most[name].agg(["min", "max"])
        if ends.notna().all():
            inside &= own[name].between(*ends)
            where.append(f"{' to '.join(dict.fromkeys(map(show, ends / size)))} {unit}")
    own, f, at = own[inside], most.frequency_hz.median() / 1e3, [*where, *most.direction.unique()]
    share, m, n = own.share.fillna(0) @ own.stops, own.measured_stops.sum(), own.stops.sum()
    heard = "" if own.measured_stops.isna().any() else f", {m:.0f} of {n} stops measured"
    return (
        f"Squeal is likeliest at {f:.3f} kHz, {', '.join(at)}: {100 * share / n:.0f} %"
        f" predicted{heard}."
    )

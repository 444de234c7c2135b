"""Tables of the states: how often each squeals, in which family, and in per cent of the stops."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from brake_fenicsx.folder.processes import on_first
from brake_fenicsx.results.ensemble_statistics import wilson
from brake_fenicsx.results.run import read_run
from brake_fenicsx.results.tables import RowTable
from brake_fenicsx.scene.digest import in_effect

from .matrix import AXES, Frame, read_matrix
from .outcomes import Outcomes, outcomes
from .scores import EVENTS, SCORES, Events, event_rows, read_events, score_rows

SHARE = ("squeal_samples", "share", "share_low", "share_high")
STATES = (
    "approach", "state", "pressure_pa", "speed", "temperature_degc", "direction", "section",
    "stops", "samples", "failed", "tolerance_missed", *SHARE, "measured_stops", "first_failure",
)  # fmt: skip
FAMILIES = ("approach", "state", "family", "frequency_hz", *SHARE)
OCCURRENCE = (
    "approach", "section", "from_hz", "to_hz", "stops", "predicted_percent", "measured_percent",
)  # fmt: skip
TEXTS = ("approach", "direction", "section", "first_failure", "said")


def compute(run: Any, study: Any) -> dict[str, RowTable]:
    """The tables of the states; collective."""
    made: dict[str, RowTable] = on_first(lambda: _tables(study), study.comm)
    return made


def _tables(study: Any) -> dict[str, RowTable]:
    scene, states = study.scene, read_matrix(study.scene)
    stored = read_run(study.store.directory, {"in_effect": in_effect(scene)}).stored
    events = read_events(scene, states) if scene.section("states").events else None
    makers: dict[str, Any] = {
        "states": (STATES, state_rows), "states_families": (FAMILIES, family_rows),
        "states_occurrence": (OCCURRENCE, occurrence_rows),
    }  # fmt: skip
    if events is not None:
        makers |= {"states_events": (EVENTS, event_rows), "states_scores": (SCORES, score_rows)}
    found = [*outcomes(stored)] if stored else []
    return {
        name: RowTable(names, [row for o in found for row in rows(o, scene, states, events)], TEXTS)
        for name, (names, rows) in makers.items()
    }


def state_rows(o: Outcomes, scene: Any, states: Frame, events: Events | None) -> Iterator[Any]:
    """Rows of states.csv of an approach; speed in rad/s or m/s, as the scene's motion."""
    hits = o.squeals(scene.stability.threshold)
    seen = [None] * len(states) if events is None else events.stops(states).tolist()
    for i, state in enumerate(states.to_dict("records")):
        yield [
            o.approach, i + 1, *map(state.get, AXES), state["direction"], state["section"],
            int(state["stops"]), int(o.samples[i]), int(o.failed[i]), int(o.missed[i]),
            int(hits[i]), *wilson(int(hits[i]), int(o.samples[i])).cells, seen[i], o.reasons[i],
        ]  # fmt: skip


def family_rows(o: Outcomes, scene: Any, *_: Any) -> Iterator[Any]:
    """Rows of states_families.csv of an approach: a family in a state where it squeals."""
    loud = o.modes[o.modes.damping < -scene.stability.threshold]
    for (state, family), own in loud.groupby(["state", "family"]):
        hits = own["sample"].nunique()
        share = hits, *wilson(hits, int(o.samples[state])).cells
        yield [o.approach, int(state) + 1, int(family), float(own.frequency.median()), *share]


def occurrence_rows(o: Outcomes, scene: Any, states: Frame, events: Events | None) -> Iterator[Any]:
    """Rows of states_occurrence.csv of an approach: per cent of the stops, by section and band."""
    last, bands = scene.stability.band[1], pairwise(scene.section("states").bands)
    loud = o.modes[o.modes.damping < -scene.stability.threshold]
    for low, high in [(0.0, np.inf), *bands]:
        own = loud[(loud.frequency >= low) & (loud.frequency < high)]
        stops = [np.nan_to_num(o.share(o.counted(own))) * states.stops]
        stops += [] if events is None else [events.stops(states, events.within(low, high))]
        for section in ["", *filter(None, states.section.unique())]:
            part = (states.section == section) | (section == "")
            n = int(states.stops[part].sum())
            percent = [100 * float(count[part].sum()) / n for count in stops]
            ends = low, min(high, last)
            yield [o.approach, section or "all", *ends, n, *percent, *[None] * (2 - len(stops))]

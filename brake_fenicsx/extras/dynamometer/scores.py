"""Predicted squeal beside stops that squealed: hits, Brier score, area of the ROC, best threshold.

A stop is a trial that squeals or not, and its state gives the predicted probability p. Intervals
are of 95 %, from the scatter of the stops alone. The Brier score is the mean of (p - y)^2 (G. W.
Brier, Monthly Weather Review 78, 1950, 1), linear in the number of squealing stops of each state,
which is binomial. The area of the ROC has the interval of DeLong, DeLong and Clarke-Pearson
(Biometrics 44, 1988, 837). The threshold is that of largest likelihood, its interval that of the
likelihood ratio (S. S. Wilks, Annals of Mathematical Statistics 9, 1938, 60).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from brake_fenicsx.errors import SceneError

from .matrix import AXES, Array, Frame, axis_units, read_columns
from .outcomes import Outcomes

EVENTS = (
    "approach", "event", "state", "frequency_hz", "level_db", "family", "family_frequency_hz",
    "families_within_tolerance", "predicted_share",
)  # fmt: skip
SCORES = (
    "approach", "family", "events", "hits", "misses", "false_alarms", "quiet", "brier",
    "brier_low", "brier_high", "roc_area", "roc_area_low", "roc_area_high", "threshold",
    "threshold_low", "threshold_high", "said",
)  # fmt: skip
ALL = -2  # in place of the number of a family; -1 are modes of none
Z, RATIO = 1.959964, 3.841459  # of 95 %: normal, and twice the logarithm of a likelihood ratio
FEWEST = 10  # stops with squeal, or without, below which scores tell little
GRID = 400  # thresholds that are tried
Interval = tuple[float | None, float | None, float | None]
NOTHING: Interval = (None, None, None)


@dataclass(frozen=True, slots=True)
class Events:
    """Stops that squealed.

    Attributes:
        table: columns state, from 0; stop, of which two events may be; frequency [Hz] and level
            [dB], nan where they are not known.
    """

    table: Frame

    def within(self, low: float, high: float) -> Any:
        """Which lie in a band of frequency [Hz]; without an end it holds unknown ones too."""
        f = self.table.frequency.fillna(low if np.isinf(high) else -1.0)
        return (f >= low) & (f < high)

    def stops(self, states: Frame, which: Any = slice(None)) -> Any:
        """Stops with one of some events in each state, shape (states,)."""
        pairs = self.table[which][["state", "stop"]].drop_duplicates()
        return np.bincount(pairs.state, minlength=len(states))


def read_events(scene: Any, states: Frame) -> Events:
    """The events of a scene.

    Raises:
        SceneError: file, line, value and remedy.
    """
    file, units = scene.section("states").events, axis_units(scene) | {"state": "", "level": ""}
    units |= {"direction": "text", "frequency": "Hz", "stop": "text"}
    table = read_columns(scene.path(file), units)
    same = np.ones((len(table), len(states)), bool)
    numbered = states.assign(state=states.index + 1)
    for column in [n for n in (*AXES, "direction", "state") if n in table and n in numbered]:
        given, known = table[column].to_numpy()[:, None], numbered[column].to_numpy()
        same &= given == known if column == "direction" else np.isclose(given, known, 1e-6)
    for i in np.flatnonzero(same.sum(axis=1) != 1):
        raise SceneError(
            f"{file}: line {i + 2}: is of {same[i].sum()} states; write the number of its state, or"
            " the pressure, speed, temperature and direction that tell it from others"
        )
    lacking = {"stop": np.arange(len(table)), "frequency": np.nan, "level": np.nan}
    table = table.assign(**{k: v for k, v in lacking.items() if k not in table})
    events = Events(table.assign(state=same.argmax(axis=1)))
    for k in np.flatnonzero(events.stops(states) > states.stops):
        raise SceneError(
            f"{file}: more stops of state {k + 1} squealed than its {states.stops[k]:g}; write its"
            " stops in the matrix, or name the stop of each event in a column stop"
        )
    return events


def match(events: Events, modes: Frame, tolerance: float) -> tuple[Any, Array, Any]:
    """Family of each event: the nearest in frequency within a tolerance.

    Args:
        events: the events.
        modes: those that squeal, see ``Outcomes``. The frequency of a family is its median in the
            state of the event or, where it does not squeal there, in all states.
        tolerance: [Hz].

    Returns:
        Number of the family, -1 for none; its frequency [Hz]; how many families lie within the
        tolerance, of which more than one cannot be told apart.
    """
    known = modes[modes.family >= 0]
    usual = known.groupby("family").frequency.median()
    here = known.groupby(["state", "family"]).frequency.median().unstack()
    at = here.reindex(events.table.state, columns=usual.index).fillna(usual).to_numpy()
    apart = np.abs(at - events.table.frequency.to_numpy()[:, None])
    near = np.where(apart <= tolerance, apart, np.inf)
    within, each = np.isfinite(near).sum(axis=1), np.arange(len(at))
    if not usual.size:
        return np.full(len(at), -1), np.full(len(at), np.nan), within
    j = near.argmin(axis=1)
    family = np.where(within > 0, usual.index.to_numpy()[j], -1)
    return family, np.where(within > 0, at[each, j], np.nan), within


def event_rows(o: Outcomes, scene: Any, states: Frame, events: Events) -> Iterator[Any]:
    """Rows of states_events.csv of an approach."""
    threshold, tolerance = scene.stability.threshold, scene.section("states").tolerance
    given = o.modes[o.modes.damping < -threshold], tolerance
    for i, (family, at, within) in enumerate(zip(*match(events, *given), strict=True)):
        event = events.table.iloc[i]
        share = o.share(o.squeals(threshold, family))[event.state] if within else np.nan
        numbers = (event.frequency, event.level, at, share)
        f, level, at, share = (float(x) if np.isfinite(x) else None for x in numbers)
        number = int(family) if within else None
        yield [o.approach, i + 1, int(event.state) + 1, f, level, number, at, int(within), share]


def score_rows(o: Outcomes, scene: Any, states: Frame, events: Events) -> Iterator[Any]:
    """Rows of states_scores.csv of an approach: all squeal (family -2), then each family.

    Squeal is predicted where its share is that of ``samples.limit`` or more.
    """
    threshold, tolerance = scene.stability.threshold, scene.section("states").tolerance
    loud, good = o.modes[o.modes.damping < -threshold], o.samples > 0
    matched = match(events, loud, tolerance)[0]
    for family in [ALL, *sorted(f for f in loud.family.unique() if f >= 0)]:
        every = family == ALL
        p = o.share(o.squeals(threshold, None if every else family))[good]
        m = events.stops(states, slice(None) if every else matched == family)[good]
        n = states.stops.to_numpy(int)[good]
        warned = p >= scene.samples.limit
        squealed, quiet, hits = int(m.sum()), int((n - m).sum()), int(m[warned].sum())
        alarms, few = int((n - m)[warned].sum()), min(squealed, quiet) < FEWEST
        said = f"{squealed} stops with squeal and {quiet} without tell little" if few else ""
        scores = *brier(p, n, m), *roc_area(p, n, m)
        best = best_threshold(o, n, m) if every and good.all() else NOTHING
        counts = squealed, hits, squealed - hits, alarms, quiet - alarms
        yield [o.approach, int(family), *counts, *scores, *best, said]


def brier(p: Array, n: Any, m: Any) -> tuple[float, float, float]:
    """Brier score with its interval.

    Args:
        p: predicted probability of each state.
        n: its stops.
        m: of these, those that squealed.
    """
    value = float(np.sum(n * p**2 + m * (1 - 2 * p)) / n.sum())
    q = (m + 0.5) / (n + 1)  # not certain, though all or none of few stops squealed
    half = Z * float(np.sqrt(np.sum((1 - 2 * p) ** 2 * n * q * (1 - q))) / n.sum())
    return value, value - half, value + half


def roc_area(p: Array, n: Any, m: Any) -> Interval:
    """Probability that a stop with squeal was given more than one without, with its interval.

    Arguments as of ``brier``; None without stops of both kinds.
    """
    quiet = n - m
    if not m.any() or not quiet.any():
        return NOTHING
    order = np.sign(p[:, None] - p) / 2 + 0.5
    loud, calm = order @ quiet / quiet.sum(), m @ order / m.sum()
    area = float(m @ loud / m.sum())
    spread = m @ (loud - area) ** 2 / m.sum() ** 2 + quiet @ (calm - area) ** 2 / quiet.sum() ** 2
    half = Z * float(np.sqrt(spread))
    return area, area - half, area + half


def best_threshold(o: Outcomes, n: Any, m: Any) -> Interval:
    """Threshold of damping of the largest likelihood, and its interval; None where all are alike.

    Args:
        o: modes of the samples.
        n: stops of each state.
        m: of these, those that squealed.
    """
    growth = np.unique(-o.modes.damping[o.modes.damping < 0])
    if not growth.size or not 0 < m.sum() < n.sum():
        return NOTHING
    steps = np.quantile(growth, np.linspace(0, 1, min(GRID, growth.size)))
    tried = np.array([0.0, *0.5 * (steps[1:] + steps[:-1])])
    worst = -o.modes.groupby(["state", "sample"]).damping.min()
    state, growth = worst.index.get_level_values(0).to_numpy(), worst.to_numpy()
    hits = [np.bincount(state[growth > x], minlength=len(o.samples)) for x in tried]
    shares = (np.array(hits) + 0.5) / (o.samples + 1.0)
    likely = np.log(shares) @ m + np.log(1 - shares) @ (n - m)
    inside = tried[2 * (likely.max() - likely) <= RATIO]
    return float(np.median(tried[likely == likely.max()])), float(inside[0]), float(inside[-1])

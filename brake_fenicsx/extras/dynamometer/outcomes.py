"""What becomes of samples and of stops in the states of a brake: shares, scores, tables.

Modes are those that grow, in a frame with the columns sample, state, family (its number as text, or
"none"), frequency_hz and damping; events are stops that squealed, see ``read_events``.

A stop is a trial that squeals or not, and its state gives the predicted probability p. The Brier
score is the mean of (p - y)^2 (G. W. Brier, Monthly Weather Review 78, 1950, 1). The area of the
receiver operating characteristic is the probability that a stop with squeal was given more than one
without (J. A. Hanley, B. J. McNeil, Radiology 143, 1982, 29). The threshold of damping is that of
the largest likelihood. Intervals are of 95 %, from the scatter of the stops alone: by a parametric
bootstrap (B. Efron, R. J. Tibshirani, An Introduction to the Bootstrap, 1993, chapter 6), that of
the threshold by the likelihood ratio (S. S. Wilks, Annals of Mathematical Statistics 9, 1938, 60).
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from brake_fenicsx.arguments import AnyArray, Array
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder import arrays, processes
from brake_fenicsx.results.ensemble_statistics import wilson
from brake_fenicsx.results.run import read_run
from brake_fenicsx.results.tables import RowTable
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.digest import in_effect

from .states import AXES, Frame, in_si, read_matrix, units_of_state

ALL, NONE = "all", "none"  # in place of the number of a family
EVENT = ["state", "stop", "frequency_hz", "level_db"]
# Columns of files -> those of tables.
UNITS = {"pressure": "pressure_pa", "temperature": "temperature_degc"}

Z, DRAWS = 1.959964, 300  # half an interval over the standard deviation, of so many draws
RATIO = 3.841459  # twice the logarithm of a likelihood ratio
FEWEST = 10  # stops with squeal, or without, below which scores tell little
GRID = 400  # thresholds that are tried
RATED = [f"{n}{end}" for n in ("brier", "roc_area", "threshold") for end in ("", "_low", "_high")]
COLUMNS = ["family", "events", "hits", "misses", "false_alarms", "quiet", *RATED, "note"]


def scores(families: Frame, samples: Any, modes: Frame, limit: float) -> Frame:
    """Scores of all modes and of each family.

    Args:
        families: shares of samples and stops in each state, see ``by_family``.
        samples: that have modes in each state.
        modes: all that grow, of which the best threshold is told.
        limit: squeal is predicted in a state from this share on.

    Returns:
        Columns family; events, stops that squealed; hits and misses, of these; false_alarms and
        quiet, of the others; brier, roc_area and threshold, each with its interval; note.
    """
    rows, (tried, expected) = list[Any](), shares_by_threshold(modes, samples[samples > 0])
    named = families[(families.samples > 0) & (families.family != "none")]
    for family, own in named.groupby("family", sort=False):
        p, n, m = own[["share", "stops", "measured_stops"]].to_numpy(float).T
        warned, quiet = p >= limit, n - m
        counts = m, m[warned], m[~warned], quiet[warned], quiet[~warned]
        few = bool(min(m.sum(), quiet.sum()) < FEWEST)
        note = f"{m.sum():g} stops with squeal and {quiet.sum():g} without tell little" * few
        found = with_intervals(p, n, m, tried, expected)
        if rows or tried.size < 2:  # the threshold is one of all modes
            found[2] = np.nan
        rows.append([family, *(int(x.sum()) for x in counts), *found.ravel(), note])
    return pd.DataFrame(rows, columns=COLUMNS)


def rated(p: Array, n: Array, m: AnyArray) -> Array:
    """Brier score and area of the ROC, nan without stops of both kinds; shape (2, ...).

    Args:
        p: predicted probability of each state.
        n: its stops.
        m: of these, those that squealed, shape (..., states).
    """
    quiet, (level, which) = n - m, np.unique(p, return_inverse=True)
    loud, calm = (x @ np.eye(level.size)[which] for x in (m, quiet))
    above = np.tri(level.size, k=-1) + np.eye(level.size) / 2
    with np.errstate(invalid="ignore"):
        area = np.sum((loud @ above) * calm, axis=-1) / (m.sum(axis=-1) * quiet.sum(axis=-1))
    return np.array([np.sum(n * p**2 + m * (1 - 2 * p), axis=-1) / n.sum(), area])


def with_intervals(p: Array, n: Array, m: Array, tried: Array, expected: Array) -> Array:
    """Both, and the threshold of the largest likelihood, with their intervals, shape (3, 3).

    Args:
        p: predicted probability of each state.
        n: its stops.
        m: of these, those that squealed; where all or none did, that is not taken as certain.
        tried: thresholds.
        expected: shares of squeal that they predict, see ``shares_by_threshold``.
    """
    value, rng = rated(p, n, m), np.random.default_rng(0)
    draws = rng.binomial(n.astype(int), (m + 0.5) / (n + 1), (DRAWS, n.size))
    half = Z * np.nanstd(rated(p, n, draws), axis=1)
    likely = np.log(expected) @ m + np.log(1 - expected) @ (n - m)
    inside = tried[likely.max() - likely <= RATIO / 2]
    best = np.array([np.median(tried[likely == likely.max()]), inside[0], inside[-1]])
    ends = np.clip([value, value - half, value + half], 0, 1).T
    return np.array([*ends, np.where(np.isfinite(value[1]), best, np.nan)])


def shares_by_threshold(modes: Frame, samples: Any) -> tuple[Array, Array]:
    """Thresholds of damping that are tried, and the share of squeal that each predicts.

    Args:
        modes: that grow.
        samples: that have modes, by state.

    Returns:
        Thresholds, rising, and shares that are neither 0 nor 1, shape (thresholds, states).
    """
    growth = -modes.groupby(["state", "sample"]).damping.min()
    steps = growth.quantile(np.linspace(0, 1, GRID)).dropna()
    tried = np.unique([0.0, *steps.rolling(2).mean().dropna()])
    beyond = (growth[growth > x].groupby("state").size() for x in tried)
    counts = np.array([each.reindex(samples.index, fill_value=0) for each in beyond])
    return tried, (counts + 0.5) / (samples.to_numpy() + 1.0)


def read_events(scene: Scene, states: Frame) -> Frame:
    """The stops that squealed; none without the file ``states.events``.

    Args:
        scene: the scene.
        states: its states.

    Returns:
        Columns state, from 1; stop, of which two events may be; frequency_hz and level_db, nan
        where they are not known.

    Raises:
        SceneError: file, line, value and remedy.
    """
    if not (file := scene.section("states").events):
        return pd.DataFrame(columns=EVENT, dtype=float)
    units = units_of_state(scene, state="", frequency="Hz", stop=None, level="")
    table = arrays.TextTable.read(scene.path(file))
    given = in_si(table, units.__getitem__)
    known = states.assign(state=states.index)
    same = np.ones((len(given), len(states)), bool)
    for name in [n for n in (*AXES, "direction", "state") if n in given and n in known]:
        a, b = given[name].to_numpy()[:, None], known[name].to_numpy()
        same &= a == b if name == "direction" else np.isclose(a, b, 1e-6)
    for i in np.flatnonzero(same.sum(axis=1) != 1):
        text = f"is of {same[i].sum()} states; write the number of its state, or all that tells it"
        raise SceneError(f"{file}: line {table.lines[int(i)]}: {text}")
    rest = {"stop": given.index, "frequency": np.nan, "level": np.nan} | dict(given)
    found = given.assign(**{**rest, "state": same.argmax(axis=1) + 1})
    stops = found.groupby("state").stop.nunique()
    for k in stops.index[stops > states.stops[stops.index]]:
        text = f"has {states.stops[k]}; name the stop of each event in a column stop"
        raise SceneError(f"{file}: more stops of state {k} squealed than it {text}")
    return found.rename(columns={"frequency": "frequency_hz", "level": "level_db"})[EVENT]


def match(events: Frame, modes: Frame, tolerance: float) -> Frame:
    """Events with the family of each: the nearest in frequency within a tolerance.

    Args:
        events: the events.
        modes: those that squeal. The frequency of a family is its median in the state of the event
            or, where it does not squeal there, in all states.
        tolerance: [Hz].

    Returns:
        The events with the columns family, perhaps "none"; family_frequency_hz; and
        families_within_tolerance, of which more than one cannot be told apart.
    """
    known = modes[modes.family != NONE]
    usual = known.groupby("family").frequency_hz.median()
    here = known.groupby(["state", "family"]).frequency_hz.median().unstack()
    at = here.reindex(events.state, columns=usual.index).fillna(usual).assign(**{NONE: np.nan})
    apart = np.abs(at.to_numpy() - events.frequency_hz.to_numpy()[:, None])
    near = np.where(apart <= tolerance, apart, np.inf)
    near[:, -1] = np.finfo(float).max
    nearest = near.argmin(axis=1)
    found = events.assign(family=at.columns[nearest].astype(str))
    found["family_frequency_hz"] = at.to_numpy()[np.arange(len(at)), nearest]
    return found.assign(families_within_tolerance=(apart <= tolerance).sum(axis=1))


def shares(states: Frame, modes: Frame, events: Frame, name: str, keys: Iterable[Any]) -> Frame:
    """Samples and stops that squeal in each state.

    Args:
        states: of the brake, see ``read_matrix``, with the column samples, those that have modes.
        modes: that squeal.
        events: stops that squealed.
        name: column of modes and events.
        keys: its values; those of all modes and events, "all", come first.

    Returns:
        For each key the columns of the states, with frequency_hz, the median of the modes that
        squeal there, squeal_samples, share, share_low, share_high, and measured_stops, nan without
        events.
    """
    rows = pd.MultiIndex.from_product([[ALL, *keys], states.index], names=[name, "state"])
    doubled = (pd.concat([t.assign(**{name: ALL}), t]) for t in (modes, events))
    squeal, heard = (t.groupby([name, "state"], sort=False) for t in doubled)
    found = states.reindex(rows, level="state").assign(frequency_hz=squeal.frequency_hz.median())
    found["squeal_samples"] = squeal["sample"].nunique().reindex(rows, fill_value=0)
    cells = [wilson(*pair).cells for pair in zip(found.squeal_samples, found.samples, strict=True)]
    found[["share", "share_low", "share_high"]] = np.array(cells, float)
    stops = heard.stop.nunique().reindex(rows, fill_value=0)
    return found.assign(measured_stops=stops if len(events) else np.nan).reset_index()


def by_family(states: Frame, modes: Frame, events: Frame) -> Frame:
    """Shares of all modes, of each family that squeals, and of modes without one, "none"."""
    families = sorted({*modes.family}, key=lambda f: (f == NONE, len(f), f))
    return shares(states, modes, events, "family", families)


def occurrence(
    states: Frame, modes: Frame, events: Frame, bands: Sequence[float], end: float
) -> Frame:
    """Per cent of the stops that squeal, by section and by band, between these frequencies [Hz].

    The first band is the whole one up to its end, which holds events of unknown frequency too.
    """
    modes, events = (t.assign(band=np.digitize(t.frequency_hz, bands)) for t in (modes, events))
    every = shares(states, modes, events, "band", range(1, len(bands)))
    ends: dict[Any, Any] = {ALL: (0.0, end), **dict(enumerate(pairwise(bands), 1))}
    every[["from_hz", "to_hz"]] = [ends[band] for band in every.band]
    every["predicted_percent"] = 100 * every.share.fillna(0) * every.stops
    every["measured_percent"] = 100 * every.measured_stops
    every = pd.concat([every.assign(section=ALL), every[every.section != ""]])
    groups = every.groupby(["section", "from_hz", "to_hz"], sort=False)
    sums = groups[["stops", "predicted_percent", "measured_percent"]].sum(min_count=1)
    return sums.assign(**sums.iloc[:, 1:].div(sums.stops, axis=0)).reset_index()


def outcomes(stored: Any, states: Frame) -> Iterator[tuple[str, Frame, Frame]]:
    """What the stored samples say of the states.

    Args:
        stored: the samples.
        states: of the brake.

    Yields:
        Approach; the states with the columns samples, those that have modes; failed, those that
        have none; tolerance_missed, modes beyond the tolerance; and first_failure, why the first
        of them failed; modes that grow.
    """
    groups = dict[str, list[Any]]()
    for (approach, _), data, family in stored.with_arrays("state_"):
        modes = pd.DataFrame({"state": data["state_of"], "damping": data["state_damping"]})
        modes["family"] = np.array([*map(str, family), NONE])[data["state_mode"]]
        modes["frequency_hz"] = data["state_s"].imag / (2 * np.pi)
        groups.setdefault(approach, []).append((modes, data["state_outcome"], data["state_missed"]))
    for approach, group in groups.items():
        tables, texts, missed = zip(*group, strict=True)
        said = pd.DataFrame(texts, columns=states.index)
        found = states.assign(samples=(said == "").sum(), failed=(said != "").sum())
        found["tolerance_missed"] = sum(missed)
        found["first_failure"] = said.apply(lambda own: next(filter(None, own), ""))
        modes = pd.concat(tables, keys=range(len(group)), names=["sample"])
        yield approach, found, modes.reset_index("sample")


def compute(run: Any, study: Any) -> dict[str, RowTable]:
    """The tables of the states; collective."""
    return processes.on_first(lambda: _tables(study.scene, study.store), study.comm)


def _tables(scene: Any, store: Any) -> dict[str, RowTable]:
    table, states, parts = scene.section("states"), read_matrix(scene), dict[str, list[Frame]]()
    events = read_events(scene, states)
    stored = read_run(store.directory, {"in_effect": in_effect(scene)}).stored
    for approach, found, every in outcomes(stored, states) if stored else ():
        modes = every[every.damping < -scene.stability.threshold]
        heard = match(events, modes, table.tolerance)
        families = by_family(found, modes, heard)
        per_band = occurrence(found, modes, heard, table.bands, scene.stability.band[1])
        made = {"states": families, "states_occurrence": per_band}
        if len(events):
            share = families[["state", "family", "share"]]
            made["states_events"] = heard.merge(share, "left", ["state", "family"])
            made["states_scores"] = scores(families, found.samples, every, scene.samples.limit)
        for name, frame in made.items():
            frame.insert(0, "approach", approach)
            parts.setdefault(name, []).append(frame.rename(columns=UNITS))
    frames = {name: pd.concat(each) for name, each in parts.items()}
    return {name: RowTable(frame.columns, cells_of(frame)) for name, frame in frames.items()}


def cells_of(frame: Frame) -> Any:
    """Cells of a frame by rows, None where there is no number."""
    return frame.astype(object).where(frame.notna(), None).to_numpy().tolist()

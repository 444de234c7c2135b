"""Scores against what they must be where the events are drawn from the predictions themselves."""

import numpy as np
import pandas as pd
import pytest

from brake_fenicsx.extras.dynamometer.outcomes import (
    EVENT,
    by_family,
    match,
    occurrence,
    scores,
    shares_by_threshold,
    with_intervals,
)

DRAWS, SAMPLES, STATES = 200, 100, 12


def growing(rows):
    """Growing modes, of samples in states."""
    modes = pd.DataFrame(rows, columns=["sample", "state", "family", "frequency_hz", "damping"])
    return modes.astype({"family": str})


def brake(states, stops, samples=SAMPLES):
    """States of a brake, all of whose samples have modes."""
    numbers = pd.RangeIndex(1, states + 1)
    return pd.DataFrame({"stops": stops, "samples": samples, "section": ""}, numbers)


def events(*rows):
    """Stops that squealed."""
    return pd.DataFrame(rows, columns=EVENT, dtype=float)


@pytest.fixture(scope="module")
def model():
    """Modes whose growth rises from state to state; shares at the threshold 0.006, and of all."""
    rng = np.random.default_rng(5)
    modes = growing([
        (k, i, 0, 2000.0, -g) for i in range(1, STATES + 1)
        for k, g in enumerate(rng.exponential(0.002 + 0.001 * i, SAMPLES))
    ])  # fmt: skip
    states = brake(STATES, 20)
    loud = modes[modes.damping < -0.006]
    p = by_family(states, loud, match(events(), loud, 1.0))[:STATES].share.to_numpy()
    return p, shares_by_threshold(modes, states.samples)


def test_intervals_hold_the_scores_of_events_drawn_from_the_model(model):
    """200 draws: Brier score, area of the ROC and threshold lie within their intervals."""
    (p, tried), rng, n = model, np.random.default_rng(1), np.full(STATES, 20.0)
    order = np.sign(p[:, None] - p) / 2 + 0.5
    area = p @ order @ (1 - p) / (p.sum() * (1 - p).sum())
    true, held = np.array([np.mean(p * (1 - p)), area, 0.006]), np.zeros(3)
    for _ in range(DRAWS):
        _, low, high = with_intervals(p, n, rng.binomial(20, p).astype(float), *tried).T
        held += (low <= true) & (true <= high)
    assert np.all((held >= 0.90 * DRAWS) & (held <= 0.98 * DRAWS)), held / DRAWS


def test_scores_by_hand():
    p, n, m = np.array([0.9, 0.1]), np.full(2, 2.0), np.array([2.0, 0.0])
    none = np.zeros(1), np.full((1, 2), 0.5)
    assert with_intervals(p, n, m, *none)[:2, 0] == pytest.approx([0.01, 1.0])
    assert with_intervals(p, n, n - m, *none)[1, 0] == 0.0
    assert with_intervals(np.full(2, 0.5), n, m, *none)[1, 0] == 0.5


@pytest.mark.hard
@pytest.mark.parametrize("squealed", [0.0, 20.0])
def test_no_event_at_all_and_every_stop_an_event(squealed, model):
    """Neither tells an area of the ROC nor a threshold; the Brier score is known all the same."""
    p, n = np.full(STATES, 0.5), np.full(STATES, 20.0)
    found = with_intervals(p, n, np.full(STATES, squealed), *model[1])
    assert np.isnan(found[1:]).all()
    value, low, high = found[0]
    assert low <= value == 0.25 <= high


@pytest.mark.hard
def test_two_families_closer_than_the_tolerance_are_counted():
    """An event between two families is matched with the nearer one, and both are counted."""
    modes = growing([
        (0, 1, 1, 2000.0, -0.1), (0, 1, 2, 2080.0, -0.1), (0, 2, 3, 5000.0, -0.1),
    ])  # fmt: skip
    heard = events((1, 0, 2030.0, np.nan), (1, 1, 2070.0, 80.0), (1, 2, 4990.0, 80.0),
                   (2, 0, 3000.0, 80.0), (2, 1, np.nan, 80.0))  # fmt: skip
    found = match(heard, modes, 100.0)
    # The family of 5 kHz does not squeal in state 1: its frequency is that of the others.
    assert [*found.family] == ["1", "2", "3", "none", "none"]
    assert [*found.families_within_tolerance] == [2, 2, 1, 0, 0]
    at = [2000.0, 2080.0, 5000.0, np.nan, np.nan]
    np.testing.assert_allclose(found.family_frequency_hz, at)


@pytest.mark.hard
def test_events_match_nothing_where_nothing_squeals():
    """Without a mode that squeals an event has no family, and no state squeals."""
    none = growing([]).astype({"state": int, "frequency_hz": float})
    found = match(events((1, 0, 2030.0, 80.0)), none, 100.0)
    assert [*found.family] == ["none"] and found.family_frequency_hz.isna().all()
    shares = by_family(brake(2, 4), none, found)
    assert [*shares.share] == [0.0, 0.0] and [*shares.measured_stops] == [1, 0]


def test_hits_misses_and_false_alarms_by_hand():
    """State 1: all samples squeal, 3 of 4 stops do; state 2: none squeals, 1 of 4 stops does."""
    modes, states = growing([(k, 1, 7, 2000.0, -0.1) for k in range(SAMPLES)]), brake(2, 4)
    heard = events(*((1, i, 2010.0, 80.0) for i in range(3)), (2, 5, 3000.0, 80.0))
    heard = match(heard, modes, 100.0)
    found = scores(by_family(states, modes, heard), states.samples, modes, 0.5)
    counts = found.set_index("family")[["events", "hits", "misses", "false_alarms", "quiet"]]
    assert [*counts.loc["all"]] == [4, 3, 1, 1, 3] and [*counts.loc["7"]] == [3, 3, 0, 1, 4]
    assert found.note.str.contains("tell little").all()


def test_stops_are_counted_by_section_and_band():
    modes = growing([(k, 1, 7, 2000.0, -0.1) for k in range(50)])
    states, heard = brake(2, [4, 6]).assign(section=["a", "b"]), events((2, 0, 5e3, 80.0))
    found = occurrence(states, modes, match(heard, modes, 100.0), [1e3, 3e3, 9e3], 9e3)
    found = found.set_index(["section", "from_hz"])[["predicted_percent", "measured_percent"]]
    assert [*found.loc["all", 0.0]] == [20.0, 10.0] and [*found.loc["a", 1e3]] == [50.0, 0.0]
    np.testing.assert_allclose(found.loc["b", 3e3], [0.0, 100 / 6])

"""Scores against what they must be where the events are drawn from the predictions themselves."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from brake_fenicsx.extras.dynamometer.outcomes import Outcomes
from brake_fenicsx.extras.dynamometer.scores import (
    Events,
    best_threshold,
    brier,
    match,
    roc_area,
    score_rows,
)

DRAWS = 200


def growing(rows, samples=100, states=12):
    """Modes of the samples of an approach."""
    modes = pd.DataFrame(rows, columns=["sample", "state", "family", "frequency", "damping"])
    every = np.full(states, samples)
    return Outcomes("multi-scale", every, 0 * every, 0 * every, [""] * states, modes)


def random_modes(rng, states=12, samples=100):
    """One mode of each sample in each state, whose growth rises from state to state."""
    return growing([
        (k, i, 0, 2000.0, -g) for i in range(states)
        for k, g in enumerate(rng.exponential(0.002 + 0.001 * i, samples))
    ])  # fmt: skip


def test_intervals_hold_the_scores_of_events_drawn_from_the_model():
    """200 draws: Brier score, area of the ROC and threshold lie within their intervals."""
    rng = np.random.default_rng(5)
    o, n = random_modes(rng), np.full(12, 20)
    p = o.share(o.squeals(0.006))
    true_brier = np.mean(p * (1 - p))
    order = np.sign(p[:, None] - p) / 2 + 0.5
    true_area = p @ order @ (1 - p) / (p.sum() * (1 - p).sum())
    held = np.zeros(3)
    for _ in range(DRAWS):
        m = rng.binomial(n, p)
        found = brier(p, n, m), roc_area(p, n, m), best_threshold(o, n, m)
        for i, true in enumerate((true_brier, true_area, 0.006)):
            held[i] += found[i][1] <= true <= found[i][2]
    assert np.all((held >= 0.90 * DRAWS) & (held <= 0.995 * DRAWS)), held / DRAWS


def test_scores_by_hand():
    p, n, m = np.array([0.9, 0.1]), np.array([2, 2]), np.array([2, 0])
    assert brier(p, n, m)[0] == pytest.approx(0.01)
    assert roc_area(p, n, m)[0] == 1.0
    assert roc_area(p, n, n - m)[0] == 0.0
    assert roc_area(np.full(2, 0.5), n, m)[0] == 0.5


@pytest.mark.hard
@pytest.mark.parametrize("squealed", [0, 20])
def test_no_event_at_all_and_every_stop_an_event(squealed):
    """Neither tells an area of the ROC nor a threshold; the Brier score is known all the same."""
    o, n, m = random_modes(np.random.default_rng(1)), np.full(12, 20), np.full(12, squealed)
    assert roc_area(np.full(12, 0.5), n, m) == best_threshold(o, n, m) == (None, None, None)
    value, low, high = brier(np.full(12, 0.5), n, m)
    assert low <= value == 0.25 <= high


def events(*rows):
    return Events(pd.DataFrame(rows, columns=["state", "stop", "frequency", "level"]))


@pytest.mark.hard
def test_two_families_closer_than_the_tolerance_are_counted():
    """An event between two families is matched with the nearer one, and both are counted."""
    modes = growing(
        [(0, 0, 1, 2000.0, -0.1), (0, 0, 2, 2080.0, -0.1), (0, 1, 3, 5000.0, -0.1)]
    ).modes
    given = events((0, 0, 2030.0, np.nan), (0, 1, 2070.0, 80.0), (0, 2, 4990.0, 80.0),
                   (1, 0, 3000.0, 80.0), (1, 1, np.nan, 80.0))  # fmt: skip
    family, at, within = match(given, modes, 100.0)
    # The family of 5 kHz does not squeal in state 0: its frequency is that of the others.
    np.testing.assert_array_equal(family, [1, 2, 3, -1, -1])
    np.testing.assert_array_equal(within, [2, 2, 1, 0, 0])
    np.testing.assert_allclose(at, [2000.0, 2080.0, 5000.0, np.nan, np.nan])


def test_events_match_nothing_where_nothing_squeals():
    none = growing([]).modes.astype({"family": int, "state": int, "frequency": float})
    family, at, within = match(events((0, 0, 2030.0, 80.0)), none, 100.0)
    assert family == [-1] and np.isnan(at).all() and within == [0]


def test_hits_misses_and_false_alarms_by_hand():
    """State 0: all samples squeal, 3 of 4 stops do; state 1: none squeals, 1 of 4 stops does."""
    o = growing([(k, 0, 7, 2000.0, -0.1) for k in range(100)], states=2)
    scene = SimpleNamespace(
        stability=SimpleNamespace(threshold=0.0), samples=SimpleNamespace(limit=0.5),
        section=lambda name: SimpleNamespace(tolerance=100.0),
    )  # fmt: skip
    states = pd.DataFrame({"stops": [4, 4]})
    given = events(*((0, i, 2010.0, 80.0) for i in range(3)), (1, 5, 3000.0, 80.0))
    every, family = score_rows(o, scene, states, given)
    assert every[1:7] == [-2, 4, 3, 1, 1, 3]
    assert family[1:7] == [7, 3, 3, 0, 1, 4]
    assert "tell little" in every[-1]

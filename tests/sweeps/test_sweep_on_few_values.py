"""Sweeps on the vectors of a few values, against full evaluation of every value."""

import numpy as np
import pytest

from brake_fenicsx import prepare
from brake_fenicsx.sweeps.branches import follow
from brake_fenicsx.sweeps.events import END, ONSET, find_events
from brake_fenicsx.sweeps.matching import Points
from coarse_block import BLOCK, SWEPT

KEY, LAST = "contact.block_plate.friction", 0.8


@pytest.fixture(scope="module")
def model():
    return prepare(BLOCK, SWEPT)


def points(model, task, full=False):
    """Modes over friction; ``full``: each value alone."""
    if not full:
        return Points(model.study, task, KEY, ends=(0.0, LAST))
    solve = Points(model.study, task, KEY)
    solve.line = None
    return solve


def events(model, task, steps, full=False, tolerance=1e-4, onsets=False):
    """Events between evenly spaced values: kind and value; and how the values were computed."""
    solve, stability = points(model, task, full), model.scene.stability
    values = np.linspace(0.0, LAST, steps).tolist()
    followed = follow(solve, values, stability.band)
    found = find_events(followed, solve, stability.threshold, tolerance, onsets)
    return [(e.kind, e.x, e.s.imag) for e in found], solve.line


@pytest.mark.parametrize("approach", ["multi-scale", "classical"])
def test_each_value_is_within_its_estimate_of_full_evaluation(model, approach):
    """33 values of friction: rough contact that locks in, and perfect contact that opens."""
    full, near = points(model, (approach, 0), full=True), points(model, (approach, 0))
    contact, growing = set(), set()
    for x in np.linspace(0.0, LAST, 33):
        a, b = full(x), near(x)
        assert a.s.size == b.s.size
        assert np.all(np.abs(a.s - b.s) <= a.error + b.error)
        assert np.all(b.error <= 1e-4 * np.abs(b.s) * np.maximum(1, b.condition))
        contact.add(b.open)
        growing.add(int(np.sum(b.s.real > 0)))
    assert len(growing) > 1
    assert (len(contact) > 3) == (approach == "classical")
    assert near.line.projected > near.line.full


@pytest.mark.long
@pytest.mark.parametrize("approach", ["multi-scale", "classical"])
def test_events_are_those_of_161_values_in_full(model, approach):
    """Merging, splitting, onset and end of squeal: the same ones, to 1e-4 of the range."""
    reference, _ = events(model, (approach, 0), 161, full=True, tolerance=1e-6)
    assert len(reference) >= 6
    for steps in (11, 41):
        found, line = events(model, (approach, 0), steps)
        assert line.projected > 3 * line.full
        assert [kind for kind, *_ in found] == [kind for kind, *_ in reference]
        for (_, x, _), (_, wanted, _) in zip(found, reference, strict=True):
            assert abs(x - wanted) <= 1e-4 * LAST


@pytest.mark.long
def test_samples_miss_no_onset_but_of_windows_within_a_step(model):
    """Eleven values of each sample, and those between where modes meet, against 41 in full."""
    step = LAST / 10
    for k in range(2):
        every, _ = events(model, ("multi-scale", k), 41, full=True, tolerance=1e-6)
        found, _ = events(model, ("multi-scale", k), 11, onsets=True)
        onsets, ends, found = (
            [(x, omega) for kind, x, omega in some if kind == wanted]
            for some, wanted in ((every, ONSET), (every, END), (found, ONSET))
        )
        assert onsets and found
        for x, omega in onsets:
            own = [y for y, w in found if abs(w / omega - 1) < 1e-2]
            if not any(abs(x - y) <= 1e-4 * LAST for y in own):
                # The frequency of a window changes over it.
                end = min(y for y, w in ends if y > x and abs(w / omega - 1) < 5e-2)
                assert end // step == x // step


@pytest.mark.hard
def test_a_window_of_flutter_between_two_full_values(model):
    """Two modes merge and split within 0.3 % of the friction, far from both ends of the line."""
    solve = Points(model.study, ("multi-scale", 0), KEY, ends=(0.6, 0.72))
    followed = follow(solve, np.linspace(0.6, 0.72, 4).tolist(), model.scene.stability.band)
    found = [e for e in find_events(followed, solve, 1e-3, 1e-4) if 0.64 < e.x < 0.67]
    assert [e.kind for e in found] == ["merging", "onset of squeal", "end of squeal", "splitting"]
    assert solve.line.full <= 4
    merged, split = found[0].x, found[-1].x
    assert 0 < split - merged < 0.005
    alone = points(model, ("multi-scale", 0), full=True)
    width = 1e-4 * 0.12
    for x, inside in ((merged, 1), (split, -1)):
        growing = [int(np.sum(alone(x + side * width).s.real > 0)) for side in (-inside, inside)]
        assert growing[1] == growing[0] + 1


@pytest.mark.slow
def test_values_of_the_demo_brake_between_full_ones():
    """A sample of the demo brake: 17 values on the vectors of two."""
    demo = prepare(BLOCK.with_name("disc_brake_demo.toml"), ["micro.laws=10", "samples.n=2"])
    key = "contact.pad_disc.friction"
    near = Points(demo.study, ("multi-scale", 1), key, ends=(0.0, LAST))
    full = Points(demo.study, ("multi-scale", 1), key)
    full.line = None
    for x in np.linspace(0.0, LAST, 17):
        a, b = full(x), near(x)
        assert a.s.size == b.s.size
        assert np.all(np.abs(a.s - b.s) <= a.error + b.error)
    assert near.line.full <= 4

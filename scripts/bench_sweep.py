"""Sweeps of the demo brake over friction: values, solves, seconds, memory, error of the events.

    python scripts/bench_sweep.py events             merging points and onsets, by number of values
    python scripts/bench_sweep.py samples [NUMBER]   critical friction of rough samples (6)

Errors are distances to the events of 161 values computed in full and found to 1e-6 of the range,
the largest of all. The other rows are found on the vectors of a few values, or each value alone.
"""

import resource
import sys
import time
from pathlib import Path

import numpy as np

from brake_fenicsx import prepare
from brake_fenicsx.sweeps.branches import CUT, follow
from brake_fenicsx.sweeps.events import ONSET, find_events
from brake_fenicsx.sweeps.matching import Points
from brake_fenicsx.sweeps.sweep_study import FINE

DEMO = Path(__file__).parent / "scenes" / "disc_brake_demo.toml"
KEY, LAST = "contact.pad_disc.friction", 0.8


def memory():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def farthest(found, reference):
    """Largest distance of an event to the nearest one of its kind in the reference."""
    return max(
        (min((abs(e.x - r.x) for r in reference if r.kind == e.kind), default=np.inf)
         for e in found), default=0.0,
    )  # fmt: skip


class Prepared:
    """The demo brake with some samples."""

    def __init__(self, number):
        self.model = prepare(DEMO, [f"samples.n={number}", "micro.laws=40"])
        stability = self.model.scene.stability
        self.band, self.threshold = stability.band, stability.threshold

    def line(self, k, steps, tolerance=FINE, full=False, onsets=False):
        """Branches and events of a sample, values computed in full and on vectors, seconds."""
        ends = () if full else (0.0, LAST)
        solve = Points(self.model.study, ("multi-scale", k), KEY, ends=ends)
        line = solve.line
        if full:
            solve.line = None
        start = time.perf_counter()
        followed = follow(solve, np.linspace(0, LAST, steps).tolist(), self.band)
        between = time.perf_counter()
        found = find_events(followed, solve, self.threshold, tolerance, onsets)
        if onsets:
            found = [e for e in found if e.kind == ONSET]
        seconds = between - start, time.perf_counter() - between
        return followed, found, (line.full, line.projected), seconds


def events():
    brake = Prepared(2)
    _, reference, _, _ = brake.line(0, 161, 1e-6, full=True)
    print(
        "| values | each alone | modes in full | on vectors | cut | events | follow [s] |"
        " events [s] | error |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for steps, full in ((41, True), (11, False), (21, False), (41, False), (81, False)):
        followed, found, count, seconds = brake.line(0, steps, full=full)
        cut = sum(b.end == CUT for b in followed.branches)
        modes = (len(followed.states), 0) if full else count
        print(
            f"| {steps} | {'yes' if full else 'no'} | {modes[0]} | {modes[1]} | {cut} |"
            f" {len(found)} of {len(reference)} | {seconds[0]:.1f} | {seconds[1]:.1f} |"
            f" {farthest(found, reference):.1e} |", flush=True,
        )  # fmt: skip
    print(f"peak memory {memory():.2f} GB")


def missed(found, reference):
    """Onsets of a reference that have no other within 1 % of the range and of the frequency."""
    return sum(
        not any(
            abs(e.x - r.x) <= 0.01 * LAST and abs(e.s / r.s - 1) <= 0.01
            for e in found
        )
        for r in reference
    )  # fmt: skip


def samples(number):
    brake = Prepared(number)
    shown = [brake.line(k, 161, 1e-6, full=True, onsets=True)[1] for k in range(number)]
    print(
        "| values | each alone | modes in full per sample | on vectors | s per sample | onsets |"
        " missed | error |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for steps, full in ((11, True), (41, True), (6, False), (11, False), (21, False), (41, False)):
        modes, taken, onsets, lost, error = np.zeros(2), 0.0, 0, 0, 0.0
        for k in range(number):
            _, found, count, seconds = brake.line(k, steps, full=full, onsets=True)
            modes, taken, onsets = modes + count, taken + sum(seconds), onsets + len(found)
            lost += missed(found, shown[k])
            error = max(error, farthest(found, shown[k]))
        alone = "yes | all | 0" if full else "no | {:.1f} | {:.1f}".format(*modes / number)
        print(
            f"| {steps} | {alone} | {taken / number:.2f} | {onsets} of {sum(map(len, shown))} |"
            f" {lost} | {error:.1e} |", flush=True,
        )  # fmt: skip
    print(f"peak memory {memory():.2f} GB")


if __name__ == "__main__":
    if sys.argv[1:2] == ["events"]:
        events()
    elif sys.argv[1:2] == ["samples"]:
        samples(int(sys.argv[2]) if len(sys.argv) > 2 else 6)
    else:
        sys.exit(__doc__)

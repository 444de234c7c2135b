"""Sweeps of the demo brake over friction: values, solves, seconds, memory, error of the events.

    python scripts/bench_sweep.py events             merging points and onsets, by number of values
    python scripts/bench_sweep.py samples [NUMBER]   critical friction of rough samples (8)

Errors are distances to the events of 161 values found to 1e-6 of the range, the largest of all.
"""

import resource
import sys
import time
from pathlib import Path

import numpy as np

from brake_fenicsx import prepare
from brake_fenicsx.sweeps.branches import CUT, follow
from brake_fenicsx.sweeps.events import ONSET, find_events
from brake_fenicsx.sweeps.state import Points
from brake_fenicsx.sweeps.study import COARSE, FINE

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


def events():
    model = prepare(DEMO, ["samples.n=2", "micro.laws=40"])
    stability = model.scene.stability
    band, threshold = (stability.band[0], stability.band[1]), stability.threshold

    def line(steps, tolerance):
        solve = Points(model.study, ("multi-scale", 0), KEY)
        start = time.perf_counter()
        followed = follow(solve, np.linspace(0, LAST, steps).tolist(), band)
        between = time.perf_counter()
        found = find_events(followed, solve, threshold, tolerance)
        seconds = between - start, time.perf_counter() - between
        return followed, found, seconds

    _, reference, _ = line(161, 1e-6)
    print("| values | modes computed | branches | cut | events | follow [s] | events [s] | error |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for steps in (11, 21, 41, 81):
        followed, found, seconds = line(steps, FINE)
        cut = sum(b.end == CUT for b in followed.branches)
        print(
            f"| {steps} | {followed.solves} | {len(followed.branches)} | {cut} | {len(found)} of"
            f" {len(reference)} | {seconds[0]:.1f} | {seconds[1]:.1f} |"
            f" {farthest(found, reference):.1e} |", flush=True,
        )  # fmt: skip
    print(f"peak memory {memory():.2f} GB")


def samples(number):
    model = prepare(DEMO, [f"samples.n={number}", "micro.laws=40"])
    stability = model.scene.stability
    band, threshold = (stability.band[0], stability.band[1]), stability.threshold

    def loud(state):
        return (state.verdict == "unstable") & (state.damping < -threshold)

    print("| values | onsets | modes computed per sample | s per sample | missed | error |")
    print("| --- | --- | --- | --- | --- | --- |")
    full = []
    for k in range(number):
        solve = Points(model.study, ("multi-scale", k), KEY)
        followed = follow(solve, np.linspace(0, LAST, 41).tolist(), band)
        found = find_events(followed, solve, threshold, FINE, onsets_alone=True)
        full.append([e for e in found if e.kind == ONSET])
    for steps in (6, 11, 21):
        seconds, count, onsets, missed, error = 0.0, 0, 0, 0, 0.0
        for k in range(number):
            own = Points(model.study, ("multi-scale", k), KEY)
            solves = [0]

            def solve(x, own=own, solves=solves):
                solves[0] += 1
                return own(x)

            start = time.perf_counter()
            followed = follow(solve, np.linspace(0, LAST, steps).tolist(), band, loud)
            found = find_events(followed, solve, threshold, COARSE, onsets_alone=True)
            seconds += time.perf_counter() - start
            found = [e for e in found if e.kind == ONSET]
            count, onsets = count + solves[0], onsets + len(found)
            missed += max(0, len(full[k]) - len(found))
            error = max(error, farthest(found, full[k]))
        print(
            f"| {steps} | {onsets} | {count / number:.1f} | {seconds / number:.2f} | {missed} |"
            f" {error:.1e} |", flush=True,
        )  # fmt: skip
    print(f"peak memory {memory():.2f} GB")


if __name__ == "__main__":
    if sys.argv[1:2] == ["events"]:
        events()
    elif sys.argv[1:2] == ["samples"]:
        samples(int(sys.argv[2]) if len(sys.argv) > 2 else 8)
    else:
        sys.exit(__doc__)

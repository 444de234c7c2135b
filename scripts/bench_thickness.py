#!/usr/bin/env python3
"""Thicknesses as inputs: ranges against seconds, memory and error of the reduced model.

    scripts/bench_thickness.py [SCENE] [--set KEY=VALUE] [--no-full] [--range KEY LOW HIGH]

A row for each set of ranges: constant bodies; the lining +-20 %; the same with the disc +-1 %; the
lining over its life; or constant bodies and ranges of one's own [m]. Samples at the ends of all
ranges and at two points between are compared with full order on the bodies of these lengths:
largest relative error of lambda, largest estimate, and the share of the modes whose error is beyond
its estimate. Seconds of full order are the median.
"""

from __future__ import annotations

import argparse
import os
import resource
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from brake_fenicsx.model import Model, prepare
from brake_fenicsx.samples.solve import full_modes
from brake_fenicsx.stability.modes import Modes

SCENE = Path(__file__).parent / "scenes" / "disc_brake_demo.toml"
LINING, DISC = "parts.pad.lining", "parts.disc.thickness"
RANGES: dict[str, dict[str, tuple[float, float]]] = {
    "constant": {},
    "lining 8 to 12 mm": {LINING: (8e-3, 12e-3)},
    "the same, disc 19.8 to 20.2 mm": {LINING: (8e-3, 12e-3), DISC: (19.8e-3, 20.2e-3)},
    "lining 3 to 10 mm": {LINING: (3e-3, 10e-3)},
}
# Shares of the ranges: ends, and points between the anchors of the interpolation.
POINTS = (0.0, 1.0, 0.3, 0.63)


def main() -> None:
    """A row for each set of ranges."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", type=Path, default=SCENE)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--no-full", action="store_true", help="without full order")
    parser.add_argument("--range", action="append", nargs=3, metavar=("KEY", "LOW", "HIGH"))
    given = parser.parse_args()
    own = {
        f"{k} {low} to {high}": {k: (float(low), float(high))} for k, low, high in given.range or ()
    }
    every = {"constant": {}} | own if own else RANGES
    sets = ["samples.approaches=['multi-scale']", "stability.verify=0", *given.set]
    print(
        f"{given.scene.stem}\n{'ranges':>32}{'kept':>6}{'offline s':>11}{'sample s':>10}"
        f"{'full s':>8}{'MB':>7}{'error':>9}{'estimate':>10}{'beyond':>8}"
    )
    for name, ranges in every.items():
        model = prepare(given.scene, sets, parameters=ranges or None)
        print(f"{name:>32}{row(model, ranges, not given.no_full)}", flush=True)


def row(model: Model, ranges: dict[str, tuple[float, float]], full: bool) -> str:
    """Numbers of one set of ranges."""
    (reduced,) = model.study.models.reduction.models.values()
    sampled, wholly, errors, estimates, beyond = [], [], [], [], []
    memory = 0.0
    for share in POINTS if ranges else POINTS[:1]:
        values = {key: low + share * (high - low) for key, (low, high) in ranges.items()}
        start = time.perf_counter()
        found = model.modes(values)
        sampled.append(time.perf_counter() - start)
        estimates.append(float((found.error / np.abs(found.s)).max()))
        memory = memory or resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        if full:
            start = time.perf_counter()
            exact = at_full_order(model, values)
            wholly.append(time.perf_counter() - start)
            if exact.s.size != found.s.size:
                raise SystemExit(f"{values}: {found.s.size} modes, {exact.s.size} at full order")
            distance = np.abs(found.s - exact.s)
            errors.append(float((distance / np.abs(exact.s)).max()))
            beyond.append(float((distance > found.error + exact.error).mean()))
    worst, share = max(errors, default=np.nan), np.mean(beyond) if beyond else np.nan
    return (
        f"{reduced.bodies[-1].modes.stop:6d}{reduced.seconds:11.1f}{np.median(sampled):10.2f}"
        f"{np.median(wholly) if wholly else np.nan:8.0f}{memory:7.0f}{worst:9.1e}"
        f"{max(estimates):10.1e}{share:8.2f}"
    )


def at_full_order(model: Model, values: dict[str, float]) -> Modes:
    """Modes of the same sample at full order, at its own equilibrium."""
    study = model.study
    sample = study.sample(("multi-scale", 0), values)
    return full_modes(study.models, sample, study.balance(sample))


if __name__ == "__main__":
    main()

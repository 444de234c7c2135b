#!/usr/bin/env python3
"""What each damping term does to the unstable modes of a scene.

    scripts/damping_study.py [SCENE] [-o DIR] [--samples 6] [--speed "5 rad/s"] [--set KEY=VALUE]

Every row is the same study with other terms, in a folder of its own below DIR; finished rows are
only read. Columns for each approach: unstable modes of all samples; how many of those without
damping are still unstable (same sample, frequency within 1 %); how many are new; median and
lowest damping -2 alpha / |omega|; and how many have a damping above -2e-4. Loss factors are the
same in all materials and exact at 5 kHz.
"""

from __future__ import annotations

import argparse
import csv
import sys
import tomllib
from pathlib import Path

import numpy as np
from bench_ensemble import SCENE, study

NEAR, WEAK = 1e-2, -2e-4
LOSSES = (1e-3, 1e-2)

Found = dict[str, dict[str, np.ndarray]]


def cases(scene: Path, speed: str) -> dict[str, list[str]]:
    """Name of each row and what it changes in the scene."""
    materials = tomllib.loads(scene.read_text())["materials"]

    def row(*terms: str, eta: float = 0.0) -> list[str]:
        lossy = ["loss=true", "omega_ref='5 kHz'"] if eta else []
        damping = f"stability.damping={{ {', '.join([*terms, *lossy])} }}"
        factors = [f"materials.{name}.loss={eta}" for name in materials] if eta else []
        return [damping, f"motion.speed={speed}", *factors]

    both = "sliding=true", "gyroscopic=true"
    rows: dict[str, list[str]] = {"none": []}
    rows |= {"sliding": row(both[0]), "gyroscopic": row(both[1])}
    rows |= {f"loss {eta:.1%}": row(eta=eta) for eta in LOSSES}
    rows["sliding, gyroscopic"] = row(*both)
    return rows | {f"all, loss {eta:.1%}": row(*both, eta=eta) for eta in LOSSES}


def unstable(out: Path) -> Found:
    """Approach -> sample, frequency [Hz] and damping of the unstable modes of a finished run."""
    with (out / "modes.csv").open() as file:
        rows = list(csv.DictReader(file))
    found: Found = {}
    for approach in dict.fromkeys(r["approach"] for r in rows):
        own = [r for r in rows if r["approach"] == approach and r["verdict"] == "unstable"]
        names = {"sample": "sample", "f": "frequency_hz", "damping": "damping"}
        found[approach] = {n: np.array([float(r[c]) for r in own]) for n, c in names.items()}
    return found


def common(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> int:
    """Modes of the first that are among the second."""
    same = one["sample"][:, None] == other["sample"]
    near = np.abs(one["f"][:, None] - other["f"]) < NEAR * one["f"][:, None]
    return int(np.sum(np.any(same & near, axis=1)))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", type=Path, default=SCENE)
    parser.add_argument("-o", "--out", type=Path, default=Path("damping-study"))
    parser.add_argument("--samples", type=int, default=6)
    parser.add_argument("--speed", default="5 rad/s")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    args = parser.parse_args()
    stages = 'stages=["surface","micro","equilibrium","stability","uncertainty"]'
    first: Found = {}
    print(
        f"{'terms':22s}{'approach':14s}{'unstable':>8s}{'still':>7s}{'new':>5s}{'median':>10s}"
        f"{'lowest':>10s}{'weak':>6s}"
    )
    for name, sets in cases(args.scene, args.speed).items():
        out, every = args.out / name, [stages, "stability.verify=0", *args.set, *sets]
        if not (out / "modes.csv").exists():
            study(args.scene, out, args.samples, 1, every, args.out / "cache")
        found = unstable(out)
        first = first or found
        for approach, own in found.items():
            damping = own["damping"] if own["damping"].size else np.array([np.nan])
            still = common(first[approach], own)
            new = own["f"].size - common(own, first[approach])
            print(
                f"{name:22s}{approach:14s}{own['f'].size:8d}{still:7d}{new:5d}"
                f"{np.median(damping):10.1e}{damping.min():10.1e}{np.sum(damping > WEAK):6d}",
                flush=True,
            )


if __name__ == "__main__":
    sys.exit(main())

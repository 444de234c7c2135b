#!/usr/bin/env python3
"""Reduced model of the reference brake: kept modes against seconds, memory and error.

    scripts/bench_stability.py [--size 2] [--band 8000] [--samples 2] [--cutoff 1.2 1.6 2.0]

Samples have lognormal contact stiffness over two decades and 30 % open elements, at mu = 0.5.
Columns: cutoff over the band's highest frequency; modes kept; seconds offline (once) and online
(per sample); peak memory so far; largest and median error of the eigenvalues of all samples against
full order, relative to |lambda|; errors not covered by their estimates; wrong and neutral verdicts.
The last line is full order itself; it says how its modes were counted. Seconds are wall clock, and
in brackets processor seconds of this process, which other work on the machine does not lengthen.
"""

from __future__ import annotations

import argparse
import resource
import time

import numpy as np
from bench_equilibrium import brake, scaled

from brake_fenicsx.macro.solver import local_rows
from brake_fenicsx.stability import Modes, Reduced, complex_modes
from brake_fenicsx.stability.interface import contact_interface
from brake_fenicsx.stability.modes import THRESHOLD
from brake_fenicsx.stability.operators import tangent

MU = 0.5

# Stiffness of the reference [Pa/m].
K0 = 8e9


def stiffness(n: int, seed: int) -> np.ndarray:
    """Contact stiffness of a sample [Pa/m]: two decades about k0, 30 % open."""
    rng = np.random.default_rng(seed)
    k = K0 * np.exp(rng.normal(0.0, np.log(10) / 2, n))
    k[rng.random(n) < 0.3] = 0.0
    return k


def compare(found: Modes, full: Modes) -> tuple[np.ndarray, int, int, int]:
    """Relative errors; how many are not covered, wrong, neutral."""
    distance = np.abs(found.s[:, None] - full.s)
    nearest = full.s[distance.argmin(axis=1)]
    error = distance.min(axis=1)
    uncovered = int(np.sum(error > found.error + full.error[distance.argmin(axis=1)]))
    grows = nearest.real > THRESHOLD * np.abs(nearest)
    verdicts = np.array(found.verdict)
    neutral = verdicts == "neutral"
    wrong = ~neutral & ((verdicts == "unstable") != grows)
    return error / np.abs(found.s), uncovered, int(wrong.sum()), int(neutral.sum())


def memory() -> float:
    """Peak memory of this process [GB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=float, default=2.0, help="multiple of the reference mesh")
    parser.add_argument("--band", type=float, default=8000.0, help="Hz")
    parser.add_argument("--samples", type=int, default=2)
    parser.add_argument("--cutoff", type=float, nargs="+", default=[1.2, 1.6, 2.0])
    given = parser.parse_args()
    case, band = brake(scaled(given.size), order=2), (0.0, given.band)
    c, K, M = case.contact, case.elastic.K, case.elastic.M
    samples = [stiffness(c.w.size, seed) for seed in range(given.samples)]
    start, busy = time.perf_counter(), time.process_time()
    full = [
        complex_modes(
            M, None, tangent(K, c.N, c.T, c.w, k, MU), band,
            frictionless=tangent(K, c.N, c.T, c.w, k, 0.0),
            friction=contact_interface(c.N, c.T, c.w * k, MU),
        )
        for k in samples
    ]  # fmt: skip
    seconds, peak = (time.perf_counter() - start) / len(samples), memory()
    busy = (time.process_time() - busy) / len(samples)
    print(f"{local_rows(K).shape[0]} dofs, {c.w.size} contact elements, band 0 to {band[1]:g} Hz")
    print(
        "cutoff  modes  offline/s  online/s  peak memory/GB  largest error  median error"
        "  uncovered  wrong  neutral  missed"
    )
    for factor in given.cutoff:
        start = time.perf_counter()
        red = Reduced(K, M, c.N, c.T, c.w, K0, band, factor * band[1])
        offline = time.perf_counter() - start
        found = [red.modes(k, MU) for k in samples]
        online = np.mean([m.seconds for m in found])
        parts = [compare(a, b) for a, b in zip(found, full, strict=True)]
        error = np.concatenate([p[0] for p in parts])
        uncovered, wrong, neutral = (sum(p[i] for p in parts) for i in (1, 2, 3))
        missed = sum(abs(len(a) - len(b)) for a, b in zip(found, full, strict=True))
        print(
            f"{factor:6.1f} {red.basis.Lambda.size:6d} {offline:10.2f} {online:9.4f}"
            f" {memory():15.2f} {error.max():14.1e} {np.median(error):13.1e}"
            f" {uncovered:10d} {wrong:6d} {neutral:8d} {missed:7d}"
        )
    modes = sum(len(m) for m in full)
    unstable = sum(m.verdict.count("unstable") for m in full)
    print(
        f"  full {modes:6d} {'':10s} {seconds:9.2f} {peak:15.2f}"
        f"   ({modes} modes of {len(samples)} samples, {unstable} unstable; {busy:.1f} processor s)"
    )
    print(f"  counted by {full[0].count.how}")


if __name__ == "__main__":
    main()

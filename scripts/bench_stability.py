#!/usr/bin/env python3
"""Reduced model of the reference brake: kept modes against seconds, memory and error.

    scripts/bench_stability.py [--size 3 2] [--band 8000] [--samples 2] [--cutoff 1.2 1.6 2.0]

A ladder of meshes from coarse to fine, one table each.
Samples have lognormal contact stiffness over two decades and 30 % open elements, at mu = 0.5.
Columns: cutoff over the band's highest frequency; modes kept; seconds offline (once) and online
(per sample); full order's seconds over the latter; peak memory so far; largest error of frequency
and of growth of all samples against full order, and median error of the eigenvalue, relative to
|lambda|; errors not covered by their estimates; wrong and neutral verdicts; modes missed. The last
line is full order itself. Seconds are wall clock, and in brackets processor seconds of this
process, which other work on the machine does not lengthen.
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


def parts(found: Modes, full: Modes) -> np.ndarray:
    """Relative errors of frequency and of growth, over |lambda|, shape (2, modes)."""
    nearest = full.s[np.abs(found.s[:, None] - full.s).argmin(axis=1)]
    off = (found.s - nearest) / np.abs(nearest)
    return np.abs([off.imag, off.real])


def table(size: float, band: tuple[float, float], number: int, cutoffs: list[float]) -> None:
    """One brake: full order once, the reduced model for each cutoff."""
    case = brake(scaled(size), order=2)
    c, K, M = case.contact, case.elastic.K, case.elastic.M
    samples = [stiffness(c.w.size, seed) for seed in range(number)]
    start, busy = time.perf_counter(), time.process_time()
    full = [
        complex_modes(
            M, None, tangent(K, c.N, c.T, c.w, k, MU), band,
            frictionless=tangent(K, c.N, c.T, c.w, k, 0.0),
            friction=contact_interface(c.N, c.T, c.w * k, MU),
        )
        for k in samples
    ]  # fmt: skip
    seconds, peak = (time.perf_counter() - start) / number, memory()
    busy = (time.process_time() - busy) / number
    modes = sum(len(m) for m in full)
    unstable = sum(m.verdict.count("unstable") for m in full)
    print(
        f"{local_rows(K).shape[0]} dofs, {c.w.size} contact elements, band 0 to {band[1]:g} Hz;"
        f" {modes} modes of {number} samples, {unstable} unstable,\n"
        f"counted by {full[0].count.how}"
    )
    print(
        "cutoff  modes  offline/s  online/s   ratio  memory/GB  frequency    growth  median error"
        "  uncovered  wrong  neutral  missed"
    )
    for factor in cutoffs:
        start = time.perf_counter()
        red = Reduced(K, M, c.N, c.T, c.w, K0, band, factor * band[1])
        offline = time.perf_counter() - start
        found = [red.modes(k, MU) for k in samples]
        online = np.mean([m.seconds for m in found])
        both = list(zip(found, full, strict=True))
        compared = [compare(*pair) for pair in both]
        error = np.concatenate([row[0] for row in compared])
        frequency, growth = np.concatenate([parts(*pair) for pair in both], axis=1).max(axis=1)
        uncovered, wrong, neutral = (sum(row[i] for row in compared) for i in (1, 2, 3))
        missed = sum(abs(len(a) - len(b)) for a, b in both)
        print(
            f"{factor:6.1f} {red.basis.Lambda.size:6d} {offline:10.2f} {online:9.4f}"
            f" {seconds / online:7.0f} {memory():10.2f} {frequency:10.1e} {growth:9.1e}"
            f" {np.median(error):13.1e} {uncovered:10d} {wrong:6d} {neutral:8d} {missed:7d}",
            flush=True,
        )
    print(f"  full {'':17s} {seconds:9.2f} {'':7s} {peak:10.2f}   ({busy:.1f} processor s)\n")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--size", type=float, nargs="+", default=[2.0], help="multiples of the reference mesh"
    )
    parser.add_argument("--band", type=float, default=8000.0, help="Hz")
    parser.add_argument("--samples", type=int, default=2)
    parser.add_argument("--cutoff", type=float, nargs="+", default=[1.2, 1.6, 2.0])
    given = parser.parse_args()
    for size in given.size:
        table(size, (0.0, given.band), given.samples, given.cutoff)


if __name__ == "__main__":
    main()

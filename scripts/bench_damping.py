#!/usr/bin/env python3
"""Damped samples: terms against seconds, memory and error of the reduced model.

    scripts/bench_damping.py [SCENE] [--band 8000] [--samples 3] [--terms none loss sliding all]

Contact stiffness over two decades with 30 % of the elements open, pressures spread as much, mu =
0.5, sliding at 1 m/s. Columns: terms; seconds offline (once) and online (per sample); modes refined
on the full problem; peak memory so far; seconds of full order (per sample) and how many times
faster the reduced model is; largest and median error of all eigenvalues against full order,
relative to |lambda|; errors not covered by their estimates; wrong and neutral verdicts; missed.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

from mpi4py import MPI

import numpy as np
from bench_stability import K0, MU, compare, memory, stiffness

from brake_fenicsx.macro.brake import assemble_brake
from brake_fenicsx.macro.condensation import gathered
from brake_fenicsx.macro.solver import local_rows
from brake_fenicsx.scene import read_scene
from brake_fenicsx.stability import DampedReduced, Reduced, complex_modes
from brake_fenicsx.stability.damping import sliding_damping, velocity_slope
from brake_fenicsx.stability.operators import tangent
from brake_fenicsx.stability.terms import damping_terms

SCENES = Path(__file__).parent / "scenes"
BULK = {
    "loss": "{ loss = true, omega_ref = '4 kHz' }",
    "rayleigh": "{ rayleigh = ['20 1/s', '1e-8 s'] }",
    "all": "{ loss = true, omega_ref = '4 kHz', rayleigh = ['20 1/s', '1e-8 s'] }",
}
ALONG, ACROSS = ("slope", "all"), ("sliding", "all")
V, SLOPE, PRESSURE, ZETA = 1.0, -0.05, 2e5, 0.2


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", default=SCENES / "disc_brake_demo.toml", type=Path)
    parser.add_argument("--band", type=float, default=8000.0, help="Hz")
    parser.add_argument("--samples", type=int, default=3)
    parser.add_argument(
        "--terms", nargs="+", default=["loss", "rayleigh", "sliding", "slope", "all"]
    )
    given = parser.parse_args()
    changes = [
        "materials.lining.loss = 0.05", "materials.steel.loss = 0.002",
        "contact.pad_disc.gap = none",
        "stages = ['equilibrium', 'stability']",
        "contact.pad_disc.law = { p0 = '2e5 Pa', u0 = '2e-6 m' }",
    ]  # fmt: skip
    band = (0.0, given.band)
    b = assemble_brake(read_scene(given.scene, changes), MPI.COMM_SELF)
    w, R = b.w, b.contact.R
    reduced = Reduced(b.K, b.M, b.N, b.T, w, K0, band, order=0)
    M = local_rows(gathered(b.M))
    print(f"{M.shape[0]} dofs, {w.size} contact elements, band 0 to {given.band:g} Hz")
    print(f"real modes and statics: {sum(reduced.seconds.values()):.1f} s")
    print(
        "   terms  offline/s  online/s  refined  peak memory/GB  full/s  ratio  largest error"
        "  median error  uncovered  wrong  neutral  missed"
    )
    for name in given.terms:
        bulk = None
        if name in BULK:
            scene = read_scene(given.scene, [*changes, f"stability.damping = {BULK[name]}"])
            bulk = damping_terms(scene, b).bulk
        model = DampedReduced(reduced, bulk, R, name in ALONG, name in ACROSS)
        found, full, seconds = [], [], []
        for seed in range(given.samples):
            k = stiffness(w.size, seed)
            p = PRESSURE * k / k.mean()
            along, across = SLOPE * p * (name in ALONG), MU * p / V * (name in ACROSS)
            found.append(model.modes(k, MU, along, across, ZETA))
            C = sliding_damping(R, w, across * V, V + 0 * w, 1.0) + velocity_slope(
                b.T, w, along, 1.0
            )
            C = C if bulk is None else C + bulk
            start = time.perf_counter()
            full.append(complex_modes(M, C, tangent(b.K, b.N, b.T, w, k, MU), band, zeta_max=ZETA))
            seconds.append(time.perf_counter() - start)
        parts = [compare(a, c) for a, c in zip(found, full, strict=True)]
        error = np.concatenate([p[0] for p in parts])
        uncovered, wrong, neutral = (sum(p[i] for p in parts) for i in (1, 2, 3))
        missed = sum(abs(len(a) - len(c)) for a, c in zip(found, full, strict=True))
        online = float(np.median([m.seconds for m in found]))
        print(
            f"{name:>8s} {model.seconds:10.1f} {online:9.3f} {sum(m.iterations for m in found):8d}"
            f" {memory():15.2f} {np.mean(seconds):7.1f} {np.mean(seconds) / online:6.0f}"
            f" {error.max():14.1e} {np.median(error):13.1e} {uncovered:10d} {wrong:6d}"
            f" {neutral:8d} {missed:7d}",
            flush=True,
        )


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Samples of other materials: degree of the interpolation against seconds, memory and error.

    scripts/bench_materials.py [SCENE] [--band 8000] [--samples 3] [--degrees 2 3 4]
                               [--spread 0.2] [--tolerance 1e-6]

E_3, G_13 and G_23 of the lining vary uniformly by the spread, contact stiffness over two decades
with 30 % of the elements open, mu = 0.5. Columns: degree; anchors; directions of the bodies'
spaces; seconds offline (once) and online (per sample); peak memory so far; modes refined on the
full problem, all samples together; largest and median error of all eigenvalues against full order
of the sample's own bodies, and the largest estimate, relative to |lambda|; errors not covered by
their estimates; wrong and neutral verdicts; largest relative error of the compliance. For each
degree one line without and one with refinement of what is estimated beyond the tolerance. The last
line is full order.
"""

from __future__ import annotations

import argparse
import os
import time
from functools import partial
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

from mpi4py import MPI

import numpy as np
from bench_stability import K0, MU, compare, memory, stiffness

from brake_fenicsx.macro.brake import assemble_brake
from brake_fenicsx.macro.condensation import compliance, gathered, petsc_matrix
from brake_fenicsx.macro.solver import local_rows
from brake_fenicsx.scene import read_scene
from brake_fenicsx.stability import complex_modes, contact_interface
from brake_fenicsx.stability.changing.anchors import Anchors
from brake_fenicsx.stability.changing.own_bodies import Whole
from brake_fenicsx.stability.ensemble_basis import EnsembleBasis
from brake_fenicsx.stability.operators import tangent
from brake_fenicsx.uncertainty.bulk import assemble_bulk
from brake_fenicsx.uncertainty.material_box import MaterialBox

SCENES = Path(__file__).parent / "scenes"
CONSTANTS = ("E_3", "G_13", "G_23")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", default=SCENES / "disc_brake_demo.toml", type=Path)
    parser.add_argument("--band", type=float, default=8000.0, help="Hz")
    parser.add_argument("--samples", type=int, default=3)
    parser.add_argument("--degrees", type=int, nargs="+", default=[2, 3, 4])
    parser.add_argument("--spread", type=float, default=0.2)
    parser.add_argument("--tolerance", type=float, default=1e-6)
    given = parser.parse_args()
    law = f"{{ law = 'uniform', spread = {given.spread} }}"
    changes = [f'samples.random."materials.lining.{name}"={law}' for name in CONSTANTS]
    penalty = "contact.pad_disc.law={ p0 = '2e5 Pa', u0 = '2e-6 m' }"
    changes += ["stages=['equilibrium','stability','uncertainty']", "contact.pad_disc.gap=none"]
    scene = read_scene(given.scene, [*changes, penalty])
    b = assemble_brake(scene, MPI.COMM_SELF)
    bulk, band, k0 = assemble_bulk(scene, b), (0.0, given.band), np.full(b.w.size, K0)
    box = MaterialBox(scene, bulk)
    K, M = local_rows(gathered(b.K)), local_rows(gathered(b.M))
    rng = np.random.default_rng(0)
    places = rng.uniform(-1, 1, (given.samples, len(CONSTANTS)))
    contact = [stiffness(b.w.size, seed) for seed in range(given.samples)]
    full, seconds = [], []

    def whole(x):
        return Whole(box.bodies(x, None)[0], M, b.N, b.T, b.contact.R)

    for x, k in zip(places, contact, strict=True):
        own = petsc_matrix(whole(x).K)
        parts = (b.N, b.T, b.w, k)
        start = time.perf_counter()
        full.append(
            complex_modes(
                M, None, tangent(own, *parts, MU), band, frictionless=tangent(own, *parts, 0.0),
                friction=contact_interface(b.N, b.T, b.w * k, MU),
            )
        )  # fmt: skip
        seconds.append(time.perf_counter() - start)
    exact = compliance(own, b.N, b.T, b.w, b.f, k0, MPI.COMM_SELF)
    print(f"{K.shape[0]} dofs, {b.w.size} contact elements, band 0 to {given.band:g} Hz")
    print(
        "degree  anchors  directions  offline/s  online/s  peak memory/GB  refined  largest error"
        "  median error  largest estimate  uncovered  wrong  neutral  missed  compliance"
    )
    for degree in given.degrees:
        basis = EnsembleBasis(
            K, M, b.N, b.T, b.w, b.f[:, None], list(bulk.parts.values()), box.coefficients,
            len(CONSTANTS), band, degree,
        )  # fmt: skip
        NN = basis.compliance(places[-1], k0)[0]
        off = np.abs(NN - exact.NN).max() / np.abs(exact.NN).max()
        for tolerance in (np.inf, given.tolerance):
            found = [
                basis.modes(x, k, MU, tolerance, partial(whole, x))
                for x, k in zip(places, contact, strict=True)
            ]
            parts = [compare(a, c) for a, c in zip(found, full, strict=True)]
            error = np.concatenate([p[0] for p in parts])
            estimate = max(float((m.error / np.abs(m.s)).max()) for m in found)
            uncovered, wrong, neutral = (sum(p[i] for p in parts) for i in (1, 2, 3))
            missed = sum(abs(len(a) - len(c)) for a, c in zip(found, full, strict=True))
            print(
                f"{degree:6d} {len(Anchors(len(CONSTANTS), degree).points):8d}"
                f" {sum(body.directions for body in basis.bodies):11d} {basis.seconds:10.1f}"
                f" {np.mean([m.seconds for m in found]):9.3f} {memory():15.2f}"
                f" {sum(m.iterations for m in found):8d} {error.max():14.1e}"
                f" {np.median(error):13.1e} {estimate:17.1e} {uncovered:10d} {wrong:6d}"
                f" {neutral:8d} {missed:7d} {off:11.1e}",
                flush=True,
            )
    print(f"  full {'':30s} {np.mean(seconds):9.1f}")


if __name__ == "__main__":
    main()

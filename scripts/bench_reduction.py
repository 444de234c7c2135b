#!/usr/bin/env python3
"""The reduced model of every kind of brake: seconds, memory and error against full order.

    scripts/bench_reduction.py [SCENE] [--kinds undamped loss sliding all] [--spread 0 0.2]
                               [--band 8000] [--samples 2] [--tolerance 1e-5] [--cutoff HZ]
                               [--every-anchor] [--no-full] [--set KEY=VALUE ...]

Contact stiffness of a sample is lognormal over two decades, 30 % of the elements open, pressures
spread as much, mu = 0.5, sliding at 1 m/s. With a spread E_3, G_13 and G_23 of the lining differ
from sample to sample, uniformly. ``--every-anchor``: a factor at every point of the interpolation,
as without the contact of a typical sample, which tells whether fewer are enough. Columns: kind;
spread; modes kept; factors; seconds offline (once), online (median of the samples) and at full
order (mean), and the ratio of the last two; peak memory so far; largest and median error of all
eigenvalues against full order, and the largest estimate, relative to |lambda|; errors not covered
by their estimates; wrong and neutral verdicts; modes missed.
"""

from __future__ import annotations

import argparse
import os
import resource
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.build.brake import Brake, assemble_brake
from brake_fenicsx.build.changes import assemble_changes
from brake_fenicsx.build.damping_terms import damping_terms
from brake_fenicsx.build.material_table import layer_materials
from brake_fenicsx.samples.numbering import dof_points
from brake_fenicsx.scene import Scene, read_scene
from brake_fenicsx.stability import (
    ContactLinearisation,
    Modes,
    complex_modes,
    contact_interface,
    reduce_bodies,
    split_substructures,
)
from brake_fenicsx.stability.damping_matrices import friction_damping
from brake_fenicsx.stability.eigen import tangent
from brake_fenicsx.stability.modes import THRESHOLD
from brake_fenicsx.stability.substructures import CONSTANT

SCENES = Path(__file__).parent / "scenes"
BULK = {
    "loss": "{ loss = true, omega_ref = '4 kHz' }",
    "rayleigh": "{ rayleigh = ['20 1/s', '1e-8 s'] }",
    "turning": "{ gyroscopic = true }",
    "all": "{ loss = true, omega_ref = '4 kHz', rayleigh = ['20 1/s', '1e-8 s'],"
    " gyroscopic = true }",
}
KINDS = ("undamped", "sliding", "slope", *BULK)
ALONG, ACROSS = ("slope", "all"), ("sliding", "all")
MU, V, SLOPE, PRESSURE, ZETA, K0 = 0.5, 1.0, -0.05, 2e5, 0.2, 8e9
CONSTANTS = ("E_3", "G_13", "G_23")


def damped_by(kind: str) -> list[str]:
    """Changes of the scene of the demo that damp its bodies."""
    if kind not in BULK:
        return []
    losses = ["materials.lining.loss = 0.05", "materials.steel.loss = 0.002"]
    return [f"stability.damping = {BULK[kind]}", *(losses if "loss" in BULK[kind] else [])]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", default=SCENES / "disc_brake_demo.toml", type=Path)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=["undamped", "loss"])
    parser.add_argument("--spread", type=float, nargs="+", default=[0.0, 0.2])
    parser.add_argument("--band", type=float, default=8000.0, help="Hz")
    parser.add_argument("--samples", type=int, default=2)
    parser.add_argument("--tolerance", type=float, default=1e-5)
    parser.add_argument("--cutoff", type=float, help="kept modes reach up to it, Hz")
    parser.add_argument("--every-anchor", action="store_true", help="factors at all points")
    parser.add_argument("--no-full", action="store_true", help="seconds of the reduced model alone")
    parser.add_argument("--set", nargs="+", default=[], help="KEY=VALUE of the scene")
    given = parser.parse_args()
    changes = [
        "contact.pad_disc.gap = none", "samples.approaches = ['multi-scale']",
        "stages = ['equilibrium', 'stability', 'uncertainty']",
        "contact.pad_disc.law = { p0 = '2e5 Pa', u0 = '2e-6 m' }", *given.set,
    ]  # fmt: skip
    brake = assemble_brake(read_scene(given.scene, changes), MPI.COMM_SELF)
    print(f"{brake.f.size} dofs, {brake.w.size} contact elements, band 0 to {given.band:g} Hz")
    print(
        "    kind  spread  modes  factors  offline/s  online/s  full/s  ratio  memory/GB"
        "  largest error  median error  largest estimate  uncovered  wrong  neutral  missed"
    )
    for spread in given.spread:
        law = f"{{ law = 'uniform', spread = {spread} }}"
        random = [f'samples.random."materials.lining.{name}"={law}' for name in CONSTANTS]
        for kind in given.kinds:
            more = damped_by(kind)
            scene = read_scene(given.scene, [*changes, *(random if spread else []), *more])
            row(Case(scene, brake, kind, spread, given), given)


class Case:
    """One kind of brake, reduced."""

    def __init__(self, scene: Scene, b: Brake, kind: str, spread: float, given: argparse.Namespace):
        """Offline stage."""
        b = replace(b, materials=layer_materials(scene, b.mesh.layers))  # those with loss factors
        self.b, self.kind, self.spread, self.band = b, kind, spread, (0.0, given.band)
        self.K, self.M = b.K, b.M
        self.terms = damping_terms(scene, b) if kind in BULK else None
        self.random = assemble_changes(scene, b) if spread else None
        changes, box = [], CONSTANT
        if self.random is not None:
            changes, box = self.random.matrices, self.random.parameters
        C = None if self.terms is None else self.terms.bulk
        interface = {"N": b.N, "T": b.T, "R": b.R}
        points = dof_points(b)
        typical = None if given.every_anchor else ContactLinearisation.of(np.full(b.w.size, K0), MU)
        factors: list[int] = []
        start = time.perf_counter()
        bodies = split_substructures(self.K, self.M, interface, b.f[:, None], changes, C, points)
        followed = "N" + "T" * (kind in ALONG) + "R" * (kind in ACROSS)
        self.model = reduce_bodies(
            bodies, b.w, self.band, box, followed, given.tolerance, given.cutoff, typical,
            progress=lambda total: factors.append,
        )  # fmt: skip
        self.offline, self.factors = time.perf_counter() - start, sum(factors)

    def sample(self, seed: int) -> tuple[np.ndarray, ContactLinearisation]:
        """Point of the box, and the contact of a sample."""
        rng, n = np.random.default_rng(seed), self.b.w.size
        k = K0 * np.exp(rng.normal(0.0, np.log(10) / 2, n))
        k[rng.random(n) < 0.3] = 0.0
        p = PRESSURE * k / k.mean()
        along, across = SLOPE * p * (self.kind in ALONG), MU * p / V * (self.kind in ACROSS)
        x = rng.uniform(-1, 1, self.model.parameters.dimension)
        return x, ContactLinearisation.of(k, MU, along, across)

    def full(self, x: np.ndarray, contact: ContactLinearisation) -> Modes:
        """The same at full order."""
        b, K, C = self.b, self.K, sp.csr_matrix(self.K.shape)
        if self.terms is not None and self.terms.bulk is not None:
            C = C + self.terms.bulk
        if self.random is not None:
            values = self.random.box.values(x)
            K = K + self.random.change(values, "K")
            C = C + self.random.change(values, "C")
        C = (C + friction_damping(b.T, b.R, b.w, contact.along, contact.across)).tocsr()
        C.eliminate_zeros()
        whole = tangent(K, b.N, b.T, b.w, contact.k, MU)
        friction = contact_interface(b.N, b.T, b.w * contact.k, np.full(b.w.size, MU))
        return complex_modes(
            self.M, C if C.nnz else None, whole, self.band, zeta_max=ZETA, friction=friction
        )


def row(case: Case, given: argparse.Namespace) -> None:
    """One line of the table."""
    found, full, seconds = [], [], []
    for seed in range(given.samples):
        x, contact = case.sample(seed)
        found.append(case.model.modes(x, contact, ZETA))
        if not given.no_full:
            start = time.perf_counter()
            full.append(case.full(x, contact))
            seconds.append(time.perf_counter() - start)
    online = float(np.median([m.seconds for m in found]))
    estimate = max(float((m.error / np.abs(m.s))[np.abs(m.s) > 1e3].max()) for m in found)
    head = (
        f"{case.kind:>8s} {case.spread:7.2f} {case.model.bodies[-1].modes.stop:6d}"
        f" {case.factors:8d}"
        f" {case.offline:10.1f} {online:9.3f}"
    )
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    if given.no_full:
        print(f"{head} {'':14s} {memory:10.2f} {'':28s} {estimate:17.1e}", flush=True)
        return
    parts = [compare(a, c) for a, c in zip(found, full, strict=True)]
    error = np.concatenate([p[0] for p in parts])
    uncovered, wrong, neutral = (sum(p[i] for p in parts) for i in (1, 2, 3))
    missed = sum(abs(len(a) - len(c)) for a, c in zip(found, full, strict=True))
    print(
        f"{head} {np.mean(seconds):7.1f} {np.mean(seconds) / online:6.0f} {memory:10.2f}"
        f" {error.max():14.1e} {np.median(error):13.1e} {estimate:17.1e} {uncovered:10d}"
        f" {wrong:6d} {neutral:8d} {missed:7d}",
        flush=True,
    )


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


if __name__ == "__main__":
    main()

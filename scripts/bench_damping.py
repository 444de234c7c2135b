#!/usr/bin/env python3
"""Damped samples: terms against seconds, memory and error of the reduced model.

    scripts/bench_damping.py [SCENE] [--band 8000] [--samples 3] [--terms loss sliding all]
                             [--spread 0.2] [--set KEY=VALUE ...]

With a spread E_3, G_13 and G_23 of the lining differ from sample to sample, uniformly, and the
reduced model is that of changing materials. Contact stiffness over two decades with 30 % of the
elements open, pressures spread as much, mu = 0.5, sliding at 1 m/s. Columns: terms; seconds offline
(once) and online (per sample); modes refined on the full problem; peak memory so far; seconds of
full order (per sample) and how many times faster the reduced model is; largest and median error of
all eigenvalues against full order, and the largest estimate, relative to |lambda|; errors not
covered by their estimates; wrong and neutral verdicts; missed.
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
import scipy.sparse as sp
from bench_stability import K0, MU, compare, memory, stiffness

from brake_fenicsx.macro.brake import assemble_brake
from brake_fenicsx.macro.condensation import gathered, petsc_matrix
from brake_fenicsx.macro.solver import local_rows
from brake_fenicsx.scene import read_scene
from brake_fenicsx.stability import DampedReduced, Reduced, complex_modes
from brake_fenicsx.stability.changing.own_bodies import Whole
from brake_fenicsx.stability.changing.proportion import Damping
from brake_fenicsx.stability.damping import sliding_damping, velocity_slope
from brake_fenicsx.stability.ensemble_basis import EnsembleBasis
from brake_fenicsx.stability.operators import tangent
from brake_fenicsx.stability.terms import damping_terms
from brake_fenicsx.uncertainty.bulk import assemble_bulk
from brake_fenicsx.uncertainty.material_box import MaterialBox

SCENES = Path(__file__).parent / "scenes"
BULK = {
    "loss": "{ loss = true, omega_ref = '4 kHz' }",
    "rayleigh": "{ rayleigh = ['20 1/s', '1e-8 s'] }",
    "turning": "{ gyroscopic = true }",
    "all": "{ loss = true, omega_ref = '4 kHz', rayleigh = ['20 1/s', '1e-8 s'],"
    " gyroscopic = true }",
}
ALPHA, RAYLEIGH = 20.0, ("rayleigh", "all")
ALONG, ACROSS = ("slope", "all"), ("sliding", "all")
V, SLOPE, PRESSURE, ZETA = 1.0, -0.05, 2e5, 0.2


CONSTANTS = ("E_3", "G_13", "G_23")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", default=SCENES / "disc_brake_demo.toml", type=Path)
    parser.add_argument("--band", type=float, default=8000.0, help="Hz")
    parser.add_argument("--samples", type=int, default=3)
    parser.add_argument(
        "--terms", nargs="+", default=["loss", "rayleigh", "sliding", "slope", "all"]
    )
    parser.add_argument("--spread", type=float, default=0.0, help="of the lining's constants")
    parser.add_argument("--set", nargs="+", default=[], help="KEY=VALUE of the scene")
    given = parser.parse_args()
    changes = [
        "materials.lining.loss = 0.05", "materials.steel.loss = 0.002",
        "contact.pad_disc.gap = none",
        "stages = ['equilibrium', 'stability', 'uncertainty']",
        "contact.pad_disc.law = { p0 = '2e5 Pa', u0 = '2e-6 m' }", *given.set,
    ]  # fmt: skip
    law = f"{{ law = 'uniform', spread = {given.spread} }}"
    if given.spread:
        changes += [f'samples.random."materials.lining.{name}"={law}' for name in CONSTANTS]
    band = (0.0, given.band)
    scene = read_scene(given.scene, changes)
    b = assemble_brake(scene, MPI.COMM_SELF)
    w, R = b.w, b.contact.R
    M = local_rows(gathered(b.M))
    print(f"{M.shape[0]} dofs, {w.size} contact elements, band 0 to {given.band:g} Hz")
    samples = [(stiffness(w.size, seed), seed) for seed in range(given.samples)]
    kind = Changing(scene, b, band, given.samples) if given.spread else Fixed(b, band)
    print(
        "   terms  offline/s  online/s  refined  peak memory/GB  full/s  ratio  largest error"
        "  median error  largest estimate  uncovered  wrong  neutral  missed"
    )
    for name in given.terms:
        terms = None
        if name in BULK:
            damped = read_scene(given.scene, [*changes, f"stability.damping = {BULK[name]}"])
            terms = damping_terms(damped, b)
        offline = kind.offline(terms, ALPHA * (name in RAYLEIGH), name in ALONG, name in ACROSS)
        found, full, seconds = [], [], []
        for k, seed in samples:
            p = PRESSURE * k / k.mean()
            along, across = SLOPE * p * (name in ALONG), MU * p / V * (name in ACROSS)
            found.append(kind.modes(seed, k, along, across))
            K, C = kind.matrices(seed, terms)
            C = C + sliding_damping(R, w, across * V, V + 0 * w, 1.0)
            C = C + velocity_slope(b.T, w, along, 1.0)
            start = time.perf_counter()
            full.append(complex_modes(M, C, tangent(K, b.N, b.T, w, k, MU), band, zeta_max=ZETA))
            seconds.append(time.perf_counter() - start)
        parts = [compare(a, c) for a, c in zip(found, full, strict=True)]
        error = np.concatenate([p[0] for p in parts])
        estimate = max(float((m.error / np.abs(m.s)).max()) for m in found)
        uncovered, wrong, neutral = (sum(p[i] for p in parts) for i in (1, 2, 3))
        missed = sum(abs(len(a) - len(c)) for a, c in zip(found, full, strict=True))
        online = float(np.median([m.seconds for m in found]))
        print(
            f"{name:>8s} {offline:10.1f} {online:9.3f} {sum(m.iterations for m in found):8d}"
            f" {memory():15.2f} {np.mean(seconds):7.1f} {np.mean(seconds) / online:6.0f}"
            f" {error.max():14.1e} {np.median(error):13.1e} {estimate:17.1e} {uncovered:10d}"
            f" {wrong:6d} {neutral:8d} {missed:7d}",
            flush=True,
        )


class Fixed:
    """Samples of the scene's own bodies."""

    def __init__(self, b, band):
        """Real modes and statics."""
        self.b = b
        self.reduced = Reduced(b.K, b.M, b.N, b.T, b.w, K0, band, order=0)
        print(f"real modes and statics: {sum(self.reduced.seconds.values()):.1f} s")

    def offline(self, terms, alpha, along, across):
        """Make the model; its seconds."""
        bulk = None if terms is None else terms.bulk
        self.model = DampedReduced(self.reduced, bulk, self.b.contact.R, along, across)
        return self.model.seconds

    def modes(self, seed, k, along, across):
        """Modes of a sample."""
        return self.model.modes(k, MU, along, across, ZETA)

    def matrices(self, seed, terms):
        """Stiffness and damping of its bodies."""
        K = local_rows(gathered(self.b.K))
        return self.b.K, sp.csr_matrix(K.shape) if terms is None else terms.bulk


class Changing:
    """Samples of other moduli."""

    def __init__(self, scene, b, band, count):
        """Place the samples in the box of the materials."""
        self.b, self.band, self.bulk = b, band, assemble_bulk(scene, b)
        self.box = MaterialBox(scene, self.bulk)
        self.places = np.random.default_rng(0).uniform(-1, 1, (count, len(CONSTANTS)))

    def offline(self, terms, alpha, along, across):
        """Make the model; its seconds."""
        b, bulk = self.b, None if terms is None else terms.bulk
        damping = Damping(bulk, alpha, self.box.follows(terms), b.contact.R, along, across)
        parts = [*self.bulk.parts.values()]
        self._terms = terms
        self.model = EnsembleBasis(
            local_rows(gathered(b.K)), local_rows(gathered(b.M)), b.N, b.T, b.w, b.f[:, None],
            parts, self.box.coefficients, len(CONSTANTS), self.band, damping=damping,
        )  # fmt: skip
        return self.model.seconds

    def modes(self, seed, k, along, across):
        """Modes of a sample."""
        whole = partial(self._whole, seed)
        place = self.places[seed]
        return self.model.damped_modes(place, k, MU, along, across, ZETA, whole=whole)

    def _whole(self, seed):
        """A sample at full order, for what is refined."""
        K, C = self.box.bodies(self.places[seed], self._terms)
        return Whole(K, local_rows(gathered(self.b.M)), self.b.N, self.b.T, self.b.contact.R, C)

    def matrices(self, seed, terms):
        """Stiffness and damping of its bodies."""
        K, C = self.box.bodies(self.places[seed], terms)
        return petsc_matrix(K), sp.csr_matrix(K.shape) if C is None else C


if __name__ == "__main__":
    main()

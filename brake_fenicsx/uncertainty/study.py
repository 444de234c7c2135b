"""The samples of a scene: what they share, each one's equilibrium and modes, their tables."""

from __future__ import annotations

import time
from dataclasses import fields
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import NotConverged
from brake_fenicsx.log import Progress, logger
from brake_fenicsx.macro.brake import Brake
from brake_fenicsx.macro.braking import reference_stiffness
from brake_fenicsx.macro.condensation import Compliance, compliance, gathered
from brake_fenicsx.macro.equilibrium import Equilibrium, equilibrium
from brake_fenicsx.micro.law import Laws
from brake_fenicsx.report.tables import CONTACT, MODES, SAMPLES, write_rows
from brake_fenicsx.scene import Scene
from brake_fenicsx.store import Store
from brake_fenicsx.surface.hdf import HeightDistribution

from .ensemble import Task, run_ensemble
from .results import Results
from .sampling import SampleInput, draw_sample, sample_count

Array = NDArray[np.float64]

VERIFY = "verify"


class Study:
    """All samples of a scene on one brake."""

    def __init__(
        self,
        scene: Scene,
        brake: Brake,
        library: Laws | None,
        hdf: HeightDistribution | None,
        store: Store,
        comm: MPI.Comm,
    ):
        """Collect what the samples need.

        Args:
            scene: the scene.
            brake: its operators.
            library: pressure-gap laws, if the scene makes any.
            hdf: height distribution, if the scene has a surface.
            store: the results folder.
            comm: processes that share the samples.
        """
        self.scene, self.brake, self.library, self.hdf = scene, brake, library, hdf
        self.store, self.comm = store, comm
        self.facts: dict[str, Any] = {}
        self.reduced: Any = None
        self.compliance: Compliance | None = None
        self.K, self.M = gathered(brake.K), gathered(brake.M)
        self.steps = max((load.steps for load in scene.loads.values()), default=1)
        count = {"multi-scale": sample_count(scene), "classical": 1}
        self.tasks: list[Task] = [
            (name, k) for name in scene.samples.approaches for k in range(count[name])
        ]
        stability = scene.stability if "stability" in scene.stages else None
        # One sample alone does not pay for a basis: it is solved at full order.
        self.by_reduction = {
            name: stability is not None and stability.method == "reduced" and count[name] > 1
            for name in scene.samples.approaches
        }
        self.verify: list[Task] = []
        if stability is not None:
            names = [name for name, reduced in self.by_reduction.items() if reduced]
            self.verify = [(VERIFY, k) for name in names for k in range(stability.verify)]

    def prepare(self) -> None:
        """Factor the reference, and make or load the reduced basis."""
        brake = self.brake
        laws = self._draw(next(iter(self.by_reduction)), 0).laws
        pressure = brake.pressed / float(brake.w.sum())
        k0 = np.full(len(brake.w), reference_stiffness(laws, pressure))
        self.facts["reference_stiffness_Pa_per_m"] = float(k0[0])
        if any(self.by_reduction.values()):
            self._prepare_reduced(k0)
        else:
            self.compliance = compliance(self.K, brake.N, brake.T, brake.w, brake.f, k0, self.comm)

    def _prepare_reduced(self, k0: Array) -> None:
        from brake_fenicsx.stability.reduction import Reduced

        stability, brake = self.scene.stability, self.brake
        if stability is None:
            return
        known = self._cached_basis()
        progress = Progress("interface columns", -(-len(brake.w) // self.comm.size))
        band = (stability.band[0], stability.band[1])
        start = time.perf_counter()
        self.reduced = Reduced(
            self.K, self.M, brake.N, brake.T, brake.w, k0, band, stability.cutoff, self.comm,
            progress.advance, known,
        )  # fmt: skip
        basis = self.reduced.basis
        if known is None and self.comm.rank == 0:
            self._cache_basis(basis, self.reduced.Phi)
        factor = self.reduced.factor
        self.compliance = Compliance(
            factor, basis.k0, basis.compliance[0], basis.compliance[1],
            brake.N @ factor.solve(brake.f),
        )  # fmt: skip
        self.facts["reduced_basis"] = {
            "real_modes": len(basis.Lambda),
            "complete_up_to_hz": float(np.sqrt(basis.limit) / 2 / np.pi),
            "seconds": time.perf_counter() - start,
            **{f"seconds_{name}": value for name, value in self.reduced.seconds.items()},
        }

    def _cached_basis(self) -> Any:
        from brake_fenicsx.stability.basis import Basis

        stored = self.store.load("cache/basis.npz")
        if stored is None:
            return None
        logger.info("reduced basis: from the cache")
        values: dict[str, Any] = {f.name: stored[f.name] for f in fields(Basis)}
        for name in ("NN", "NT", "compliance"):
            values[name] = tuple(values[name])
        values["limit"] = float(values["limit"])
        return Basis(**values), stored["Phi"]

    def _cache_basis(self, basis: Any, Phi: Array) -> None:
        arrays = {f.name: np.asarray(getattr(basis, f.name)) for f in fields(basis)}
        self.store.save("cache/basis.npz", Phi=Phi, **arrays)

    def run(self) -> None:
        """Run every sample that is not stored yet; long ones first."""
        long = [t for t in self.tasks if not self.by_reduction[t[0]]]
        short = [t for t in self.tasks if self.by_reduction[t[0]]]
        run_ensemble([*long, *self.verify, *short], self.work, self.store, self.comm)

    def work(self, task: Task) -> dict[str, Any]:
        """Equilibrium and modes of one sample, as arrays to store."""
        approach, k = task
        if approach == VERIFY:
            approach = next(name for name, reduced in self.by_reduction.items() if reduced)
        sample = self._draw(approach, k)
        eq = self._equilibrium(sample)
        names = sorted(sample.random)
        out: dict[str, Any] = {
            "seed": np.uint64(sample.seed),
            "mu": sample.mu, "mu_equilibrium": sample.mu_equilibrium,
            "g": eq.g, "g_cr": sample.laws.g_cr, "p": eq.p, "k": eq.k, "law": sample.laws.index,
            "random_names": np.array(names, dtype=str),
            "random": np.array([sample.random[n] for n in names]),
            "equilibrium_iterations": sum(eq.iterations), "equilibrium_residual": eq.residual,
            "equilibrium_seconds": eq.seconds,
        }  # fmt: skip
        if "stability" not in self.scene.stages:
            return out
        reduced = self.by_reduction[approach] and task[0] != VERIFY
        return out | (self._reduced(eq, sample) if reduced else self._full(eq, sample))

    def _equilibrium(self, sample: SampleInput) -> Equilibrium:
        """The full load at once, which nearly always converges; the scene's ramp if it does not."""
        try:
            return equilibrium(self, sample.laws, sample.mu_equilibrium)
        except NotConverged:
            if self.steps == 1:
                raise
        return equilibrium(self, sample.laws, sample.mu_equilibrium, self.steps)

    @property
    def w(self) -> Array:
        """Areas of the contact elements [m^2]."""
        return self.brake.w

    @property
    def g0(self) -> Array:
        """Gaps of the undeformed bodies [m]."""
        return self.brake.g0

    def _draw(self, approach: str, k: int) -> SampleInput:
        return draw_sample(self.scene, approach, k, self.brake.contact, self.library, self.hdf)

    def _reduced(self, eq: Equilibrium, sample: SampleInput) -> dict[str, Any]:
        return _arrays(modes := self.reduced.modes(eq.k, sample.mu)) | {
            "coordinates": modes.right.astype(np.complex64)
        }

    def _full(self, eq: Equilibrium, sample: SampleInput) -> dict[str, Any]:
        from brake_fenicsx.stability import complex_modes, contact_interface
        from brake_fenicsx.stability.operators import tangent

        stability, b = self.scene.stability, self.brake
        if stability is None:
            return {}
        K = tangent(self.K, b.N, b.T, b.w, eq.k, sample.mu)
        band = (stability.band[0], stability.band[1])
        friction = contact_interface(b.N, b.T, b.w * eq.k, sample.mu) if sample.mu.any() else None
        modes = complex_modes(self.M, None, K, band, zeta_max=stability.zeta_max, friction=friction)
        unstable = np.flatnonzero(np.array(modes.verdict) == "unstable")
        out = _arrays(modes)
        out |= {"vectors": modes.right[:, unstable].astype(np.complex64), "vector_mode": unstable}
        if self.reduced is not None:
            coordinates = self.reduced.Phi.T @ (self.reduced.M @ modes.right)
            out["coordinates"] = coordinates.astype(np.complex64)
        return out

    def write(self) -> Results:
        """modes.csv, samples.csv and contact.csv from the stored samples."""
        results = Results(self.store, self.tasks, self.verify)
        if self.comm.rank == 0:
            path = self.store.path
            write_rows(path("samples.csv"), results.sample_columns(SAMPLES), results.samples())
            if "stability" in self.scene.stages:
                write_rows(path("modes.csv"), MODES, results.modes())
            write_rows(path("contact.csv"), CONTACT, results.contact(self.brake.contact))
        return results


def _arrays(modes: Any) -> dict[str, Any]:
    return {
        "s": modes.s, "residual": modes.residual, "error": modes.error,
        "condition": modes.condition, "verdict": np.array(modes.verdict, dtype=str),
        "damping": modes.damping, "expected": modes.count.expected, "counted": modes.count.how,
        "stability_seconds": modes.seconds,
    }  # fmt: skip

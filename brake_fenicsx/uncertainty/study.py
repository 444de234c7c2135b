"""The samples of a scene: what they share, each one's equilibrium and modes, their tables."""

from __future__ import annotations

import time
from dataclasses import fields, replace
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult, NotConverged
from brake_fenicsx.log import Progress, logger
from brake_fenicsx.macro.brake import Brake
from brake_fenicsx.macro.braking import reference_stiffness
from brake_fenicsx.macro.condensation import Compliance, compliance, gathered
from brake_fenicsx.macro.corrected import Bodies, corrected_equilibrium
from brake_fenicsx.macro.equilibrium import Equilibrium, displacement, equilibrium
from brake_fenicsx.macro.gap import EnrichedGap
from brake_fenicsx.macro.solver import local_rows
from brake_fenicsx.micro import LawRecipe, make_library
from brake_fenicsx.micro.law import Laws
from brake_fenicsx.report.tables import CONTACT, MODES, SAMPLES, write_rows
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene_samples import split_key
from brake_fenicsx.store import Store
from brake_fenicsx.surface.hdf import HeightDistribution

from .bulk import Bulk, assemble_bulk
from .ensemble import Task, run_ensemble
from .inputs import PERFECT, points_of
from .outcomes import ensembles
from .results import Results
from .robustness import write_causes
from .sampling import SampleInput, draw_sample, sample_count

Array = NDArray[np.float64]

VERIFY = "verify"

# Real modes up to this multiple of the band tell the modes of changed bodies apart.
FAMILIES = 1.3


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
        recipe: LawRecipe | None = None,
    ):
        """Collect what the samples need.

        Args:
            scene: the scene.
            brake: its operators.
            library: pressure-gap laws, if the scene makes any.
            hdf: height distribution, if the scene has a surface.
            store: the results folder.
            comm: processes that share the samples.
            recipe: how laws are made, where each sample makes its own; ``library`` then holds
                those of sample 0.
        """
        self.recipe = recipe
        self.scene, self.brake, self.library, self.hdf = scene, brake, library, hdf
        self.store, self.comm = store, comm
        self.facts: dict[str, Any] = {}
        self.reduced: Any = None
        self.compliance: Compliance | None = None
        self.K, self.M = gathered(brake.K), gathered(brake.M)
        self.steps = max((load.steps for load in scene.loads.values()), default=1)
        approaches = scene.samples.approaches
        count = {name: sample_count(scene, name) for name in approaches}
        self.points = {name: points_of(scene, name) for name in approaches}
        self.bulk: Bulk | None = None
        self.loads: dict[str, Array] = {}
        self.shapes: Array | None = None
        self.tasks: list[Task] = [
            (name, k) for name in scene.samples.approaches for k in range(count[name])
        ]
        stability = scene.stability if "stability" in scene.stages else None
        # One sample alone does not pay for a basis: it is solved at full order.
        self.by_reduction = {
            name: stability is not None and stability.method == "reduced" and count[name] > 1
            and not self.changes_bodies(name)
            for name in approaches
        }  # fmt: skip
        self.verified = next((name for name, reduced in self.by_reduction.items() if reduced), "")
        self.verify: list[Task] = []
        if stability is not None and self.verified:
            most = min(stability.verify, count[self.verified])
            self.verify = [(VERIFY, k) for k in range(most)]

    def changes_bodies(self, approach: str) -> bool:
        """Whether the materials of an approach's samples differ from those of the scene."""
        random = self.scene.samples.random
        materials = any(split_key(name)[0] == "materials" for name in random)
        return materials and self.scene.samples.takes_random(approach)

    def prepare(self) -> None:
        """Factor the reference, and make or load the reduced basis."""
        brake = self.brake
        laws = self._reference_laws()
        pressure = brake.pressed / float(brake.w.sum())
        k0 = np.full(len(brake.w), reference_stiffness(laws, pressure))
        self.facts["reference_stiffness_Pa_per_m"] = float(k0[0])
        if any(self.by_reduction.values()):
            self._prepare_reduced(k0)
        else:
            self.compliance = compliance(self.K, brake.N, brake.T, brake.w, brake.f, k0, self.comm)
        self._prepare_bodies()

    def _reference_laws(self) -> EnrichedGap:
        """Laws of the first sample that can be drawn, of rough contact if there is any."""
        names = self.scene.samples.approaches
        name = next((n for n in names if n not in PERFECT), names[0])
        for k in range(sum(task[0] == name for task in self.tasks)):
            try:
                return self._draw(name, k).laws
            except InaccurateResult as error:
                reason = error
        raise reason

    def _prepare_bodies(self) -> None:
        """Unit changes of random materials and loads, and shapes to tell modes apart by."""
        random, compliance = self.scene.samples.random, self.compliance
        sections = {split_key(name)[0] for name in random}
        if not sections & {"materials", "loads"} or compliance is None:
            return
        self.bulk = assemble_bulk(self.scene, self.brake)
        N = self.brake.N
        self.loads = {face: N @ compliance.factor.solve(f) for face, f in self.bulk.loads.items()}
        names = [name for name in self.by_reduction if self.changes_bodies(name)]
        stability = self.scene.stability
        if not names or stability is None or "stability" not in self.scene.stages:
            return
        logger.info("%s: bodies change from sample to sample, full order", ", ".join(names))
        if self.reduced is None:
            from brake_fenicsx.stability.lanczos import lowest_modes

            limit = (2 * np.pi * FAMILIES * stability.band[1]) ** 2
            rows = local_rows(self.M)
            found = None
            if self.comm.rank == 0:
                found = lowest_modes(compliance.factor, rows, limit).Phi
            self.shapes = self.comm.bcast(found, root=0)

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
        from brake_fenicsx.stability.reduction import ORDER

        stored = self.store.load("cache/basis.npz")
        if stored is None or len(stored["NN"]) != ORDER + 1:
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
            approach = self.verified
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
        if sample.random:
            out["rejected"] = sample.rejected
        if "stability" not in self.scene.stages:
            return out
        reduced = self.by_reduction[approach] and task[0] != VERIFY
        return out | self.modes_of_sample(sample, eq, reduced)

    def modes_of_sample(
        self, sample: SampleInput, eq: Equilibrium, reduced: bool
    ) -> dict[str, Any]:
        """Complex modes of a sample, as arrays to store: the one place that chooses the solver.

        Args:
            sample: its inputs; materials that differ from the scene's change the stiffness.
            eq: its equilibrium.
            reduced: whether the reduced model of the scene's own bodies serves.
        """
        if reduced and not sample.materials:
            return self._reduced(eq, sample)
        if self.bulk is None or not sample.materials:
            return self._full(eq, sample, self.K)
        return self._full(eq, sample, self.bulk.stiffness(sample.materials))

    def _equilibrium(self, sample: SampleInput) -> Equilibrium:
        """The full load at once, which nearly always converges; the scene's ramp if it does not."""
        try:
            return self._loaded(sample, 1)
        except NotConverged:
            if self.steps == 1:
                raise
        return self._loaded(sample, self.steps)

    def _loaded(self, sample: SampleInput, steps: int) -> Equilibrium:
        """Equilibrium in equal load steps, of the scene's bodies or of the sample's own."""
        laws, mu = sample.laws, sample.mu_equilibrium
        bulk = self.bulk
        if bulk is None or not (sample.materials or sample.pressures):
            return equilibrium(self, laws, mu, steps)
        bodies = self.bodies(sample)
        if not sample.materials:
            return equilibrium(bodies, laws, mu, steps)
        try:
            return corrected_equilibrium(bodies, bulk.change(sample.materials), laws, mu, steps)
        except NotConverged:
            logger.info("the materials of a sample are far from the scene's: factored afresh")
        b, K, k0 = self.brake, bulk.stiffness(sample.materials), bodies.compliance.k0
        own = compliance(K, b.N, b.T, b.w, bodies.f, k0, MPI.COMM_SELF)
        own_bodies = replace(bodies, compliance=own)
        eq = equilibrium(own_bodies, laws, mu, steps)
        u = displacement(own_bodies, eq, bodies.f)
        own.factor.destroy()
        return replace(eq, u=u)

    def bodies(self, sample: SampleInput) -> Bodies:
        """The scene's bodies under the loads of a sample."""
        b, c = self.brake, self.compliance
        if c is None:
            raise ValueError("prepare() comes first")
        if self.bulk is None:
            return Bodies(b.N, b.T, b.w, b.g0, b.f, c)
        Nf = c.Nf
        for face, value in sample.pressures.items():
            Nf = Nf + (value - self.bulk.pressures[face]) * self.loads[face]
        f = b.f + self.bulk.added_loads(sample.pressures, b.f)
        return Bodies(b.N, b.T, b.w, b.g0, f, replace(c, Nf=Nf))

    def displacement(self, task: Task, data: dict[str, Any]) -> Array:
        """Displacement of a stored sample's equilibrium [m], shape (dofs,)."""
        sample = self._draw(*task)
        if sample.materials:
            u = self._equilibrium(sample).u
            if u is None:
                raise ValueError("an equilibrium of changed bodies without displacement")
            return u
        zero: tuple[Any, ...] = ((0,), 0.0, (), 0.0)
        eq = Equilibrium(data["g"], data["p"], data["k"], data["mu_equilibrium"], *zero)
        bodies = self.bodies(sample)
        return displacement(bodies, eq, bodies.f)

    @property
    def w(self) -> Array:
        """Areas of the contact elements [m^2]."""
        return self.brake.w

    @property
    def g0(self) -> Array:
        """Gaps of the undeformed bodies [m]."""
        return self.brake.g0

    def _draw(self, approach: str, k: int) -> SampleInput:
        points = self.points[approach]
        point = None if points is None else points[k]
        library = self.library if approach in PERFECT else self._laws(k)
        return draw_sample(self.scene, approach, k, self.brake.contact, library, self.hdf, point)

    def _laws(self, k: int) -> Laws | None:
        """The library, or the laws that sample ``k`` makes for itself."""
        micro = self.scene.micro
        if micro is None or not micro.fresh or k == 0 or self.recipe is None:
            return self.library
        numbers = range(k * micro.laws_per_sample, (k + 1) * micro.laws_per_sample)
        made = [self.recipe.law(micro.seed, i) for i in numbers]
        return make_library(made, list(numbers))

    def _reduced(self, eq: Equilibrium, sample: SampleInput) -> dict[str, Any]:
        return _arrays(modes := self.reduced.modes(eq.k, sample.mu)) | {
            "coordinates": modes.right.astype(np.complex64)
        }

    def _full(self, eq: Equilibrium, sample: SampleInput, stiffness: Any) -> dict[str, Any]:
        from brake_fenicsx.stability import complex_modes, contact_interface
        from brake_fenicsx.stability.operators import tangent

        stability, b = self.scene.stability, self.brake
        if stability is None:
            return {}
        K = tangent(stiffness, b.N, b.T, b.w, eq.k, sample.mu)
        band = (stability.band[0], stability.band[1])
        friction = contact_interface(b.N, b.T, b.w * eq.k, sample.mu) if sample.mu.any() else None
        modes = complex_modes(self.M, None, K, band, zeta_max=stability.zeta_max, friction=friction)
        unstable = np.flatnonzero(np.array(modes.verdict) == "unstable")
        out = _arrays(modes)
        out |= {"vectors": modes.right[:, unstable].astype(np.complex64), "vector_mode": unstable}
        shapes = self.shapes if self.reduced is None else self.reduced.Phi
        if shapes is not None:
            coordinates = shapes.T @ (local_rows(self.M) @ modes.right)
            out["coordinates"] = coordinates.astype(np.complex64)
        return out

    def write(self) -> Results:
        """modes.csv, samples.csv and contact.csv from the stored samples."""
        results = Results(self.store, self.tasks, self.verify, self.verified)
        if self.comm.rank == 0:
            path = self.store.path
            write_rows(path("samples.csv"), results.sample_columns(SAMPLES), results.samples())
            if "stability" in self.scene.stages:
                write_rows(path("modes.csv"), MODES, results.modes())
            write_rows(path("contact.csv"), CONTACT, results.contact(self.brake.contact))
            stability = self.scene.stability
            if stability is not None and {"stability", "uncertainty"} <= {*self.scene.stages}:
                found = ensembles(results, stability.band)
                self.facts["robustness"] = write_causes(path(), self.scene.samples, found)
        return results


def _arrays(modes: Any) -> dict[str, Any]:
    return {
        "s": modes.s, "residual": modes.residual, "error": modes.error,
        "condition": modes.condition, "verdict": np.array(modes.verdict, dtype=str),
        "damping": modes.damping, "expected": modes.count.expected, "counted": modes.count.how,
        "stability_seconds": modes.seconds,
    }  # fmt: skip

"""The samples of a scene: what they share, each one's equilibrium and modes, their tables."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import BrakeError, InaccurateResult
from brake_fenicsx.log import logger
from brake_fenicsx.macro.brake import Brake
from brake_fenicsx.macro.braking import reference_stiffness
from brake_fenicsx.macro.condensation import Compliance, compliance, gathered
from brake_fenicsx.macro.equilibrium import Equilibrium
from brake_fenicsx.macro.gap import EnrichedGap
from brake_fenicsx.macro.solver import local_rows
from brake_fenicsx.micro import LawRecipe, make_library
from brake_fenicsx.micro.law import Laws
from brake_fenicsx.report.tables import CONTACT, MODES, SAMPLES, write_rows
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene_damping import active_terms
from brake_fenicsx.scene_samples import split_key
from brake_fenicsx.shelf import Shelf, of_bodies
from brake_fenicsx.store import Store
from brake_fenicsx.surface.hdf import HeightDistribution

from .bulk import Bulk, assemble_bulk
from .ensemble import Task, run_ensemble
from .equilibria import Equilibria
from .inputs import PERFECT, points_of
from .numbering import FILE as DOFS
from .numbering import Numbering
from .outcomes import ensembles
from .results import Results
from .robustness import write_causes
from .sampling import SampleInput, draw_sample, sample_count

if TYPE_CHECKING:
    from brake_fenicsx.stability.terms import Terms

    from .changing import ChangingBodies
    from .solve import Shared

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
        recipe: LawRecipe | None = None,
        shelf: Shelf | None = None,
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
            shelf: what the folder shares with others; nothing if None.
        """
        self.recipe, self.shelf = recipe, shelf or Shelf(store)
        self.scene, self.brake, self.library, self.hdf = scene, brake, library, hdf
        self.store, self.comm = store, comm
        self.facts: dict[str, Any] = {}
        self.reduced: Any = None
        self.K, self.M = gathered(brake.K), gathered(brake.M)
        approaches = scene.samples.approaches
        count = {name: sample_count(scene, name) for name in approaches}
        self.points = {name: points_of(scene, name) for name in approaches}
        self.bulk: Bulk | None = None
        self.equilibria: Equilibria | None = None
        self.modal: Shared | None = None
        self.changing: ChangingBodies | None = None
        self.terms: Terms | None = None
        self.numbering: Numbering
        self.tasks: list[Task] = [
            (name, k) for name in scene.samples.approaches for k in range(count[name])
        ]
        stability = scene.stability if "stability" in scene.stages else None
        # One sample alone does not pay for a basis: it is solved at full order.
        self.by_reduction = {
            name: stability is not None and stability.method == "reduced" and count[name] > 1
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

    def damped(self, approach: str) -> bool:
        """Whether damping acts in an approach's samples."""
        return bool(active_terms(self.scene, approach))

    def prepare(self) -> None:
        """Factor the reference, and make or load the reduced basis."""
        brake = self.brake
        if "stability" in self.scene.stages:
            from brake_fenicsx.stability.terms import damping_terms

            self.terms = damping_terms(self.scene, brake)
            with self.shelf.shared(DOFS, lambda: of_bodies(self.scene), self.comm):
                self.numbering = Numbering(brake, local_rows(self.K), self.store, self.comm)
        laws = self._reference_laws()
        pressure = brake.pressed / float(brake.w.sum())
        # Any value serves; a round one is that of similar scenes too.
        k0 = np.full(len(brake.w), float(f"{reference_stiffness(laws, pressure):.1e}"))
        self.facts["reference_stiffness_Pa_per_m"] = float(k0[0])
        if self._of_one_body():
            seen = self._prepare_reduced(k0)
        else:
            seen = compliance(self.K, brake.N, brake.T, brake.w, brake.f, k0, self.comm)
        if {split_key(name)[0] for name in self.scene.samples.random} & {"materials", "loads"}:
            self.bulk = assemble_bulk(self.scene, self.brake)
        self._prepare_changing()
        steps = max((load.steps for load in self.scene.loads.values()), default=1)
        self.equilibria = Equilibria(brake, seen, steps, self.bulk, self.changing)
        self._prepare_modes()

    def _of_one_body(self) -> list[str]:
        """Approaches that the reduced model of the scene's own bodies serves."""
        return [n for n, r in self.by_reduction.items() if r and not self.changes_bodies(n)]

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

    def _acting(self) -> list[Any]:
        """What the damping of the bodies depends on beside themselves."""
        stability = self.scene.table.get("stability", {})
        return [stability.get("damping"), self.scene.table.get("motion")]

    @contextmanager
    def _shared(self, name: str, k0: Array | float, *depends: Any) -> Iterator[None]:
        """A reduced model on springs k0, from other folders or for them."""
        stability = self.scene.stability
        band = None if stability is None else [*stability.band, stability.cutoff]
        here = [self.numbering.kept_mark, np.unique(k0).tolist(), band, *depends]
        with self.shelf.shared(name, lambda: [of_bodies(self.scene), *here], self.comm):
            yield

    def _prepare_changing(self) -> None:
        """Reduced model of samples whose materials change; full order where there can be none."""
        names = [n for n, r in self.by_reduction.items() if r and self.changes_bodies(n)]
        damped = [n for n in names if self.damped(n)]
        self._try_changing(damped, self.terms)
        # Damping that no model takes leaves the samples without it theirs.
        if self.changing is None:
            self._try_changing([n for n in names if n not in damped], None)

    def _try_changing(self, names: list[str], terms: Terms | None) -> None:
        """Reduced model of the samples of some approaches, or full order for them."""
        if not names or self.bulk is None:
            return
        from .changing import FILE, MADE_WITH, ChangingBodies

        random, laws = self.scene.samples.random, self.scene.table["samples"]["random"]
        moduli = [n for n in sorted(random) if split_key(n)[0] == "materials"]
        box = [[n, laws[n], random[n].digest] for n in moduli]
        acts = None if terms is None else self._acting()
        try:
            with self._shared(FILE, 0.0, box, acts, self.numbering.mark, MADE_WITH.tolist()):
                self.changing = ChangingBodies(
                    self.scene, self.brake, (self.K, self.M), self.bulk, self.store, self.comm,
                    self.numbering.mark, terms,
                )  # fmt: skip
        except BrakeError as error:
            logger.warning("no reduced model of changing materials: %s; full order", error)
            self.by_reduction |= dict.fromkeys(names, False)
            return
        self.facts["changing_bodies"] = {"seconds": self.changing.basis.seconds}

    def _prepare_reduced(self, k0: Array) -> Compliance:
        """Reduced model of the scene's own bodies; returns them as seen from the contact."""
        from brake_fenicsx.stability.reduction import ORDER

        from .basis import FILE, compliance_of, reduced_model

        stability, brake = self.scene.stability, self.brake
        if stability is None:
            raise ValueError("a scene without [stability] has no modes")
        order = ORDER if any(not self.damped(name) for name in self._of_one_body()) else 0
        with self._shared(FILE, k0, order):
            self.reduced, self.facts["reduced_basis"] = reduced_model(
                stability, brake, self.K, self.M, k0, self.store, self.comm, self.numbering, order
            )
        return compliance_of(self.reduced, brake.f)

    def _prepare_modes(self) -> None:
        """What the samples' modes share; nothing without the stage stability."""
        stability, seen = self.scene.stability, self._prepared.compliance
        if stability is None or "stability" not in self.scene.stages:
            return
        from .basis import SHAPES, family_shapes
        from .solve import share

        special = [n for n in self.by_reduction if self.damped(n) or self.changes_bodies(n)]
        full = [n for n in special if not self.by_reduction[n]]
        if full:
            logger.info("%s: damping or materials of their own, full order", ", ".join(full))
        shapes = None
        many = any(sum(task[0] == name for task in self.tasks) > 1 for name in full)
        if (many or self.changing is not None) and self.reduced is None:
            with self._shared(SHAPES, seen.k0):
                shapes = family_shapes(
                    seen.factor, self.M, stability.band[1], self.store, self.comm,
                    self.numbering,
                )  # fmt: skip
        whole = (self.K, self.M)
        self.modal = share(self.scene, self.brake, whole, self.bulk, self.reduced, self.terms)
        self.modal.shapes = shapes
        if self.changing is not None:
            self.modal.take_changing(self.changing)
        if self.modal.damping:
            self.facts["damping"] = self.modal.damping
        self._prepare_damped(self.modal)
        for term, numbers in self.modal.damping.items():
            said = ", ".join(f"{name} = {value}" for name, value in numbers.items())
            logger.info("damping, %s: %s", term, said)

    def _prepare_damped(self, modal: Shared) -> None:
        """Damping in the reduced model; full order where it is too strong for that."""
        names = [name for name in self._of_one_body() if self.damped(name)]
        if not names or modal.terms is None or modal.reduced is None:
            return
        from .basis import DAMPED_FILE, damped_model

        try:
            with self._shared(DAMPED_FILE, modal.reduced.basis.k0, self._acting()):
                modal.damped = damped_model(
                    modal.reduced, modal.terms, self.brake.contact, self.store, self.comm
                )
        except InaccurateResult as error:
            logger.warning("%s; full order", error)
            self.by_reduction |= dict.fromkeys(names, False)
            return
        self.facts["damped_basis"] = {
            "seconds": modal.damped.seconds,
            "converges_up_to_hz": modal.damped.basis.radius / 2 / np.pi,
        }

    def run(self) -> None:
        """Run every sample that is not stored yet; long ones first."""
        long = [t for t in self.tasks if not self.by_reduction[t[0]]]
        short = [t for t in self.tasks if self.by_reduction[t[0]]]
        # An equilibrium alone is no work for several processes.
        size = 1 if self.modal is None else self.scene.samples.processes_per_sample
        run_ensemble(short, self.work, self.store, self.comm, [*long, *self.verify], size)

    def work(self, task: Task, comm: MPI.Comm = MPI.COMM_SELF) -> dict[str, Any]:
        """Equilibrium and modes of one sample, as arrays to store; process 0 of comm has them."""
        begun = self._begun(task) if comm.rank == 0 else None
        out, sample, eq, reduced = comm.bcast(begun)
        if self.modal is not None:
            from .solve import modes_of_sample

            out |= modes_of_sample(self.modal, sample, eq, reduced, comm)
            if "vectors" in out:
                out["vectors"] = self.numbering.kept(out["vectors"])
        return dict(out)

    def _begun(self, task: Task) -> tuple[dict[str, Any], SampleInput, Equilibrium, bool]:
        """A sample up to its equilibrium, and whether a reduced model gives its modes."""
        approach, k = task
        if approach == VERIFY:
            approach = self.verified
        sample = self._draw(approach, k)
        reduced = self.by_reduction[approach] and task[0] != VERIFY
        if sample.materials and self.changing is not None:
            reduced &= self.changing.box.holds(sample.random)
        eq = self._prepared.of(sample, reduced)
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
        return out, sample, eq, reduced

    def displacement(self, task: Task, data: dict[str, Any]) -> Array:
        """Displacement of a stored sample's equilibrium [m], shape (dofs,)."""
        return self._prepared.displacement(self._draw(*task), data)

    @property
    def _prepared(self) -> Equilibria:
        if self.equilibria is None:
            raise ValueError("prepare() comes first")
        return self.equilibria

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

    def write(self) -> Results:
        """modes.csv, samples.csv and contact.csv from the stored samples."""
        results = Results(self.store, self.tasks, self.verify, self.verified)
        if self.comm.rank == 0:
            path = self.store.path
            write_rows(path("samples.csv"), results.sample_columns(SAMPLES), results.samples())
            if "stability" in self.scene.stages:
                write_rows(path("modes.csv"), results.mode_columns(MODES), results.modes())
            write_rows(path("contact.csv"), CONTACT, results.contact(self.brake.contact))
            stability = self.scene.stability
            if stability is not None and {"stability", "uncertainty"} <= {*self.scene.stages}:
                found = ensembles(results, stability.band)
                self.facts["robustness"] = write_causes(path(), self.scene.samples, found)
        return results

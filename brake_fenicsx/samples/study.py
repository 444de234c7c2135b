"""The samples of a scene: what they share, and each one's equilibrium and modes."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

from mpi4py import MPI

import numpy as np

from brake_fenicsx.arguments import Array, Complex
from brake_fenicsx.build.brake import Brake
from brake_fenicsx.build.parametric import parametric_brake
from brake_fenicsx.errors import BrakeError, InaccurateResult, OfOneProcess, SceneError
from brake_fenicsx.extensions import beside_samples, load
from brake_fenicsx.folder.files import SharedCache
from brake_fenicsx.folder.sample_files import Task
from brake_fenicsx.folder.store import Store
from brake_fenicsx.macro.braking import reference_stiffness
from brake_fenicsx.macro.contact_forces import EnrichedGap
from brake_fenicsx.macro.equilibrium import Equilibrium
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.scalars import changes_bodies
from brake_fenicsx.stability.modes import Modes
from brake_fenicsx.stability.substructures.parameter_line import Basis

from . import drivers, ensemble, forces, sampling
from .models import Models
from .solve import Equilibria, More, displacements, full_modes, modes_of_sample, reduced_modes

T = TypeVar("T")

VERIFY = "verify"
# [dofs] below which two processes may share a sample at full order: each holds a factor, and the
# vectors that they exchange are a message of less than 2 GB.
LARGEST = 500_000


class Study(OfOneProcess):
    """All samples of a scene on one brake."""

    def __init__(
        self,
        scene: Scene,
        brake: Brake,
        rough: sampling.Roughness,
        store: Store,
        comm: MPI.Comm,
        cache: SharedCache | None = None,
        zones: Mapping[str, sampling.Roughness] | None = None,
    ):
        """Collect what the samples need.

        Args:
            scene: the scene.
            brake: its operators.
            rough: what the scene makes of its surface.
            store: the results folder.
            comm: processes that share the samples.
            cache: what the folder shares with others; nothing if None.
            zones: interfaces that have a surface of their own.
        """
        self.rough: sampling.Roughness = rough
        self.zones: Mapping[str, sampling.Roughness] = zones or {}
        self.scene: Scene = scene
        self.brake: Brake = brake
        self.store: Store = store
        self.comm: MPI.Comm = comm
        self.facts: dict[str, Any] = {}
        approaches = scene.samples.approaches
        count = {name: sampling.sample_count(scene, name) for name in approaches}
        self.points: dict[str, Array | None] = {
            name: sampling.points_of(scene, name) for name in approaches
        }
        self.tasks: list[Task] = [(name, k) for name in approaches for k in range(count[name])]
        self.models: Models = Models(scene, count, store, comm, cache or SharedCache(store))
        self.equilibria = Equilibria.of_scene(scene, self.models)
        self._displaced: dict[Task, Array] = {}
        self._first: dict[str, Array | None] = {}
        self._drawn: dict[Task, sampling.SampleInput] = {}  # the last one
        # Vectors of the families, once the tables are written; on one process.
        self.families: Complex | None = None
        self.squealing: list[int] = []
        self.beside: dict[str, Any] = {}  # what extras compute -> the work
        reduced = self.models.reduction.by_reduction
        self.verified: str = next((name for name in approaches if reduced[name]), "")
        self.verify: list[Task] = []
        if scene.stability is not None and self.verified:
            most = min(scene.stability.verify, count[self.verified])
            self.verify = [(VERIFY, k) for k in range(most)]

    def prepare(self) -> None:
        """Factor the reference, and make or load the reduced models."""
        brake, models = self.brake, self.models
        sampling.note_laws(self.scene)
        models.brake = parametric_brake(self.scene, brake)
        pressure = brake.pressed / float(brake.w.sum())
        # Any value serves; a round one is that of similar scenes too.
        k0 = float(f"{reference_stiffness(self._reference_laws(), pressure):.1e}")
        models.prepare(np.full(len(brake.w), k0))
        self.facts |= {"reference_stiffness_Pa_per_m": k0, **models.facts}
        if models.stability is not None:
            works = beside_samples(self.scene)
            self.beside = {what: load(name)(self.scene, models) for what, name in works.items()}

    def _reference_laws(self) -> EnrichedGap:
        """Laws of the first sample that can be drawn, of rough contact if there is any."""
        names = self.scene.samples.approaches
        name = next((n for n in names if n not in sampling.PERFECT), names[0])
        for k in range(sum(task[0] == name for task in self.tasks)):
            try:
                return self.sample((name, k)).laws
            except InaccurateResult as error:
                reason = error
        raise reason

    def run(self, first: int | None = None) -> None:
        """Run every sample that is not stored yet; long ones first, then approaches of few samples.

        Those of the verification are left to `verified_beside`, except by a share of a run.

        Args:
            first: so many of each approach, without the verification; all if None.
        """
        reduced = self.models.reduction.by_reduction
        tasks = [t for t in self.tasks if first is None or t[1] < first]
        long = [t for t in tasks if not reduced[t[0]]]
        if first is None and self.store.share is not None:
            long += self.verify
        # One sample that takes long comes before many, which fill the time of the others.
        count = Counter(approach for approach, _ in tasks)
        short = sorted((t for t in tasks if reduced[t[0]]), key=lambda t: count[t[0]])
        ensemble.run_ensemble(short, self.work, self.store, self.comm, long, paired=self._paired)

    @property
    def few(self) -> bool:
        """Whether all samples take less time than one at full order, without its processes."""
        reduced, free = self.models.reduction.by_reduction, self.comm.size - len(self.verify)
        soon = len(self.tasks) <= ensemble.AS_LONG * free
        return bool(self.verify) and soon and all(reduced[name] for name, _ in self.tasks)

    @property
    def _paired(self) -> bool:
        """Whether two processes may share a sample: an equilibrium alone is no work for them."""
        return self.models.stability is not None and self.brake.K.shape[0] < LARGEST

    def verified_beside(
        self,
        works: Sequence[Callable[[], T]],
        together: Callable[[MPI.Comm], Sequence[Callable[[], T]]] | None = None,
    ) -> list[T]:
        """Solve the samples of the verification at full order; other work fills the time.

        Args:
            works: what processes without such a sample do: no part of the results depends on it.
            together: what they do before, see ``run_ensemble``.

        Returns:
            What came of each work, on every process.
        """
        parts = ("samples at full order", self.verify), ("pictures and figures", works)
        what = ", ".join(name for name, there in parts if there)
        given = self.verify, what, self._paired, works, together
        return ensemble.run_ensemble((), self.work, self.store, self.comm, *given)

    def work(self, task: Task, comm: MPI.Comm = MPI.COMM_SELF) -> dict[str, Any]:
        """Equilibrium and modes of one sample, as arrays to store.

        Args:
            task: approach and number of the sample.
            comm: processes that share it; the first has what is to be stored.

        Raises:
            BrakeError: it has none, a matrix of it is singular, or its verification fails; what is
                known of its inputs is in ``known``.
        """
        approach, k = task
        known: dict[str, Any] = {
            "seed": np.uint64(sampling.sample_seed(self.scene.samples.seed, k))
        }
        try:
            sample = self.sample((self.verified if approach == VERIFY else approach, k))
            names = sorted(sample.values)
            known |= {
                "mu": sample.friction.mu,
                "mean_mu": forces.mean_friction(self.brake.contact, sample.friction.mu),
                "random_names": np.array(names, dtype=str),
                "random": np.array([sample.values[n] for n in names]),
            }
            if sample.values:
                known["rejected"] = sample.rejected
            return known | self._solved(task, sample, comm)
        except Exception as error:
            failed = self._named(task, error)
            if failed is None:
                raise
            failed.known = {**known, **failed.known}
            if failed is error:
                raise
            raise failed from error

    def _named(self, task: Task, error: Exception) -> BrakeError | None:
        """How a sample fails; None for a defect of the program, which ends the run."""
        if isinstance(error, BrakeError):
            return error
        if isinstance(error, np.linalg.LinAlgError):
            return InaccurateResult(f"a matrix of the sample: {error}")
        # Beside the samples: whatever it is costs the comparison alone.
        if task[0] == VERIFY:
            return InaccurateResult(f"verification at full order: {error}")
        return None

    def _solved(self, task: Task, sample: sampling.SampleInput, comm: MPI.Comm) -> dict[str, Any]:
        """Equilibrium and modes of a sample by its inputs; arguments as above."""
        k, models, own = task[1], self.models, task[0] != VERIFY
        reduced = own and models.reduction.takes(sample)
        start = self._first_gaps(sample.approach) if k and reduced else None
        sample, eq = self.equilibria.of(sample, reduced, start)
        out: dict[str, Any] = {n: getattr(eq, n) for n in ("g", "p", "k", "k_vibration")}
        out |= {"mu_equilibrium": sample.friction.equilibrium, "g_cr": sample.laws.g_cr}
        out |= {"law": sample.laws.index, "equilibrium_iterations": sum(eq.iterations)}
        out |= {"equilibrium_residual": eq.residual, "equilibrium_seconds": eq.seconds}
        contact = sample.brake.contact
        out["beyond_laws"] = sample.laws.beyond(eq.p, contact.w)
        if contact is not self.brake.contact:
            out["moved"] = forces.moved(contact)
        out["forces"] = forces.forces_of_sample(self.scene, contact, eq.p, sample.friction.mu)
        if models.stability is not None:
            more: list[More] = []
            if models.stability.drivers and own and comm.rank == 0:
                given = self.equilibria, sample, eq, k == 0
                more.append(("drivers", partial(drivers.driver_arrays, *given)))
            extras = self.beside.items() if own and comm.rank == 0 else ()
            more += [(what, partial(work.of, sample, eq)) for what, work in extras]
            out |= modes_of_sample(models, sample, eq, reduced, more, comm)
        return out

    def _first_gaps(self, approach: str) -> Array | None:
        """Gaps of the first sample of an approach [m], from which the others start.

        Each process computes them for itself, so that no sample depends on which others its process
        took. None where the first sample has no equilibrium.
        """
        if approach not in self._first:
            self._first[approach] = None
            with suppress(BrakeError):
                self._first[approach] = self.balance(self.sample((approach, 0)), True).g
        return self._first[approach]

    def solved(
        self, task: Task, values: Mapping[str, float], start: Array | None = None,
        line: Basis | None = None,
    ) -> tuple[Equilibrium, Modes]:  # fmt: skip
        """Equilibrium and modes of a sample some of whose inputs take other values; not stored.

        Args:
            task: approach and number of the sample.
            values: scalars of the scene by dotted key, SI.
            start: gaps of an equilibrium nearby [m], to start from.
            line: the sample at other values, on whose vectors its modes are found where these
                suffice.

        Returns:
            The equilibrium, and the modes, which the mesh can show, with vectors in coordinates in
            which the mass is about the identity.
        """
        models = self.models
        for key in values:
            if changes_bodies(self.scene, key) and key not in models.brake.changes.box.names:
                raise SceneError(f"""{key}: enters the matrices of the bodies; name it in
                    [sweep.parameters] or [samples.random], or give its range to prepare(..,
                    parameters={{..}})""")
        sample = self.sample(task, values)
        reduced = models.reduction.takes(sample)
        sample, eq = self.equilibria.of(sample, reduced, start)
        if reduced:
            modes = reduced_modes(models, sample, eq, line)
            contact = {"k_vibration": eq.k_vibration, "p": eq.p}
            known: dict[str, Any] = {**contact, "s": modes.s, "coordinates": modes.right}
            return eq, replace(modes, on_mesh=partial(self._on_mesh, sample, known))
        modes = full_modes(models, sample, eq)
        known = {"vectors": modes.right, "vector_mode": np.arange(len(modes))}
        right, left = models.coordinates.of(modes.right), models.coordinates.of(modes.left)
        if right is None or left is None:
            raise ValueError("prepare() made no coordinates")
        on_mesh = partial(self._on_mesh, sample, known)
        return eq, replace(modes, right=right, left=left, on_mesh=on_mesh)

    def _on_mesh(
        self, sample: sampling.SampleInput, known: Mapping[str, Any], mode: int
    ) -> tuple[Any, Complex]:
        """Space of the displacements and those of a mode of a sample; see ``Modes.on_mesh``."""
        ((u, _),) = displacements(self.models, [(sample, known, np.array([mode]))], MPI.COMM_SELF)
        free = self.brake.elastic.free
        return free.V, free.expand(u[:, 0])

    def work_beside(self, what: str, task: Task, values: Mapping[str, float]) -> dict[str, Any]:
        """What an extra computes beside the modes of a sample; arguments as in ``solved``."""
        eq, modes = self.solved(task, values)
        sample = self.sample(task, values)
        reduced = self.models.reduction.takes(sample)
        return self.beside[what].of(sample, eq, modes, np.arange(len(modes)), reduced)

    def displacements(self, stored: Mapping[Task, Mapping[str, Any]]) -> dict[Task, Array]:
        """Displacements of the equilibria of stored samples [m], shape (dofs,) each; kept."""
        if self._displaced.keys() != stored.keys():
            given = [(self.sample(task), data) for task, data in stored.items()]
            found = self.equilibria.displacements(given)
            self._displaced = dict(zip(stored, found, strict=True))
        return self._displaced

    def sample(self, task: Task, values: Mapping[str, float] | None = None) -> sampling.SampleInput:
        """A sample with its brake, laws and friction, before its equilibrium.

        Args:
            task: approach and number of the sample.
            values: scalars by dotted key, SI, in place of those that are drawn or the scene's.

        Raises:
            InaccurateResult: its point of the design cannot be used and may not be replaced.
            SceneError: no brake has the given values.
        """
        if task not in self._drawn:
            (approach, k), points = task, self.points[task[0]]
            point = None if points is None else points[k]
            given = self.scene, approach, k, self.models.brake.at, self.rough, point
            drawn = sampling.draw_sample(*given, self.zones)
            self._drawn = {task: drawn}
        drawn = self._drawn[task]
        return sampling.at_values(drawn, values) if values else drawn

    def balance(self, sample: sampling.SampleInput, reduced: bool = False) -> Equilibrium:
        """Braking equilibrium of a sample; see ``Equilibria.of``."""
        return self.equilibria.of(sample, reduced)[1]

    def stored(self, task: Task) -> dict[str, Any]:
        """What was stored of a sample."""
        found = self.store.samples.load(task)
        if found is None:
            raise ValueError(f"{task}: not computed")
        return found

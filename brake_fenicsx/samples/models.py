"""Who gives the modes of a study's samples: the reduced model, or full order.

This is the one place that chooses. One reduced model serves all approaches whose samples something
damps, and one all others; a sample that none of them serves, an approach that asks for full order,
and what no reduced model takes (too strong damping, materials that are not positive definite
everywhere in their box) go to full order; ``Models.by_reduction`` says which approach goes where.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.build.brake import Brake
from brake_fenicsx.build.changes import Box, ChangingBodies, assemble_changes
from brake_fenicsx.build.material_table import layer_materials, scene_materials
from brake_fenicsx.build.shapes import body_centres
from brake_fenicsx.errors import BrakeError, SceneError, StorageError
from brake_fenicsx.folder.cache import SharedCache
from brake_fenicsx.folder.log import Progress, logger
from brake_fenicsx.folder.memory import release_memory
from brake_fenicsx.folder.processes import on_first
from brake_fenicsx.folder.store import Store
from brake_fenicsx.macro.condensation import Compliance, Solves, compliance
from brake_fenicsx.macro.contact import Contact
from brake_fenicsx.macro.equilibrium import Condensed
from brake_fenicsx.macro.layer_mass import layer_masses
from brake_fenicsx.scene import Scene, Stability
from brake_fenicsx.scene.approaches import active_terms, lone_samples, reduced_approaches
from brake_fenicsx.scene.digest import bodies_key
from brake_fenicsx.scene.scalars import changes_bodies, si_unit
from brake_fenicsx.scene.units import quantity_text

from .numbering import FILE as DOFS
from .numbering import Numbering, dof_points
from .sampling import friction_coefficients

if TYPE_CHECKING:
    from brake_fenicsx.build.damping_terms import Terms
    from brake_fenicsx.stability.substructures import (
        ContactLinearisation,
        Parameters,
        ReducedModel,
    )

    from .sampling import SampleInput

Array = NDArray[np.float64]

SHAPES = "cache/shapes.npz"
LAYERS = "cache/layers.npz"

# Real modes up to this multiple of the band tell modes apart where there is no reduced model.
FAMILIES = 1.3

# Kept modes reach this multiple of the band for limit cycles, which meet higher harmonics: on the
# block of the tutorials amplitudes are off by 29 % with 1.8, 7 % with 2.5, 0.7 % with 3 and 0.1 %
# with 4.
HARMONICS = 3.0

# Number of the layout of a kept reduced model; one of another layout is made again.
LAYOUT = 11


class Models:
    """The brake of a study as its samples see it.

    Attributes:
        by_reduction: whether a reduced model gives the modes of an approach's samples.
        numbering: tells the mesh and the bodies of the dofs; only with modes.
        compliance: the bodies seen from their contact elements, under the scene's loads.
        unit_loads: loads of 1 Pa on each loaded face [N/Pa], or the whole of a force [N], in the
            order of their names, shape (dofs, faces).
        changes: what random and swept scalars change in the bodies, if any do.
        reduced: damped or not -> the reduced model, where one serves any sample.
        terms: damping terms of the scene; None without damping.
        grams: mass of each layer between the kept modes of the reduced models, shape (kept modes,
            kept modes).
        facts: for the summary.
    """

    def __init__(
        self,
        scene: Scene,
        brake: Brake,
        counts: Mapping[str, int],
        store: Store,
        comm: MPI.Comm,
        cache: SharedCache,
    ):
        """Ask what there could be.

        Args:
            scene: the scene.
            brake: its operators.
            counts: number of samples of each approach.
            store: the results folder.
            comm: processes that share the work.
            cache: what the folder shares with others.
        """
        self._scene, self._counts = scene, counts
        self.brake: Brake = brake
        self._store, self._comm, self._cache = store, comm, cache
        self.facts: dict[str, Any] = {}
        self.changes: ChangingBodies | None = None
        self.reduced: dict[bool, ReducedModel] = {}
        self.terms: Terms | None = None
        self.grams: dict[str, Array] = {}
        self._shapes: Array | None = None
        self.compliance: Compliance
        self.unit_loads: Array = brake.unit_loads
        # Gaps under these, and forces that they press the contact faces together with.
        self._unit_gaps: Array = np.zeros((0, 0))
        self._unit_carried: Array | None = None
        self.numbering: Numbering
        self.stability: Stability | None = scene.stability if "stability" in scene.stages else None
        reduced = reduced_approaches(scene, counts)
        self.by_reduction: dict[str, bool] = {name: name in reduced for name in counts}

    @property
    def K(self) -> sp.csr_matrix:
        """Elastic stiffness [N/m], shape (dofs, dofs)."""
        return self.brake.K

    @property
    def M(self) -> sp.csr_matrix:
        """Mass [kg], likewise."""
        return self.brake.M

    @cached_property
    def masses(self) -> dict[str, sp.csr_matrix]:
        """Mass of each layer [kg], shape (dofs, dofs)."""
        scene, brake = self._scene, self.brake
        layers = layer_materials(scene, scene_materials(scene), brake.mesh.layers)
        density = {name: m.rho for name, m in layers.items()}
        lumped = scene.mesh.mass == "lumped"
        found = layer_masses(brake.mesh, brake.elastic.free, density, lumped)
        return found | brake.elastic.masses

    def changes_bodies(self, approach: str) -> bool:
        """Whether the bodies of an approach's samples differ from those of the scene."""
        samples, sweep = self._scene.samples, self._scene.sweep
        drawn = samples.random if samples.takes_random(approach) else {}
        names = {*drawn, *(sweep.parameters if sweep else ())}
        return any(changes_bodies(self._scene, name) for name in names)

    def damped(self, approach: str) -> bool:
        """Whether damping acts in an approach's samples."""
        return bool(active_terms(self._scene, approach))

    def parameter_point(self, drawn: Mapping[str, float]) -> Array:
        """A sample's point in the box of the reduced models."""
        return np.zeros(0) if self.changes is None else self.changes.box.point(drawn)

    def pressures(self, drawn: Mapping[str, float]) -> Array:
        """Factors of ``unit_loads`` in a sample: pressures [Pa], drawn or of the scene, or 1."""
        loads = sorted(self._scene.loads.items())
        own = {face: 1.0 if load.pressure is None else load.pressure for face, load in loads}
        return np.array([drawn.get(face, size) for face, size in own.items()])

    def loaded(self, pressures: Array) -> Compliance:
        """The bodies of the scene seen from their contact elements, under some pressures."""
        carried = None if self._unit_carried is None else float(self._unit_carried @ pressures)
        return replace(self.compliance, Nf=self._unit_gaps @ pressures, carried=carried)

    def takes(self, approach: str, drawn: Mapping[str, float]) -> bool:
        """Whether the reduced model takes a sample: its bodies lie in the box."""
        if self.changes is not None:
            self.changes.check_range(drawn)
        if not self.by_reduction[approach]:
            return False
        held = self.changes is None or self.changes.box.holds(drawn)
        if not held and self._by_ratio(approach):
            raise SceneError(
                f"stability.damping.modal: materials of a sample of {approach!r} lie outside of the"
                " range of the reduced model, and full order has no damping ratios"
            )
        return held

    def _by_ratio(self, approach: str) -> bool:
        """Whether damping ratios of the parts act, which full order does not have."""
        return "modal" in active_terms(self._scene, approach)

    def coordinates(self, u: NDArray[Any]) -> NDArray[Any] | None:
        """Displacements in the coordinates that families are followed in; None without any.

        Args:
            u: shape (dofs, columns).
        """
        for model in self.reduced.values():
            return model.coordinates(self._kept_mass, u)
        return None if self._shapes is None else self._shapes.T @ (self.M @ u)

    def shapes(self, coordinates: NDArray[Any]) -> NDArray[Any]:
        """Displacements of modes by the coordinates that families are followed in alone.

        Args:
            coordinates: shape (coordinates, columns).

        Returns:
            Shape (dofs, columns).
        """
        for model in self.reduced.values():
            return model.kept_displacements(coordinates)
        if self._shapes is None:
            raise ValueError("families have no coordinates")
        return np.asarray(self._shapes @ coordinates)

    @property
    def _kept_mass(self) -> sp.csr_matrix:
        """Mass at the centre of the box, in which the kept modes are orthonormal."""
        if self.changes is None:
            return self.M
        centre = self.changes.box.values(np.zeros(len(self.changes.box.names)))
        return self.M + self.changes.mass_change(centre)

    def contact(self, values: Mapping[str, float]) -> Contact:
        """Contact elements by the scalars that differ from the scene, by dotted key, SI."""
        return self.brake.contact if self.changes is None else self.changes.contact.at(values)

    def stiffness(self, sample: SampleInput) -> sp.csr_matrix:
        """Stiffness of a sample's bodies [N/m]."""
        if self.changes is None or not self.has_own_bodies(sample):
            return self.K
        return (self.K + self.changes.stiffness_change(sample.random)).tocsr()

    def mass(self, sample: SampleInput) -> sp.csr_matrix:
        """Mass of a sample's bodies [kg]."""
        if self.changes is None or not self.has_own_bodies(sample):
            return self.M
        return (self.M + self.changes.mass_change(sample.random)).tocsr()

    def has_own_bodies(self, sample: SampleInput) -> bool:
        """Whether stiffness or mass of a sample's bodies are not those of the scene."""
        return self.changes is not None and self.changes.changed_by(sample.random)

    def prepare(self, k0: Array) -> None:
        """Make or load what the samples share, on springs k0 [Pa/m]; collective."""
        brake, scene = self.brake, self._scene
        if any(changes_bodies(scene, name) for name in scene.varied):
            self.changes = assemble_changes(scene, brake)
        if self.stability is not None:
            self._prepare_modes(k0)
        if not self.reduced:
            b = brake
            self.compliance = compliance(b.K, b.N, b.T, b.w, b.f, k0, self._comm)
            self._unit_gaps = brake.N @ self.compliance.solve(self.unit_loads)
        full = [n for n, r in self.by_reduction.items() if not r]
        many = any(self._counts[n] > 1 or scene.sweep for n in full)
        if self.stability is not None and many and not self.reduced:
            with self._cache.shared(
                SHAPES, lambda: self._depends([float(k) for k in np.unique(k0)]), self._comm
            ):
                self._shapes = self._family_shapes(self.compliance)
        release_memory()

    def _prepare_modes(self, k0: Array) -> None:
        """Damping, numbering and reduced models."""
        from brake_fenicsx.build.damping_terms import damping_terms, record

        scene, brake = self._scene, self.brake
        self.terms = damping_terms(scene, brake)
        with self._cache.shared(DOFS, lambda: bodies_key(scene), self._comm):
            self.numbering = Numbering(brake, self._store, self._comm)
        for damped in (False, True):
            names = [n for n, r in self.by_reduction.items() if r and self.damped(n) == damped]
            if names:
                self._reduce(damped, names, k0)
        full = [n for n, r in self.by_reduction.items() if not r]
        for name in lone_samples(scene, self._counts):
            logger.info(
                '%s: one sample, at full order although stability.method = "reduced": a reduced'
                " model takes longer than one sample, and pays from two on%s",
                name,
                "; there is nothing to verify" * bool(self.stability and self.stability.verify),
            )
        special = [n for n in full if self.damped(n) or self.changes_bodies(n)]
        if special:
            logger.info("%s: damping or bodies of their own, full order", ", ".join(special))
        if self.reduced:
            self._from_reduced(next(iter(self.reduced.values())), k0)
        acting = record(scene, brake.contact)
        if acting:
            self.facts["damping"] = acting
        for term, numbers in acting.items():
            said = ", ".join(f"{name} = {value}" for name, value in numbers.items())
            logger.info("damping, %s: %s", term, said)

    def _reduce(self, damped: bool, names: list[str], k0: Array) -> None:
        """Reduced model of some approaches; full order for them only if the scene says so."""
        from brake_fenicsx.stability.substructures import ContactLinearisation

        file = f"cache/{'damped' if damped else 'undamped'}.npz"
        scene, contact = self._scene, self.brake.contact
        mu, _ = friction_coefficients(scene, contact.interface, contact.speed, names[0], {})
        usual = ContactLinearisation.of(k0, mu)
        changing = any(self.changes_bodies(n) for n in self.by_reduction)
        try:
            with self._cache.shared(file, lambda: self._depends(self._acting(damped)), self._comm):
                model = self._reduced_model(damped, changing, file, usual)
        except StorageError:
            raise
        except BrakeError as error:
            if any(self._by_ratio(name) for name in names):
                raise
            if self.stability is None or self.stability.on_tolerance != "full order":
                raise SceneError(
                    f'{self._scene.file}: stability.method = "reduced": {error}; write'
                    ' stability.method = "full", or allow full order, which may cost a hundred'
                    ' times as much, by stability.on_tolerance = "full order"'
                ) from error
            logger.warning("no reduced model: %s; full order", error)
            self.by_reduction |= dict.fromkeys(names, False)
            return
        self.reduced[damped] = model
        if damped and any(self._by_ratio(name) for name in names):
            logger.info(
                "damping, modal: exact for the modes of the parts up to %.0f Hz; beyond, damping in"
                " proportion to M and K",
                model.complete_up_to,
            )  # fmt: skip
        self.facts["damped_model" if damped else "reduced_model"] = {
            "kept_modes": model.bodies[-1].modes.stop,
            "bodies": len(model.bodies),
            "complete_up_to_hz": model.complete_up_to,
            "seconds": model.seconds,
            **self._note_shortfall(model, usual),
        }

    def _note_shortfall(
        self, model: ReducedModel, usual: ContactLinearisation
    ) -> dict[str, str | float]:
        """Say before the samples where their modes will miss the tolerance; for the summary too."""
        from brake_fenicsx.stability.substructures import shortfall

        settings = self.stability
        if settings is None or self.changes is None:
            return {}
        lacking = self._comm.bcast(shortfall(model, usual, settings.tolerance))
        if lacking is None:
            return {}
        box, names = self.changes.box, np.array(model.parameters.names)[lacking.wide]
        holds = ", ".join(
            f"{name} from {_between(box.part(name, lacking.share), si_unit(self._scene, name))}"
            f" (now {_between(box.part(name, 1.0), si_unit(self._scene, name))})"
            for name in names
        )
        advice = 'write stability.on_tolerance = "full order"'
        if settings.on_tolerance == "full order":
            advice = "leave such samples to full order"
        logger.warning(
            "stability.tolerance = %g: missed by %d of %d modes between the ends of what varies,"
            " by up to %.1e; a narrower range should hold it: %s; or raise the tolerance, or %s",
            settings.tolerance, lacking.missed, lacking.modes, lacking.error, holds, advice,
        )  # fmt: skip
        return {"largest_error": lacking.error, "ranges_that_hold": holds}

    def _reduced_model(
        self, damped: bool, changing: bool, file: str, usual: ContactLinearisation
    ) -> ReducedModel:
        from brake_fenicsx.build.damping_terms import with_modal_damping
        from brake_fenicsx.stability.substructures import ReducedModel, split_substructures

        stability, brake = self.stability, self.brake
        if stability is None:
            raise ValueError("a scene without [stability] has no modes")
        band = stability.band[0], stability.band[1]
        parameters = self._parameters(changing)
        if (known := self._known(file)) is not None:
            logger.info("reduced model: from the cache")
            return ReducedModel(known, brake.w, band, parameters)
        terms = self.terms if damped else None
        followed, C = "N", None
        if terms is not None:
            followed, C = "N" + "T" * terms.slope + "R" * terms.sliding, terms.bulk
        changes = self.changes.matrices if changing and self.changes else []
        points = dof_points(brake)
        bodies = split_substructures(
            self.K, self.M, {"N": brake.N, "T": brake.T, "R": brake.R}, self.unit_loads, changes, C,
            np.column_stack([points, body_centres(points, self.numbering.body)]),
        )  # fmt: skip
        if damped:
            bodies = with_modal_damping(self._scene, bodies, self.masses)
        release_memory()
        return ReducedModel.offline(
            bodies, brake.w, band, parameters, followed, stability.tolerance,
            self._cutoff(parameters), usual, self._comm,
            lambda total: Progress("solves of the reduced model", total).advance,
            lambda made: self._kept(file, made),
        )  # fmt: skip

    def _cutoff(self, parameters: Parameters) -> float | None:
        """Cutoff of the scene [Hz]; higher by itself where the bodies meet higher harmonics."""
        settings = self.stability
        if settings is None or settings.cutoff or self._scene.limit_cycle is None:
            return settings.cutoff if settings else None
        return float(HARMONICS / np.sqrt(parameters.softening)) * settings.band[1]

    def _kept(self, file: str, made: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """What an offline stage made, from the file that the first process writes; collective."""
        marks = {"layout": np.array(LAYOUT), "dofs": np.array(self.numbering.mark)}
        on_first(lambda: self._store.save(file, **marks, **made), self._comm)
        made.clear()
        found = self._known(file)
        if found is None:
            raise StorageError(f"{self._store.path(file)}: another run wrote over it")
        return found

    def _parameters(self, changing: bool) -> Parameters:
        """Box of what changes in the bodies."""
        from brake_fenicsx.stability.substructures import CONSTANT

        return self.changes.parameters if changing and self.changes else CONSTANT

    def _acting(self, damped: bool) -> list[Any]:
        """What a reduced model depends on beside the bodies."""
        scene, stability = self._scene, self._scene.table.get("stability", {})
        spans = self.changes.box if self.changes else Box(scene)
        box = [[*ends] for ends in zip(spans.names, spans.low, spans.high, strict=True)]
        acts = [stability.get("damping"), scene.table.get("motion")] if damped else None
        settings = self.stability
        accuracy = None if settings is None else [settings.tolerance, settings.cutoff]
        if accuracy and scene.limit_cycle is not None:
            accuracy.append(HARMONICS)
        return [LAYOUT, box, acts, accuracy]

    def _depends(self, more: list[Any]) -> list[Any]:
        """What files that folders share depend on."""
        band = None if self.stability is None else [*self.stability.band]
        return [bodies_key(self._scene), self.numbering.mark, band, *more]

    def _known(self, file: str) -> dict[str, NDArray[Any]] | None:
        """What an earlier run left: processes of a machine hold the large arrays once; collective.

        Their checksums are looked at here, by one process, and nowhere else.
        """
        try:
            on_first(lambda: self._store.check_mapped(file), self._comm)
            stored = self._store.load(file, mapped=True)
        except SceneError as error:  # cut short, by a full disc or a killed copy
            logger.warning("%s: made again", error)
            return None
        if stored is None or int(stored.get("layout", 0)) != LAYOUT:
            return None
        return stored if str(stored["dofs"]) == self.numbering.mark else None

    def _from_reduced(self, model: ReducedModel, k0: Array) -> None:
        """Compliance, unit loads and layers' masses as the reduced model knows them."""
        b, (NN, NT, self._unit_gaps) = self.brake, model.static(self.parameter_point({}), k0)
        carried = []
        for Nf in self._unit_gaps.T:
            unit = Condensed(Compliance(None, k0, NN, NT, Nf, 0.0), b.w, 0 * b.w, 0.0)
            carried.append(-float(np.sum(b.w * k0 * unit.linear(1.0, 0 * b.w, k0))))
        self._unit_carried = np.array(carried)
        self.compliance = Compliance(None, k0, NN, NT, self._unit_gaps.sum(axis=1))
        self.compliance = self.loaded(self.pressures({}))
        self.grams = self._layers_of(model)

    def _layers_of(self, model: ReducedModel) -> dict[str, Array]:
        """Layers' masses of the kept modes, from the folder where they are there; collective."""
        mark = f"{self.numbering.mark} {model.bodies[-1].modes.stop}"

        def make() -> dict[str, Array]:
            stored = self._store.load(LAYERS) or {}
            if str(stored.pop("mark", "")) == mark:
                return {key.removeprefix("of_"): gram for key, gram in stored.items()}
            made = {name: model.coordinates(A) for name, A in self.masses.items()}
            named = {f"of_{name}": gram for name, gram in made.items()}
            self._store.save(LAYERS, mark=np.array(mark), **named)
            return made

        return on_first(make, self._comm)

    def _family_shapes(self, factor: Solves) -> Array:
        """Real modes of the reference that families are followed in, shape (dofs, modes).

        They are kept: an eigensolver may return them with other signs.
        """
        from brake_fenicsx.stability.eigensolvers.lanczos import lowest_modes

        if self.stability is None:
            raise ValueError("a scene without [stability] has no modes")
        limit = (2 * np.pi * FAMILIES * self.stability.band[1]) ** 2
        shapes: Array | None = None
        if self._comm.rank == 0:
            stored = self._store.load(SHAPES)
            if stored is None:
                shapes = lowest_modes(factor, self.M, limit).Phi
                self._store.save(SHAPES, shapes=shapes)
            else:
                shapes = stored["shapes"]
        return np.asarray(self._comm.bcast(shapes, root=0))


def _between(ends: tuple[float, float], unit: str) -> str:
    """Two values with their unit, to three digits."""
    return " to ".join(quantity_text(float(f"{end:.3g}"), unit) for end in ends)

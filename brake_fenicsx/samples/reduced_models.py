"""The reduced models of a study: which approaches they serve, made or read from the folder.

This is the one place that chooses between them and full order. One reduced model serves all
approaches whose samples something damps, and one all others; a sample that none of them serves, an
approach that asks for full order, and what no reduced model takes (too strong damping, materials
that are not positive definite everywhere in their box) go to full order.
"""

from collections.abc import Mapping
from typing import Any

from mpi4py import MPI

import numpy as np

from brake_fenicsx.arguments import AnyArray, Array, Index
from brake_fenicsx.build import damping_terms, parametric, values
from brake_fenicsx.errors import BrakeError, OfOneProcess, SceneError, StorageError
from brake_fenicsx.extensions import widest_band
from brake_fenicsx.folder import files, processes
from brake_fenicsx.folder.log import Progress, logger
from brake_fenicsx.folder.store import Store
from brake_fenicsx.scene import Scene, Stability, digest, units
from brake_fenicsx.scene.scalars import changes_bodies, si_unit
from brake_fenicsx.scene.scene import active_terms, lone_samples, reduced_approaches
from brake_fenicsx.stability import substructures

from .numbering import Numbering, dof_places
from .sampling import SampleInput, friction_of_contact

# Number of the layout of a kept reduced model; one of another layout is made again.
LAYOUT = 13


class ReducedModels(OfOneProcess):
    """Reduced models of a study.

    Attributes:
        by_reduction: whether a reduced model gives the modes of an approach's samples.
        models: damped or not -> the reduced model, where one serves any sample.
        facts: for the summary.
    """

    _brake: parametric.ParametricBrake
    _body: Index  # of each dof

    def __init__(
        self, scene: Scene, counts: Mapping[str, int], store: Store, cache: files.SharedCache,
        comm: MPI.Comm,
    ):  # fmt: skip
        """Ask which approaches a reduced model may serve; arguments as of ``Models``."""
        self._scene, self._counts = scene, counts
        self._store, self._cache, self._comm = store, cache, comm
        self.stability = scene.stability if "stability" in scene.stages else None
        served = reduced_approaches(scene, counts)
        self.by_reduction: dict[str, bool] = {name: name in served for name in counts}
        self.models: dict[bool, substructures.ReducedModel] = {}
        self.facts: dict[str, Any] = {}
        self.mark = ""

    def prepare(self, brake: parametric.ParametricBrake, numbering: Numbering, k0: Array) -> None:
        """Make or load the models on springs k0 [Pa/m]; collective."""
        self.mark, self._brake, self._body = numbering.mark, brake, numbering.body
        for damped in (False, True):
            names = [n for n, r in self.by_reduction.items() if r and self.damped(n) == damped]
            if names:
                self._reduce(damped, names, k0)
        for name in lone_samples(self._scene, self._counts):
            logger.info(
                '%s: one sample, at full order although stability.method = "reduced": a reduced'
                " model takes longer than one sample, and pays from two on%s",
                name,
                "; there is nothing to verify" * bool(self.settings.verify),
            )
        special = [n for n in self.full if self.damped(n) or self._changes_bodies(n)]
        if special:
            logger.info("%s: damping or bodies of their own, full order", ", ".join(special))

    @property
    def settings(self) -> Stability:
        """How modes are computed.

        Raises:
            ValueError: the scene has no modes.
        """
        if self.stability is None:
            raise ValueError("a scene without [stability] has no modes")
        return self.stability

    @property
    def full(self) -> list[str]:
        """Approaches at full order."""
        return [name for name, reduced in self.by_reduction.items() if not reduced]

    def damped(self, approach: str) -> bool:
        """Whether damping acts in an approach's samples."""
        return bool(active_terms(self._scene, approach))

    def of(self, approach: str) -> substructures.ReducedModel:
        """The model of the samples of an approach that a reduced model takes."""
        return self.models[self.damped(approach)]

    def takes(self, sample: SampleInput) -> bool:
        """Whether a reduced model takes a sample: its bodies lie in the box."""
        changes, approach = sample.brake.reference.changes, sample.approach
        changes.check_range(sample.values)
        if not self.by_reduction[approach]:
            return False
        held = changes.box.holds(sample.values)
        if not held and self._by_ratio(approach):
            raise SceneError(f"""stability.damping.modal: materials of a sample of {approach!r} lie
                outside of the range of the reduced model, and full order has no damping ratios""")
        return held

    def _by_ratio(self, approach: str) -> bool:
        """Whether damping ratios of the parts act, which full order does not have."""
        return "modal" in active_terms(self._scene, approach)

    def _changes_bodies(self, approach: str) -> bool:
        """Whether the bodies of an approach's samples differ from those of the scene."""
        samples, sweep = self._scene.samples, self._scene.sweep
        drawn = samples.random if samples.takes_random(approach) else {}
        names = {*drawn, *(sweep.parameters if sweep else ()), *self._scene.spanned}
        return any(changes_bodies(self._scene, name) for name in names)

    def _reduce(self, damped: bool, names: list[str], k0: Array) -> None:
        """Reduced model of some approaches; full order for them only if the scene says so."""
        file, box = f"cache/{'damped' if damped else 'undamped'}.npz", self._brake.changes.box
        friction = friction_of_contact(self._brake.contact, names[0], values.Values(self._scene))
        usual = substructures.ContactLinearisation.of(k0, friction.mu)
        depends = self.depends(self._acting(damped, box))
        try:
            with self._cache.shared(file, lambda: depends, self._comm):
                model = self._model(damped, file, usual)
        except StorageError:
            raise
        except BrakeError as error:
            if any(self._by_ratio(name) for name in names):
                raise
            if self.settings.on_tolerance != "full order":
                raise SceneError(f"""{self._scene.file}: stability.method = "reduced": {error};
                    write stability.method = "full", or allow full order, which may cost a hundred
                    times as much, by stability.on_tolerance = "full order" """) from error
            logger.warning("no reduced model: %s; full order", error)
            self.by_reduction |= dict.fromkeys(names, False)
            return
        self.models[damped] = model
        if damped and any(self._by_ratio(name) for name in names):
            logger.info(
                "damping, modal: exact for the modes of the parts up to %.0f Hz; beyond, damping in"
                " proportion to M and K",
                model.complete_up_to,
            )
        self.facts["damped_model" if damped else "reduced_model"] = {
            "kept_modes": model.bodies[-1].modes.stop,
            "bodies": len(model.bodies),
            "complete_up_to_hz": model.complete_up_to,
            "seconds": model.seconds,
            **self._note_shortfall(model, usual),
        }

    def _note_shortfall(
        self, model: substructures.ReducedModel, usual: substructures.ContactLinearisation
    ) -> dict[str, str | float]:
        """Say before the samples where their modes will miss the tolerance; for the summary too."""
        settings, box = self.settings, self._brake.changes.box
        lacking = self._comm.bcast(
            substructures.shortfall(model, usual, settings.tolerance, self._comm)
        )
        if lacking is None:
            return {}
        names = np.array(model.parameters.names)[lacking.wide]
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
            " by up to %.1e; a narrower range should hold it: %s; or %sraise the tolerance, or %s",
            settings.tolerance, lacking.missed, lacking.modes, lacking.error, holds,
            "change fewer numbers together, or " * (len(names) > 1), advice,
        )  # fmt: skip
        return {"largest_error": lacking.error, "ranges_that_hold": holds}

    def _model(
        self, damped: bool, file: str, usual: substructures.ContactLinearisation
    ) -> substructures.ReducedModel:
        """A reduced model, from the folder where it is there."""
        stability, brake = self.settings, self._brake
        band = stability.band[0], stability.band[1]
        changing = any(self._changes_bodies(n) for n in self.by_reduction)
        parameters = brake.changes.parameters if changing else substructures.CONSTANT
        if (known := self._known(file)) is not None:
            logger.info("reduced model: taken from an earlier run")
            return substructures.ReducedModel(known, brake.w, band, parameters)
        terms = brake.terms if damped else damping_terms.Terms()
        followed = "N" + "T" * terms.falls + "R" * terms.turns
        rows = {"N": brake.N, "T": brake.T, "R": brake.R}
        changed = brake.changes.matrices if changing else []
        given = changed, terms.bulk, dof_places(brake, self._body)
        bodies = substructures.split_substructures(brake.K, brake.M, rows, brake.unit_loads, *given)
        if damped:
            bodies = damping_terms.with_modal_damping(self._scene, bodies, brake.masses)
        processes.release_memory()
        return substructures.reduce_bodies(
            bodies, brake.w, band, parameters, followed, stability.tolerance,
            self._cutoff(parameters), usual, self._comm,
            lambda total: Progress("factorisations for the reduced model", total).advance,
            lambda made: self._kept(file, made),
        )  # fmt: skip

    def _cutoff(self, parameters: substructures.Parameters) -> float | None:
        """Cutoff of the scene [Hz]; higher by itself where extras ask for it."""
        settings, widest = self.settings, widest_band(self._scene)
        if settings.cutoff or not widest:
            return settings.cutoff
        return float(widest / np.sqrt(parameters.softening)) * settings.band[1]

    def _kept(self, file: str, made: dict[str, AnyArray]) -> dict[str, AnyArray]:
        """What an offline stage made, from the file that the first process writes; collective."""
        marks = {"layout": np.array(LAYOUT), "dofs": np.array(self.mark)}
        processes.on_first(lambda: self._store.save(file, **marks, **made), self._comm)
        made.clear()
        found = self._known(file)
        if found is None:
            raise StorageError(f"{self._store.path(file)}: another run wrote over it")
        return found

    def _acting(self, damped: bool, box: values.Box) -> list[Any]:
        """What a reduced model depends on beside the bodies."""
        scene, stability = self._scene, self._scene.table.get("stability", {})
        ends = [[*end] for end in zip(box.names, box.low, box.high, strict=True)]
        acts = [stability.get("damping"), scene.table.get("motion")] if damped else None
        accuracy = [self.settings.tolerance, self.settings.cutoff]
        if widest := widest_band(scene):
            accuracy.append(widest)
        return [LAYOUT, ends, acts, accuracy]

    def depends(self, more: list[Any]) -> list[Any]:
        """What files that folders share depend on."""
        return [digest.bodies_key(self._scene), self.mark, [*self.settings.band], *more]

    def _known(self, file: str) -> dict[str, AnyArray] | None:
        """What an earlier run left: processes of a machine hold the large arrays once; collective.

        Their checksums are looked at here, by one process, and nowhere else.
        """
        try:
            processes.on_first(lambda: self._store.check_mapped(file), self._comm)
            stored = self._store.load(file, mapped=True)
        except SceneError as error:  # cut short, by a full disc or a killed copy
            logger.warning("%s: made again", error)
            return None
        if stored is None or int(stored.get("layout", 0)) != LAYOUT:
            return None
        return stored if str(stored["dofs"]) == self.mark else None


def _between(ends: tuple[float, float], unit: str) -> str:
    """Two values with their unit, to three digits."""
    return " to ".join(units.quantity_text(float(f"{end:.3g}"), unit) for end in ends)

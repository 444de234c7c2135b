"""Who gives the modes of a study's samples: the reduced models they have in common, or full order.

What no reduced model takes, because it stands alone, is damped too strongly or has materials out of
reach, is solved at full order; ``Models.by_reduction`` says which approach goes where.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import BrakeError, InaccurateResult
from brake_fenicsx.log import logger
from brake_fenicsx.macro.brake import Brake
from brake_fenicsx.macro.condensation import Compliance, compliance, gathered
from brake_fenicsx.macro.solver import local_rows
from brake_fenicsx.scene import Scene, Stability
from brake_fenicsx.scene_damping import active_terms
from brake_fenicsx.scene_samples import split_key
from brake_fenicsx.shelf import Shelf, of_bodies
from brake_fenicsx.store import Store

from .bulk import Bulk, assemble_bulk
from .numbering import FILE as DOFS
from .numbering import Numbering

if TYPE_CHECKING:
    from brake_fenicsx.stability import Reduced
    from brake_fenicsx.stability.terms import Terms

    from .changing import ChangingBodies
    from .shared import Shared

Array = NDArray[np.float64]


class Models:
    """The brake of a study as its samples see it.

    Attributes:
        by_reduction: whether a reduced model gives the modes of an approach's samples.
        numbering: order of the dofs that vectors are stored in; only with modes.
        K: elastic stiffness [N/m], whole on this process.
        M: mass [kg], likewise.
        compliance: the bodies seen from their contact elements.
        bulk: unit changes of random materials and loads, if there are any.
        changing: the reduced model of bodies whose materials change, if there is one.
        modal: what the samples' modes share; None without the stage stability.
        facts: for the summary.
    """

    def __init__(
        self,
        scene: Scene,
        brake: Brake,
        counts: Mapping[str, int],
        store: Store,
        comm: MPI.Comm,
        shelf: Shelf,
    ):
        """Ask what there could be.

        Args:
            scene: the scene.
            brake: its operators.
            counts: number of samples of each approach.
            store: the results folder.
            comm: processes that share the work.
            shelf: what the folder shares with others.
        """
        self._scene, self._brake, self._counts = scene, brake, counts
        self._store, self._comm, self._shelf = store, comm, shelf
        self.K, self.M = gathered(brake.K), gathered(brake.M)
        self.facts: dict[str, Any] = {}
        self.bulk: Bulk | None = None
        self.changing: ChangingBodies | None = None
        self.modal: Shared | None = None
        self.compliance: Compliance
        self.numbering: Numbering
        self._reduced: Reduced | None = None
        self._terms: Terms | None = None
        self._stability = scene.stability if "stability" in scene.stages else None
        # One sample alone does not pay for a basis: it is solved at full order.
        reduced = self._stability is not None and self._stability.method == "reduced"
        self.by_reduction = {name: reduced and count > 1 for name, count in counts.items()}

    def changes_bodies(self, approach: str) -> bool:
        """Whether the materials of an approach's samples differ from those of the scene."""
        random = self._scene.samples.random
        materials = any(split_key(name)[0] == "materials" for name in random)
        return materials and self._scene.samples.takes_random(approach)

    def damped(self, approach: str) -> bool:
        """Whether damping acts in an approach's samples."""
        return bool(active_terms(self._scene, approach))

    def prepare(self, k0: Array) -> None:
        """Factor the bodies on springs k0 [Pa/m], and make or load what is reduced; collective."""
        brake, stability = self._brake, self._stability
        if stability is not None:
            from brake_fenicsx.stability.terms import damping_terms

            self._terms = damping_terms(self._scene, brake)
            with self._shelf.shared(DOFS, lambda: of_bodies(self._scene), self._comm):
                self.numbering = Numbering(brake, local_rows(self.K), self._store, self._comm)
        if stability is not None and self._of_one_body():
            seen = self._prepare_reduced(stability, k0)
        else:
            seen = compliance(self.K, brake.N, brake.T, brake.w, brake.f, k0, self._comm)
        self.compliance = seen
        if {split_key(name)[0] for name in self._scene.samples.random} & {"materials", "loads"}:
            self.bulk = assemble_bulk(self._scene, brake)
        self._prepare_changing()
        if stability is not None:
            self._prepare_modes(stability, seen)

    def _of_one_body(self) -> list[str]:
        """Approaches that the reduced model of the scene's own bodies serves."""
        return [n for n, r in self.by_reduction.items() if r and not self.changes_bodies(n)]

    def _acting(self) -> list[Any]:
        """What the damping of the bodies depends on beside themselves."""
        stability = self._scene.table.get("stability", {})
        return [stability.get("damping"), self._scene.table.get("motion")]

    @contextmanager
    def _shared(self, name: str, k0: Array | float, *depends: Any) -> Iterator[None]:
        """A reduced model on springs k0, from other folders or for them."""
        stability = self._stability
        band = None if stability is None else [*stability.band, stability.cutoff]
        here = [self.numbering.kept_mark, np.unique(k0).tolist(), band, *depends]
        with self._shelf.shared(name, lambda: [of_bodies(self._scene), *here], self._comm):
            yield

    def _prepare_changing(self) -> None:
        """Reduced model of samples whose materials change; full order where there can be none."""
        names = [n for n, r in self.by_reduction.items() if r and self.changes_bodies(n)]
        damped = [n for n in names if self.damped(n)]
        self._try_changing(damped, self._terms)
        # Damping that no model takes leaves the samples without it theirs.
        if self.changing is None:
            self._try_changing([n for n in names if n not in damped], None)

    def _try_changing(self, names: list[str], terms: Terms | None) -> None:
        """Reduced model of the samples of some approaches, or full order for them."""
        if not names or self.bulk is None:
            return
        from .changing import FILE, MADE_WITH, ChangingBodies

        random, laws = self._scene.samples.random, self._scene.table["samples"]["random"]
        moduli = [n for n in sorted(random) if split_key(n)[0] == "materials"]
        box = [[n, laws[n], random[n].digest] for n in moduli]
        acts = None if terms is None else self._acting()
        try:
            with self._shared(FILE, 0.0, box, acts, self.numbering.mark, MADE_WITH.tolist()):
                self.changing = ChangingBodies(
                    self._scene, self._brake, (self.K, self.M), self.bulk, self._store, self._comm,
                    self.numbering.mark, terms,
                )  # fmt: skip
        except BrakeError as error:
            logger.warning("no reduced model of changing materials: %s; full order", error)
            self.by_reduction |= dict.fromkeys(names, False)
            return
        self.facts["changing_bodies"] = {"seconds": self.changing.basis.seconds}

    def _prepare_reduced(self, stability: Stability, k0: Array) -> Compliance:
        """Reduced model of the scene's own bodies; returns them as seen from the contact."""
        from brake_fenicsx.stability.reduction import ORDER

        from .basis import FILE, compliance_of, reduced_model

        brake = self._brake
        order = ORDER if any(not self.damped(name) for name in self._of_one_body()) else 0
        with self._shared(FILE, k0, order):
            self._reduced, self.facts["reduced_basis"] = reduced_model(
                stability, brake, self.K, self.M, k0, self._store, self._comm, self.numbering, order
            )
        return compliance_of(self._reduced, brake.f)

    def _prepare_modes(self, stability: Stability, seen: Compliance) -> None:
        """What the samples' modes share."""
        from .basis import SHAPES, family_shapes
        from .shared import share

        special = [n for n in self.by_reduction if self.damped(n) or self.changes_bodies(n)]
        full = [n for n in special if not self.by_reduction[n]]
        if full:
            logger.info("%s: damping or materials of their own, full order", ", ".join(full))
        shapes = None
        many = any(self._counts[name] > 1 for name in full)
        if (many or self.changing is not None) and self._reduced is None:
            with self._shared(SHAPES, seen.k0):
                shapes = family_shapes(
                    seen.factor, self.M, stability.band[1], self._store, self._comm,
                    self.numbering,
                )  # fmt: skip
        whole = (self.K, self.M)
        self.modal = share(self._scene, self._brake, whole, self.bulk, self._reduced, self._terms)
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
                    modal.reduced, modal.terms, self._brake.contact, self._store, self._comm
                )
        except InaccurateResult as error:
            logger.warning("%s; full order", error)
            self.by_reduction |= dict.fromkeys(names, False)
            return
        self.facts["damped_basis"] = {
            "seconds": modal.damped.seconds,
            "converges_up_to_hz": modal.damped.basis.radius / 2 / np.pi,
        }

"""Reduced model of samples whose materials change."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.log import Progress, logger
from brake_fenicsx.macro.brake import Brake
from brake_fenicsx.macro.condensation import gathered_vector
from brake_fenicsx.macro.elasticity import unit_loads
from brake_fenicsx.macro.solver import local_rows
from brake_fenicsx.scene import Scene, Stability
from brake_fenicsx.stability.changing.interpolated import LATER_DEGREES
from brake_fenicsx.stability.changing.offline import VARIED_CUTOFF
from brake_fenicsx.stability.changing.own_bodies import Whole
from brake_fenicsx.stability.changing.proportion import Damping
from brake_fenicsx.stability.changing.shifts import Changes
from brake_fenicsx.stability.ensemble_basis import DEGREE, EnsembleBasis
from brake_fenicsx.stability.modes import Modes
from brake_fenicsx.stability.reduced.damped_basis import DAMPED_ORDER
from brake_fenicsx.stability.reduction import CUTOFF, ORDER
from brake_fenicsx.stability.terms import Terms
from brake_fenicsx.store import Store

from .bulk import Bulk
from .material_box import TAIL, MaterialBox

Array = NDArray[np.float64]

FILE = "cache/bodies.npz"

# Number of the layout of ``arrays``.
LAYOUT = 6

# A cache of another layout or accuracy is made again.
MADE_WITH = np.array(
    [LAYOUT, DEGREE, *LATER_DEGREES, ORDER, CUTOFF, *VARIED_CUTOFF, TAIL, DAMPED_ORDER]
)


class ChangingBodies:
    """Modes and compliance of samples of other materials.

    Attributes:
        basis: the reduced model of all of them.
        damped: whether it knows the damping of the samples.
        mark: of the order of the dofs that it was made in.
    """

    def __init__(
        self,
        scene: Scene,
        brake: Brake,
        matrices: tuple[PETSc.Mat, PETSc.Mat],
        bulk: Bulk,
        store: Store,
        comm: MPI.Comm,
        mark: str,
        terms: Terms | None = None,
    ):
        """Offline stage, or what an earlier one left in the results folder; collective.

        Args:
            scene: the scene, with its section [stability].
            brake: its operators.
            matrices: stiffness [N/m] and mass [kg], whole on this process.
            bulk: unit changes of the random materials.
            store: the results folder.
            comm: processes that share the work.
            mark: of the present order of the dofs; what was made in another is made again.
            terms: damping of its samples; None where nothing damps them.

        Raises:
            SceneError, InaccurateResult: the materials are not positive definite everywhere in the
                box of the samples, or the bodies are damped as no model of them can take.
        """
        stability = scene.stability
        if stability is None:
            raise ValueError("a scene without [stability] has no modes")
        self.box, self.mark, self.damped = MaterialBox(scene, bulk), mark, terms is not None
        damping = None if terms is None else _damping(stability, terms, brake, self.box)
        self.faces = sorted(scene.loads)
        mesh, free = brake.mesh, brake.elastic.free
        loads = [gathered_vector(unit_loads(mesh, free, face)) for face in self.faces]
        self._pressures = {face: scene.loads[face].pressure for face in self.faces}
        K, M = (local_rows(A) for A in matrices)
        self._M, self._contact, self._terms = M, brake.contact, terms
        band = (stability.band[0], stability.band[1])
        names = "" if damping is None else f"{damping.names}, damped"
        known = _cached(store, mark, names)
        self.basis = EnsembleBasis(
            K, M, brake.N, brake.T, brake.w, np.stack(loads, axis=1), list(bulk.parts.values()),
            self.box.coefficients, len(self.box.names), band, comm=comm,
            progress=lambda total: Progress("anchors", total).advance, known=known, damping=damping,
        )  # fmt: skip
        if known is None and comm.rank == 0:
            made = [body.arrays() for body in self.basis.bodies]
            named = {f"{i}.{name}": a for i, one in enumerate(made) for name, a in one.items()}
            marks = {"made_with": MADE_WITH, "dofs": mark, "damping": names}
            store.save(FILE, bodies=np.array(len(made)), **marks, **named)

    def compliance(
        self, drawn: Mapping[str, float], pressures: Mapping[str, float], k0: Array
    ) -> tuple[Array, Array, Array]:
        """Compliance of a sample's bodies on springs k0, and its gaps under the loads.

        Args:
            drawn: its random inputs.
            pressures: its random pressures [Pa], by face.
            k0: reference stiffness [Pa/m].
        """
        NN, NT, Nf = self.basis.compliance(self.box.place(drawn), k0)
        return NN, NT, Nf @ self._loads(pressures)

    def compliance_doubt(
        self, pressures: Mapping[str, float], normal: Array, along: Array
    ) -> Array:
        """Typical errors of the gaps of the bodies [m], shape (errors, elements).

        Args:
            pressures: random pressures of a sample [Pa], by face.
            normal: forces on the gaps of the elements [N], shape (elements,).
            along: forces on their slips.
        """
        return self.basis.compliance_doubt(normal, along, self._loads(pressures))

    def _loads(self, pressures: Mapping[str, float]) -> Array:
        """Pressures on all faces [Pa]."""
        load = {**self._pressures, **pressures}
        return np.array([load[face] for face in self.faces])

    def modes(
        self,
        drawn: Mapping[str, float],
        k: Array,
        mu: Array,
        rates: tuple[Array, Array] | None = None,
        zeta_max: float = 0.0,
        tolerance: float = 1e-6,
        doubt: Changes | None = None,
    ) -> Modes:
        """Complex modes of a sample, in coordinates of the basis.

        Args:
            drawn: its random inputs.
            k: its contact stiffness [Pa/m].
            mu: its friction coefficients.
            rates: friction's own damping, see ``rates_of_sample``; None where nothing damps it.
            zeta_max: decaying modes up to this damping ratio are looked for where it is damped.
            tolerance: relative error of lambda beyond which a mode is refined on the full problem.
            doubt: errors of what acts at its contact.
        """
        place = self.box.place(drawn)
        whole = partial(self._whole, place)
        if rates is None:
            return self.basis.modes(place, k, mu, tolerance, whole, doubt)
        return self.basis.damped_modes(place, k, mu, *rates, zeta_max, tolerance, whole, doubt)

    def _whole(self, place: Array) -> Whole:
        """A sample at full order."""
        (K, C), contact = self.box.bodies(place, self._terms), self._contact
        return Whole(K, self._M, contact.N, contact.T, contact.R, C)


def _damping(stability: Stability, terms: Terms, brake: Brake, box: MaterialBox) -> Damping:
    """Damping terms as the bodies take them."""
    table = stability.damping
    alpha = table.rayleigh[0] if table is not None and table.rayleigh is not None else 0.0
    follows = box.follows(terms)
    return Damping(terms.bulk, alpha, follows, brake.contact.R, terms.slope, terms.sliding)


def _cached(store: Store, mark: str, damping: str) -> list[dict[str, Array]] | None:
    """Arrays of all bodies that an earlier run left."""
    stored = store.load(FILE)
    if stored is None or not np.array_equal(stored["made_with"], MADE_WITH):
        return None
    if str(stored.get("damping")) != damping:
        return None
    if str(stored.get("dofs")) != mark:
        logger.info("reduced bodies: the dofs are numbered in another way now; made again")
        return None
    logger.info("reduced bodies: from the cache")
    found: list[dict[str, Array]] = [{} for _ in range(int(stored["bodies"]))]
    for name, values in stored.items():
        number, dot, inner = name.partition(".")
        if dot:
            found[int(number)][inner] = values
    return found

"""Reduced model of samples whose materials change: their box, and each one's place in it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.log import Progress, logger
from brake_fenicsx.macro.brake import Brake
from brake_fenicsx.macro.condensation import gathered_vector
from brake_fenicsx.macro.elasticity import unit_loads
from brake_fenicsx.macro.material_sample import varied_stiffness
from brake_fenicsx.macro.solver import local_rows
from brake_fenicsx.scene import Scene, Stability
from brake_fenicsx.scene_samples import split_key
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

from .bulk import PLACES, Bulk
from .distributions import quantile
from .inputs import nominal_value

Array = NDArray[np.float64]

FILE = "cache/bodies.npz"

# Probability of a constant beyond either end of the box, and how far from its centre, in half
# widths, a sample may lie and still be taken.
TAIL, BEYOND = 1e-3, 1.1

# Number of the layout of ``arrays``.
LAYOUT = 6

# A cache of another layout or accuracy is made again.
MADE_WITH = np.array(
    [LAYOUT, DEGREE, *LATER_DEGREES, ORDER, CUTOFF, *VARIED_CUTOFF, TAIL, DAMPED_ORDER]
)


class Box:
    """The box that the random material constants of nearly all samples lie in.

    Moduli enter by their inverse: a body that is softer as a whole by a factor answers with that
    factor, and the interpolation has nothing left to do.
    """

    def __init__(self, scene: Scene, bulk: Bulk):
        """Span the box by the laws of the constants.

        Args:
            scene: the scene.
            bulk: unit changes of the random materials.
        """
        self.scene, self.bulk = scene, bulk
        self.names = [n for n in sorted(scene.samples.random) if split_key(n)[0] == "materials"]
        ends = []
        for name in self.names:
            law = scene.samples.random[name]
            nominal = nominal_value(scene, name) if law.spread else None
            values = quantile(law, [TAIL, 1 - TAIL], nominal)
            ends.append(sorted(self._turned(name, float(v)) for v in values))
        self.low, self.high = np.array(ends).T

    def holds(self, drawn: Mapping[str, float]) -> bool:
        """Whether a sample lies in the box or hardly beyond it."""
        return bool(np.all(np.abs(self.place(drawn)) <= BEYOND))

    def place(self, drawn: Mapping[str, float]) -> Array:
        """A sample's place in [-1, 1]^d."""
        values = np.array([self._turned(n, drawn[n]) for n in self.names])
        width = np.where(self.high > self.low, self.high - self.low, 1.0)
        return np.asarray((2 * values - self.low - self.high) / width)

    def coefficients(self, x: Array) -> Array:
        """Coefficients of the unit changes of ``bulk.parts`` [Pa] at a place."""
        values = 0.5 * (self.low + self.high) + 0.5 * (self.high - self.low) * x
        groups: dict[str, dict[str, float]] = {}
        for name, value in zip(self.names, values, strict=True):
            _, material, constant = split_key(name)
            groups.setdefault(material, {})[constant] = self._turned(name, value)
        change = {
            m: varied_stiffness(self.scene.materials[m], given) - self.bulk.materials[m]
            for m, given in groups.items()
        }
        return np.array([change[material][PLACES[c]] for material, c in self.bulk.parts])

    def follows(self, terms: Terms | None) -> Array:
        """Share [s] of each unit change of ``bulk.parts`` that the damping takes."""
        shares = {} if terms is None else terms.follows
        return np.array([shares.get(material, 0.0) for material, _ in self.bulk.parts])

    def bodies(self, x: Array, terms: Terms | None) -> tuple[sp.csr_matrix, sp.csr_matrix | None]:
        """Stiffness [N/m] of the bodies at a place, and their damping [N s/m] if they have any."""
        pairs = zip(self.coefficients(x), self.bulk.parts.values(), strict=True)
        changes = [c * part for c, part in pairs]
        K = (self.bulk.K + sum(changes)).tocsr()
        if terms is None or terms.bulk is None:
            return K, None
        shares = zip(self.follows(terms), changes, strict=True)
        return K, terms.bulk + sum(share * A for share, A in shares)

    @staticmethod
    def _turned(name: str, value: float) -> float:
        """The inverse of a modulus, anything else itself; its own inverse."""
        return 1 / value if split_key(name)[2][0] in "EGC" and value > 0 else value


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
        self.box, self.mark, self.damped = Box(scene, bulk), mark, terms is not None
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


def _damping(stability: Stability, terms: Terms, brake: Brake, box: Box) -> Damping:
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

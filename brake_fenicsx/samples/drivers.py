"""What drives the unstable modes of a sample: derivatives to friction, loads, contact and layers.

Friction and loads move the equilibrium too, and with it the contact stiffness and the pressures of
every element (``macro.equilibrium_change``); what moves in the bodies leaves the state of the
contact as it is. Of a reduced sample the interface gives the derivatives of the contact at next to
no cost; layers need displacements of both vectors at full order (``stability.derivatives``), and
are left to the first sample of each approach: the kept modes alone miss how soft layers deform.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.build.layers import layer_derivatives
from brake_fenicsx.macro.equilibrium import Equilibrium
from brake_fenicsx.macro.equilibrium_change import (
    BodyOperators,
    EquilibriumChange,
    equilibrium_change,
)
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.approaches import slides
from brake_fenicsx.scene.scalars import is_length
from brake_fenicsx.stability.derivatives import (
    ContactDerivatives,
    bilinear,
    contact_derivatives,
    friction_work,
    motions_of_vectors,
    trusted,
)
from brake_fenicsx.stability.eigen import tangent
from brake_fenicsx.stability.eigensolvers.eigenpairs import QuadraticPencil, inner
from brake_fenicsx.stability.modes import Complex, Modes
from brake_fenicsx.stability.substructures.vectors import ContactMotions

from .equilibria import Equilibria
from .models import Models
from .solve import linearised

if TYPE_CHECKING:
    from .sampling import SampleInput

Array = NDArray[np.float64]
Index = NDArray[np.intp]

# Change by which a derivative must hold to be trusted: of a parameter, relatively, and of a loss
# factor.
STEP, LOSS_STEP = 0.01, 1e-3

# Relative error of vectors up to which a derivative is trusted.
SHARP = 1e-6

ALL = "all"


@dataclass(slots=True)
class _Table:
    """Derivatives of lambda to some parameters."""

    names: list[tuple[str, str]] = field(default_factory=list)
    steps: list[float] = field(default_factory=list)
    values: list[Complex] = field(default_factory=list)

    def add(self, parameter: str, kind: str, step: float, value: Complex) -> None:
        self.names.append((parameter, kind))
        self.steps.append(step)
        self.values.append(value)


class Drivers:
    """Derivatives of the unstable modes of any sample of a scene."""

    def __init__(self, scene: Scene, models: Models, equilibria: Equilibria):
        """Take what all samples share."""
        self._scene, self._models, self._equilibria = scene, models, equilibria

    def of(
        self,
        sample: SampleInput,
        eq: Equilibrium,
        first: bool,
        modes: Modes,
        partner: Index,
        reduced: bool,
    ) -> dict[str, Any]:
        """Derivatives of a sample's unstable modes, as arrays to store.

        Args:
            sample: its inputs.
            eq: its equilibrium.
            first: whether it is the first one of its approach: with maps, and layers in any case.
            modes: its modes.
            partner: flutter partner of each, -1 without one.
            reduced: whether they are those of the reduced model.

        Returns:
            ``driver_mode``, ``driver_parameter`` and ``driver_kind``; ``driver_value`` [1/s] and
            ``driver_trusted``, shape (parameters, modes): not where the vectors have errors beyond
            ``SHARP``; of the first sample ``driver_map``, d lambda / d ln k [1/s], and
            ``driver_work`` [-], shape (elements, modes). Nothing where no mode grows.
        """
        growing = np.flatnonzero((np.array(modes.verdict, str) == "unstable") & (modes.s.imag > 0))
        if not growing.size:
            return {}
        chosen, neighbours = _with_neighbours(modes.s, growing, partner)
        mirrored = np.isin(partner[chosen], growing) & ~np.isin(chosen, growing)
        mirrored &= not self._models.reduction.damped(sample.approach)
        table, maps, error = self._found(sample, eq, first, modes, chosen[~mirrored], reduced)
        # Without damping the partner's eigenvalue is -conj(lambda), and so is its derivative.
        values = np.zeros((len(table.values), chosen.size), complex)
        values[:, ~mirrored] = table.values
        origin = np.searchsorted(chosen, partner[chosen[mirrored]])
        values[:, mirrored] = -values[:, origin].conj()
        kept = trusted(modes.s[chosen], values, np.array(table.steps), neighbours)
        own = np.searchsorted(chosen[~mirrored], growing)
        return {
            "driver_mode": growing,
            "driver_parameter": np.array([name for name, _ in table.names], dtype=str),
            "driver_kind": np.array([kind for _, kind in table.names], dtype=str),
            "driver_value": np.array(table.values)[:, own],
            "driver_trusted": kept & (error[own] <= SHARP),
            **{name: columns[:, own] for name, columns in maps.items()},
        }

    def _found(
        self,
        sample: SampleInput,
        eq: Equilibrium,
        first: bool,
        modes: Modes,
        chosen: Index,
        reduced: bool,
    ) -> tuple[_Table, dict[str, NDArray[Any]], Array]:
        """Derivatives of chosen modes, maps over the elements, and errors of the vectors."""
        w, contact = sample.brake.contact.w, linearised(sample, eq.k_vibration, eq.p)
        s, right, left = modes.s[chosen], modes.right[:, chosen], modes.left[:, chosen]
        whole: tuple[Complex, Complex] | None = None if reduced else (right, left)
        errors: list[Array] = [np.zeros(s.size)]
        if reduced:
            model, p = self._models.reduction.of(sample), sample.brake.point
            motions, right, left = model.motions(p, contact, s, right, left)
            errors.append(motions.error)
            if first:
                right, right_error = model.displacements(p, contact, s, right)
                left, left_error = model.displacements(p, contact, s, left, left=True)
                whole = right, left
                errors += [right_error, left_error]
        if whole is not None:
            whole_motions = self._whole_motions(sample, eq, s, whole)
            motions = motions if reduced else whole_motions
        d = contact_derivatives(motions, contact, sample.friction.mu, w)
        table, maps = _Table(), dict[str, NDArray[Any]]()
        self._contact(table, sample, eq, d, reduced)
        if whole is not None:
            self._bodies(table, sample, eq, s, (*whole, whole_motions.slope))
        if whole is not None and first:
            inertia = inner(whole[0], sample.brake.M @ whole[0]).real
            maps["driver_map"] = contact.k[:, None] * d.k
            maps["driver_work"] = friction_work(whole_motions, contact, w, inertia)
        return table, maps, np.max(errors, axis=0)

    def _whole_motions(
        self, sample: SampleInput, eq: Equilibrium, s: Complex, vectors: tuple[Complex, Complex]
    ) -> ContactMotions:
        b, brake = sample.brake.contact, sample.brake
        pencil = QuadraticPencil(brake.M, brake.C(sample.friction, eq.p), brake.reference.K)
        rows = {"N": b.N, "T": b.T, "R": b.R}
        return motions_of_vectors(rows, pencil, s, *vectors)

    def _contact(
        self,
        table: _Table,
        sample: SampleInput,
        eq: Equilibrium,
        d: ContactDerivatives,
        reduced: bool,
    ) -> None:
        """Friction of each interface, loads, and the stiffness of the contact."""
        w, friction = sample.brake.contact.w, sample.friction
        bodies = self._equilibria.bodies(sample, reduced)
        state = bodies.compliance, w, sample.laws, eq

        def moved(new: EquilibriumChange, mu: Array) -> Complex:
            along, across = sample.brake.rates(friction, new.p)
            across = across + sample.brake.rates(replace(friction, mu=mu), eq.p)[1]
            return d.chain(new.k, mu, along, across)

        for i, (name, interface) in enumerate(self._scene.contact.items()):
            if not slides(self._scene, name):
                continue
            on = (sample.brake.contact.interface == i).astype(float)
            step = STEP * float(on @ friction.mu) / max(float(on.sum()), 1.0)
            in_equilibrium = on * interface.friction_in_equilibrium
            value = moved(equilibrium_change(*state, mu=in_equilibrium), on)
            table.add(name, "friction", step, value)
        none, faces = np.zeros_like(w), sorted(self._scene.loads)
        loads = [
            moved(equilibrium_change(*state, Nf=Nf), none)
            for Nf in self._loads(sample, reduced, bodies)
        ]
        for face, value in zip(faces, loads, strict=True):
            table.add(face, "load", STEP, value)
        if len(faces) > 1:
            table.add(ALL, "load", STEP, np.sum(loads, axis=0))
        k = d.chain(eq.k_vibration, none, none, none)
        table.add(ALL, "contact stiffness", STEP, k)

    def _bodies(
        self,
        table: _Table,
        sample: SampleInput,
        eq: Equilibrium,
        s: Complex,
        vectors: tuple[Complex, ...],
    ) -> None:
        """Stiffness, mass and loss factor of each layer, and thicknesses that vary."""
        found = layer_derivatives(sample.brake, s, vectors)
        for (layer, kind), value in found.items():
            table.add(layer, kind, LOSS_STEP if kind == "loss factor" else STEP, value)
        changes = self._models.brake.changes
        for name in filter(is_length, () if changes is None else changes.box.names):
            table.add(name, "length", STEP, self._length(name, sample, eq, s, vectors))

    def _length(
        self,
        name: str,
        sample: SampleInput,
        eq: Equilibrium,
        s: Complex,
        vectors: tuple[Complex, ...],
    ) -> Complex:
        """D lambda / d ln h of a length, shape (modes,)."""
        size, out = sample.values.value(name), np.zeros(s.size, complex)
        for step in (STEP, -STEP):
            there = self._models.brake.at({**sample.values, name: size * (1 + step)})
            b, C = there.contact, there.C(sample.friction, eq.p)
            K = there.stiffness_change
            K = tangent(K, b.N, b.T, b.w, eq.k_vibration, sample.friction.mu)
            change = bilinear(K, *vectors) + s**2 * bilinear(there.M, *vectors)
            out += (change if C is None else change + s * bilinear(C, *vectors)) / (2 * step)
        return out

    def _loads(self, sample: SampleInput, reduced: bool, bodies: BodyOperators) -> Sequence[Array]:
        """Gaps under each load of the sample alone, in the order of the faces."""
        sizes, out = sample.brake.pressures, list[Array]()
        for alone in np.diag(sizes)[:-1]:
            own = self._equilibria.bodies(sample, reduced, alone)
            out.append(own.compliance.Nf)
        return [*out, bodies.compliance.Nf - sum(out)] if sizes.size else []


def _with_neighbours(
    s: Complex, growing: Index, partner: Index
) -> tuple[Index, dict[int, list[int]]]:
    """The growing modes and those that they may merge with: the nearest one, and the partner.

    Args:
        s: eigenvalues [1/s], shape (modes,).
        growing: numbers of the growing modes.
        partner: flutter partner of each mode, -1 without one.

    Returns:
        Numbers of all these modes, sorted; place of a growing one among them -> places of others.
    """
    near = {}
    for i in growing:
        distance = np.abs(s - s[i])
        distance[i] = np.inf
        others = {int(np.argmin(distance))} if s.size > 1 else set()
        near[int(i)] = sorted(others | ({int(partner[i])} if partner[i] >= 0 else set()))
    chosen = np.unique([*near, *(j for others in near.values() for j in others)]).astype(np.intp)
    place = {int(j): n for n, j in enumerate(chosen)}
    return chosen, {place[i]: [place[j] for j in others] for i, others in near.items()}

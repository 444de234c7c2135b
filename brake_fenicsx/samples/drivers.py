"""What drives the unstable modes of a sample: derivatives to friction, loads, contact and layers.

Friction and loads move the equilibrium too, and with it the contact stiffness and the pressures of
every element (``macro.equilibrium``); what moves in the bodies leaves the state of the
contact as it is. Of a reduced sample the interface gives the derivatives of the contact at next to
no cost; layers need displacements of both vectors at full order (``stability.derivatives``), and
are left to the first sample of each approach: the kept modes alone miss how soft layers deform.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index
from brake_fenicsx.build.parametric import layer_derivatives
from brake_fenicsx.macro.equilibrium import Equilibrium, EquilibriumChange, equilibrium_change
from brake_fenicsx.scene.scalars import is_length
from brake_fenicsx.scene.scene import slides
from brake_fenicsx.stability import derivatives
from brake_fenicsx.stability.eigen import tangent
from brake_fenicsx.stability.eigensolvers.eigenpairs import QuadraticPencil, inner
from brake_fenicsx.stability.modes import Modes
from brake_fenicsx.stability.substructures.vectors import ContactMotions

from . import sampling, solve

_Arrays = dict[str, AnyArray]

# Change by which a derivative must hold to be trusted: of a parameter, relatively, and of a loss
# factor.
STEP, LOSS_STEP = 0.01, 1e-3

# Relative error of vectors up to which a derivative is trusted.
SHARP = 1e-6

ALL = "all"


def driver_arrays(
    equilibria: solve.Equilibria, sample: sampling.SampleInput, eq: Equilibrium, first: bool,
    modes: Modes, partner: Index, reduced: bool,
) -> dict[str, Any]:  # fmt: skip
    """Derivatives of a sample's unstable modes, as arrays to store.

    Args:
        equilibria: what the equilibria of all samples share.
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
    mirrored &= not equilibria.models.reduction.damped(sample.approach)
    table = _Table(equilibria, sample, eq, reduced)
    maps, error = table.fill(first, modes, chosen[~mirrored])
    # Without damping the partner's eigenvalue is -conj(lambda), and so is its derivative.
    values = np.zeros((len(table.values), chosen.size), complex)
    values[:, ~mirrored] = table.values
    origin = np.searchsorted(chosen, partner[chosen[mirrored]])
    values[:, mirrored] = -values[:, origin].conj()
    kept = derivatives.trusted(modes.s[chosen], values, np.array(table.steps), neighbours)
    own = np.searchsorted(chosen[~mirrored], growing)
    return {
        "driver_mode": growing,
        "driver_parameter": np.array([name for name, _ in table.names], dtype=str),
        "driver_kind": np.array([kind for _, kind in table.names], dtype=str),
        "driver_value": np.array(table.values)[:, own],
        "driver_trusted": kept & (error[own] <= SHARP),
        **{name: columns[:, own] for name, columns in maps.items()},
    }


@dataclass(slots=True)
class _Table:
    """Derivatives of lambda of some modes of a sample, to one parameter after the other."""

    equilibria: solve.Equilibria
    sample: sampling.SampleInput
    eq: Equilibrium
    reduced: bool
    names: list[tuple[str, str]] = field(default_factory=list)
    steps: list[float] = field(default_factory=list)
    values: list[Complex] = field(default_factory=list)

    def fill(self, first: bool, modes: Modes, chosen: Index) -> tuple[_Arrays, Array]:
        """Add all parameters; maps over the contact elements, and errors of the vectors."""
        sample, eq = self.sample, self.eq
        w, contact = sample.brake.contact.w, solve.linearised(sample, eq.k_vibration, eq.p)
        s, right, left = modes.s[chosen], modes.right[:, chosen], modes.left[:, chosen]
        whole: tuple[Complex, Complex] | None = None if self.reduced else (right, left)
        errors: list[Array] = [np.zeros(s.size)]
        if self.reduced:
            model, p = self.equilibria.models.reduction.of(sample.approach), sample.brake.point
            motions, right, left = model.motions(p, contact, s, right, left)
            errors.append(motions.error)
            if first:
                right, right_error = model.displacements(p, contact, s, right)
                left, left_error = model.displacements(p, contact, s, left, left=True)
                whole = right, left
                errors += [right_error, left_error]
        if whole is not None:
            whole_motions = self._whole_motions(s, whole)
            motions = motions if self.reduced else whole_motions
        d = derivatives.contact_derivatives(motions, contact, sample.friction.mu, w)
        maps: _Arrays = {}
        self._contact(d)
        if whole is not None:
            self._bodies(s, (*whole, whole_motions.slope))
        if whole is not None and first:
            inertia = inner(whole[0], sample.brake.M @ whole[0]).real
            maps["driver_map"] = contact.k[:, None] * d.k
            maps["driver_work"] = derivatives.friction_work(whole_motions, contact, w, inertia)
        return maps, np.max(errors, axis=0)

    def _add(self, parameter: str, kind: str, value: Complex, step: float = STEP) -> None:
        self.names.append((parameter, kind))
        self.steps.append(step)
        self.values.append(value)

    def _whole_motions(self, s: Complex, vectors: tuple[Complex, Complex]) -> ContactMotions:
        brake, b = self.sample.brake, self.sample.brake.contact
        C = brake.C(self.sample.friction, self.eq.p)
        pencil = QuadraticPencil(brake.M, C, brake.reference.K)
        rows = {"N": b.N, "T": b.T, "R": b.R}
        return derivatives.motions_of_vectors(rows, pencil, s, *vectors)

    def _contact(self, d: derivatives.ContactDerivatives) -> None:
        """Friction of each interface, loads, and the stiffness of the contact."""
        brake, friction, eq = self.sample.brake, self.sample.friction, self.eq
        scene, w = brake.values.scene, brake.contact.w
        bodies = self.equilibria.bodies(self.sample, self.reduced)
        state = bodies.compliance, w, self.sample.laws, eq

        def moved(new: EquilibriumChange, mu: Array) -> Complex:
            along, across = brake.rates(friction, new.p)
            across = across + brake.rates(replace(friction, mu=mu), eq.p)[1]
            return d.chain(new.k, mu, along, across)

        for i, (name, interface) in enumerate(scene.contact.items()):
            if not slides(scene, name):
                continue
            on = (brake.contact.interface == i).astype(float)
            step = STEP * float(on @ friction.mu) / max(float(on.sum()), 1.0)
            in_equilibrium = on * interface.friction_in_equilibrium
            value = moved(equilibrium_change(*state, mu=in_equilibrium), on)
            self._add(name, "friction", value, step)
        none, faces = np.zeros_like(w), sorted(scene.loads)
        gaps = self._gaps_of_loads(bodies.compliance.Nf)
        loads = [moved(equilibrium_change(*state, Nf=Nf), none) for Nf in gaps]
        for face, value in zip(faces, loads, strict=True):
            self._add(face, "load", value)
        if len(faces) > 1:
            self._add(ALL, "load", np.sum(loads, axis=0))
        self._add(ALL, "contact stiffness", d.chain(eq.k_vibration, none, none, none))

    def _gaps_of_loads(self, together: Array) -> Sequence[Array]:
        """Gaps under each load of the sample alone [m], of all together, in the order of faces."""
        sizes, out = self.sample.brake.pressures, list[Array]()
        for alone in np.diag(sizes)[:-1]:
            own = self.equilibria.bodies(self.sample, self.reduced, alone)
            out.append(own.compliance.Nf)
        return [*out, together - sum(out)] if sizes.size else []

    def _bodies(self, s: Complex, vectors: tuple[Complex, ...]) -> None:
        """Stiffness, mass and loss factor of each layer, and thicknesses that vary."""
        for (layer, kind), value in layer_derivatives(self.sample.brake, s, vectors).items():
            self._add(layer, kind, value, LOSS_STEP if kind == "loss factor" else STEP)
        for name in filter(is_length, self.sample.brake.reference.changes.box.names):
            self._add(name, "length", self._length(name, s, vectors))

    def _length(self, name: str, s: Complex, vectors: tuple[Complex, ...]) -> Complex:
        """D lambda / d ln h of a length, shape (modes,)."""
        sample, eq = self.sample, self.eq
        size, out = sample.values.value(name), np.zeros(s.size, complex)
        for step in (STEP, -STEP):
            there = sample.brake.reference.at({**sample.values, name: size * (1 + step)})
            b, C = there.contact, there.C(sample.friction, eq.p)
            K = there.stiffness_change
            K = tangent(K, b.N, b.T, b.w, eq.k_vibration, sample.friction.mu)
            change = derivatives.bilinear(K, *vectors) + s**2 * derivatives.bilinear(
                there.M, *vectors
            )
            out += (change if C is None else change + s * derivatives.bilinear(C, *vectors)) / (
                2 * step
            )
        return out


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

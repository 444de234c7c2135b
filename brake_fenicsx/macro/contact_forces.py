"""Forces of a contact element: the law of its gap, and friction along and across the sliding.

Gaps are enriched. First enrichment: a critical gap per element, drawn from the height distribution
with zero mean. Second enrichment: a law p = P(delta) per element, from the boundary-element contact
of a rough surface. delta = g - g_cr is the separation the law sees: a positive g_cr (a patch that
stands proud) touches at a larger gap. Two readings:

- drawn from the height distribution, each element for itself (the source's). The law already holds
  the heights inside a patch, and the critical gap adds the same variance once more: where heights
  are correlated over less than a patch that counts them twice, an upper bound of the scatter;
- the waviness of the face: one correlated field of the mean heights of patches, from the part of
  the spectrum that is longer than a patch. Law and critical gap share the variance.

Rough laws are not clipped at delta = 0: their summits carry load from first touch, at delta > 0.

Friction has one encoding inside: ``SlidingFriction``, for each contact element the coefficient mu
at its sliding speed V and the slope mu'(V). An element of area w under the pressure p has the
forces

    w p (1, t, r)

along its normal, along and across the sliding direction; t and r are the traction over the
pressure, t = mu and r = 0 in the equilibrium. Their tangent is -w k (1, t, r) to the gap, k =
-dp/dg, and w p d(1, t, r)/dv to the slip rates v; small vibrations have p mu'(V) along and mu p / V
across the sliding direction. Equilibrium, small vibrations and limit cycles take them from here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from brake_fenicsx.arguments import Array, Index

if TYPE_CHECKING:
    from brake_fenicsx.micro.law import Laws
    from brake_fenicsx.surface.hdf import HeightDistribution
    from brake_fenicsx.surface.spectrum import Waviness
from collections.abc import Callable

from brake_fenicsx.arguments import Mask
from brake_fenicsx.errors import SceneError

# Slip speeds [m/s], shape (elements, ...) -> coefficients and their slopes [s/m], likewise.
Coefficient = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True, slots=True)
class EnrichedGap:
    """Laws and critical gaps of all contact elements.

    Attributes:
        laws: the library.
        index: number of each element's law, shape (elements,).
        g_cr: critical gaps [m], shape (elements,).
    """

    laws: Laws
    index: Index
    g_cr: Array

    def delta(self, g: Array) -> Array:
        """Separation g - g_cr [m] in the contact potential with critical gaps, Eq. (14)."""
        return g - self.g_cr

    def pressure(self, g: Array) -> Array:
        """A law of its own for each contact element: pressure P_i(g_i - g_cr_i) [Pa], Eq. (15)."""
        return self.loading(g)[0]

    def stiffness(self, g: Array) -> Array:
        """Contact stiffness k = -dp/dg [Pa/m], shape (elements,)."""
        return self.loading(g)[1]

    def loading(self, g: Array) -> tuple[Array, Array]:
        """Pressure [Pa] and stiffness [Pa/m] together, each of shape (elements,)."""
        return self.laws.loading(self.index, self.delta(g))

    def vibration(self, g: Array) -> tuple[Array, Array]:
        """Stiffness v of small vibrations about the state at g [Pa/m], and dv/dg [Pa/m^2]."""
        return self.laws.vibration(self.index, self.delta(g))

    def up_to(self, p: Array) -> EnrichedGap:
        """With laws that are known at these pressures [Pa] too; itself where they all are."""
        laws = self.laws.up_to(self.index, p)
        return self if laws is self.laws else replace(self, laws=laws)

    def beyond(self, p: Array, w: Array) -> float:
        """Share of the normal force above the pressures up to which the laws are known.

        Args:
            p: pressure of each element [Pa], shape (elements,).
            w: area of each [m^2].
        """
        force = w * p
        above = p > self.laws.highest(self.index) * (1.0 + 1e-9)
        return float(force[above].sum() / max(force.sum(), 1e-300))

    def first_touch(self) -> Array:
        """Gap at which each element begins to carry [m]."""
        return self.laws.first_touch(self.index) + self.g_cr


def draw_critical_gaps(hdf: HeightDistribution, n: int, rng: np.random.Generator) -> Array:
    """Critical gaps [m] for the distribution of the shifted gap: zero-mean heights, Eq. (16).

    Args:
        hdf: height distribution of the scan, zero mean.
        n: number of contact elements.
        rng: random numbers of the sample.

    Returns:
        Shape (n,).
    """
    return hdf.sample(n, rng)


def draw_waviness(
    waviness: Waviness, points: Array, normal: Array, rng: np.random.Generator
) -> Array:
    """Critical gaps [m] from the waviness of the faces: a field of its own for each pad.

    Args:
        waviness: field of the mean heights of patches.
        points: centres of the contact elements of one interface [m], shape (n, 3).
        normal: unit normals from disc to pad, shape (n, 3); pads on opposite sides of a disc
            differ by their sign.
        rng: random numbers of the sample.

    Returns:
        Shape (n,); positive where the patch protrudes.
    """
    heights = np.zeros(len(points))
    one_side = normal @ normal[0] >= 0.0
    for pad in (one_side, ~one_side):
        if pad.any():
            own = points[pad] - points[pad].mean(axis=0)
            # The plane of the face: the two directions in which its centres spread most.
            _, _, axes = np.linalg.svd(own, full_matrices=False)
            heights[pad] = waviness.sample(own @ axes[:2].T, rng)
    return heights


@dataclass(frozen=True, slots=True)
class Rotation:
    """The disc turns about an axis.

    Attributes:
        speed: angular velocity [rad/s]; its sign is the sense.
        axis: direction of the axis, any length, shape (3,).
        point: a point of it [m], shape (3,).
    """

    speed: float
    axis: tuple[float, ...] = (0.0, 0.0, 1.0)
    point: tuple[float, ...] = (0.0, 0.0, 0.0)

    @property
    def frame(self) -> Array:
        """Unit vectors across and along the axis as rows; x, y and z for the axis z."""
        along = np.asarray(self.axis, float) / np.linalg.norm(self.axis)
        across = np.eye(3)[(int(np.argmax(np.abs(along))) + 1) % 3]
        across = across - (across @ along) * along
        across = across / np.linalg.norm(across)
        return np.array([across, np.cross(along, across), along])

    def local(self, x: Array) -> Array:
        """Coordinates of points in the frame, from the point of the axis [m], shape (n, 3)."""
        return np.asarray((x - np.array(self.point)) @ self.frame.T)

    def velocity(self, x: Array) -> Array:
        """Velocity of the disc [m/s] at points x [m], shape (n, 3)."""
        return np.asarray(np.cross(self.speed * self.frame[2], x - np.array(self.point)))


@dataclass(frozen=True, slots=True)
class Translation:
    """The second body of an interface moves along a direction.

    Attributes:
        direction: direction, any length, shape (3,).
        speed: speed [m/s].
    """

    direction: tuple[float, ...]
    speed: float

    def velocity(self, x: Array) -> Array:
        """Velocity [m/s] at points x [m], shape (n, 3)."""
        d = np.asarray(self.direction, float)
        return np.broadcast_to(self.speed * d / np.linalg.norm(d), x.shape)


Motion = Rotation | Translation


def slip_frame(motion: Motion, points: Array, normal: Array) -> tuple[Array, Array, Array]:
    """Direction s of the disc's velocity relative to the pad and the transverse one.

    Args:
        motion: how the disc moves.
        points: contact points [m], shape (n, 3).
        normal: unit normals from disc to pad, shape (n, 3).

    Returns:
        s, r = normal x s, both of shape (n, 3), and the sliding speed V [m/s], shape (n,).

    Raises:
        SceneError: the disc does not slide at some contact point.
    """
    v = motion.velocity(points)
    v = v - np.einsum("ij,ij->i", v, normal)[:, None] * normal
    speed = np.linalg.norm(v, axis=1)
    if np.any(speed <= 0):
        raise SceneError("""motion: the disc does not slide along its face at some contact point;
            change motion.speed, axis or direction""")
    s = v / speed[:, None]
    return s, np.cross(normal, s), speed


@dataclass(frozen=True, slots=True)
class SlidingFriction:
    """Friction of the contact elements, each of shape (elements,).

    Attributes:
        mu: coefficient at the sliding speed; 0 where the faces stick.
        slope: mu'(V) [s/m]; 0 where friction does not depend on the speed.
        speed: sliding speed V [m/s].
        braking: whether it acts in the equilibrium too, which one may solve without.
    """

    mu: Array
    slope: Array
    speed: Array
    braking: Mask

    @property
    def equilibrium(self) -> Array:
        """Coefficients of the equilibrium."""
        return self.mu * self.braking

    def rates(self, p: Array, turns: bool, falls: bool) -> tuple[Array, Array]:
        """What slip rates are multiplied by, p mu'(V) along and mu p / V across [Pa s/m].

        Args:
            p: pressures at equilibrium [Pa].
            turns: whether friction turns with the direction of sliding; across is zero else.
            falls: whether it changes with the speed; along is zero else.
        """
        along = self.slope * p if falls else np.zeros_like(p)
        across = np.zeros_like(p)
        if turns:
            # Faces that stick have neither speed nor friction. A negative mu, of a disc that turns
            # the other way, damps as a positive one does.
            np.divide(np.abs(self.mu) * p, self.speed, out=across, where=self.speed > 0)
        return along, across

    def traction(
        self, v: Array, coefficient: Coefficient | None = None, smooth: float = 0.0
    ) -> tuple[Array, Array]:
        """Coulomb's traction over the pressure when the pad slips, mu(|V - v|) (V - v) / |V - v|.

        Args:
            v: slip rates of the pad along and across the sliding direction [m/s], shape (2,
                elements, ...).
            coefficient: mu by the slip speed; ``mu`` at all speeds if None.
            smooth: slip speed below which the direction is smoothed, over the sliding speed.

        Returns:
            Traction on the pad along and across, likewise, and its derivatives to v [s/m], shape
            (2, 2, elements, ...).
        """
        V, mu = (a.reshape(-1, *[1] * (v.ndim - 2)) for a in (self.speed, self.mu))
        along, across = V - v[0], v[1]
        # Faces that stick have neither speed nor friction.
        size = np.sqrt(along**2 + across**2 + np.where(V > 0, smooth * V, 1.0) ** 2)
        mu, slope = (mu, 0.0) if coefficient is None else coefficient(size)
        m, dm = mu / size, (slope - mu / size) / size**2
        mixed = dm * along * across
        slopes = [[-(m + dm * along**2), mixed], [mixed, -(m + dm * across**2)]]
        return np.array([m * along, -m * across]), np.array(slopes)


@dataclass(frozen=True, slots=True)
class PatchForces:
    """Forces of some contact elements along n, s and r, and their tangent.

    Attributes:
        value: [N], shape (3, elements, ...).
        gap: derivatives to the gaps [N/m], likewise.
        rate: derivatives to the slip rates along and across [N s/m], shape (3, 2, elements, ...).
    """

    value: Array
    gap: Array
    rate: Array


def patch_forces(
    w: Array, p: Array, k: Array, traction: Array, slopes: Array | None = None
) -> PatchForces:
    """Forces of contact elements.

    Args:
        w: areas [m^2], shape (elements,).
        p: pressures [Pa], shape (elements, ...).
        k: stiffnesses -dp/dg [Pa/m], likewise.
        traction: t and r, shape (2, elements, ...).
        slopes: their derivatives to the slip rates [s/m], shape (2, 2, elements, ...); none if
            None.
    """
    w = w.reshape(-1, *[1] * (p.ndim - 1))
    direction = np.stack([np.ones_like(p), *np.broadcast_to(traction, (2, *p.shape))])
    rate = np.zeros((3, 2, *p.shape))
    if slopes is not None:
        rate[1:] = w * p * slopes
    return PatchForces(w * p * direction, -w * k * direction, rate)


def sliding(mu: float | Array, p: Array) -> Array:
    """Traction over the pressure of elements that slide steadily, t = mu and r = 0."""
    return np.stack([np.broadcast_to(mu, p.shape), np.zeros_like(p)])

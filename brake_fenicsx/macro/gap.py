"""Enriched contact: every contact element has its own pressure-gap law and its own critical gap.

First enrichment: a critical gap per element, drawn from the height distribution with zero mean.
Second enrichment: a law p = P(delta) per element, from the boundary-element contact of a rough
surface. delta = g - g_cr is the separation the law sees: a positive g_cr (a patch that stands
proud) touches at a larger gap. Two readings:

- drawn from the height distribution, each element for itself (the source's). The law already holds
  the heights inside a patch, and the critical gap adds the same variance once more: where heights
  are correlated over less than a patch that counts them twice, an upper bound of the scatter;
- the waviness of the face: one correlated field of the mean heights of patches, from the part of
  the spectrum that is longer than a patch. Law and critical gap share the variance.

Rough laws are not clipped at delta = 0: their summits carry load from first touch, at delta > 0.
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

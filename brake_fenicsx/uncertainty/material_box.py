"""The box that random material constants lie in, and each sample's place in it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.macro.material_sample import varied_stiffness
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene_samples import split_key
from brake_fenicsx.stability.terms import Terms

from .bulk import PLACES, Bulk
from .distributions import quantile
from .inputs import nominal_value

Array = NDArray[np.float64]

# Probability of a constant beyond either end of the box, and how far from its centre, in half
# widths, a sample may lie and still be taken.
TAIL, BEYOND = 1e-3, 1.1


class MaterialBox:
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

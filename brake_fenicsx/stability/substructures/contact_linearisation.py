"""Contact and friction of one sample, linearised at its equilibrium.

A motion with the gaps g, the slips v_T along and v_R across the sliding direction meets the forces

    w k g on the gaps,   mu w k g + lambda w p mu'(V) v_T along,   lambda (w mu p / V) v_R across

of each contact element, along the rows I = [N; T] or [N; T; R]; see ``damping`` for their signs.
They are J u of the gaps and slip rates u = [g; lambda v_T; lambda v_R].
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from brake_fenicsx.errors import SceneError

from ..modes import Complex
from .contact_rows import Rows

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ContactLinearisation:
    """What acts in the contact elements of one sample, each of shape (elements,).

    Attributes:
        k: contact stiffness [Pa/m], zero where the element is open.
        friction: tangential force per gap, mu k [Pa/m].
        along: p mu'(V) [Pa s/m]; zero without falling friction.
        across: mu p / V [Pa s/m]; zero without sliding damping.
    """

    k: Array
    friction: Array
    along: Array
    across: Array

    @classmethod
    def of(
        cls, k: ArrayLike, mu: ArrayLike, along: ArrayLike = 0.0, across: ArrayLike = 0.0
    ) -> ContactLinearisation:
        """Check and complete the numbers of one sample.

        Args:
            k: contact stiffness of each element [Pa/m], shape (elements,).
            mu: friction coefficient, one or one per element.
            along: p mu'(V) [Pa s/m], likewise.
            across: mu p / V [Pa s/m], likewise.

        Raises:
            SceneError: a stiffness is negative, or a number is not finite or has the wrong shape.
        """
        k = np.asarray(k, dtype=float)
        named = {"k": k, "mu": mu, "along": along, "across": across}
        out = {}
        for name, value in named.items():
            given = np.asarray(value, dtype=float)
            if k.ndim != 1 or given.shape not in ((), k.shape):
                raise SceneError(
                    f"{name}: shape {given.shape}, one value for each contact element is needed"
                )
            if not np.all(np.isfinite(given)):
                raise SceneError(f"{name}: a value is not finite")
            out[name] = np.broadcast_to(given, k.shape)
        if k.size and k.min() < 0:
            raise SceneError(f"k = {k.min():.3g} Pa/m: contact stiffness must not be negative")
        friction = out["mu"] * out["k"]
        return cls(out["k"], friction, out["along"], out["across"])

    @property
    def closed(self) -> NDArray[np.intp]:
        """Elements in which anything acts."""
        return np.flatnonzero(
            (self.k > 0) | (self.friction != 0) | (self.along != 0) | (self.across != 0)
        )


@dataclass(frozen=True, slots=True)
class ContactForces:
    """J of some elements in units of the band's end.

    Attributes:
        normal: w k, shape (elements,).
        friction: mu w k.
        rates: for each followed row beside "N", its place among the acting rows and its factor.
    """

    normal: Array
    friction: Array
    rates: list[tuple[int, Array]]

    @classmethod
    def of(
        cls,
        contact: ContactLinearisation,
        w: Array,
        elements: NDArray[np.intp],
        rows: Rows,
        omega: float,
    ) -> ContactForces:
        """Scale the forces of some elements.

        Args:
            contact: all elements of the sample.
            w: their areas [m^2].
            elements: the chosen ones.
            rows: blocks of contact rows.
            omega: end of the band [rad/s].
        """
        w = np.asarray(w[elements], dtype=float)
        normal = np.asarray(w * contact.k[elements] / omega**2)
        friction = np.asarray(w * contact.friction[elements] / omega**2)
        factor = {"T": contact.along, "R": contact.across}
        rates = [
            (rows.acting.index(name), np.asarray(w * factor[name][elements] / omega))
            for name in rows.followed[1:]
        ]
        return cls(normal, friction, rates)

    def blocks_after(self, A: NDArray[Any]) -> Iterator[NDArray[Any]]:
        """A J, one block of followed rows at a time, in the precision of A.

        Args:
            A: shape (rows, acting rows).

        Yields:
            Shape (rows, elements).
        """
        n = self.normal.size
        normal = A[:, :n] * self.normal.astype(A.dtype, copy=False)
        if self.friction.any():
            normal += A[:, n : 2 * n] * self.friction.astype(A.dtype, copy=False)
        yield normal
        for place, rate in self.rates:
            yield A[:, place * n : (place + 1) * n] * rate.astype(A.dtype, copy=False)

    def __call__(self, u: Complex) -> Complex:
        """J u of gaps and slip rates, shape (acting rows, columns)."""
        n = self.normal.size
        blocks = [self.normal[:, None] * u[:n], self.friction[:, None] * u[:n]]
        if any(place == 2 for place, _ in self.rates):
            blocks.append(np.zeros_like(blocks[0]))
        for j, (place, rate) in enumerate(self.rates, 1):
            blocks[place] = blocks[place] + rate[:, None] * u[j * n : (j + 1) * n]
        return np.vstack(blocks)

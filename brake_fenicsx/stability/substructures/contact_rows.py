"""Variables and contact rows of the reduced model.

Without contact a substructure is a matrix polynomial P(w) = P_0 + w P_1 + w^2 P_2 about a real
shift, in units in which the end of the band is 1:

    undamped    w = kappa + sigma,      P = [K + sigma M, -M],                  kappa = -lambda^2
    damped      w = lambda - lambda_0,  P = [K + lambda_0 C + sigma M, C + 2 lambda_0 M, M]

with sigma = lambda_0^2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..modes import Complex

Array = NDArray[np.float64]

# sigma in units of the band's end: positive, so that free bodies have a factor, and small.
SIGMA = 0.05


@dataclass(frozen=True, slots=True)
class Rows:
    """BlockMatrix of contact rows: those whose motion forces follow, and those forces act along.

    Attributes:
        followed: "N", then "T" and "R" where forces follow the slip rates along and across.
        damped: whether a body depends on a rate: its variable w is lambda - lambda_0 then, else
            kappa + sigma.
    """

    followed: str
    damped: bool

    @property
    def acting(self) -> str:
        """Normal forces and friction act in any case."""
        return "NT" + "R" * ("R" in self.followed)

    @property
    def rates(self) -> bool:
        """Whether anything depends on a rate, so that eigenvalues are z = lambda - lambda_0."""
        return self.damped or self.followed != "N"

    @property
    def shift(self) -> float:
        """lambda_0; 0 where eigenvalues are z = kappa + sigma."""
        return float(np.sqrt(SIGMA)) if self.rates else 0.0

    def gaps(self, motions: int) -> int:
        """Gaps among a number of motions that forces follow; slips come after them."""
        return motions // len(self.followed)

    @property
    def _contact_rates_alone(self) -> bool:
        """Whether contact forces follow rates and bodies do not, so that w is not z."""
        return self.rates and not self.damped

    def variable(self, z: Complex) -> Complex:
        """The variable w of the bodies at eigenvalues z."""
        return SIGMA - (z + self.shift) ** 2 if self._contact_rates_alone else z

    def slope(self, z: Complex) -> Complex:
        """dw/dz."""
        return -2 * (z + self.shift) if self._contact_rates_alone else np.ones_like(z)

    def powers(self, count: int) -> Array:
        """Coefficients of z^m in w^n, n < count, shape (powers of z, count)."""
        w = [0.0, -2 * self.shift, -1.0] if self._contact_rates_alone else [0.0, 1.0]
        out = np.zeros(((count - 1) * (len(w) - 1) + 1, count))
        out[0, 0] = 1.0
        for n in range(1, count):
            out[:, n] = np.convolve(out[:, n - 1], w)[: len(out)]
        return out


def shifted_polynomial(
    K: sp.csr_matrix, C: sp.csr_matrix | None, M: sp.csr_matrix, rows: Rows
) -> list[sp.csr_matrix]:
    """P_0, P_1 and, with rates, P_2 of a body from its matrices in units of the band's end.

    Args:
        K: stiffness.
        C: damping; None where the body has none.
        M: mass.
        rows: whether anything depends on a rate.
    """
    if not rows.damped:
        return [(K + SIGMA * M).tocsr(), -M]
    s = rows.shift
    C = sp.csr_matrix(K.shape) if C is None else C
    return [(K + s * C + SIGMA * M).tocsr(), (C + 2 * s * M).tocsr(), M]

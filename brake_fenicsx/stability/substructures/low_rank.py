"""Moments of high order from a few combinations of the columns.

A series in kappa has D_n = X_i' M X_j, i + j = n - 1: symmetric over the columns, definite, and
near to a low rank, the lower the higher n is, for short waves on the contact face fade out. From a
block of combinations Omega of the columns follows the Nystroem approximation

    D_n ~ (D_n Omega) (Omega' D_n Omega)^-1 (D_n Omega)'.

Some combinations stay out of it: with them its error is measured.

Reference: N. Halko, P. G. Martinsson and J. A. Tropp, SIAM Review 53 (2011) 217, section 5.5,
doi:10.1137/090771806.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]

# Moments of every column; combinations for each kept mode and some more; the most for each column.
# Measured on the reference brake: eigenvalues differ by a tenth of the stated errors from those of
# all columns.
EXACT, RANK, MORE, MOST = 3, 4, 32, 0.75

# Combinations that measure the error, and what this may be of the last moment, which tells how
# large the first one is that is left out.
HELD_OUT, SHARE = 8, 0.25

# Eigenvalues of Omega' D_n Omega below this share of the largest are round-off.
ROUND_OFF = 1e-12


@dataclass(frozen=True, slots=True)
class MomentPlan:
    """Solves for the moments of a body at a point.

    Attributes:
        exact: moments of every column.
        further: moments of combinations alone.
        rank: number of combinations, 0 where there are no further moments.
    """

    exact: int
    further: int = 0
    rank: int = 0

    @classmethod
    def of(cls, columns: int, kept: int, count: int) -> MomentPlan:
        """The cheapest.

        Args:
            columns: number of columns.
            kept: number of kept modes; what is left out begins with waves hardly shorter.
            count: number of moments.
        """
        rank = RANK * kept + MORE + HELD_OUT
        if count <= EXACT or rank > MOST * columns:
            return cls(count)
        return cls(EXACT, count - EXACT, rank)


def combinations(columns: int, number: int) -> Array:
    """Random orthonormal combinations of columns, shape (columns, number)."""
    if not number:
        return np.zeros((columns, 0))
    drawn = np.random.default_rng(0).standard_normal((columns, number))
    return np.asarray(la.qr(drawn, mode="economic")[0])


def completed(seen: Array, omega: Array, places: Index) -> tuple[Array, float]:
    """Moments of all columns from those of combinations.

    Args:
        seen: Omega' D_n for each further moment, shape (further, combinations, width).
        omega: the combinations, shape (columns, combinations).
        places: which of the width are the columns themselves, shape (columns,).

    Returns:
        D_n, shape (further, columns, width); the largest error of one of them over the size of the
        last one, measured with the combinations held out.
    """
    used, held = omega[:, :-HELD_OUT], omega[:, -HELD_OUT:]
    out = np.empty((len(seen), omega.shape[0], seen.shape[2]))
    error = 0.0
    for D, rows in zip(out, seen, strict=True):
        left = rows[:-HELD_OUT]
        core = left[:, places] @ used
        values, vectors = la.eigh(0.5 * (core + core.T))
        good = np.abs(values) > ROUND_OFF * np.abs(values).max(initial=0.0)
        inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T
        D[:] = left[:, places].T @ (inverse @ left)
        error = max(error, float(la.norm(rows[-HELD_OUT:] - held.T @ D)))
    return out, error / float(la.norm(seen[-1, -HELD_OUT:]))

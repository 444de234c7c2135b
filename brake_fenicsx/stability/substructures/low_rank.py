"""Low-rank approximation of the moments of high order from random combinations of their columns.

Columns are contact rows and coupled kept modes, see ``series``. In a series in kappa, D_n = X_i' M
X_j with i + j = n - 1 is symmetric and definite over the columns. Its singular values fall faster
the higher n is: each factor P_0^-1 M damps short waves on the contact face. From random
combinations Omega of the columns follows Nystroem's approximation

    D_n ~ (D_n Omega) (Omega' D_n Omega)^-1 (D_n Omega)'.

Further combinations, which the approximation does not use, measure its error.

Reference: N. Halko, P. G. Martinsson and J. A. Tropp, SIAM Review 53 (2011) 217, algorithm 5.5,
doi:10.1137/090771806.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]

# Moments that are computed of every column. Of the others RANK * kept modes + MORE combinations,
# unless these are more than the share MOST of the columns. Measured on the reference brake, rough
# and perfect contact: eigenvalues change by less than a twentieth of their stated errors.
EXACT, RANK, MORE, MOST = 3, 4, 32, 0.75

# Combinations that measure the error, and the largest error over the size of the last moment: the
# stated error of a mode holds the moments beyond the last one, which fall from there. Measured:
# with 0.19 errors of modes low in the band were up to three times as large as stated (demo brake),
# with 0.04 at most half as large (reference brake).
HELD_OUT, SHARE = 8, 0.06

# Eigenvalues of Omega' D_n Omega below this share of the largest are round-off.
ROUND_OFF = 1e-12


@dataclass(frozen=True, slots=True)
class MomentPlan:
    """Which moments of a body are computed of every column, and which of combinations.

    Attributes:
        exact: number of moments of every column.
        further: number of moments of combinations alone, of higher order than these.
        rank: number of combinations, 0 where there are no further moments.
    """

    exact: int
    further: int = 0
    rank: int = 0

    @classmethod
    def of(cls, columns: int, kept: int, count: int) -> MomentPlan:
        """Plan for a symmetric series.

        Args:
            columns: number of columns.
            kept: number of kept modes: the rank of the moments grows with it.
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
        last one, measured with the combinations held out; infinite if that one is zero.
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
    size = float(la.norm(seen[-1, -HELD_OUT:]))
    return out, error / size if size else np.inf

"""T of a sample in powers of z, and the motions of its contact elements; letters as in ``problem``.

y + (E(w) - 1) u = source(w) a is solved power by power. With Lambda = Lambda_0 + z Lambda' the
coefficients of u are u_m = Lambda_0 y_m + Lambda' y_m-1, and

    (1 + (E_0 - 1) Lambda_0) y_m = source_m - (E_0 - 1) Lambda' y_m-1 - sum_n>0 E_n (w^n u)_m.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult

from .contact_rows import SIGMA, Rows
from .polynomials import Coefficients

Array = NDArray[np.float64]

# Least power of z in T (two of lambda for each of kappa), the most, and the share of T_0 that the
# last one (two of lambda) may have at the end of the band. Measured against full order on a block,
# mu p / V from 0.03 to 0.9 times the impedance of the lining: the stated errors hold where this is
# settled, and are up to 16 times too small where it is not.
LEAST, MOST, SETTLED = {False: 2, True: 4}, 16, 1e-3


def expanded(
    E: Sequence[Array], source: Array, forced: Coefficients, own: Array, rows: Rows,
    solve: Callable[[Array], Array],
) -> tuple[Array, Array]:  # fmt: skip
    """Coefficients of y as a function of a, and of T, as many as it takes.

    Args:
        E: coefficients in powers of w.
        source: likewise.
        forced: likewise.
        own: likewise.
        rows: blocks of contact rows.
        solve: solves with the matrix of y_m.

    Raises:
        InaccurateResult: the series does not settle.
    """
    y: list[Array] = []
    u: list[Array] = []
    T: list[Array] = []
    sizes: list[float] = []
    gaps, rates = rows.gaps(len(E[0])), rows.rates
    end = float(np.hypot(1.0, rows.shift) if rates else 1.0 + SIGMA)
    # In powers of z.
    source, own = (np.einsum("mn,n...->m...", rows.powers(len(A)), A) for A in (source, own))
    powers = rows.powers(len(E))

    def times_u(A: Coefficients, m: int, first: int) -> Iterator[Array]:
        """A_n (w^n u)_m of n = first and those after it."""
        for n in range(first, min(m, len(A) - 1) + 1):
            terms = [k for k in range(n, m + 1) if k < len(powers) and powers[k, n]]
            x = sum(powers[k, n] * u[m - k] for k in terms)
            yield A[n] @ np.asarray(x, A[n].dtype)

    for m in range(MOST + 1):
        rhs = source[m] if m < len(source) else np.zeros_like(source[0])
        if m and gaps < len(rhs):
            rhs[gaps:] += y[-1][gaps:]
            rhs -= E[0][:, gaps:] @ y[-1][gaps:]
        for product in times_u(E, m, 1):
            rhs -= product
        y.append(solve(rhs))
        u.append(y[m])
        if gaps < len(rhs):
            u[m] = y[m].copy()
            u[m][gaps:] = rows.shift * y[m][gaps:] + (y[m - 1][gaps:] if m else 0.0)
        T.append(own[m] if m < len(own) else np.zeros_like(own[0]))
        T[m] += sum(times_u(forced, m, 0))
        sizes.append(float(la.norm(T[m])) * end**m)
        if m >= LEAST[rates] and max(sizes[-2 if rates else -1 :]) <= SETTLED * sizes[0]:
            return np.array(y), np.array(T)
    raise InaccurateResult(
        "the motions of the contact are no short series in lambda: its forces that follow rates"
        " (damping of sliding mu p / V, or falling friction) are too strong for the reduced model;"
        ' use stability.method = "full", or'
        ' stability.on_tolerance = "full order"'
    )

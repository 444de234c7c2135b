"""Forces at contact that follow a motion and its rate, J(lambda) = J_0 + lambda J_1.

Of a motion with the gaps g, the slips v_T along and v_R across the sliding direction they are

    dD g on the gaps,   mu D g + lambda w p mu'(V) v_T along,   lambda (w mu p / V) v_R across.

They act along the rows I = [N; T] or [N; T; R]; the motion is seen through O = [N], to which T and
R belong only where a force follows them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..modes import Complex

Array = NDArray[np.float64]


def acting_blocks(names: str) -> str:
    """Blocks of I for those of O: normal forces and friction act in any case."""
    return "NT" + "R" * ("R" in names)


def interface_rows(
    names: str, N: sp.csr_matrix, T: sp.csr_matrix, R: sp.csr_matrix
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """O and I over some dofs.

    Args:
        names: blocks of O: "N", then "T" and "R" where a force follows their rates.
        N: gap operator, shape (elements, dofs).
        T: slip operator along the sliding direction.
        R: across it.
    """
    rows = {"N": N, "T": T, "R": R}
    seen, forced = (
        sp.vstack([rows[name] for name in blocks]).tocsr()
        for blocks in (names, acting_blocks(names))
    )
    return seen, forced


class ContactForces:
    """J of one sample.

    Attributes:
        n: number of contact elements.
        rows: number of rows of O.
        columns: number of rows of I.
    """

    def __init__(self, dD: Array, mD: Array, rates: dict[str, Array], columns: int):
        """Keep the factors of each element.

        Args:
            dD: w (k - k0) [N/m], shape (elements,).
            mD: w mu k [N/m].
            rates: for the names that O has beside N, in its order: "T" -> w p mu'(V) [N s/m],
                "R" -> w mu p / V.
            columns: number of rows of I.
        """
        self.n, self.rows, self.columns = dD.size, dD.size * (1 + len(rates)), columns
        self._dD, self._mD, self._rates = dD, mD, rates

    def __call__(self, s: Complex, z: Complex) -> Complex:
        """J z, shape (rows of I, modes)."""
        n = self.n
        out = s * self.rate(z)
        out[:n] += self._dD[:, None] * z[:n]
        out[n : 2 * n] += self._mD[:, None] * z[:n]
        return out

    def rate(self, z: Complex) -> Complex:
        """J_1 z."""
        out = np.zeros((self.columns, z.shape[1]), complex)
        for seen, own, rate in self._followed():
            out[own] = rate[:, None] * z[seen]
        return out

    def left(self, s: Complex, x: Complex) -> Complex:
        """J^H x at the conjugate s of lambda, shape (rows of O, modes)."""
        n = self.n
        out = s * self.left_rate(x)
        out[:n] += self._dD[:, None] * x[:n] + self._mD[:, None] * x[n : 2 * n]
        return out

    def left_rate(self, x: Complex) -> Complex:
        """J_1' x."""
        out = np.zeros((self.rows, x.shape[1]), complex)
        for seen, own, rate in self._followed():
            out[seen] = rate[:, None] * x[own]
        return out

    def after(self, now: Array, before: Array | None) -> Array:
        """Coefficient of lambda^i in A(lambda) J(lambda).

        Args:
            now: coefficient of lambda^i in A, shape (any, rows of I).
            before: that of lambda^(i-1); None for zero.
        """
        n = self.n
        out = np.zeros((now.shape[0], self.rows))
        np.multiply(now[:, :n], self._dD, out=out[:, :n])
        if self._mD.any():
            out[:, :n] += now[:, n : 2 * n] * self._mD
        if before is not None:
            for seen, own, rate in self._followed():
                out[:, seen] = before[:, own] * rate
        return out

    def _followed(self) -> Iterator[tuple[slice, slice, Array]]:
        """Rows of O that a rate is taken of, rows of I along which its force acts, its factor."""
        n = self.n
        for j, (name, rate) in enumerate(self._rates.items(), 1):
            first = n * "NTR".index(name)
            yield slice(j * n, (j + 1) * n), slice(first, first + n), rate

"""Rows of the table of modes: which eigenvalues belong to a band, rigid modes and divergence."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Eigenvalues up to this share of the band's end may be rigid modes; vectors of rigid modes that
# differ by less are one.
NEAR_ZERO, SAME_SHAPE = 1e-4, 1e-4


def undamped_rows(
    kappa: Complex, error: Array, band: tuple[float, float]
) -> tuple[NDArray[np.intp], Complex, Array, NDArray[np.bool_]]:
    """Rows of the band from the eigenvalues of K phi = kappa M phi, lambda^2 = -kappa.

    Args:
        kappa: eigenvalues [1/s^2], complex ones with their conjugates.
        error: their estimated errors [1/s^2].
        band: lowest and highest frequency [Hz].

    Returns:
        For each row: number of its kappa, lambda [1/s], error of lambda [1/s], and whether kappa
        is real, positive and too far from all others and from zero for an error to have made it so.
    """
    lam = np.sqrt(-kappa.astype(complex))
    # Of the two roots +-lambda the one with omega > 0; of two real ones the growing one.
    lam = np.where(lam.imag < 0, -lam, lam)
    with np.errstate(divide="ignore"):
        spread = np.where(np.abs(lam) > 0, error / (2 * np.abs(lam)), np.sqrt(error))
    frequency = lam.imag / (2 * np.pi)
    inside = (frequency >= band[0]) & (frequency <= band[1]) & (lam.imag > 0)
    diverging = (lam.imag == 0) & (kappa.real < 0) & (band[0] <= 0)
    chosen = np.flatnonzero(inside | diverging)
    order = chosen[np.lexsort((lam[chosen].real, frequency[chosen]))]
    return order, lam[order], spread[order], _surely_real(kappa, error)[order]


def _surely_real(kappa: Complex, error: Array) -> NDArray[np.bool_]:
    """Surely real and positive kappa: its error disc meets no other disc and not zero."""
    real = (kappa.imag == 0) & (kappa.real > error)
    order = np.argsort(kappa.real, kind="stable")
    x, e = kappa.real[order], 2 * error[order]
    clear = np.ones(kappa.size, dtype=bool)
    if kappa.size > 1:
        touch = np.diff(x) <= e[1:] + e[:-1]
        clear[1:] &= ~touch
        clear[:-1] &= ~touch
    out = np.empty_like(clear)
    out[order] = clear
    return real & out


def damped_rows(
    s: Complex, right: Complex, error: Array, band: tuple[float, float], zeta_max: float
) -> tuple[NDArray[np.intp], Complex]:
    """Rows of the band among some eigenvalues with omega >= 0, rigid modes first.

    Args:
        s: eigenvalues [1/s], shape (found,).
        right: their vectors, shape (size, found).
        error: their estimated errors [1/s].
        band: lowest and highest omega [rad/s].
        zeta_max: modes that decay faster are left out; those that grow faster are not.

    Returns:
        Number of each row's eigenvalue, and the eigenvalue, zero for a rigid mode.
    """
    low, high = band
    wanted = (s.imag > 0) & (s.imag >= low) & (s.imag <= high) & (s.real >= -zeta_max * np.abs(s))
    wanted |= (s.imag == 0) & (s.real > 0) & (low <= 0)
    rigid = (np.abs(s) <= np.minimum(error, NEAR_ZERO * high)) & (low <= 0)
    rows = np.r_[_independent(right, np.flatnonzero(rigid)), np.flatnonzero(wanted & ~rigid)]
    # What cannot be told from zero is a rigid mode: no frequency, no verdict.
    return rows, np.where(np.abs(s[rows]) <= error[rows], 0.0, s[rows])


def _independent(right: Complex, among: NDArray[np.intp]) -> NDArray[np.intp]:
    """Those of some eigenvalues at zero that have vectors of their own.

    A rigid mode that nothing damps is a double zero, and round-off splits zeros into pairs of any
    kind: their vectors tell how many modes there are.
    """
    if not among.size:
        return among
    X = right[:, among] / np.linalg.norm(right[:, among], axis=0)
    _, R, order = la.qr(np.hstack([X.real, X.imag]), mode="economic", pivoting=True)
    rank = int(np.sum(np.abs(np.diag(R)) > SAME_SHAPE * abs(R[0, 0])))
    # A vector may stand in twice, by its real and its imaginary part.
    first = list(dict.fromkeys(int(i) % among.size for i in order))[:rank]
    return among[np.sort(first)]

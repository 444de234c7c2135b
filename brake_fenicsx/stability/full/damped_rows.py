"""Damped modes of a band: the region that is counted, and the rows of the table."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from .completeness import Trapezium
from .slices import widest_gap

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Eigenvalues up to this share of the band's end may be rigid modes; vectors of rigid modes that
# differ by less are one.
NEAR_ZERO, SAME_SHAPE = 1e-4, 1e-4


def rectangle(s: Complex, high: float, wide: float, margin: float) -> Trapezium:
    """Region of the plane of lambda that holds the band, its edges in gaps of the spectrum.

    Args:
        s: eigenvalues in the band and beyond [1/s].
        high: upper end of the band [rad/s].
        wide: largest |Re lambda| over that.
        margin: the edges may be moved outwards by this factor.
    """
    wide *= high
    inner = s[np.abs(s.real) < margin * wide]
    return Trapezium(
        widest_gap(s.real, -margin * wide, -wide), widest_gap(s.real, wide, margin * wide), 0.0,
        widest_gap(np.abs(inner.imag), high, margin * high),
    )  # fmt: skip


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

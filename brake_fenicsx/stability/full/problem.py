"""The undamped problem taken apart, what a method returns, and the region that is counted."""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult

from ..interface import Interface
from .completeness import Trapezium, lowest_real, opening
from .slices import widest_gap

Complex = NDArray[np.complex128]

# The region of the count may reach beyond the band to a gap of the spectrum, by this share.
MARGIN = 0.1


@dataclass(frozen=True, slots=True)
class Problem:
    """K x = kappa M x, taken apart.

    Attributes:
        K: stiffness [N/m].
        M: mass [kg].
        smooth: symmetric part without friction, K itself if that is symmetric.
        face: K - smooth as an interface; None if K is symmetric or the rest has no low rank.
        comm: processes that call together and may share the work.
    """

    K: sp.csr_matrix
    M: sp.csr_matrix
    smooth: sp.csr_matrix
    face: Interface | None
    comm: MPI.Comm

    @property
    def symmetric(self) -> bool:
        """Whether there is no friction."""
        return self.smooth is self.K


@dataclass(frozen=True, slots=True)
class Found:
    """What a method found.

    Attributes:
        kappa: eigenvalues [1/s^2], conjugates included.
        right: right vectors, shape (dofs, modes).
        left: left vectors, psi^H K = kappa psi^H M.
        how: how their number was counted.
        iterations: block solves or restarts.
    """

    kappa: Complex
    right: Complex
    left: Complex
    how: str
    iterations: int


def search_region(kappa: NDArray, low: float, high: float, zeta_max: float) -> Trapezium:
    """Region of the plane of kappa that holds the band, its edges in gaps of the spectrum.

    Every mode of the band with a damping ratio up to zeta_max lies inside.

    Args:
        kappa: eigenvalues in the band and beyond [1/s^2].
        low: lower end of the band [1/s^2].
        high: upper end.
        zeta_max: largest damping ratio looked for.
    """
    rise = 1e-3 * high
    wide, least = opening(zeta_max), lowest_real(low, zeta_max)
    near = kappa[np.abs(kappa.imag) <= 2 * wide * np.abs(kappa.real) + rise]
    top = widest_gap(near.real, high, high * (1 + MARGIN))
    bottom = widest_gap(near.real, least * (1 - MARGIN), least) if low > 0 else -0.02 * high
    inner = kappa[(kappa.real > bottom) & (kappa.real < top) & (kappa.real > 0)]
    slopes = (np.abs(inner.imag) - rise) / np.maximum(inner.real, 1e-6 * high)
    slope = widest_gap(slopes, wide, wide * (1 + MARGIN))
    return Trapezium(bottom, top, slope, rise)


def agree(found: int, expected: int, high: float, by: str) -> None:
    """Compare the modes found with those counted.

    Raises:
        InaccurateResult: they differ.
    """
    if found != expected:
        raise InaccurateResult(
            f"{found} modes found up to {np.sqrt(high) / 2 / np.pi:g} Hz, {by} counts {expected}"
        )

"""Full order with damping: all modes of a band of (lambda^2 M + lambda C + K) phi = 0.

Small problems are solved densely, and counted by the winding number of their determinant. Large
ones go to block Arnoldi, and are counted by the function that is given.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import NotConverged

from ..eigensolvers.eigenpairs import (
    ROUND_OFF,
    QuadraticPencil,
    damped_errors,
    paired,
    rayleigh_quotient,
    residuals,
)  # fmt: skip
from ..eigensolvers.rows import NEAR_ZERO, damped_rows
from ..modes import Complex, Count, Modes
from .dense import DENSE, counted_quadratic, dense_quadratic_modes
from .problem import Problem
from .quadratic import quadratic_modes

Array = NDArray[np.float64]


def damped_modes(
    problem: Problem,
    C: sp.csr_matrix,
    band: tuple[float, float],
    tolerance: float,
    zeta_max: float,
    counted: Callable[[Problem, sp.csr_matrix, Complex, float, float], str],
) -> Modes:
    """All modes of a band with alpha >= -zeta_max |lambda|, one of each conjugate pair.

    Args:
        problem: the problem without damping.
        C: damping [N s/m].
        band: lowest and highest frequency [Hz].
        tolerance: relative residual of every mode.
        zeta_max: largest damping ratio looked for.
        counted: counts the modes of a large problem, see ``damped_count``.

    Returns:
        The modes; where their number could not be counted the record says why.

    Raises:
        NotConverged: a mode misses the tolerance by more than round-off explains.
        InaccurateResult: more or fewer modes than counted.
    """
    start = time.perf_counter()
    low, high = (2 * np.pi * f for f in band)
    pencil = QuadraticPencil(problem.M, C, problem.K)
    if problem.K.shape[0] <= DENSE:
        s, right, left, used = *dense_quadratic_modes(pencil, high), 1
        how = counted_quadratic(pencil, s, high, zeta_max)
    else:
        s, right, left, used = quadratic_modes(pencil, high, zeta_max)
        how = counted(problem, C, s, high, zeta_max)
    # Only decay is cut off: a mode that grows faster than that is news.
    slow = s.real >= -zeta_max * np.abs(s)
    chosen = np.flatnonzero(
        slow & (s.imag >= 0) & (s.imag <= high) | (np.abs(s) <= NEAR_ZERO * high)
    )
    chosen = chosen[np.lexsort((s[chosen].real, s[chosen].imag))]
    s, right, left = s[chosen], right[:, chosen], left[:, chosen]
    left = paired(s, left, pencil.slope(s, right))
    s = rayleigh_quotient(pencil, s, right, left)
    condition, error = damped_errors(pencil, s, right, left)
    rows, s = damped_rows(s, right, error, (low, high), zeta_max)
    right, left = right[:, rows], left[:, rows]
    residual, backward = residuals(pencil, s, right)
    if np.any((residual > tolerance) & (backward > ROUND_OFF)):
        raise NotConverged(
            f"damped modes: relative residual {residual.max():.1e}, wanted {tolerance:.0e}"
        )
    return Modes(
        s, right, left, residual, error[rows], condition[rows],
        Count(s.size, how), used, time.perf_counter() - start,
        np.zeros(s.size, dtype=bool),
    )  # fmt: skip

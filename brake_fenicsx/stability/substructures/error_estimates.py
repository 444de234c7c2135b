"""Error estimates of the reduced model, and the simple zeros and close pairs that they hold for.

To first order a change dD moves a zero by [eta; b]' dD [J y; a] / (b'T'a). Close to
another zero that is not the size of the move: two zeros that merge move by its root (Kato,
Perturbation Theory for Linear Operators, 1980, chapter II).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from ..modes import Complex
from .polynomials import Zeros
from .sample_problem import ROUND_OFF, Quotient

Array = NDArray[np.float64]

# First-order moves larger than this share of the distance to the next zero are not of first order.
CLOSE = 0.125

# An estimate is a few sizes of terms added up; it is stated with this factor.
SAFETY = 2.0


@dataclass(frozen=True, slots=True)
class Corrected:
    """Zeros after the quotient.

    Attributes:
        zeros: with vectors.
        slope: modulus of b' T'(z) a for these unit vectors, shape (zeros,).
        error: what is stated.
    """

    zeros: Zeros
    slope: Array
    error: Array


def corrected(found: Zeros, q: Quotient, interpolated: Array) -> Corrected:
    """Zeros and errors by the two-sided quotient on all vectors together.

    With the vectors A and B of all zeros found, B' T(z) A is diagonal but for small products, those
    of the quotient. The eigenvalues of diag(z) - products / slope hold for close zeros too, which a
    quotient of one vector moves too far; its real form decides whether two of them are real or
    conjugate.

    Args:
        found: zeros of the expanded T.
        q: their quotient.
        interpolated: estimated errors of the polynomials in the frequency and over the box.
    """
    z, number = found.z, found.z.size
    if not number:
        return Corrected(found, np.zeros(0), np.zeros(0))
    pairs = np.flatnonzero(z.imag)
    P, Q = q.products
    products = np.block([[P, Q.conj()[:, pairs]], [Q[pairs], P.conj()[np.ix_(pairs, pairs)]]])
    slope = np.r_[q.slope, q.slope[pairs].conj()]
    # From coordinates along a and its conjugate to those along its real and imaginary part.
    U = np.eye(slope.size, dtype=complex)
    for conjugate, one in enumerate(pairs, number):
        U[np.ix_([one, conjugate], [one, conjugate])] = [[1, 1], [1j, -1j]]
    back = np.linalg.inv(U)
    H = np.diag(np.r_[z, z[pairs].conj()]) - products / slope[:, None]
    w, L, X = la.eig((U @ H @ back).real, left=True, check_finite=False)
    some = np.flatnonzero(w.imag >= 0)
    X, L = back @ X[:, some], (L[:, some].conj().T @ U).T
    right = np.hstack([found.right, found.right[:, pairs].conj()]) @ X
    left = np.hstack([found.left, found.left[:, pairs].conj()]) @ (L / slope[:, None])
    sizes = la.norm(right, axis=0), la.norm(left, axis=0)
    right, left = right / sizes[0], left / sizes[1]
    new = np.maximum(np.abs(np.sum(L * X, axis=0)) / (sizes[0] * sizes[1]), 1e-300)
    # The old zero that each new one is most of: its first-order moves, but for the slope.
    of = np.r_[np.arange(number), pairs][np.abs(X).argmax(axis=0)]
    others = np.delete(found.every, found.chosen)
    others = others[~np.isin(others, z[pairs].conj())]
    every = np.r_[w, others]
    gap, second = distances(every, some), distances(every, some, 2)
    first = (q.unsolved + interpolated) * np.abs(q.slope) + ROUND_OFF
    # What zeros other than the nearest one would add to the second order.
    coupling = la.norm(products, axis=0) * la.norm(products, axis=1)
    first = (first[of] + coupling[of] / second) / new
    zeros = Zeros(every, some, right, left)
    simple, close = first + first**2 / gap, first + np.sqrt(first * gap)
    return Corrected(zeros, new, SAFETY * np.where(first < CLOSE * gap, simple, close))


def distances(z: Complex, chosen: NDArray[np.intp], number: int = 1) -> Array:
    """Distance of some zeros to the next of all zeros, or to the next but one."""
    apart = np.abs(z[chosen][:, None] - z[None, :])
    apart[np.arange(chosen.size), chosen] = np.inf
    if apart.shape[1] <= number:
        return np.full(chosen.size, np.inf)
    return np.asarray(np.maximum(np.partition(apart, number - 1, axis=1)[:, number - 1], 1e-300))

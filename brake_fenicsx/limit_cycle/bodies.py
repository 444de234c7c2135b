"""Elastic bodies as harmonic balance sees them: matrices that are sums of powers of lambda."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Bodies:
    """Bodies with own(lambda) a = lead(lambda) F, y = source(lambda) a + D(lambda) F.

    Attributes:
        own: terms of the coordinates' matrix, shape (terms, coordinates, coordinates).
        lead: of what forces do to coordinates, shape (terms, coordinates, acting rows).
        source: of what coordinates move, shape (terms, followed rows, coordinates).
        D: of the compliance beyond the coordinates [m/N], shape (terms, followed rows, acting
            rows).
        weights: lambda [1/s], shape (n,) -> factors of the terms of ``own`` and of those of the
            others, each of shape (terms or more, n).
    """

    own: Array
    lead: Array
    source: Array
    D: Array
    weights: Callable[[Complex], tuple[Complex, Complex]]

    def unbalanced(self, lam: Complex, a: Complex, y: Complex, F: Complex) -> Complex:
        """What is not in balance, shape (coordinates + followed rows, n); columns at each lambda.

        Args:
            lam: lambda of each column [1/s], shape (n,).
            a: coordinates, shape (coordinates, n).
            y: motions [m], shape (followed rows, n).
            F: forces [N], shape (acting rows, n).
        """
        own, other = self.weights(lam)
        first = _sum(self.own, own, a) - _sum(self.lead, other, F)
        return np.vstack([first, y - self.motions(lam, a, F)])

    def motions(self, lam: Complex, a: Complex, F: Complex) -> Complex:
        """Motions y [m], shape (followed rows, n); arguments as in ``unbalanced``."""
        other = self.weights(lam)[1]
        return _sum(self.source, other, a) + _sum(self.D, other, F)

    def at(self, s: complex) -> tuple[Complex, ...]:
        """``own``, ``lead``, ``source`` and ``D`` at lambda = s, one matrix each."""
        own, other = (w[:, 0] for w in self.weights(np.array([s])))
        given = (self.own, own), (self.lead, other), (self.source, other), (self.D, other)
        return tuple(
            np.tensordot(w.real[: len(A)], A, 1) + 1j * np.tensordot(w.imag[: len(A)], A, 1)
            for A, w in given
        )


def times(A: Array, x: Complex) -> Complex:
    """A x of a real matrix and complex columns, without a complex copy of the matrix."""
    return np.asarray((A @ np.ascontiguousarray(x).view(float)).view(complex))


def _sum(terms: Array, weights: Complex, x: Complex) -> Complex:
    out = np.zeros((terms.shape[1], x.shape[1]), complex)
    for A, w in zip(terms, weights, strict=False):
        out += times(A, w * x)
    return out

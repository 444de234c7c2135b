"""Elastic bodies as harmonic balance sees them: matrices that are sums of powers of lambda.

Of a reduced model, what the kept modes leave out is a power series about the start of the band.
Beyond the band, and HELD of the way to its nearest pole, it keeps the value it has there: higher
harmonics meet the kept modes, and a local compliance that does not change any more.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from brake_fenicsx.arguments import AnyArray, Array, Complex
from brake_fenicsx.stability.substructures import ReducedModel

# Linear steps leave out terms below these shares of the largest: of matrices, and of ``own``, whose
# terms cancel near a resonance, as far as single precision tells.
SMALL, ROUNDING = 1e-4, 1e-8
HELD = 0.5


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

    own: AnyArray
    lead: AnyArray
    source: AnyArray
    D: AnyArray
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

    def single(self, lam: Complex) -> "Bodies":
        """In single precision, without the last terms that are small at lambda, shape (n,)."""
        own, other = self.weights(lam)
        lead, source, D = (_leading(A, other, SMALL) for A in (self.lead, self.source, self.D))
        return Bodies(_leading(self.own, own, ROUNDING), lead, source, D, self.weights)

    def at(self, s: complex) -> tuple[Complex, ...]:
        """``own``, ``lead``, ``source`` and ``D`` at lambda = s, one matrix each."""
        own, other = (w[:, 0] for w in self.weights(np.array([s])))
        others = (weighted(A, other) for A in (self.lead, self.source, self.D))
        return weighted(self.own, own), *others


def weighted(terms: Array, weights: Complex) -> Complex:
    """Sum of matrices, shape (terms, rows, columns), by weights, shape (terms or more,)."""
    w = weights[: len(terms)]
    return np.tensordot(w.real, terms, 1) + 1j * np.tensordot(w.imag, terms, 1)


def times(A: AnyArray, x: AnyArray) -> AnyArray:
    """A x of a real matrix and complex columns, in the precision of A, without a complex matrix."""
    x = np.ascontiguousarray(x, np.result_type(A, np.complex64))
    return np.asarray((A @ x.view(A.dtype)).view(x.dtype))


def _sum(terms: AnyArray, weights: Complex, x: Complex) -> Complex:
    products = [times(A, w * x) for A, w in zip(terms, weights, strict=False)]
    return np.asarray(sum(products[1:], products[0]), complex)


def _leading(terms: AnyArray, weights: Complex, share: float) -> NDArray[np.float32]:
    """Terms up to the last one that is not below a share of the largest."""
    sizes = [la.norm(A) * np.abs(w).max() for A, w in zip(terms, weights, strict=False)]
    last = int(np.flatnonzero(sizes >= share * max(sizes))[-1])
    return terms[: last + 1].astype(np.float32)


def reduced_bodies(model: ReducedModel, p: Array, mu: Array) -> Bodies:
    """The bodies of a sample, with all its contact elements.

    Args:
        model: the reduced model.
        p: the sample's point of the box.
        mu: friction coefficients of the elements. Where no force follows a rate, friction is mu
            times the normal force, and normal forces are the only acting rows.
    """
    b, c, views = model.blocks(p), mu.size, model.at(p)
    lead, n = b.lead, len(views[0].modal)
    D: Array = np.array(b.D, float)
    # The kept modes follow any lambda, what they leave out does not.
    kept, coupling = np.zeros((n, *b.own.shape[1:])), np.array(b.own)
    for body, view in zip(model.bodies, views, strict=True):
        kept[:, body.modes, body.modes] = view.modal
    coupling[:n] -= kept
    if model.rows.followed == "N":
        lead, D = lead[..., :c] + mu * lead[..., c:], D[..., :c] + mu * D[..., c:]
    omega = 2 * np.pi * model.band[1]
    unit = omega**2
    end = np.abs(model.rows.variable(model.scaled(np.array(1j * omega))))
    reach = max(HELD * model.pole, float(end))

    def weights(lam: Complex) -> tuple[Complex, Complex]:
        w = model.rows.variable(model.scaled(lam))
        held = w * np.minimum(1.0, reach / np.abs(w))
        powers = held ** np.arange(len(D))[:, None]
        return np.concatenate([w ** np.arange(n)[:, None], powers]), powers

    lead, D = np.asarray(lead / unit, float), np.asarray(D / unit, float)
    return Bodies(np.concatenate([kept, coupling]), lead, b.source, D, weights)

"""Polynomials in the frequency through the values of a body at a few Chebyshev points.

What the kept modes leave out has its poles beyond the cutoff, so that a polynomial through
Chebyshev points of the band gains with every point a factor that Bernstein's ellipse tells: 10.9
for a cutoff of 1.8 times the band's end (L. N. Trefethen, Approximation Theory and Approximation
Practice, 2013, chapter 8). The points are real kappa = -lambda^2 of an undamped body, and lambda on
the imaginary axis of a damped one, where conjugate points come free. The first one lies next to the
equilibrium. The value at one point more, the end of the band, measures the error: it is the largest
of the band, since the nearest pole lies beyond.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brake_fenicsx.arguments import AnyArray, Array, Complex

from .contact_rows import SIGMA, Rows

# kappa of the first point: a free body has its rigid motions at 0.
FIRST = -1e-4

# Points keep this distance in kappa from the eigenvalues of the body, if they can within the width
# that they may be moved by.
APART, WIDTH, TRIES = 2e-3, 2e-2, 81

# Least distance of a pole, in units of the band's end, that an error is scaled with.
NEAR = 0.05


def real_points(count: int, eigenvalues: Array) -> Array:
    """Chebyshev points in kappa, from ``FIRST`` on, and the end of the band after them.

    Args:
        count: number of points but for the end, two at least.
        eigenvalues: kappa of the body, shape (modes,).

    Returns:
        Shape (count + 1,).
    """
    y = np.cos((2 * np.arange(count)[::-1] + 1) * np.pi / (2 * count))
    points = 1.0 + (1.0 - FIRST) / (1 - y[0]) * (y - 1.0)
    return np.r_[points[0], _away(np.r_[points[1:], 1.0], eigenvalues)]


def imaginary_points(count: int, eigenvalues: Array) -> Complex:
    """Chebyshev points in lambda: a real one at 0 but for ``FIRST``, those above it, i at the end.

    Args:
        count: number of points above the real one.
        eigenvalues: kappa of the body without damping, shape (modes,).

    Returns:
        Shape (count + 2,).
    """
    y = np.cos((2 * np.arange(count)[::-1] + 1) * np.pi / (4 * count + 2))
    return np.r_[np.sqrt(-FIRST), 1j * np.sqrt(_away(np.r_[y**2, 1.0], eigenvalues))]


def _away(points: Array, eigenvalues: Array) -> Array:
    """Points in kappa moved away from the eigenvalues of a body."""
    steps = np.linspace(-WIDTH, WIDTH, TRIES)
    steps = steps[np.argsort(np.abs(steps), kind="stable")]
    out = np.array(points)
    for i, point in enumerate(points):
        apart = np.abs(point + steps[:, None] - eigenvalues[None]).min(axis=1, initial=np.inf)
        far = np.flatnonzero(apart >= APART)
        out[i] += steps[far[0] if far.size else int(apart.argmax())]
    return out


class Polynomial:
    """A polynomial in w through values at some points, and its error.

    Attributes:
        count: number of its coefficients.
    """

    def __init__(self, points: AnyArray, rows: Rows):
        """Take the points.

        Args:
            points: in kappa or, where bodies are damped, in lambda; the end of the band last.
            rows: which of the two.
        """
        w = points - rows.shift if rows.damped else points + SIGMA
        above = w[:-1][np.imag(w[:-1]) > 0]
        self._nodes, self._end, self._rows = np.r_[w[:-1], above.conj()], w[-1], rows
        self.count: int = self._nodes.size
        inverse = np.linalg.inv(np.vander(self._nodes, increasing=True))
        # Conjugate values make twice the real part.
        single = np.where(np.imag(w[:-1]) > 0, 2.0, 1.0)
        self._weights = inverse[:, : w.size - 1] * single

    def coefficients(self, values: Sequence[AnyArray]) -> Array:
        """Real coefficients in powers of w from the values at all points but the end.

        Args:
            values: of each point, shape (...).
        """
        shape = np.shape(values)
        flat = np.reshape(values, (shape[0], int(np.prod(shape[1:]))))
        out = self._weights.real @ flat.real
        if np.iscomplexobj(flat):
            out -= self._weights.imag @ flat.imag
        return np.asarray(out.reshape(self.count, *shape[1:]))

    def missing(self, coefficients: Array, value: Array) -> Array:
        """What the polynomial lacks of a value at the end of the band: real and imaginary parts.

        Args:
            coefficients: in powers of w, shape (count, ...).
            value: at the end of the band, shape (...).

        Returns:
            Shape (1 or 2, ...).
        """
        powers = self._end ** np.arange(self.count)
        rest = value - np.tensordot(powers, coefficients, 1)
        return np.array([rest.real, rest.imag] if np.iscomplexobj(rest) else [rest])

    def growth(self, w: Complex, pole: float) -> Array:
        """Error at some w over that at the end of the band: 1 or less within the band.

        Args:
            w: shape (n,).
            pole: least frequency of a pole of what is left out, over the band's end.
        """
        nodes, end = self._nodes, self._end
        at_end = np.prod(np.abs(end - nodes))
        size = np.prod(np.abs(w[:, None] - nodes), axis=1) / at_end
        others = np.prod(np.abs(nodes[0] - nodes[1:])) / at_end
        within = np.minimum(1.0, others * np.abs(w - nodes[0]))
        # A pole acts by its distance: real ones of kappa, those of a damped body anywhere.
        if self._rows.damped:
            far, apart = pole, pole - np.abs(w + self._rows.shift)
        else:
            far = pole**2
            apart = np.hypot(np.maximum(far + SIGMA - w.real, 0.0), w.imag)
        nearer = (far - 1.0) / np.maximum(apart, NEAR)
        return np.asarray(np.maximum(within, size) * np.maximum(1.0, nearer))

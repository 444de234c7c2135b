r"""Newton's steps of harmonic balance, without a matrix of all harmonics.

Every harmonic n of a step obeys, with the change phi of the forces beyond -J y,

    (own_n + lead J E^-1 source) a_n = lead (1 + J D)^-1 phi_n + ...,

J the forces' stiffness averaged over a period, E = 1 + D J. GMRES finds phi, which the tangent over
time makes of the motions; it couples the harmonics. D, lead and source are real matrices of the
first harmonic, for it and the mean, and of the second one, for all others: steps converge a little
slower than those of Newton's method (on a block with D J = 5 each gains a factor of 5 to 10), and
their factors serve several vibrations. What is not in balance is exact.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, gmres

from .bodies import Array, Bodies, Complex, times

# Relative tolerance of GMRES.
LINEAR = 1e-2
# SciPy before 1.12 calls the relative tolerance "tol".
TOLERANCE = "rtol" if "rtol" in inspect.signature(gmres).parameters else "tol"

# A change of coordinates, of motions and of lambda.
Step = tuple[Complex, Complex, complex]


class _Contact:
    """The contact with a constant stiffness J, and real matrices of the bodies at one lambda.

    Attributes:
        seen: E^-1 source, motions that coordinates move, shape (followed rows, coordinates).
        pushed: E^-1 D, motions that forces move, shape (followed rows, acting rows).
        back: lead J, shape (coordinates, followed rows).
        lead: lead (1 + J D)^-1, shape (coordinates, acting rows).
    """

    def __init__(self, bodies: Bodies, s: complex, J: Array):
        lead, source, D = bodies.real(s)
        self._E = la.lu_factor(np.eye(len(D)) + through(D, J), check_finite=False)
        self.seen, self.pushed, self.back = self.solve(source), self.solve(D), through(lead, J)
        self.lead = lead - self.back @ self.pushed

    def solve(self, b: NDArray) -> NDArray:
        """E^-1 b."""
        return np.asarray(la.lu_solve(self._E, b, check_finite=False))


class Factors:
    """Inverse of the bodies at all harmonics with a constant stiffness J at the contact."""

    def __init__(self, bodies: Bodies, lam: Complex, J: Array, slope: Complex, phase: Complex):
        """Factor it.

        Args:
            bodies: the bodies.
            lam: lambda of each harmonic [1/s], shape (harmonics + 1,).
            J: stiffness, shape (acting blocks, followed blocks, elements).
            slope: what the balance of each harmonic changes by with its lambda, shape (coordinates
                + followed rows, harmonics + 1).
            phase: row of the first harmonic's motions whose value is given with lambda unknown.
        """
        self.J, self._phase, self._T = J, phase, []
        self._parts = [
            (which, _Contact(bodies, complex(lam[n]), J))
            for n, which in enumerate((slice(0, 2), slice(2, None)), 1)
            if n < len(lam)
        ]
        seen = self._parts[0][1].seen
        m = seen.shape[1]
        self._column, self._shift = slope[:m].copy(), np.empty_like(slope[m:])
        owns = bodies.owns(lam)
        for which, part in self._parts:
            self._shift[:, which] = part.solve(slope[m:, which])
            self._column[:, which] -= times(part.back, self._shift[:, which])
            owns[which] += part.back @ part.seen
        self._sizes = float(la.norm(self._column[:, 1])), float(la.norm(phase @ seen))
        column, row = self._column[:, 1:2] / self._sizes[0], (phase @ seen)[None] / self._sizes[1]
        corner = phase @ self._shift[:, 1] / self._sizes[0] / self._sizes[1]
        border = np.block([[owns[1], column], [row, -corner[None, None]]])
        # Single precision: its error is far below that of the steps.
        self._T = [
            la.lu_factor((border if n == 1 else own).astype(np.complex64), check_finite=False)
            for n, own in enumerate(owns)
        ]

    def solve(self, phi: Complex, missing: complex, x: Complex | None = None) -> Step:
        """Changes of coordinates, motions and lambda.

        Args:
            phi: forces, shape (acting rows, harmonics + 1).
            missing: value of the phase row.
            x: right-hand sides of the balances, shape (coordinates + followed rows, harmonics + 1).
        """
        y, a = np.empty_like(self._shift), np.empty_like(self._column)
        for which, part in self._parts:
            y[:, which] = times(part.pushed, phi[:, which])
            a[:, which] = times(part.lead, phi[:, which])
            if x is not None:
                more = part.solve(x[len(a) :, which])
                y[:, which] += more
                a[:, which] += x[: len(a), which] - times(part.back, more)
        border = _solved(
            self._T[1], np.r_[a[:, 1], (missing - self._phase @ y[:, 1]) / self._sizes[1]]
        )
        s = complex(border[-1]) / self._sizes[0]
        moved = changes(s, a.shape[1])
        a -= self._column * moved
        for n, factors in enumerate(self._T):
            a[:, n] = border[:-1] if n == 1 else _solved(factors, a[:, n])
        y -= self._shift * moved
        for which, part in self._parts:
            y[:, which] += times(part.seen, a[:, which])
        return a, y, s


def across(J: Array, y: NDArray) -> NDArray:
    """J y of motions y, shape (followed rows, n), to (acting rows, n).

    Args:
        J: shape (acting blocks, followed blocks, elements).
        y: the motions.
    """
    g, f, c = J.shape
    return np.einsum("gfc,fcn->gcn", J, y.reshape(f, c, -1)).reshape(g * c, -1)


def changes(s: complex, count: int) -> Complex:
    """Change of each harmonic's lambda with a change s of the first one's."""
    out: Complex = np.asarray(1j * s.imag * np.arange(count), complex)
    out[1] = s
    return out


def newton_step(
    factors: Factors,
    forces: Callable[[Complex, complex], Complex],
    equation: Callable[[Complex, complex], complex],
    x: Complex,
    wanted: float,
    sizes: tuple[float, float],
    most: int,
) -> Step | None:
    """The step of a vibration; None where GMRES needs more vectors.

    Args:
        factors: of this vibration or of one nearby.
        forces: changes of motions and lambda -> changes of the contact forces [N].
        equation: the same -> two more equations, as one complex number.
        x: right-hand sides of the balances, shape (coordinates + followed rows, harmonics + 1).
        wanted: right-hand side of the real part of ``equation``.
        sizes: scales of forces [N] and of amplitudes [m].
        most: vectors at most.
    """
    shape = factors.J.shape[0] * factors.J.shape[2], x.shape[1]

    def solved(v: Array, x: Complex | None = None) -> Step:
        phi = (sizes[0] * v[:-2]).view(complex).reshape(shape)
        return factors.solve(phi, sizes[1] * complex(v[-2], v[-1]), x)

    def seen(step: Step) -> Array:
        phi, value = forces(*step[1:]) + across(factors.J, step[1]), equation(*step[1:])
        return np.r_[phi.view(float).ravel() / sizes[0], value.real, value.imag]

    none = np.zeros(2 * shape[0] * shape[1] + 2)
    # Rows of forces: phi less what the tangent makes of it; the last two: the equations.
    keeps, sign = np.ones(none.size), -np.ones(none.size)
    keeps[-2:], sign[-2:] = 0.0, 1.0
    b = -sign * seen(solved(none, x))
    b[-2] += wanted
    A = LinearOperator((b.size, b.size), lambda v: keeps * v + sign * seen(solved(v)), dtype=float)
    given = {"restart": min(most, b.size), "maxiter": 1, "atol": 0.0, TOLERANCE: LINEAR}
    v, failed = gmres(A, b, **given)
    return None if failed else solved(v, x)


def _solved(factors: tuple[NDArray, NDArray], b: Complex) -> Complex:
    return np.asarray(la.lu_solve(factors, b.astype(np.complex64), check_finite=False))


def through(A: Array, J: Array) -> Array:
    """A J of rows A, shape (rows, followed rows)."""
    g, f, c = J.shape
    return np.einsum("rgc,gfc->rfc", A.reshape(len(A), g, c), J).reshape(len(A), f * c)

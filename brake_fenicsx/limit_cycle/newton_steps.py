r"""Newton's steps of harmonic balance, without a matrix of all harmonics.

Every harmonic n of a step obeys, with the change phi of the forces beyond -J y and what is not in
balance, x,

    own a_n + lead J y_n = lead phi_n + ...,    -source a_n + (1 + D J) y_n = D phi_n + ...,

J the forces' stiffness averaged over a period. GMRES finds phi, which the tangent over time makes
of the motions; it couples the harmonics. The factors serve several vibrations.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, gmres

from .bodies import Array, Bodies, Complex

# Relative tolerance of GMRES.
LINEAR = 1e-2
# SciPy before 1.12 calls the relative tolerance "tol".
TOLERANCE = "rtol" if "rtol" in inspect.signature(gmres).parameters else "tol"

# Of the factors: its error is far below that of the steps.
SINGLE = np.complex64

# A change of coordinates, of motions and of lambda.
Step = tuple[Complex, Complex, complex]


class Factors:
    """Inverse of the balances of all harmonics with a constant stiffness J at the contact."""

    def __init__(
        self, bodies: Bodies, lam: Complex, J: Array, slope: Complex, phase: Complex,
        amplitude: float,
    ):  # fmt: skip
        """Factor it.

        Args:
            bodies: the bodies.
            lam: lambda of each harmonic [1/s], shape (harmonics + 1,).
            J: stiffness, shape (acting blocks, followed blocks, elements).
            slope: what the balance of each harmonic changes by with its lambda, shape (coordinates
                + followed rows, harmonics + 1).
            phase: row of the first harmonic's motions whose value is given with lambda unknown.
            amplitude: of the vibration [m], which ``slope`` grows with.
        """
        self.J, self._count, self._parts = J, len(slope) - phase.size, []
        self._amplitude, self._size = amplitude, float(la.norm(slope[:, 1]))
        for n, s in enumerate(lam):
            own, lead, source, D = bodies.at(complex(s))
            A = np.block([[own, through(lead, J)], [-source, np.eye(len(D)) + through(D, J)]])
            right, column = np.vstack([lead, D]), slope[:, n, None]
            if n == 1:
                row, size = np.r_[np.zeros(len(own)), phase, 0.0], la.norm(phase)
                A = np.vstack([np.hstack([A, column / self._size]), row / size])
                right = la.block_diag(right, 1 / size)
            else:
                right = np.hstack([right, -column])
            factors = la.lu_factor(A.astype(SINGLE), check_finite=False)
            response = la.lu_solve(factors, right.astype(SINGLE), check_finite=False)
            self._parts.append((factors, response))

    def solve(
        self, phi: Complex, missing: complex, amplitude: float, x: Complex | None = None
    ) -> Step:
        """Changes of coordinates, motions and lambda.

        Args:
            phi: forces, shape (acting rows, harmonics + 1).
            missing: value of the phase row.
            amplitude: of the vibration [m].
            x: right-hand sides of the balances, shape (coordinates + followed rows, harmonics + 1).
        """
        first, ratio = self._changed(1, phi, missing, x), amplitude / self._amplitude
        s = complex(first[-1]) / (self._size * ratio)
        moved = ratio * changes(s, phi.shape[1])
        out = [self._changed(n, phi, more, x) for n, more in enumerate(moved) if n != 1]
        both = np.array([out[0], first[:-1], *out[1:]], complex).T
        return both[: self._count], both[self._count :], s

    def _changed(self, n: int, phi: Complex, more: complex, x: Complex | None) -> Complex:
        """Coordinates and motions of harmonic n; of the first one, also lambda times its scale.

        Args:
            n: the harmonic.
            phi: forces, shape (acting rows, harmonics + 1).
            more: of the first harmonic the value of the phase row, of others the change of lambda.
            x: right-hand sides of the balances, shape (coordinates + followed rows, harmonics + 1).
        """
        factors, response = self._parts[n]
        z = np.asarray(response @ np.append(phi[:, n], more).astype(SINGLE))
        if x is None:
            return z
        right = np.append(x[:, n], np.zeros(len(z) - len(x))).astype(SINGLE)
        return z + la.lu_solve(factors, right, check_finite=False)


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
    equation: Callable[[Complex, Complex, complex], complex],
    x: Complex,
    wanted: float,
    sizes: tuple[float, float],
    most: int,
) -> Step | None:
    """The step of a vibration; None where GMRES needs more vectors.

    Args:
        factors: of this vibration or of one nearby.
        forces: changes of motions and lambda -> changes of the contact forces [N].
        equation: changes of coordinates, motions and lambda -> two more equations, as one complex
            number.
        x: right-hand sides of the balances, shape (coordinates + followed rows, harmonics + 1).
        wanted: right-hand side of the real part of ``equation``.
        sizes: scales of forces [N] and of amplitudes [m].
        most: vectors at most.
    """
    shape = factors.J.shape[0] * factors.J.shape[2], x.shape[1]

    def solved(v: Array, x: Complex | None = None) -> Step:
        phi = (sizes[0] * v[:-2]).view(complex).reshape(shape)
        return factors.solve(phi, sizes[1] * complex(v[-2], v[-1]), sizes[1], x)

    def seen(step: Step) -> Array:
        phi, value = forces(*step[1:]) + across(factors.J, step[1]), equation(*step)
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


def through(A: NDArray, J: Array) -> NDArray:
    """A J of rows A, shape (rows, followed rows)."""
    g, f, c = J.shape
    return np.einsum("rgc,gfc->rfc", A.reshape(len(A), g, c), J).reshape(len(A), f * c)

"""Elastic bodies in harmonic balance: matrices that are sums of powers of lambda, steps with them.

Of a reduced model, what the kept modes leave out is a power series about the start of the band.
Beyond the band, and HELD of the way to its nearest pole, it keeps the value it has there: higher
harmonics meet the kept modes, and a local compliance that does not change any more.

Newton's steps need no matrix of all harmonics. With the forces' stiffness J averaged over a period,
every harmonic n of a step obeys, x being what is not in balance,

    own a_n + lead J y_n = x_a,    -source a_n + (1 + D J) y_n = x_y.

D hardly changes with the frequency: with that of the first harmonic one real inverse of 1 + D J
eliminates the motions of all harmonics, which leaves a Schur complement on the coordinates for
each. This preconditions GMRES on the balances with the tangent over time, which couples the
harmonics (Newton-Krylov: Knoll and Keyes, J. Comput. Phys. 193, 2004,
doi:10.1016/j.jcp.2003.08.010).
"""

import inspect
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, gmres

from brake_fenicsx.arguments import AnyArray, Array, Complex
from brake_fenicsx.stability.substructures import ReducedModel
from brake_fenicsx.stability.substructures.polynomials import whole

# Linear steps leave out terms below these shares of the largest: of matrices, and of ``own``, whose
# terms cancel near a resonance, as far as single precision tells.
SMALL, ROUNDING = 1e-4, 1e-8
HELD = 0.5

# Relative tolerance of GMRES.
LINEAR = 1e-2
# SciPy before 1.12 calls the relative tolerance "tol".
TOLERANCE = "rtol" if "rtol" in inspect.signature(gmres).parameters else "tol"

# A change of coordinates, of motions and of lambda.
Step = tuple[Complex, Complex, complex]


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
    lead, n = whole(b.lead), len(views[0].modal)
    D: Array = np.array(b.D, float)
    # The kept modes follow any lambda, what they leave out does not.
    coupling = whole(b.own)
    kept = np.zeros((n, *coupling.shape[1:]))
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
    return Bodies(np.concatenate([kept, coupling]), lead, whole(b.source), D, weights)


class Factors:
    """Approximate inverse, in single precision, of a vibration's balances.

    Attributes:
        coordinates: number of the bodies' coordinates.
    """

    def __init__(
        self, bodies: Bodies, lam: Complex, J: Array, slope: Complex, phase: Complex,
        amplitude: float,
    ):  # fmt: skip
        """Eliminate the motions, and invert what remains of each harmonic.

        Args:
            bodies: the bodies.
            lam: lambda of each harmonic [1/s], shape (harmonics + 1,).
            J: stiffness, shape (acting blocks, followed blocks, elements).
            slope: what the balance of each harmonic changes by with its lambda, shape (coordinates
                + followed rows, harmonics + 1).
            phase: row of the first harmonic's motions whose value is given with lambda unknown.
            amplitude: of the vibration [m], which ``slope`` grows with.
        """
        _, lead, source, D = (A.real.astype(np.float32) for A in bodies.at(complex(lam[1])))
        J, self._phase, self.coordinates = J.astype(np.float32), phase, source.shape[1]
        self._lead, self._amplitude = through(lead, J), amplitude
        self._local = inverse(np.eye(len(D)) + through(D, J), np.float32)
        self._moved = self._local @ source
        self._with_lam = times(self._local, slope[self.coordinates :])
        self._to_lam = slope[: self.coordinates] - times(self._lead, self._with_lam)
        self._size = float(la.norm(slope[:, 1])) or 1.0
        stiffness, self._own = self._lead @ self._moved, []
        for n, weights in enumerate(bodies.weights(lam)[0].T):
            A = weighted(bodies.own, weights) + stiffness
            if n == 1:
                column = np.append(self._to_lam[:, 1], -phase @ self._with_lam[:, 1]) / self._size
                A = np.column_stack([np.vstack([A, phase @ self._moved]), column])
            self._own.append(inverse(A, np.complex64))

    def solve(self, x: Complex, given: complex, amplitude: float) -> Step:
        """Changes of coordinates, motions and lambda.

        Args:
            x: right-hand sides of the balances, shape (coordinates + followed rows, harmonics + 1).
            given: value of the phase row.
            amplitude: of the vibration [m].
        """
        ratio = amplitude / self._amplitude
        y = times(self._local, x[self.coordinates :])
        a = x[: self.coordinates] - times(self._lead, y)
        first = np.append(a[:, 1], given - self._phase @ y[:, 1]).astype(np.complex64)
        first = self._own[1] @ first
        s = complex(first[-1]) / (self._size * ratio)
        moved = ratio * changes(s, x.shape[1])
        a = (a - moved * self._to_lam).astype(np.complex64)
        for n, own in enumerate(self._own):
            a[:, n] = first[:-1] if n == 1 else own @ a[:, n]
        return a, y + times(self._moved, a) - moved * self._with_lam, s


def inverse(A: AnyArray, kind: type) -> AnyArray:
    """Inverse in a precision; NaN where A is singular: the step then fails."""
    try:
        return np.asarray(la.inv(A.astype(kind), check_finite=False))
    except la.LinAlgError:
        return np.full(A.shape, np.nan, kind)


def changes(s: complex, count: int) -> Complex:
    """Change of each harmonic's lambda with a change s of the first one's."""
    out: Complex = np.asarray(1j * s.imag * np.arange(count), complex)
    out[1] = s
    return out


def newton_step(
    factors: Factors,
    balances: Callable[[Complex, Complex, complex], Complex],
    equation: Callable[[Complex, Complex, complex], complex],
    x: Complex,
    wanted: float,
    sizes: tuple[float, float, float],
    amplitude: float,
    most: int,
) -> Step | None:
    """The step of a vibration; None where GMRES needs more vectors.

    Args:
        factors: of this vibration or of one nearby.
        balances: changes of coordinates, motions and lambda -> changes of the balances, shape
            (coordinates + followed rows, harmonics + 1).
        equation: likewise, to two more equations as one complex number.
        x: right-hand sides of the balances.
        wanted: right-hand side of the real part of ``equation``.
        sizes: scales of coordinates, of motions [m] and of lambda [1/s].
        amplitude: of the vibration [m].
        most: vectors at most.
    """
    shape, count = x.shape, factors.coordinates

    def packed(x: Complex, given: complex) -> Array:
        a, y, s = factors.solve(x, amplitude * given, amplitude)
        parts = zip((a, y, np.array([s])), sizes, strict=True)
        return np.concatenate([(part / size).ravel() for part, size in parts]).view(float)

    def step_of(v: Array) -> Step:
        z: Complex = np.asarray(v.view(complex))
        both = z[:-1].reshape(shape)
        return sizes[0] * both[:count], sizes[1] * both[count:], sizes[2] * complex(z[-1])

    def seen(v: Array) -> Array:
        step = step_of(v)
        return packed(balances(*step), equation(*step))

    b = packed(x, wanted)
    A = LinearOperator((b.size, b.size), seen, dtype=float)
    given = {"restart": most, "maxiter": 1, "atol": 0.0, TOLERANCE: LINEAR}
    v, failed = gmres(A, b, **given)
    return None if failed else step_of(v)


def through(A: AnyArray, J: Array) -> AnyArray:
    """A J of rows A, shape (rows, followed rows)."""
    g, f, c = J.shape
    return np.einsum("rgc,gfc->rfc", A.reshape(len(A), g, c), J).reshape(len(A), f * c)


def across(J: Array, y: AnyArray) -> AnyArray:
    """J y of motions y, shape (followed rows, n), to (acting rows, n).

    Args:
        J: shape (acting blocks, followed blocks, elements).
        y: the motions.
    """
    g, f, c = J.shape
    return np.einsum("gfc,fcn->gcn", J, y.reshape(f, c, -1)).reshape(g * c, -1)

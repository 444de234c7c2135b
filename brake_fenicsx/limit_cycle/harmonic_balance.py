"""Periodic vibration of elastic bodies under nonlinear contact forces, by harmonic balance.

The motions y of the contact and the coordinates a of the bodies are sums over harmonics,

    y(t) = Re sum_n y_n exp(i n omega t),      own a_n = lead F_n,      y_n = source a_n + D F_n,

with matrices of the bodies at lambda_n, and forces F(y, y') evaluated at points of time over a
period (Cameron and Griffin, J. Appl. Mech. 56, 1989, doi:10.1115/1.3176036). The first harmonic
belongs to lambda_1 = alpha + i omega, the n-th to i n omega: alpha is the growth rate of a mode
whose shape and frequency follow its amplitude, and a limit cycle where it is zero (complex
nonlinear modes: Laxalde and Thouverez, J. Sound Vib. 322, 2009, doi:10.1016/j.jsv.2009.02.019;
Krack, Comput. Struct. 154, 2015, doi:10.1016/j.compstruc.2015.03.008).

Newton's method solves for a_n, y_n, alpha and omega at a given amplitude; its linear systems are
solved by GMRES, preconditioned by the bodies with the forces' tangent averaged over a period.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, gmres

from brake_fenicsx.errors import NotConverged

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Newton's iterations at most, and what each must gain with the factors of an earlier one; vectors
# of GMRES at most, with new factors and with those of an earlier vibration, and its relative
# tolerance; relative step of differences over lambda.
ITERATIONS, GAIN, VECTORS, FEW, LINEAR, DIFFERENCE = 15, 0.2, 200, 60, 1e-3, 1e-6
# SciPy before 1.12 calls the relative tolerance "tol".
TOLERANCE = "rtol" if "rtol" in inspect.signature(gmres).parameters else "tol"


@dataclass(frozen=True, slots=True)
class Response:
    """The bodies at one lambda; see the module.

    Attributes:
        own: shape (coordinates, coordinates).
        lead: shape (coordinates, acting rows).
        source: shape (followed rows, coordinates).
        D: shape (followed rows, acting rows).
    """

    own: Complex
    lead: Complex
    source: Complex
    D: Complex


class Bodies(Protocol):
    """Elastic bodies, seen from their contact."""

    def at(self, s: complex) -> Response:
        """The bodies at lambda = s [1/s]."""


@dataclass(frozen=True, slots=True)
class Tangent:
    """Derivatives of forces over a period: blocks of acting and followed rows, element by element.

    Attributes:
        y: to motions, shape (acting blocks, followed blocks, elements, times).
        v: to velocities, likewise; None where forces follow none.
        past: to the motion of the first followed block at ``time`` of each element, shape (acting
            blocks, elements, times); None where forces remember nothing.
        time: shape (elements,).
    """

    y: Array
    v: Array | None = None
    past: Array | None = None
    time: NDArray[np.intp] | None = None

    def times(self, y: Array, v: Array) -> Array:
        """Change of the forces, shape (acting rows, times)."""
        blocks, count = self.y.shape[1:3]
        moved = y.reshape(blocks, count, -1)
        out = np.einsum("ijct,jct->ict", self.y, moved)
        if self.v is not None:
            out += np.einsum("ijct,jct->ict", self.v, v.reshape(moved.shape))
        if self.past is not None:
            out += self.past * moved[0][np.arange(count), self.time][None, :, None]
        return out.reshape(-1, out.shape[-1])

    def mean(self, s: complex) -> Complex:
        """Stiffness at lambda averaged over a period, shape (acting, followed blocks, elements)."""
        J = -self.y.mean(axis=-1) + 0j
        return J if self.v is None else J - s * self.v.mean(axis=-1)


# Motions and velocities, shape (followed rows, times) -> forces, shape (acting rows, times).
Forces = Callable[[Array, Array], tuple[Array, Tangent]]


@dataclass(frozen=True, slots=True)
class Vibration:
    """A periodic vibration.

    Attributes:
        a: coordinates of the bodies, shape (coordinates, harmonics + 1).
        y: motions of the contact [m], shape (followed rows, harmonics + 1).
        s: alpha + i omega [1/s].
        amplitude: root mean square over the elements of |y_1| [m], see ``HarmonicBalance.size``.
    """

    a: Complex
    y: Complex
    s: complex
    amplitude: float

    @property
    def lam(self) -> Complex:
        """Lambda of each harmonic [1/s]."""
        out: Complex = np.asarray(1j * self.s.imag * np.arange(self.y.shape[1]), complex)
        out[1] = self.s
        return out

    def moved(self, d: Change, share: float = 1.0) -> Vibration:
        """The vibration after a change."""
        return Vibration(
            self.a + share * d.a, self.y + share * d.y, self.s + share * d.s,
            self.amplitude + share * d.amplitude,
        )  # fmt: skip


class Change(Vibration):
    """A change of a vibration, of the same layout."""


# A vibration -> a number that is to be zero, and its derivatives to alpha and to the amplitude.
Condition = Callable[[Vibration], tuple[float, float, float]]


class HarmonicBalance:
    """The equations of one problem."""

    def __init__(self, bodies: Bodies, forces: Forces, weights: Array, harmonics: int, points: int):
        """Take the problem.

        Args:
            bodies: the bodies.
            forces: of the contact.
            weights: of the followed rows in the mean square of the amplitude; their sum is 1.
            harmonics: number of harmonics beside the mean.
            points: points of time over a period, more than twice the harmonics.
        """
        if points <= 2 * harmonics:
            raise ValueError(f"{points} points of time for {harmonics} harmonics; take more")
        self.bodies, self.forces, self._weights = bodies, forces, weights
        self.harmonics, self.points = harmonics, points
        # Of a vibration nearby, found before.
        self._factors: _Factors | None = None

    def contact(self, at: Vibration) -> tuple[Complex, Tangent]:
        """Harmonics of the forces of a vibration, and their tangent over time."""
        F, tangent = self.forces(self.over_time(at.y), self.over_time(at.lam * at.y))
        return self.harmonics_of(F), tangent

    def over_time(self, x: Complex) -> Array:
        """Values at the points of time of harmonics, shape (rows, harmonics + 1)."""
        full = np.zeros((len(x), self.points // 2 + 1), complex)
        full[:, : x.shape[1]] = 0.5 * x
        full[:, 0] *= 2
        return np.fft.irfft(full, self.points) * self.points

    def harmonics_of(self, x: Array) -> Complex:
        """Harmonics of values at the points of time."""
        out = np.fft.rfft(x)[:, : self.harmonics + 1] * (2 / self.points)
        out[:, 0] *= 0.5
        return out

    def size(self, y: Complex) -> float:
        """Root mean square of |y| [m] of one harmonic, shape (followed rows,)."""
        return float(np.sqrt(self._weights @ np.abs(y) ** 2))

    def at_rest(self, s: complex, a: Complex) -> Complex:
        """Motions of the contact under the coordinates of a small vibration at lambda = s."""
        still = np.zeros((self._weights.size, self.points))
        J = self.forces(still, still)[1].mean(s)
        return _Harmonic(self.bodies.at(s), J).seen @ a

    def start(self, s: complex, a: Complex, y: Complex, amplitude: float) -> Vibration:
        """A vibration along a linear mode.

        Args:
            s: its eigenvalue [1/s].
            a: its coordinates, shape (coordinates,).
            y: its motions at the contact, shape (followed rows,).
            amplitude: of the vibration [m].
        """
        factor = amplitude / self.size(y)
        both = np.zeros((a.size + y.size, self.harmonics + 1), complex)
        both[:, 1] = factor * np.r_[a, y]
        return Vibration(both[: a.size], both[a.size :], s, amplitude)

    def solve(
        self, guess: Vibration, condition: Condition, tolerance: float = 1e-8
    ) -> tuple[Vibration, Change, int]:
        """The vibration nearby that fulfils a condition on alpha and amplitude.

        Args:
            guess: where Newton's method starts; it also fixes the phase.
            condition: what is asked for.
            tolerance: largest change of motions and lambda in the last step, relative to them.

        Returns:
            The vibration, how those nearby change with the amplitude, and the number of iterations.

        Raises:
            NotConverged: there is none nearby.
        """
        found, phase = guess, self._weights * guess.y[:, 1].conj() / self.size(guess.y[:, 1])
        along, last = None, 0.0
        for iteration in range(1, ITERATIONS + 1):
            system = _Linearised(self, found, phase)
            for factors in dict.fromkeys((self._factors, None)):
                try:
                    made = factors or _Factors(system)
                    most = VECTORS if factors is None else FEW
                    along = along or system.with_amplitude(made, most)
                    fixed = system.step(made, most)
                    break
                except _NeedsFactorsError:
                    along = None
            else:
                break
            self._factors = made
            value, to_alpha, to_amplitude = condition(found.moved(fixed))
            slope = to_alpha * along.s.real + to_amplitude * along.amplitude
            step = -value / slope if slope else np.inf
            total = Change(
                fixed.a + step * along.a, fixed.y + step * along.y, fixed.s + step * along.s,
                fixed.amplitude + step * along.amplitude,
            )  # fmt: skip
            size = max(la.norm(total.y) / la.norm(found.y), abs(total.s) / abs(found.s))
            if not np.isfinite(size) or size > 10:
                break
            found = found.moved(total, min(1.0, 0.5 / size))
            if found.s.imag <= 0 or found.amplitude <= 0:
                break
            if size <= tolerance:
                return replace(found, amplitude=self.size(found.y[:, 1])), along, iteration
            if iteration > 1 and size > GAIN * last:
                self._factors, along = None, None
            last = size
        raise NotConverged(
            f"limit cycle: no vibration of amplitude near {1e6 * guess.amplitude:.3g} um; take"
            " more harmonics or points of time"
        )


class _Harmonic:
    """Inverse of the bodies at one harmonic, with a constant stiffness J at the contact.

    Attributes:
        seen: motions of the contact by coordinates, shape (followed rows, coordinates).
    """

    def __init__(self, r: Response, J: Complex, border: tuple[Complex, NDArray] | None = None):
        """Factor it.

        Args:
            r: the bodies.
            J: see ``through``.
            border: column of lambda, which then is an unknown too, and row of the motions.
        """
        self._E = la.lu_factor(np.eye(len(r.D)) + through(r.D, J), check_finite=False)
        self._lead, self.seen = through(r.lead, J), self._contact(r.source)
        T, self._row = r.own + self._lead @ self.seen, None
        self._shift: Complex = np.zeros((1, 1), complex)
        if border is not None:
            m, (column, self._row) = len(T), border
            self._shift = self._contact(column[m:, None])
            side = column[:m, None] - self._lead @ self._shift
            last = self._row[None]
            T = np.block([[T, side], [last @ self.seen, -last @ self._shift]])
        # A border in other units is no lack of accuracy that a warning should name.
        self._T = la.lu_factor(T, check_finite=False)

    def _contact(self, b: Complex) -> Complex:
        return np.asarray(la.lu_solve(self._E, b, check_finite=False))

    def solve(self, x: Complex) -> Complex:
        """Solutions (a, y, lambda) of columns x, shape (coordinates + followed rows + 1, columns).

        Args:
            x: right-hand sides of own a + lead J y + column lambda = ., of y - source a + D J y +
                column lambda = ., and of row y = .; without a border lambda is zero.
        """
        y = self._contact(x[-len(self._E[1]) - 1 : -1])
        b = x[: -len(y) - 1] - self._lead @ y
        if self._row is not None:
            b = np.vstack([b, x[-1:] - self._row @ y])
        a = la.lu_solve(self._T, b, check_finite=False)
        a, s = (a, np.zeros_like(x[-1:])) if self._row is None else (a[:-1], a[-1:])
        return np.vstack([a, y + self.seen @ a - self._shift * s, s])


def through(A: Complex, J: Complex) -> Complex:
    """A J of rows A, shape (rows, followed rows); J: (acting blocks, followed blocks, elements)."""
    g, f, c = J.shape
    return np.einsum("rgc,gfc->rfc", A.reshape(len(A), g, c), J).reshape(len(A), f * c)


class _NeedsFactorsError(Exception):
    """GMRES needs too many vectors with these factors."""


class _Factors:
    """Inverses of all harmonics with the tangent's mean, applied to the contact forces.

    Attributes:
        harmonics: one for each.
        phase: row of the first harmonic's motions in its border.
        J: their stiffnesses at the contact, shape (harmonics + 1, acting, followed, elements).
        slope: d residual / d lambda of each, shape (rows, harmonics + 1).
        G: what unit forces move: coordinates, then motions and lambda, each of shape (harmonics +
            1, rows, acting rows).
        shifted: what a unit change of lambda moves, shape (harmonics + 1, rows + 1).
    """

    def __init__(self, system: _Linearised):
        at = system.at
        step = DIFFERENCE * abs(at.s)
        moved = [system.problem.bodies.at(s + step) for s in at.lam]
        self.slope = (residual(moved, at, system.F) - system.residual) / step
        self.J = np.array([system.tangent.mean(s) for s in at.lam])
        self.phase = system.phase
        border = self.slope[:, 1], system.phase
        self.harmonics = [
            _Harmonic(r, J, border if n == 1 else None)
            for n, (r, J) in enumerate(zip(system.responses, self.J, strict=True))
        ]
        G, shifted = [], []
        for n, (r, harmonic) in enumerate(zip(system.responses, self.harmonics, strict=True)):
            loads = np.hstack([np.vstack([r.lead, r.D]), self.slope[:, [n]] * (n != 1)])
            loads = np.vstack([loads, np.zeros(loads.shape[1])])
            columns = harmonic.solve(loads)
            G.append(columns[:, :-1])
            shifted.append(columns[:, -1])
        m = len(at.a)
        self.G = np.array([g[:m] for g in G]), np.array([g[m:] for g in G])
        self.shifted = np.array(shifted)

    def solve(self, x: Complex, s: complex) -> Complex:
        """Solutions with right-hand sides x, shape (rows, harmonics + 1), and s of the border."""
        last = np.zeros((1, x.shape[1]), complex)
        last[0, 1] = s
        columns = np.vstack([x, last])
        return np.hstack([
            harmonic.solve(columns[:, [n]]) for n, harmonic in enumerate(self.harmonics)
        ])  # fmt: skip


def residual(responses: list[Response], at: Vibration, F: Complex) -> Complex:
    """What is not in balance, shape (coordinates + followed rows, harmonics + 1)."""
    columns = zip(responses, at.a.T, at.y.T, F.T, strict=True)
    return np.array([
        np.r_[r.own @ a - r.lead @ f, y - r.source @ a - r.D @ f] for r, a, y, f in columns
    ]).T  # fmt: skip


class _Linearised:
    """Newton's linear system about a vibration, on the motions of the contact and lambda alone.

    Attributes:
        problem: the equations.
        at: the vibration.
        phase: row of the first harmonic's motions that fixes phase and amplitude.
        F: harmonics of the forces.
        tangent: of the forces.
        responses: the bodies at each harmonic.
        residual: what is not in balance.
    """

    def __init__(self, problem: HarmonicBalance, at: Vibration, phase: NDArray):
        self.problem, self.at, self.phase = problem, at, phase
        self.F, self.tangent = problem.contact(at)
        self.responses = [problem.bodies.at(s) for s in at.lam]
        self.residual = residual(self.responses, at, self.F)

    def step(self, factors: _Factors, most: int) -> Change:
        """Newton's step at the amplitude, by so many vectors at most."""
        missing = complex(self.at.amplitude - self.phase @ self.at.y[:, 1])
        return self._solved(factors, self._inverted(factors, -self.residual, missing), 0.0, most)

    def with_amplitude(self, factors: _Factors, most: int) -> Change:
        """The change with the amplitude."""
        return self._solved(factors, self._inverted(factors, 0 * self.residual, 1.0), 1.0, most)

    def _inverted(self, factors: _Factors, x: Complex, missing: complex) -> Complex:
        """Solution of the bordered systems with the factors of this vibration or an earlier one.

        The border of an earlier one has its own row of phase. ``missing`` is scaled so that a
        change along this vibration has the same amplitude by that row as by this one's.
        """
        y = self.at.y[:, 1]
        return factors.solve(x, missing * complex(factors.phase @ y) / complex(self.phase @ y))

    def _solved(self, factors: _Factors, x: Complex, amplitude: float, most: int) -> Change:
        """The change of which the inverses without the rest of the tangent make x."""
        m = len(self.at.a)
        y, s = self._unpacked(self._gmres(factors, self._packed(x[m:-1], x[-1, 1]), most))
        more = self._rest(factors, y, s, 0)
        return Change(x[:m] + more, y, s, amplitude)

    def _rest(self, factors: _Factors, y: Complex, s: complex, part: int) -> Complex:
        """What the inverses make of the rest of the tangent, shape (rows, harmonics + 1).

        Of the coordinates (part 0), or of motions and lambda (1).
        """
        problem, at = self.problem, self.at
        moved = 1j * s.imag * np.arange(y.shape[1])
        moved[1] = s
        dv = problem.over_time(at.lam * y + moved * at.y)
        dF = problem.harmonics_of(self.tangent.times(problem.over_time(y), dv))
        _, g, f, c = factors.J.shape
        held = np.einsum("ngfc,fcn->gcn", factors.J, y.reshape(f, c, -1)).reshape(g * c, -1)
        return (
            np.matmul(factors.G[part], (dF + held).T[..., None])[..., 0]
            - np.split(factors.shifted, [len(at.a)], axis=1)[part] * moved[:, None]
        ).T

    def _times(self, factors: _Factors, v: Array) -> Array:
        y, s = self._unpacked(v)
        rest = self._rest(factors, y, s, 1)
        return self._packed(y - rest[:-1], s - rest[-1, 1])

    def _packed(self, x: Complex, s: complex) -> Array:
        """Real unknowns: the mean, real and imaginary parts of the rest, then of lambda."""
        parts = [x[:, 0].real, x[:, 1:].real.ravel(), x[:, 1:].imag.ravel()]
        return np.concatenate([*parts, [s.real, complex(s).imag]])

    def _unpacked(self, v: Array) -> tuple[Complex, complex]:
        rows, H = self.at.y.shape[0], self.problem.harmonics
        x = np.zeros((rows, H + 1), complex)
        x[:, 0] = v[:rows]
        both = v[rows:-2].reshape(2, rows, H)
        x[:, 1:] = both[0] + 1j * both[1]
        return x, complex(v[-2], v[-1])

    def _gmres(self, factors: _Factors, b: Array, most: int) -> Array:
        """Solution, lambda and motions in units of the vibration."""
        scale = np.full(b.size, la.norm(self.at.y))
        scale[-2:] = abs(self.at.s)
        A = LinearOperator(
            (b.size, b.size), lambda v: self._times(factors, scale * v) / scale, dtype=float
        )
        given = {"restart": most, "maxiter": 1, "atol": 0.0, TOLERANCE: LINEAR}
        x, failed = gmres(A, b / scale, **given)
        if failed:
            raise _NeedsFactorsError
        return np.asarray(scale * x)

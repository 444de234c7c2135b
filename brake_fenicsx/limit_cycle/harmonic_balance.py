"""Periodic vibration of elastic bodies under nonlinear contact forces, by harmonic balance.

The motions y of the contact and the coordinates a of the bodies are sums over harmonics,

    y(t) = Re sum_n y_n exp(i n omega t),      own a_n = lead F_n,      y_n = source a_n + D F_n,

with matrices of the bodies at lambda_n, and forces F(y, y') evaluated at points of time over a
period (Cameron and Griffin, J. Appl. Mech. 56, 1989, doi:10.1115/1.3176036). The first harmonic
belongs to lambda_1 = alpha + i omega, the n-th to i n omega: alpha is the growth rate of a mode
whose shape and frequency follow its amplitude, and a limit cycle where it is zero (complex
nonlinear modes: Laxalde and Thouverez, J. Sound Vib. 322, 2009, doi:10.1016/j.jsv.2009.02.019; Krack,
Comput. Struct. 154, 2015, doi:10.1016/j.compstruc.2015.03.008).

Newton's method solves for a_n, y_n, alpha and omega at a given amplitude; its linear systems are
solved by GMRES, preconditioned by the bodies with the forces' tangent averaged over a period.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from brake_fenicsx.errors import NotConverged

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Newton's iterations at most; vectors of GMRES at most, and its relative residual; relative step of
# differences over lambda.
ITERATIONS, VECTORS, LINEAR, DIFFERENCE = 12, 120, 1e-4, 1e-6


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

    def residual(self, a: Complex, y: Complex, F: Complex) -> Complex:
        """What is not in balance, shape (coordinates + followed rows,)."""
        return np.r_[self.own @ a - self.lead @ F, y - self.source @ a - self.D @ F]


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
        out = 1j * self.s.imag * np.arange(self.y.shape[1])
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

    def __init__(
        self, bodies: Bodies, forces: Forces, weights: Array, harmonics: int, points: int
    ):
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
        response, tangent = self.bodies.at(s), self.forces(still, still)[1]
        return _Preconditioner(response, tangent.mean(s)).seen @ a

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
            The vibration, how it changes with the amplitude, and the number of iterations.

        Raises:
            NotConverged: there is none nearby.
        """
        found, phase = guess, self._weights * guess.y[:, 1].conj() / self.size(guess.y[:, 1])
        for iteration in range(1, ITERATIONS + 1):
            system = _Linearised(self, found, phase)
            fixed, along = system.solve()
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
                return found, along, iteration
        raise NotConverged(
            f"limit cycle: no vibration of amplitude near {1e6 * guess.amplitude:.3g} um; take"
            " more harmonics or points of time"
        )


class _Linearised:
    """Newton's linear system about a vibration, at a fixed amplitude."""

    def __init__(self, problem: HarmonicBalance, at: Vibration, phase: Complex):
        self._problem, self._at, self._phase = problem, at, phase
        lam = at.lam
        y, v = problem.over_time(at.y), problem.over_time(lam * at.y)
        F, self._tangent = problem.forces(y, v)
        self._F = problem.harmonics_of(F)
        self._responses = [problem.bodies.at(s) for s in lam]
        self._residual = self._of_harmonics(self._responses, at.a, at.y, self._F)
        steps = DIFFERENCE * np.abs(at.s)
        moved = [problem.bodies.at(s + steps) for s in lam[1:]]
        # d residual / d lambda_n.
        self._slope = np.zeros_like(self._residual)
        there = self._of_harmonics(moved, at.a[:, 1:], at.y[:, 1:], self._F[:, 1:])
        self._slope[:, 1:] = (there - self._residual[:, 1:]) / steps
        self._factors = [
            _Preconditioner(r, self._tangent.mean(s)) for r, s in zip(self._responses, lam, strict=True)
        ]  # fmt: skip
        self._bordered = self._factors[1].bordered(self._slope[:, 1], phase)

    def solve(self) -> tuple[Change, Change]:
        """Newton's step at the amplitude, and the change with the amplitude."""
        at = self._at
        missing = at.amplitude - self._phase @ at.y[:, 1]
        step = self._gmres(self._packed(-self._residual, missing))
        along = self._gmres(self._packed(0 * self._residual, 1.0))
        return self._change(step, 0.0), self._change(along, 1.0)

    def _of_harmonics(
        self, responses: list[Response], a: Complex, y: Complex, F: Complex
    ) -> Complex:
        columns = zip(responses, a.T, y.T, F.T, strict=True)
        return np.array([r.residual(*column) for r, *column in columns]).T

    def _packed(self, x: Complex, s: complex) -> Array:
        """Real unknowns: the mean, real and imaginary parts of the rest, then of lambda."""
        parts = [x[:, 0].real, x[:, 1:].real.ravel(), x[:, 1:].imag.ravel()]
        return np.concatenate([*parts, [s.real, complex(s).imag]])

    def _unpacked(self, v: Array) -> tuple[Complex, complex]:
        rows, H = self._residual.shape[0], self._problem.harmonics
        x = np.zeros((rows, H + 1), complex)
        x[:, 0] = v[:rows]
        both = v[rows:-2].reshape(2, rows, H)
        x[:, 1:] = both[0] + 1j * both[1]
        return x, complex(v[-2], v[-1])

    def _change(self, v: Array, amplitude: float) -> Change:
        (x, s), m = self._unpacked(v), len(self._at.a)
        return Change(x[:m], x[m:], s, amplitude)

    def _times(self, v: Array) -> Array:
        """Product with the Jacobian."""
        problem, (x, s), m = self._problem, self._unpacked(v), len(self._at.a)
        a, y = x[:m], x[m:]
        moved = 1j * s.imag * np.arange(y.shape[1])
        moved[1] = s
        dv = problem.over_time(self._at.lam * y + moved * self._at.y)
        dF = problem.harmonics_of(self._tangent.times(problem.over_time(y), dv))
        out = self._of_harmonics(self._responses, a, y, dF) + self._slope * moved
        return self._packed(out, self._phase @ y[:, 1])

    def _nearly(self, v: Array) -> Array:
        """Nearly the inverse: harmonic by harmonic, with the mean tangent."""
        x, s = self._unpacked(v)
        out = np.empty_like(x)
        out[:, 1], s = self._bordered(x[:, 1], s)
        moved = 1j * s.imag * np.arange(x.shape[1])
        for n, factor in enumerate(self._factors):
            if n != 1:
                out[:, n] = factor(x[:, n] - self._slope[:, n] * moved[n])
        return self._packed(out, s)

    def _gmres(self, b: Array) -> Array:
        """Solution by GMRES (Saad and Schultz 1986), preconditioned from the right."""
        size = la.norm(b)
        if not size:
            return b
        Q, Z, H = [b / size], [], np.zeros((VECTORS + 1, VECTORS))
        for j in range(VECTORS):
            Z.append(self._nearly(Q[-1]))
            w = self._times(Z[-1])
            for _ in range(2):
                basis = np.array(Q)
                share = basis @ w
                w, H[: j + 1, j] = w - share @ basis, H[: j + 1, j] + share
            H[j + 1, j] = la.norm(w)
            rhs = np.eye(j + 2, 1)[:, 0] * size
            c, *_ = la.lstsq(H[: j + 2, : j + 1], rhs)
            left = la.norm(H[: j + 2, : j + 1] @ c - rhs)
            if left <= LINEAR * size or H[j + 1, j] <= 1e-14 * size:
                return np.asarray(c @ np.array(Z))
            Q.append(w / H[j + 1, j])
        raise NotConverged("limit cycle: the linear systems of a vibration do not converge")


class _Preconditioner:
    """Inverse for one harmonic, with a constant stiffness J at the contact."""

    def __init__(self, r: Response, J: Complex):
        self._r, self._J = r, J
        E = np.eye(len(r.D)) + self._through(r.D)
        self._E = la.lu_factor(E, check_finite=False)
        self._lead = self._through(r.lead)
        self.seen = la.lu_solve(self._E, r.source, check_finite=False)
        self._T = r.own + self._lead @ self.seen
        self._lu = la.lu_factor(self._T, check_finite=False)

    def _through(self, A: Complex) -> Complex:
        """A J of rows A, shape (rows, followed rows)."""
        g, f, c = self._J.shape
        return np.einsum("rgc,gfc->rfc", A.reshape(len(A), g, c), self._J).reshape(len(A), f * c)

    def _reduced(self, x: Complex) -> tuple[Complex, Complex]:
        """Right-hand side of the coordinates alone, and what the contact moves by itself."""
        m = len(self._r.own)
        y = la.lu_solve(self._E, x[m:], check_finite=False)
        return x[:m] - self._lead @ y, y

    def __call__(self, x: Complex) -> Complex:
        """Solution of one harmonic."""
        b, y = self._reduced(x)
        a = la.lu_solve(self._lu, b, check_finite=False)
        return np.r_[a, y + self.seen @ a]

    def bordered(
        self, slope: Complex, phase: Complex
    ) -> Callable[[Complex, complex], tuple[Complex, complex]]:
        """The same with lambda as an unknown, and phase and amplitude of the motions given."""
        column, shift = self._reduced(slope)
        last = np.array([[-phase @ shift]])
        A = np.block([[self._T, column[:, None]], [(phase @ self.seen)[None], last]])
        lu = la.lu_factor(A, check_finite=False)

        def solve(x: Complex, s: complex) -> tuple[Complex, complex]:
            b, y = self._reduced(x)
            *a, ds = la.lu_solve(lu, np.r_[b, s - phase @ y], check_finite=False)
            return np.r_[a, y + self.seen @ np.array(a) - shift * ds], complex(ds)

        return solve

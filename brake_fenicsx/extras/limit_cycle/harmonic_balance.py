"""Periodic vibration of elastic bodies under nonlinear contact forces, by harmonic balance.

The motions y of the contact and the coordinates a of the bodies are sums over harmonics,

    y(t) = Re sum_n y_n exp(i n omega t),      own a_n = lead F_n,      y_n = source a_n + D F_n,

with matrices of the bodies at lambda_n, and forces F(y, y') evaluated at points of time over a
period (Cameron and Griffin, J. Appl. Mech. 56, 1989, doi:10.1115/1.3176036). The first harmonic
belongs to lambda_1 = alpha + i omega, the n-th to i n omega: alpha is the growth rate of a mode
whose shape and frequency follow its amplitude, and a limit cycle where it is zero (complex
nonlinear modes: Laxalde and Thouverez, J. Sound Vib. 322, 2009, doi:10.1016/j.jsv.2009.02.019;
Krack, Comput. Struct. 154, 2015, doi:10.1016/j.compstruc.2015.03.008).

Newton's method solves for a_n, y_n, alpha and omega under a condition on growth and amplitude; see
``bodies`` for its linear systems.

The forces of patches over a period are exact in opening, yielding and reversal. A patch carries w
(p(g) - p_e) along the gap, p_e its pressure at equilibrium. Where a hardness limits the pressure,
unloading and reloading are elastic: from the smallest gap g_m that the patch has had, at
equilibrium or in the vibration, it goes back along

    p = p_m (1 - s)^n,    s = (g - g_m) v_m / (n p_m),    open for s >= 1,

p_m the pressure of loading to g_m and v_m the stiffness of small vibrations there; n = EXPONENT.
Friction mu(|v|) w p acts against the slip velocity v = (V - v_T, -v_R) of the disc past the pad,
with the rates that the scene's damping terms name. Without them its direction does not change, and
``bodies`` takes it as a part of the normal force.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la

from brake_fenicsx.arguments import Array, Complex, Index, Mask
from brake_fenicsx.errors import NotConverged
from brake_fenicsx.macro import contact_forces

from .bodies import Bodies, Factors, Step, changes, newton_step, through

# Newton's iterations at most, and what each must gain with the factors of an earlier vibration;
# slow ones that are borne; vectors of GMRES at most, with new factors and with those of an earlier
# vibration; relative step of differences over lambda, which single precision resolves; least
# frequency over that of the guess.
ITERATIONS, GAIN, MISSES, VECTORS, FEW, DIFFERENCE, SLOW = 20, 0.3, 1, 200, 100, 1e-3, 0.1

# Forces [N] and stiffnesses [N/m] beyond this are those of a state that no vibration has.
HUGE = 1e30

# Of the elastic branch under a hardness.
EXPONENT = 2.0

# Slip velocity below which the direction of friction is smoothed, over the sliding speed.
SMOOTH = 1e-3


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
    time: Index | None = None

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

    @property
    def stiffness(self) -> Array:
        """Averaged over a period, shape (acting blocks, followed blocks, elements)."""
        return np.asarray(-self.y.mean(axis=-1))


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
        return changes(self.s, self.y.shape[1])


@dataclass(frozen=True, slots=True)
class Condition:
    """Re(<``to_a``, a> + <``to_y``, y>) + ``to_alpha`` alpha has the value that the guess has.

    It is of order one.

    Attributes:
        to_a: shape (coordinates, harmonics + 1).
        to_y: shape (followed rows, harmonics + 1).
        to_alpha: [s].
    """

    to_a: Complex
    to_y: Complex
    to_alpha: float

    def __call__(self, a: Complex, y: Complex, s: complex) -> float:
        """Its value."""
        moved = np.vdot(self.to_a, a) + np.vdot(self.to_y, y)
        return float(moved.real + self.to_alpha * s.real)


class HarmonicBalance:
    """The equations of one problem."""

    def __init__(
        self, bodies: Bodies, forces: Forces, weights: Array, harmonics: int, points: int,
        loss: float = 0.0,
    ):  # fmt: skip
        """Take the problem.

        Args:
            bodies: the bodies.
            forces: of the contact.
            weights: of the followed rows in the mean square of the amplitude; their sum is 1.
            harmonics: number of harmonics beside the mean.
            points: points of time over a period, more than twice the harmonics.
            loss: loss factor of the bodies from the second harmonic on.
        """
        if points <= 2 * harmonics:
            raise ValueError(f"{points} points of time for {harmonics} harmonics; take more")
        self.bodies: Bodies = bodies
        self.forces: Forces = forces
        self.harmonics: int = harmonics
        self.points: int = points
        self.weights: Array = weights
        turn = np.exp(2j * np.pi * np.outer(np.arange(harmonics + 1), np.arange(points)) / points)
        # Rows: real and imaginary part of each harmonic.
        self._turn = np.stack([turn.real, -turn.imag], axis=1).reshape(-1, points)
        self._back = (2 / points) * self._turn.T
        self._back[:, 0] *= 0.5
        self._loss = np.where(np.arange(harmonics + 1) > 1, 0.5 * loss, 0.0)
        # Of a vibration nearby, found before.
        self._factors: Factors | None = None
        self._single: Bodies | None = None

    def contact(self, at: Vibration) -> tuple[Complex, Tangent]:
        """Harmonics of the forces of a vibration, and their tangent over time."""
        F, tangent = self.forces(self.over_time(at.y), self.over_time(at.lam * at.y))
        return self.harmonics_of(F), tangent

    def over_time(self, x: Complex) -> Array:
        """Values at the points of time of harmonics, shape (rows, harmonics + 1)."""
        return np.asarray(np.ascontiguousarray(x).view(float) @ self._turn)

    def harmonics_of(self, x: Array) -> Complex:
        """Harmonics of values at the points of time."""
        return np.asarray((x @ self._back).view(complex))

    def lam(self, at: Vibration) -> Complex:
        """Lambda at which the bodies meet each harmonic [1/s]."""
        return at.lam * (1 - 1j * self._loss)

    def size(self, y: Complex) -> float:
        """Root mean square of |y| [m] of one harmonic, shape (followed rows,)."""
        return float(np.sqrt(self.weights @ np.abs(y) ** 2))

    def at_rest(self, s: complex, a: Complex) -> Complex:
        """Motions of the contact under the coordinates of a small vibration at lambda = s."""
        still = np.zeros((self.weights.size, self.points))
        _, _, source, D = self.bodies.at(s)
        E = np.eye(len(D)) + through(D, self.forces(still, still)[1].stiffness)
        return np.asarray(la.solve(E, source @ a))

    def start(self, s: complex, a: Complex, y: Complex, amplitude: float) -> Vibration:
        """A vibration along a linear mode; factors of earlier vibrations are dropped.

        Args:
            s: its eigenvalue [1/s].
            a: its coordinates, shape (coordinates,).
            y: its motions at the contact, shape (followed rows,).
            amplitude: of the vibration [m].
        """
        self._factors = self._single = None
        factor = amplitude / self.size(y)
        first = np.eye(1, self.harmonics + 1, 1) + 0j
        return Vibration(factor * a[:, None] * first, factor * y[:, None] * first, s, amplitude)

    def solve(
        self,
        guess: Vibration,
        condition: Condition | None = None,
        tolerance: float = 1e-8,
        near: bool = False,
    ) -> tuple[Vibration, int]:
        """The vibration nearby that fulfils a condition.

        Args:
            guess: where Newton's method starts; it also fixes the phase.
            condition: what it has in common with the guess; its amplitude if None.
            tolerance: largest change of motions and lambda, relative to them, in the step that
                would come next if steps go on to shrink as the last did.
            near: whether the guess is so near that a slow start means that it was not.

        Returns:
            The vibration, and the number of iterations.

        Raises:
            NotConverged: there is none nearby.
        """
        y = guess.y[:, 1]
        phase = np.asarray(self.weights * y.conj() / self.size(y), complex)
        if condition is None:
            to_y = np.zeros_like(guess.y)
            to_y[:, 1] = phase.conj() / guess.amplitude
            condition = Condition(np.zeros_like(guess.a), to_y, 0.0)
        kept = condition(guess.a, guess.y, guess.s)
        found, last, misses = guess, 1.0, 0
        for iteration in range(1, ITERATIONS + 1):
            step, fresh = self._step(found, condition, kept, phase)
            if step is None:
                break
            a, y, s = step
            size = max(la.norm(y) / la.norm(found.y), abs(s) / abs(found.s))
            misses += size > 0.5 * last and (fresh or iteration == 1)
            if not np.isfinite(size) or size > 10 or (near and misses > min(iteration - 1, MISSES)):
                break
            share = min(1.0, 0.5 / size)
            y = found.y + share * y
            found = Vibration(
                found.a + share * a, y, found.s + share * s, float((phase @ y[:, 1]).real)
            )
            # A state at rest solves the equations too.
            if found.s.imag < SLOW * guess.s.imag or found.amplitude <= 0:
                break
            if size * min(size / last, 1.0) <= tolerance:
                return replace(found, amplitude=self.size(found.y[:, 1])), iteration
            if size > GAIN * last:
                self._factors = None
            last = size
        self._factors = None
        raise NotConverged(f"""limit cycle: no vibration of amplitude near
            {1e6 * guess.amplitude:.3g} um; take more harmonics or points of time""")

    def _step(
        self, at: Vibration, condition: Condition, kept: float, phase: Complex
    ) -> tuple[Step | None, bool]:
        """Newton's step, None if not found, and whether its factors are new."""
        F, tangent = self.contact(at)
        if not max(np.abs(F).max(initial=0.0), np.abs(tangent.stiffness).max(initial=0.0)) < HUGE:
            # Gaps so far closed that the pressures of an exponential law overflow.
            return None, True
        lam, step = self.lam(at), DIFFERENCE * abs(at.s)
        single = self._single or self.bodies.single(lam)
        ahead, here = (single.unbalanced(x, at.a, at.y, F) for x in (lam + step, lam))
        slope, self._single = (ahead - here) / step, single

        def balances(a: Complex, y: Complex, s: complex) -> Complex:
            moved = changes(s, y.shape[1])
            v = at.lam * y + moved * at.y
            change = tangent.times(self.over_time(y), self.over_time(v))
            return single.unbalanced(lam, a, y, self.harmonics_of(change)) + moved * slope

        def equation(a: Complex, y: Complex, s: complex) -> complex:
            return complex(condition(a, y, s), (phase @ y[:, 1]).imag / at.amplitude)

        missing = self.bodies.unbalanced(lam, at.a, at.y, F)
        sizes = float(la.norm(at.a)), float(la.norm(at.y)), abs(at.s)
        wanted = kept - condition(at.a, at.y, at.s)
        given = balances, equation, -missing, wanted, sizes, at.amplitude
        if self._factors and (made := newton_step(self._factors, *given, FEW)):
            return made, False
        J, amplitude = tangent.stiffness, at.amplitude
        self._factors = Factors(single, lam, J, slope, phase, amplitude)
        return newton_step(self._factors, *given, VECTORS), True


@dataclass(frozen=True, slots=True)
class PeriodForces:
    """Forces of some contact elements over a period; see ``harmonic_balance.Forces``.

    Attributes:
        laws: law and critical gap of each element.
        yields: whether a hardness limits its pressure, shape (elements,).
        w: areas [m^2].
        g: gaps at equilibrium [m].
        friction: of each element.
        followed: motions that forces follow: "N", then "T" and "R" where they follow rates.
        coefficient: friction by the slip speed; None where it does not change.
    """

    laws: contact_forces.EnrichedGap
    yields: Mask
    w: Array
    g: Array
    friction: contact_forces.SlidingFriction
    followed: str = "N"
    coefficient: contact_forces.Coefficient | None = None

    def __call__(self, y: Array, v: Array) -> tuple[Array, Tangent]:
        """Forces beyond those of the equilibrium [N], and their tangent."""
        blocks, c, mu = len(self.followed), self.w.size, self.friction.mu
        y, v = y.reshape(blocks, c, -1), v.reshape(blocks, c, -1)
        p, k, past = self.pressure(self.g[:, None] + y[0])
        p_e = self.pressure(self.g[:, None])[0]
        traction, slopes = contact_forces.sliding(mu[:, None], p), None
        rates = ["TR".index(name) for name in self.followed[1:]]
        if rates:
            slip = np.zeros((2, *p.shape))
            slip[rates] = v[1:]
            traction, slopes = self.friction.traction(slip, self.coefficient, SMOOTH)
        acting = 1 + max((1, *(1 + rate for rate in rates))) if rates else 1
        moving = contact_forces.patch_forces(self.w, p, k, traction, slopes)
        still = contact_forces.patch_forces(
            self.w, p_e, 0 * p_e, contact_forces.sliding(mu[:, None], p_e)
        )
        to_y, to_v = np.zeros((2, acting, blocks, *p.shape))
        to_y[:, 0], to_v[:, 1:] = moving.gap[:acting], moving.rate[:acting, rates]
        to_past = contact_forces.patch_forces(self.w, past, 0 * past, traction).value[:acting]
        more = to_v if rates else None, to_past if past.any() else None
        tangent = Tangent(to_y, *more, np.argmin(y[0], axis=1))
        forces = (moving.value - still.value)[:acting]
        return forces.reshape(-1, y.shape[2]), tangent

    def pressure(self, g: Array) -> tuple[Array, Array, Array]:
        """Pressure p, -dp/dg and, where yielding goes on, dp/dg_m, shape (elements, times).

        Args:
            g: gaps over a period [m], shape (elements, times).
        """
        p, k, past = np.zeros((3, *g.shape))
        soft = self.yields
        if (~soft).any():
            p[~soft], k[~soft] = _of(self.laws, ~soft, g.shape[1]).loading(g[~soft])
        if soft.any():
            lowest = g[soft].min(axis=1, keepdims=True)
            g_m, laws = np.minimum(lowest, self.g[soft, None]), _of(self.laws, soft, 1)
            branch = _elastic(g[soft] - g_m, *laws.loading(g_m), *laws.vibration(g_m))
            p[soft], k[soft], moved = branch
            past[soft] = moved * (lowest < self.g[soft, None])
        return p, k, past


def _of(laws: contact_forces.EnrichedGap, chosen: Mask, times: int) -> contact_forces.EnrichedGap:
    """Laws of some elements at so many times, of gaps of the shape (elements, times)."""
    index = np.repeat(laws.index[chosen, None], times, axis=1)
    return contact_forces.EnrichedGap(laws.laws, index, laws.g_cr[chosen, None])


def _elastic(
    away: Array, p_m: Array, k_m: Array, v_m: Array, slope: Array
) -> tuple[Array, Array, Array]:
    """Pressure, stiffness and derivative to g_m of the branch from (g_m, p_m).

    Args:
        away: g - g_m [m], not negative.
        p_m: pressure at g_m [Pa].
        k_m: stiffness of loading there [Pa/m].
        v_m: stiffness of small vibrations there.
        slope: dv_m/dg_m [Pa/m^2].
    """
    n, carries = EXPONENT, p_m > 0
    p_safe = np.where(carries, p_m, 1.0)
    s = away * v_m / (n * p_safe)
    left = np.maximum(1 - s, 0.0) * carries
    ds = -v_m / (n * p_safe) + away * (slope + v_m * k_m / p_safe) / (n * p_safe)
    past = -k_m * left**n - n * p_m * left ** (n - 1) * ds
    return p_m * left**n, v_m * left ** (n - 1), past

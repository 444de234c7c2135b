"""Growth of a mode over its amplitude, the limit cycles where it is zero, and their stability.

The branch alpha(a) is followed from the linear mode by pseudo-arclength (Keller 1977) in the
shape of all harmonics and in alpha, so that it may turn back, or turn while nothing but a higher
harmonic changes. Where alpha falls through zero on the way, a cycle is stable along its branch;
where it rises, vibrations beyond it grow: a mode that is linearly stable then grows from a kick.
Without damping alpha ends at zero, where the mode parts into two that do not grow.

The Floquet exponents of a cycle tell whether vibrations near it come to it. A small change obeys
linear equations whose contact stiffness varies with the period. They are stepped over one period,
exactly but for what the stiffness differs from its mean, which acts in kicks at the points of time
(Strang 1968); ln(rho) / period of the eigenvalues rho of the product are the exponents mu. There
the compliance D of what the kept modes leave out is real and that of the first harmonic. Its change
with lambda, D(mu + i n omega) of harmonic n, shifts mu to first order,

    d rho = sum over times of (left vector) (change of the kick),

with vectors that are stepped forwards and backwards. The exponent of a shift in time is zero: what
is found for it is the error of the others. The memory of a hardness is left out: changes are
elastic.
"""

from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg as la
from scipy.integrate import trapezoid

from brake_fenicsx.arguments import Array, Complex
from brake_fenicsx.errors import NotConverged

from .bodies import across, times
from .harmonic_balance import Condition, HarmonicBalance, Vibration

# First, largest and smallest step along the branch, relative to the vibration; a vibration found
# so near to what was expected, or nearer than a step, is of the same branch.
FIRST, LARGEST, SMALLEST, NEARBY, POINTS = 0.4, 0.8, 5e-3, 0.05, 60

# Share of the linear growth at which growth without damping counts as ended: alpha^2 falls
# linearly in the amplitude there, and the amplitude is off by the square of this share.
ENDED = 0.02

# Behind a stable cycle the branch is followed until decay is this share of the linear growth, or
# until the amplitude has changed by these factors.
DECAYS, BELOW, BEYOND = 0.25, 0.7, 2.0

# Tolerances of the cycles and of the points between them; iterations of a point that leave the step
# as it is.
EXACTLY, ROUGHLY, GOAL = 1e-7, 1e-3, 4

STABLE, UNSTABLE, UNDAMPED = "stable", "unstable", "undamped"

# Exponents that are shifted, those of largest growth; steps of inverse iteration, and the relative
# distance of its shift.
MOST, STEPS, APART = 4, 3, 1e-9

# Share of omega within which two frequencies are one.
SAME = 1e-4

GIVES_WAY, UNDECIDED = "gives way", "undecided"


@dataclass(frozen=True, slots=True)
class Cycle:
    """A limit cycle.

    Attributes:
        kind: "stable", "unstable", or "undamped": where growth without damping ends, and nothing
            settles.
        at: the vibration.
    """

    kind: str
    at: Vibration


@dataclass(slots=True)
class GrowthBranch:
    """Growth over amplitude.

    Attributes:
        size: growth by which the way along the branch is measured [1/s].
        weights: of the followed rows in it, as of the amplitude, shape (followed rows,).
        points: vibrations along the branch.
        way: of each of them from the first one, see ``between``.
        cycles: in the order of the branch.
        end: why it ends.
    """

    size: float
    weights: Array
    points: list[Vibration] = field(default_factory=list)
    way: list[float] = field(default_factory=list)
    cycles: list[Cycle] = field(default_factory=list)
    end: str = ""

    @property
    def amplitude(self) -> Array:
        """Of the points [m]."""
        return np.array([v.amplitude for v in self.points])

    @property
    def s(self) -> Complex:
        """Alpha + i omega of the points [1/s]."""
        return np.array([v.s for v in self.points])

    def add(self, v: Vibration) -> None:
        """One more point."""
        self.way.append(
            self.way[-1] + la.norm(self.between(self.points[-1], v)) if self.way else 0.0
        )
        self.points.append(v)

    def between(self, p: Vibration, q: Vibration) -> Complex:
        """From p to q: coordinates and motions of all harmonics over those of p, alpha / size."""
        a, y = (q.a - p.a) / la.norm(p.a), (q.y - p.y) / p.amplitude
        moved = np.append(a, np.sqrt(self.weights)[:, None] * y)
        return np.append(moved, (q.s - p.s).real / self.size)

    def along(self, p: Vibration, direction: Complex) -> Condition:
        """What does not change across a direction from p, a vector as of ``between``."""
        a, y = direction[: p.a.size].reshape(p.a.shape), direction[p.a.size : -1]
        y = np.sqrt(self.weights)[:, None] * y.reshape(p.y.shape)
        alpha = float(direction[-1].real) / self.size
        return Condition(a / la.norm(p.a), y / p.amplitude, alpha)

    def at(self, way: float) -> Vibration:
        """A vibration after a way, by polynomials through the last three points.

        Those of shape, eigenvalue and logarithm of the amplitude; through one point the amplitude
        alone goes on.
        """
        points, x = self.points[-3:], np.array(self.way[-3:])
        others = [np.delete(x, i) for i in range(x.size)]
        w = np.array([np.prod((way - o) / (own - o)) for own, o in zip(x, others, strict=True)])
        a = self.amplitude[-3:]
        amplitude = float(np.exp(w @ np.log(a) + (way - x[0]) * (x.size == 1)))
        shape = w * amplitude / a
        coordinates = np.asarray(np.tensordot(shape, [v.a for v in points], 1), complex)
        motions = np.asarray(np.tensordot(shape, [v.y for v in points], 1), complex)
        return Vibration(coordinates, motions, complex(w @ self.s[-3:]), amplitude)


def follow(
    problem: HarmonicBalance, start: Vibration, largest: float, damped: bool = True
) -> GrowthBranch:
    """Follow a mode from a small amplitude on.

    Args:
        problem: its equations.
        start: a vibration along the linear mode.
        largest: amplitude at which to end [m].
        damped: whether anything is damped.

    Raises:
        NotConverged: not even the first vibration is found.
    """
    branch = GrowthBranch(max(abs(start.s.real), 1e-3 * start.s.imag), problem.weights)
    branch.add(problem.solve(start, tolerance=ROUGHLY)[0])
    first = branch.points[0]
    direction = branch.between(first, replace(first, a=2 * first.a, y=2 * first.y))
    direction /= la.norm(direction)
    step, low, high = FIRST, 0.0, largest
    while not branch.end:
        p = branch.points[-1]
        if (low and p.s.real < -DECAYS * abs(start.s.real)) or not low < p.amplitude < high:
            branch.end = "stable" if low else "largest amplitude"
        elif len(branch.points) == POINTS:
            branch.end = "too many points"
        elif not damped and p.s.real <= ENDED * start.s.real:
            branch.cycles.append(Cycle(UNDAMPED, p))
            branch.end = "no growth"
        elif step < SMALLEST:
            branch.end = "lost"
        if branch.end:
            break
        try:
            guess = branch.at(branch.way[-1] + step)
            q, iterations = problem.solve(guess, branch.along(p, direction), ROUGHLY, True)
            if la.norm(branch.between(guess, q)) > max(step, NEARBY):
                raise NotConverged("limit cycle: a vibration of another branch")
            cycle = _crossing(problem, branch, q) if damped and p.s.real * q.s.real <= 0 else None
        except NotConverged:
            step *= 0.4
            continue
        if cycle is not None:
            branch.cycles.append(cycle)
            if cycle.kind == STABLE:
                low, high = BELOW * cycle.at.amplitude, min(largest, BEYOND * cycle.at.amplitude)
        direction = branch.between(p, q)
        direction /= la.norm(direction)
        branch.add(q)
        step = min(LARGEST, step * 2 ** (1 - iterations / GOAL))
    return branch


def time_to_reach(branch: GrowthBranch, cycle: Cycle, share: float = 0.01) -> float:
    """Time from a share of a cycle's amplitude to 95 % of it [s]; nan where growth is not positive.

    Args:
        branch: growth over amplitude.
        cycle: the first one that growth ends at.
        share: of its amplitude at the start; below the first point growth is that of the point.
    """
    a, alpha = branch.amplitude, branch.s.real
    # Behind the cycle the amplitude may fall again.
    inside = (a < cycle.at.amplitude) & (np.cumsum(alpha <= 0) == 0)
    a, alpha = np.r_[a[inside], cycle.at.amplitude], np.r_[alpha[inside], cycle.at.s.real]
    x = np.linspace(np.log(share), np.log(0.95), 200) + np.log(cycle.at.amplitude)
    growth = np.interp(x, np.log(a), alpha)
    if cycle is not branch.cycles[0] or np.any(np.diff(a) <= 0) or np.any(growth <= 0):
        return float("nan")
    return float(trapezoid(1 / growth, x))


def _crossing(problem: HarmonicBalance, branch: GrowthBranch, q: Vibration) -> Cycle:
    """The cycle between the last point of a branch and q, of which one grows and one decays."""
    p, both = branch.points[-1], GrowthBranch(branch.size, branch.weights)
    for v in (*branch.points[-2:], q):
        both.add(v)
    share = p.s.real / (p.s.real - q.s.real)
    guess = both.at(share * both.way[-1] + (1 - share) * both.way[-2])
    still = replace(guess, s=1j * guess.s.imag)
    growth = Condition(np.zeros_like(still.a), np.zeros_like(still.y), 1 / branch.size)
    found, _ = problem.solve(still, growth, EXACTLY)
    return Cycle(STABLE if p.s.real > 0 else UNSTABLE, found)


def verdict(growth: float, error: float, ratio: float) -> str:
    """Outcome of a cycle that is stable along its branch.

    Args:
        growth: largest real part of the exponents, but for that of a shift in time [1/s].
        error: of the exponents [1/s].
        ratio: imaginary part of that exponent over omega, 0 to 0.5.
    """
    if abs(growth) <= error:
        return UNDECIDED
    names = {0.0: "another cycle", 0.5: "its period doubles"}
    near = (name for at, name in names.items() if abs(ratio - at) < SAME)
    return f"{GIVES_WAY}: {next(near, 'a second frequency')}" if growth > error else STABLE


def exponents(problem: HarmonicBalance, at: Vibration) -> Complex:
    """Floquet exponents of a cycle [1/s], imaginary parts from 0 to omega / 2.

    Args:
        problem: its equations; more points of time make the exponents better.
        at: the cycle.

    Returns:
        That of a shift in time, then others of largest growth, shape (MOST + 1 or fewer,).
    """
    bodies, omega, points = problem.bodies, at.s.imag, problem.points
    period = 2 * np.pi / omega
    h, tangent = period / points, problem.contact(at)[1]
    still, (moving, *others) = bodies.at(0j)[0].real, bodies.at(1j * omega)
    lead, source, D = (A.real.copy() for A in others)
    M, m = (still - moving.real) / omega**2, len(still)
    push, own = la.solve(M, lead), la.solve(M, np.hstack([still, moving.imag / omega]))
    Y = np.moveaxis(tangent.y, -1, 0)
    R = np.array([np.linalg.inv(np.eye(D.shape[1]) - across(J, D)) for J in Y])
    F = np.array([r @ across(J, source) for r, J in zip(R, Y, strict=True)])
    if tangent.v is not None:
        V = np.moveaxis(tangent.v, -1, 0)
        F = np.dstack([F, [r @ across(J, source) for r, J in zip(R, V, strict=True)]])
    kicks = push @ F
    own[:, : kicks.shape[2]] -= kicks.mean(axis=0)
    kicks = h * (kicks - kicks.mean(axis=0))
    n = kicks.shape[2]
    flow = la.expm(h * np.block([[np.zeros((m, m)), np.eye(m)], [-own]]))
    P = np.eye(2 * m)
    for kick in kicks:
        P[m:] += kick @ P[:n]
        P = flow @ P
    rho = la.eigvals(P)
    mu = np.log(rho + 0j) / period
    order = [i for i in np.argsort(-mu.real) if mu[i].imag >= 0]
    shift = min(order, key=lambda i: abs(mu[i]))
    t, found = h * np.arange(points), []
    for i in [shift, *(i for i in order if i != shift)][: MOST + 1]:
        factors = la.lu_factor(P - (1 + APART) * rho[i] * np.eye(2 * m))
        x, left = np.ones((2, 2 * m), complex)
        for _ in range(STEPS):
            x, left = la.lu_solve(factors, x), la.lu_solve(factors, left, trans=2)
            x, left = x / la.norm(x), left / la.norm(left)
        size, forces, left = left.conj() @ x, [], left.conj()
        for f, kick in zip(F, kicks, strict=True):
            forces.append(f @ x[:n])
            x = flow @ np.r_[x[:m], x[m:] + kick @ x[:n]]
        turn = np.exp(mu[i] * t)
        harmonics = np.fft.fft(np.array(forces).T / turn) / points
        lam = mu[i] + 1j * omega * np.fft.fftfreq(points, 1 / points)
        gap = bodies.motions(lam, np.zeros((m, points), complex), harmonics) - times(D, harmonics)
        gap, moved = np.fft.ifft(gap) * points * turn, 0j
        for k in reversed(range(points)):
            left = left @ flow
            moved += h * left[m:] @ (push @ (R[k] @ across(Y[k], gap[:, k : k + 1])[:, 0]))
            left[:n] += left[m:] @ kicks[k]
        found.append(np.log(rho[i] + moved / size) / period)
    return np.real(found) + 1j * np.abs(np.imag(found))

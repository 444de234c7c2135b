"""Harmonic balance against closed forms: laws over a period, oscillators, flutter, friction."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.special import ellipk, iv

from brake_fenicsx.extras.limit_cycle.bodies import Bodies
from brake_fenicsx.extras.limit_cycle.growth import (
    STABLE,
    UNSTABLE,
    Cycle,
    GrowthBranch,
    exponents,
    follow,
    time_to_reach,
    verdict,
)  # fmt: skip
from brake_fenicsx.extras.limit_cycle.harmonic_balance import (
    HarmonicBalance,
    PeriodForces,
    Tangent,
    Vibration,
)
from brake_fenicsx.macro.contact_forces import EnrichedGap, SlidingFriction
from brake_fenicsx.micro import OneLaw, exponential_law, linear_law
from oscillators import first_vibration, matrices, no_growth, oscillator, van_der_pol

U0, P0, AREA = 0.3e-6, 10e6, 8e-6


def patch(law, g=0.0, mu=0.0, speed=1.0, area=AREA, **more):
    laws = EnrichedGap(OneLaw(law), np.zeros(1, dtype=np.intp), np.zeros(1))
    one = np.ones(1)
    friction = SlidingFriction(mu * one, 0 * one, speed * one, one > 0)
    return PeriodForces(laws, one < 0, area * one, g * one, friction, **more)


@pytest.mark.parametrize("ratio", [0.5, 1, 2, 5, 10])
def test_exponential_law_over_a_period(ratio):
    """Mean p(g_m) I0 and k_eq / k0 = 2 (u0 / a) I1 / I0, a law in balance rising by u0 ln I0."""
    problem = HarmonicBalance(None, None, np.ones(1), 3, 256)
    harmonic = np.array([[0, ratio * U0, 0, 0]], complex)
    for shift in (0.0, U0 * np.log(iv(0, ratio))):
        law = patch(exponential_law(P0, U0))
        y = problem.over_time(harmonic + np.array([[shift, 0, 0, 0]]))
        F, tangent = law(y, 0 * y)
        found = problem.harmonics_of(F)[0] / AREA
        p = P0 * np.exp(-shift / U0)
        assert found[0].real + P0 == pytest.approx(p * iv(0, ratio), rel=1e-10)
        k = -found[1].real / (ratio * U0)
        assert k == pytest.approx(2 * p / U0 * iv(1, ratio) / ratio, rel=1e-10)
    # At the same mean pressure, against the stiffness at rest.
    assert k / (P0 / U0) == pytest.approx(2 / ratio * iv(1, ratio) / iv(0, ratio), rel=1e-10)
    change = problem.over_time(1e-6 * np.array([[0.3 * U0, 0.2j * U0, U0, -U0]]))
    moved = law(y + change, 0 * y)[0] - law(y - change, 0 * y)[0]
    wrong = tangent.times(change, 0 * y)[0] - moved[0] / 2
    assert np.abs(wrong).max() < 1e-7 * np.abs(moved).max()


@pytest.mark.parametrize("reach", [1.5, 4.0])
def test_penalty_that_opens(reach):
    """Of a linear spring pressed by d0 and moved by reach d0, first harmonic by hand."""
    d0, k = 1e-6, 1e12
    problem = HarmonicBalance(None, None, np.ones(1), 3, 4096)
    y = problem.over_time(np.array([[0, reach * d0, 0, 0]], complex))
    F = problem.harmonics_of(patch(linear_law(k), -d0)(y, 0 * y)[0])[0] / AREA
    # Closed where cos < 1 / reach, over the angles from b to 2 pi - b.
    b = np.arccos(1 / reach)
    share = (np.pi - b + 0.5 * np.sin(2 * b)) / np.pi
    mean = ((np.pi - b) + reach * np.sin(b)) / np.pi
    share = 1 - (b - np.sin(b) * np.cos(b)) / np.pi
    assert -F[1].real / (reach * d0 * k) == pytest.approx(share, rel=1e-5)
    assert F[0].real + k * d0 == pytest.approx(mean * k * d0, rel=1e-5)


def test_friction_that_reverses():
    """Slip of amplitude U past a plate of speed V: mean (2 / pi) asin(V / U), first harmonic."""
    V, U, mu = 1.0, 1.7, 0.4
    problem = HarmonicBalance(None, None, np.ones(2), 1, 2**15)
    law = patch(exponential_law(P0, U0), mu=mu, followed="NT")
    v = problem.over_time(np.array([[0, 0], [0, U]], complex))
    F = problem.harmonics_of(law(0 * v, v)[0]) / (AREA * P0 * mu)
    assert F[1, 0].real + 1 == pytest.approx(2 / np.pi * np.arcsin(V / U), abs=2e-4)
    assert F[1, 1].real == pytest.approx(-4 / np.pi * np.sqrt(1 - (V / U) ** 2), abs=2e-4)


@pytest.mark.parametrize("amplitude", [0.3, 1.0, 5.0])
def test_duffing(amplitude):
    """x'' + x + x^3 = 0: frequency by the complete elliptic integral, at no growth."""
    problem = oscillator(lambda x, v: -(x**3), lambda x, v: -3 * x**2, lambda x, v: 0 * x)
    guess = first_vibration(problem, 1e-3 + 1j * np.sqrt(1 + 0.75 * amplitude**2), amplitude)
    found, _ = problem.solve(guess, None, 1e-11)
    top = problem.over_time(found.y).max()
    m = 0.5 * top**2 / (1 + top**2)
    assert found.s.imag == pytest.approx(0.5 * np.pi * np.sqrt(1 + top**2) / ellipk(m), rel=1e-9)
    assert abs(found.s.real) < 1e-10


def test_van_der_pol():
    """Amplitude 2; growth (e / 2)(1 - a^2 / 4) and frequency 1 - e^2 / 16 of a small e.

    Floquet exponents are 0 and -e to first order.
    """
    e = 0.02
    problem = van_der_pol(e)
    branch = follow(problem, first_vibration(problem, 0.5 * e + 1j, 0.05), 10.0)
    (cycle,) = branch.cycles
    assert cycle.kind == "stable"
    assert cycle.at.amplitude == pytest.approx(2, rel=1e-4)
    assert cycle.at.s.imag == pytest.approx(1 - e**2 / 16, rel=1e-8)
    a, alpha = np.array(branch.amplitude), np.real(branch.s)
    np.testing.assert_allclose(alpha, 0.5 * e * (1 - a**2 / 4), atol=0.01 * e)
    shift, other = exponents(problem, cycle.at)
    assert abs(shift) < 1e-3 * e and other.real == pytest.approx(-e, rel=1e-2)


def test_van_der_pol_of_relaxations():
    """Far from a cosine: amplitude and period against time steps."""
    e = 2.0
    problem = van_der_pol(e, harmonics=45, points=256)
    guess = first_vibration(problem, 1j * 0.82, 2.0)
    found, _ = problem.solve(guess, no_growth(guess), 1e-10)

    def crosses(t, x):
        return x[1] + (t < 60)

    crosses.direction = -1
    run = solve_ivp(
        lambda t, x: [x[1], e * (1 - x[0] ** 2) * x[1] - x[0]], (0, 100), [2, 0], events=crosses,
        rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    period, top = np.diff(run.t_events[0])[-1], run.y_events[0][-1][0]
    assert 2 * np.pi / found.s.imag == pytest.approx(period, rel=1e-6)
    assert problem.over_time(found.y).max() == pytest.approx(top, rel=1e-4)


def test_subcritical_oscillator():
    """x'' + (c - x'^2 + x'^4 / 4) x' + x = 0 is stable at rest, and grows from a kick: both cycles.

    To first order growth alpha is -(c - 3 a^2 / 4 + 5 a^4 / 32) e / 2, and the Floquet exponent
    2 d alpha / d ln a: positive at the first cycle, which a kick must pass.
    """
    c, e = 0.5, 0.02
    problem = oscillator(
        lambda x, v: -e * (c - v**2 + v**4 / 4) * v, lambda x, v: 0 * x,
        lambda x, v: -e * (c - 3 * v**2 + 5 * v**4 / 4),
    )  # fmt: skip
    branch = follow(problem, first_vibration(problem, -0.5 * e * c + 1j, 0.05), 10.0)
    assert [cycle.kind for cycle in branch.cycles] == ["unstable", "stable"]
    exact = np.sqrt(np.sort(np.roots([5 / 32, -3 / 4, c]).real))
    found = [cycle.at.amplitude for cycle in branch.cycles]
    np.testing.assert_allclose(found, exact, rtol=1e-3)
    for cycle, name in zip(branch.cycles, ("gives way: another cycle", "stable"), strict=True):
        a = cycle.at.amplitude
        shift, other = exponents(problem, cycle.at)
        assert other.real == pytest.approx(e * (0.75 * a**2 - 5 / 16 * a**4), rel=0.01)
        assert verdict(other.real, abs(shift.real), other.imag / cycle.at.s.imag) == name


@pytest.mark.parametrize("c", [0.02, 0.1])
def test_flutter_of_two_degrees_of_freedom(c):
    """Mode coupling by friction on a spring k (1 + y^2): one harmonic in closed form.

    A cosine sees k_a = k (1 + 3 a^2 / 4) for the motion y and friction -mu k_a for x; both modes
    are damped by c. Growth ends where the squares of the frequencies are off by c omega from real.
    """
    k11, k12, k22, k, mu = 2.0, -0.4, 0.3, 1.0, 0.9
    one = np.eye(2)
    K = np.array([[k11, k12], [k12, k22]])
    bodies = matrices(one, c * one, K, np.array([[0.0, 1.0]]), np.array([[0.0, 1.0], [mu, 0.0]]))

    def forces(y, v):
        f, slope = -k * (y + y**3), -k * (1 + 3 * y**2)
        return np.vstack([f, f]), Tangent(np.array([slope, slope])[:, None])

    problem = HarmonicBalance(bodies, forces, np.ones(1), 1, 16)

    def matrix(k_a):
        return np.array([[k11, k12 + mu * k_a], [k12, k22 + k_a]])

    def missing(k_a):
        kappa = np.linalg.eigvals(matrix(k_a))[0]
        return kappa.imag**2 - c**2 * kappa.real

    # trace T, determinant D: D - T^2 / 4 = c^2 T / 2, a quadratic equation for k_a.
    T, D = np.poly1d([1, k11 + k22]), np.poly1d([k11 - mu * k12, k11 * k22 - k12**2])
    exact = max((D - T * T / 4 - c**2 / 2 * T).roots.real)
    assert missing(exact) == pytest.approx(0, abs=1e-12)
    kappa, X = np.linalg.eig(matrix(k))
    s = -c / 2 + np.sqrt(c**2 / 4 - kappa)
    i = np.argmax(np.where(s.imag > 0, s.real, -np.inf))
    s = np.where(s.imag < 0, s.conj(), s)
    i = int(np.argmax(s.real))
    start = problem.start(s[i], X[:, i].conj() if kappa[i].imag > 0 else X[:, i], X[1:2, i], 0.02)
    branch = follow(problem, start, 10.0)
    (cycle,) = branch.cycles
    assert cycle.at.amplitude == pytest.approx(np.sqrt((exact / k - 1) * 4 / 3), rel=1e-6)


def test_equations_solved_in_another_way():
    """A general solver of the same equations, written out: two patches, compliance over lambda."""
    rng = np.random.default_rng(3)
    harmonics, points, m, c = 5, 32, 3, 2
    M, C, K = np.eye(m), np.diag([-0.1, 0.3, 0.3]), np.diag([1.0, 2.3, 9.0])
    out = rng.normal(size=(c, m))
    acting = out + 0.1 * rng.normal(size=(c, m))
    D0, D1 = 0.5 * np.eye(c) + 0.1, -0.02 * np.eye(c)

    def weights(s):
        s = np.asarray(s)
        return s ** np.arange(3)[:, None], np.array([np.ones(s.size), s**2])

    bodies = Bodies(
        np.array([K, C, M]), np.array([acting.T]), np.array([out]), np.array([D0, D1]),
        weights,
    )  # fmt: skip

    def force(y, v):
        f = -0.3 * (np.exp(y) - 1) - 0.2 * v**3
        slopes = np.zeros((2, 1, 1, c, points))
        slopes[0, 0, 0], slopes[1, 0, 0] = -0.3 * np.exp(y), -0.6 * v**2
        return f, Tangent(*slopes)

    problem = HarmonicBalance(bodies, force, np.ones(c) / c, harmonics, points)
    guess = problem.start(0.05 + 1j, np.array([1, 0, 0]), out[:, 0], 0.05)
    at = follow(problem, guess, 20.0).cycles[0].at
    phase = problem.weights * at.y[:, 1].conj()

    def unbalanced(x):
        a, y, omega = unpacked(x)
        n = 1j * omega * np.arange(harmonics + 1)
        full = np.fft.rfft(force(*(
            np.fft.irfft(np.pad(z * points / 2 * (1 + (n == 0)), ((0, 0), (0, 11))), points)
            for z in (y, n * y)
        ))[0]) * 2 / points  # fmt: skip
        F = full[:, : harmonics + 1] / (1 + (n == 0))
        own = np.array([(K + s * C + s**2 * M) @ z for s, z in zip(n, a.T, strict=True)]).T
        beyond = np.array([(D0 + s**2 * D1) @ f for s, f in zip(n, F.T, strict=True)]).T
        both = np.vstack([own - acting.T @ F, y - out @ a - beyond])
        return packed(both, (phase @ y[:, 1]).imag)

    def packed(both, last):
        return np.concatenate([both.real.ravel(), both[:, 1:].imag.ravel(), [last]])

    def unpacked(x):
        rows, n = m + c, harmonics + 1
        both = x[: rows * n].reshape(rows, n) + 0j
        both[:, 1:] += 1j * x[rows * n : -1].reshape(rows, n - 1)
        return both[:m], both[m:], x[-1]

    x = packed(np.vstack([at.a, at.y]), at.s.imag)
    found = root(unbalanced, x * (1 + 0.02 * rng.normal(size=x.size)), tol=1e-12)
    assert found.success
    a, y, omega = unpacked(found.x)
    assert omega == pytest.approx(at.s.imag, rel=1e-6)
    np.testing.assert_allclose(y, at.y, atol=1e-6 * np.abs(y).max())
    np.testing.assert_allclose(a, at.a, atol=1e-6 * np.abs(a).max())


def test_falling_friction():
    """mu = mus - k1 v + k3 v^3 on a belt: .4096 to first order, .418 by time steps."""
    mus, mum, vm, vb, c = 0.4, 0.25, 0.5, 0.45, 0.01
    k1, k3 = 1.5 * (mus - mum) / vm, 0.5 * (mus - mum) / vm**3

    def coefficient(v):
        return mus - k1 * v + k3 * v**3, -k1 + 3 * k3 * v**2

    law = patch(
        exponential_law(1.0, 1.0), mu=coefficient(vb)[0], followed="NT",
        coefficient=coefficient, speed=vb, area=1.0,
    )  # fmt: skip
    one = np.ones((1, 1))
    bodies = matrices(one, c * one, one, np.array([[0.0], [1.0]]), np.array([[0.0], [1.0]]))
    problem = HarmonicBalance(bodies, law, np.array([0.0, 1.0]), 9, 64)
    s = 0.5 * (k1 - 3 * k3 * vb**2 - c) + 1j
    branch = follow(problem, problem.start(s, np.ones(1), np.array([0, 1.0]), 0.02), 0.44)
    (cycle,) = branch.cycles
    velocity = problem.over_time(cycle.at.lam * cycle.at.y)[1]
    first_order = np.sqrt(4 / (3 * k3) * (k1 - c - 3 * k3 * vb**2))
    assert first_order == pytest.approx(0.4096, abs=5e-5)
    assert abs(cycle.at.y[1, 1]) * cycle.at.s.imag == pytest.approx(first_order, rel=0.01)

    def motion(t, x):
        return [x[1], coefficient(vb - x[1])[0] - c * x[1] - x[0]]

    run = solve_ivp(motion, (0, 1500), [0.3, 0], rtol=1e-9, atol=1e-11, dense_output=True)
    top = np.abs(run.sol(np.linspace(1480, 1500, 4000))[1]).max()
    assert np.abs(velocity).max() == pytest.approx(top, rel=1e-3)


def test_time_to_reach_a_cycle():
    """alpha = 100 (1 - a^2): integral of da / (a alpha); not what lies behind."""

    def reached(a):
        return np.log(a / np.sqrt(1 - a**2)) / 100

    one = np.ones((1, 1), complex)
    branch = GrowthBranch(100.0, np.ones(1))
    for a in (*np.geomspace(1e-3, 0.999, 400), 0.99):
        alpha = 100 * (1 - a**2) * (1 if len(branch.points) < 400 else -1)
        branch.add(Vibration(a * one, a * one, alpha + 1e3j, a))
    branch.cycles = [Cycle(kind, Vibration(one, one, 1e3j, 1.0)) for kind in (STABLE, UNSTABLE)]
    time = time_to_reach(branch, branch.cycles[0])
    assert time == pytest.approx(reached(0.95) - reached(0.01), rel=2e-3)
    assert np.isnan(time_to_reach(branch, branch.cycles[1]))

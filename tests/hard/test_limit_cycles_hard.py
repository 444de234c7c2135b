"""Hard cases of limit cycles: each gives a correct result or says what it could not find."""

import numpy as np
import pytest

from brake_fenicsx.errors import NotConverged
from brake_fenicsx.extras.limit_cycle.growth import follow
from brake_fenicsx.extras.limit_cycle.harmonic_balance import HarmonicBalance, PeriodForces
from brake_fenicsx.macro.contact_forces import EnrichedGap, SlidingFriction
from brake_fenicsx.micro import LawSteps, OneLaw, exponential_law, join_laws, make_library
from oscillators import first_vibration, no_growth, oscillator, van_der_pol

pytestmark = pytest.mark.hard


def frictionless(one):
    return SlidingFriction(0 * one, 0 * one, one, one > 0)


def test_growth_that_never_ends():
    """A linear oscillator with negative damping: the branch ends at the largest amplitude."""
    zero = lambda x, v: 0 * x  # noqa: E731
    problem = oscillator(zero, zero, zero, c=-0.02)
    branch = follow(problem, first_vibration(problem, 0.01 + 1j, 0.01), 3.0)
    assert branch.cycles == [] and branch.end == "largest amplitude"
    np.testing.assert_allclose(np.real(branch.s), 0.01, rtol=1e-3)


def test_two_cycles_and_a_jump():
    """Growth ends, begins again and ends for good: three cycles, the middle one unstable."""

    def damping(v):
        return -0.02 * (1 - v**2) * (1 - v**2 / 4) * (1 - v**2 / 9)

    def slope(v, h=1e-6):
        return (damping(v + h) * (v + h) - damping(v - h) * (v - h)) / (2 * h)

    problem = oscillator(
        lambda x, v: -damping(v) * v, lambda x, v: 0 * x, lambda x, v: -slope(v), points=256
    )
    branch = follow(problem, first_vibration(problem, 0.01 + 1j, 0.05), 20.0)
    kinds = [cycle.kind for cycle in branch.cycles]
    assert kinds[:1] == ["stable"] and set(kinds[1::2]) <= {"unstable"}


def test_no_vibration_of_an_impossible_guess():
    """A relaxation oscillator with one harmonic asked for the frequency of another one."""
    problem = van_der_pol(8.0, harmonics=2, points=8)
    guess = first_vibration(problem, 1j * 40.0, 30.0)
    with pytest.raises(NotConverged, match="limit cycle"):
        problem.solve(guess, no_growth(guess))


def test_too_few_points_of_time():
    """Harmonics beyond half of the points alias: refused."""
    with pytest.raises(ValueError, match="6 points of time for 3 harmonics"):
        HarmonicBalance(None, None, np.ones(1), 3, 6)


def test_stiff_cubic_at_large_amplitude():
    """x'' + x + 1e6 x^3 at an amplitude of 10: frequency as that of the pure cubic, 0.8472 a."""
    k = 1e6
    problem = oscillator(lambda x, v: -k * x**3, lambda x, v: -3 * k * x**2, lambda x, v: 0 * x)
    guess = first_vibration(problem, 1j * np.sqrt(0.75 * k) * 10, 10.0)
    found, _ = problem.solve(guess, None, 1e-10)
    top = problem.over_time(found.y).max()
    assert found.s.imag / (np.sqrt(k) * top) == pytest.approx(0.847213, rel=1e-5)


def hardened():
    """A law of which vibrations are five times as stiff as loading."""
    d = np.linspace(1e-6, -4e-6, 26)
    p = 1e6 * np.exp(-d / 1e-6)
    return make_library([LawSteps(d, p, p / 1e-6, 5 * p / 1e-6, -5 * p / 1e-12)])


def test_yielding_goes_on_and_comes_to_rest():
    """Under a hardness a patch yields to the deepest state of its cycle, and is elastic in it."""
    laws = EnrichedGap(hardened(), np.zeros(1, dtype=np.intp), np.zeros(1))
    one = np.ones(1)
    forces = PeriodForces(laws, one > 0, one, 0 * one, frictionless(one))
    t = 2 * np.pi * np.arange(64) / 64
    y = 1e-6 * np.cos(t)[None]
    F, tangent = forces(y, 0 * y)
    p, _ = laws.loading(np.array([-1e-6]))
    rest = laws.loading(np.zeros(1))[0]
    assert F.max() == pytest.approx(p[0] - rest[0], rel=1e-12)
    # One way there and back: elastic, no loop, open at the largest gap.
    np.testing.assert_allclose(F[0, 1:32], F[0, :32:-1], rtol=1e-9)
    assert F.min() == pytest.approx(-rest[0], rel=1e-12)
    # Beside the deepest state its pressure follows loading, all others the elastic branch.
    change = 1e-12 * (1 + 0.3 * np.sin(2 * t))[None]
    moved = (forces(y + change, 0 * y)[0] - forces(y - change, 0 * y)[0]) / 2
    wrong = tangent.times(change, 0 * y) - moved
    assert np.abs(wrong).max() < 1e-5 * np.abs(moved).max()
    # Without yielding beyond the equilibrium the stiffness of vibrations acts.
    small, _ = forces(np.abs(1e-11 * np.sin(t))[None], 0 * y)
    v = laws.vibration(np.zeros(1))[0]
    assert -small.min() == pytest.approx(v[0] * 1e-11, rel=1e-4)


def test_an_open_patch_that_closes():
    """A patch open at equilibrium carries only while the vibration closes it."""
    laws = EnrichedGap(hardened(), np.zeros(1, dtype=np.intp), np.zeros(1))
    one = np.ones(1)
    touch = laws.first_touch()
    for yields in (one > 0, one < 0):
        forces = PeriodForces(laws, yields, one, touch + 1e-7, frictionless(one))
        t = 2 * np.pi * np.arange(64) / 64
        y = 5e-7 * np.cos(t)[None]
        F, tangent = forces(y, 0 * y)
        assert F.min() == 0 and F.max() > 0 and np.isfinite(tangent.y).all()
        assert np.all(F[0, y[0] > -1e-7] == 0)


def test_one_law_per_patch():
    """Elements of one library with laws of their own, and others of a formula."""
    both = join_laws([hardened(), OneLaw(exponential_law(1e6, 2e-6))])
    laws = EnrichedGap(both, np.array([0, 1]), np.zeros(2))
    two = np.ones(2)
    forces = PeriodForces(laws, two < 0, two, 0 * two, frictionless(two))
    y = 1e-6 * np.cos(2 * np.pi * np.arange(32) / 32)[None] * two[:, None]
    F, _ = forces(y, 0 * y)
    np.testing.assert_allclose(F[1], 1e6 * (np.exp(-y[1] / 2e-6) - 1), atol=1e-6)
    assert F.shape == (2, 32) and not np.allclose(F[0], F[1])

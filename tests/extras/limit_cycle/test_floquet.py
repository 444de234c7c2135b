"""Floquet exponents of limit cycles against closed forms and steps of the equations in time."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from brake_fenicsx.extras.limit_cycle.bodies import Bodies
from brake_fenicsx.extras.limit_cycle.growth import exponents, follow, verdict
from brake_fenicsx.extras.limit_cycle.harmonic_balance import HarmonicBalance, Tangent

K, C = np.array([[2.0, -0.4, 0], [-0.4, 0.3, 0], [0, 0, 400.0]]), np.diag([0.05, 0.05, 0.5])
OUT, ACTING = np.array([0.0, 1.0, 1.0]), np.array([0.9, 1.0, 1.0])


def flutter(beyond):
    """Cycle of three modes with friction on a stiffening spring, and its problem.

    Args:
        beyond: whether the third mode is a compliance D(lambda).
    """
    n, one = (2 if beyond else 3), np.ones((1, 1))

    def forces(y, v):
        return -(y + y**3), Tangent((-1 - 3 * y**2).reshape(1, 1, 1, -1))

    def weights(s):
        compliance = OUT[2] * ACTING[2] / (K[2, 2] + s * C[2, 2] + s**2)
        return s ** np.arange(3)[:, None], np.array([s**0, compliance])

    bodies = Bodies(
        np.array([K[:n, :n], C[:n, :n], np.eye(n)]), ACTING[None, :n, None],
        OUT[None, None, :n], np.array([0 * one, one * beyond]), weights,
    )  # fmt: skip
    problem = HarmonicBalance(bodies, forces, one[0], 9, 256)
    # The linear mode that grows, of all three.
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-K - np.outer(ACTING, OUT), -C]])
    s, X = np.linalg.eig(A)
    i = np.argmax(np.where(s.imag > 0, s.real, -np.inf))
    start = problem.start(s[i], X[:n, i], X[:3, i] @ OUT * one[0], 0.02)
    return follow(problem, start, 10.0).cycles[0].at, problem


def test_against_time_steps_of_the_same_equations():
    """Eigenvalues of the change over a period, of all modes; each exponent has its error."""
    at, problem = flutter(beyond=False)
    x = np.real(np.r_[at.a.sum(axis=1), (at.a * at.lam).sum(axis=1)])
    period = 2 * np.pi / at.s.imag

    def motion(t, z):
        a, v = z[:3], z[3:6]
        y, P = a @ OUT, z[6:].reshape(6, 6)
        slope = -K - (1 + 3 * y**2) * np.outer(ACTING, OUT)
        A = np.block([[np.zeros((3, 3)), np.eye(3)], [slope, -C]])
        return np.r_[v, -K @ a - C @ v - ACTING * (y + y**3), (A @ P).ravel()]

    run = solve_ivp(motion, (0, period), np.r_[x, np.eye(6).ravel()], rtol=1e-10, atol=1e-12)
    end = run.y[:, -1]
    np.testing.assert_allclose(end[:6], x, atol=1e-4 * np.abs(x).max())
    mu = np.log(np.linalg.eigvals(end[6:].reshape(6, 6)) + 0j) / period
    found = exponents(problem, at)
    assert abs(found[0]) < 1e-3
    for one in found[1:]:
        assert np.abs(mu - one).min() < 2e-3
    assert found[1:].real.max() == pytest.approx(np.sort(mu.real)[-2], abs=1e-3)


def test_a_compliance_that_changes_with_lambda():
    """A mode is a coordinate, or a part of D(lambda): exponents agree to first order."""
    one, other = (exponents(*flutter(beyond)[::-1]) for beyond in (False, True))
    assert abs(one[0]) < 2e-3 and abs(other[0]) < 2e-3
    for exponent in other[1:]:
        assert np.abs(one - exponent).min() < 2e-3


def test_what_a_cycle_verdict_to():
    """By the frequency of what grows, and not where growth is less than its error."""
    assert verdict(-11.0, 10.0, 0.5) == "stable"
    assert verdict(9.0, 10.0, 0.5) == verdict(-9.0, 10.0, 0.5) == "undecided"
    assert verdict(11.0, 10.0, 0.5) == "gives way: its period doubles"
    assert verdict(11.0, 10.0, 0.2) == "gives way: a second frequency"
    assert verdict(11.0, 10.0, 0.0) == "gives way: another cycle"

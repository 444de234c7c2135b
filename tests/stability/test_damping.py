"""Damping terms: signs, energies and closed forms."""

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.macro.contact_forces import SlidingFriction
from brake_fenicsx.stability import complex_modes
from brake_fenicsx.stability.damping_matrices import friction_damping


def contact():
    """Three elements over four dofs: (T, R, w, p, V)."""
    rng = np.random.default_rng(0)
    T, R = (sp.csr_matrix(rng.normal(size=(3, 4))) for _ in range(2))
    return T, R, rng.uniform(1, 2, 3), rng.uniform(1, 9, 3), rng.uniform(1, 2, 3)


def friction(mu, slope, V):
    """Of one element or several."""
    mu, slope, V = np.broadcast_arrays(*map(np.atleast_1d, (mu, slope, V)))
    return SlidingFriction(mu + 0.0, slope + 0.0, V + 0.0, mu > 0)


@pytest.mark.parametrize("mu", [0.4, np.array([0.1, 0.4, 0.0])])
@pytest.mark.parametrize("slope", [-0.02, np.array([-0.02, -0.01, 0.0])])
def test_sliding_takes_energy_across_its_direction_and_falling_friction_feeds_it_in(mu, slope):
    """u'C u = sum w p (mu (R u)^2 / V + mu' (T u)^2), each alone too; a sign, or a lost area."""
    T, R, w, p, V = contact()
    u = np.array([1.0, -2.0, 0.5, 3.0])
    across, along = np.sum(mu * p * w * (R @ u) ** 2 / V), np.sum(slope * p * w * (T @ u) ** 2)
    for turns, falls in ((True, False), (False, True), (True, True)):
        C = friction_damping(T, R, w, *friction(mu, slope, V).rates(p, turns, falls))
        assert u @ C @ u == pytest.approx(turns * across + falls * along)
    assert across > 0 > along


def traction(p, mu, V, along, across):
    """Coulomb's traction on the pad (along s, along r) at a slip rate, without linearisation."""
    v = np.array([along - V, across])
    speed = np.hypot(*v)
    return -mu(speed) * p * v / speed


def test_both_terms_are_the_linearised_traction():
    """Finite differences of the full law: the terms stand on the left, so with a minus there."""
    p, V, d = 3.0, 2.0, 1e-5
    law = lambda v: 0.5 * np.exp(-v / 4)  # noqa: E731
    slope = -0.125 * np.exp(-V / 4)
    none, one = sp.csr_matrix([[0.0, 1.0]]), sp.csr_matrix([[1.0, 0.0]])
    rates = friction(law(V), slope, V).rates(p * np.ones(1), True, True)
    C = friction_damping(one, none, np.ones(1), *rates)
    along = (traction(p, law, V, d, 0) - traction(p, law, V, -d, 0)) / (2 * d)
    np.testing.assert_allclose(along, [-C[0, 0], 0.0], atol=1e-9)
    across = (traction(p, law, V, 0, d) - traction(p, law, V, 0, -d)) / (2 * d)
    np.testing.assert_allclose(across, [0.0, -C[1, 1]], atol=1e-9)


def test_friction_damped_oscillator_through_the_term():
    """A mass of 8 kg on 315 N/m across the sliding, 1 N, mu 0.5, 10 m/s: zeta = 4.980e-4."""
    m, k, mu, N, V = 8.0, 315.0, 0.5, 1.0, 10.0
    area = np.array([2e-4])
    one = sp.csr_matrix([[1.0]])
    C = friction_damping(one, one, area, *friction(mu, 0.0, V).rates(N / area, True, False))
    assert C[0, 0] == pytest.approx(mu * N / V, rel=1e-14)
    modes = complex_modes(sp.csr_matrix([[m]]), C, sp.csr_matrix([[k]]), (0.0, 5.0))
    zeta = -modes.s.real / np.abs(modes.s)
    assert zeta == pytest.approx([mu * N / V / (2 * np.sqrt(k * m))], rel=1e-12)
    assert zeta == pytest.approx([4.980e-4], rel=1e-4)
    assert modes.verdict == ["stable"]


def test_stick_slip_oscillator_grows_with_falling_friction():
    """The same mass along the sliding, mu' = -0.01 s/m: alpha = -mu' N / 2 m, unstable."""
    m, k, N = 8.0, 315.0, 1.0
    one = sp.csr_matrix([[1.0]])
    C = friction_damping(one, one, np.ones(1), np.full(1, -0.01 * N), np.zeros(1))
    modes = complex_modes(sp.csr_matrix([[m]]), C, sp.csr_matrix([[k]]), (0.0, 5.0))
    assert modes.s.real == pytest.approx([0.01 * N / (2 * m)], rel=1e-9)
    assert modes.verdict == ["unstable"]

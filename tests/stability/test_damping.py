"""Damping terms: signs, energies and closed forms."""

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.errors import SceneError
from brake_fenicsx.stability import complex_modes
from brake_fenicsx.stability.damping_matrices import (
    loss_factor,
    rayleigh,
    sliding_damping,
    velocity_slope,
)


def random_spd(n, seed):
    A = sp.random(n, n, 0.3, random_state=seed, format="csr")
    return (A @ A.T + sp.identity(n)).tocsr()


def test_sums_of_matrices():
    """The numbers, and the matrices given are left as they were."""
    M, K = random_spd(7, 0), random_spd(7, 1)
    before = M.toarray(), K.toarray()
    np.testing.assert_allclose(rayleigh(M, K, 3.0, 0.1).toarray(), (3 * M + 0.1 * K).toarray())
    C = loss_factor([(0.01, K), (0.1, M)], 50.0)
    np.testing.assert_allclose(C.toarray(), (0.01 / 50 * K + 0.1 / 50 * M).toarray())
    np.testing.assert_array_equal(M.toarray(), before[0])
    np.testing.assert_array_equal(K.toarray(), before[1])


def test_loss_factor_dissipates_its_share_of_the_strain_energy():
    """Two oscillators, steel 0.002 and lining 0.05: 2 zeta = eta omega / omega_ref each."""
    omega = np.array([500.0, 2000.0])
    K = [sp.diags([omega[0] ** 2, 0.0]).tocsr(), sp.diags([0.0, omega[1] ** 2]).tocsr()]
    M = sp.identity(2, format="csr")
    C = loss_factor([(0.002, K[0]), (0.05, K[1])], 1000.0)
    modes = complex_modes(M, C, K[0] + K[1], (0.0, 1e3))
    eta = np.array([0.002 * 0.5, 0.05 * 2.0])
    np.testing.assert_allclose(modes.damping, eta / np.sqrt(1 - eta**2 / 4), rtol=1e-9)
    assert set(modes.verdict) == {"stable"}


def contact():
    """Three elements over four dofs: (T, R, w, p, V)."""
    rng = np.random.default_rng(0)
    T, R = (sp.csr_matrix(rng.normal(size=(3, 4))) for _ in range(2))
    return T, R, rng.uniform(1, 2, 3), rng.uniform(1, 9, 3), rng.uniform(1, 2, 3)


@pytest.mark.parametrize("mu", [0.4, np.array([0.1, 0.4, 0.0])])
def test_sliding_takes_energy_across_its_direction(mu):
    """u' C_s u' = sum mu p w (R u')^2 / V, never negative; catches a wrong sign or a lost area."""
    _, R, w, p, V = contact()
    C = sliding_damping(R, w, p, V, mu)
    u = np.array([1.0, -2.0, 0.5, 3.0])
    assert u @ C @ u == pytest.approx(np.sum(mu * p * w * (R @ u) ** 2 / V))
    assert np.linalg.eigvalsh(C.toarray()).min() > -1e-12


@pytest.mark.parametrize("slope", [-0.02, np.array([-0.02, -0.01, 0.0])])
def test_falling_friction_feeds_energy_in(slope):
    """u' C_mu u' = sum mu' p w (T u')^2 < 0."""
    T, _, w, p, _ = contact()
    C = velocity_slope(T, w, p, slope)
    u = np.array([1.0, -2.0, 0.5, 3.0])
    assert u @ C @ u == pytest.approx(np.sum(slope * p * w * (T @ u) ** 2))
    assert u @ C @ u < 0


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
    one = sp.csr_matrix([[1.0]])
    unit = np.ones(1)
    along = (traction(p, law, V, d, 0) - traction(p, law, V, -d, 0)) / (2 * d)
    C = velocity_slope(one, unit, p * unit, slope)
    np.testing.assert_allclose(along, [-C[0, 0], 0.0], atol=1e-9)
    across = (traction(p, law, V, 0, d) - traction(p, law, V, 0, -d)) / (2 * d)
    C = sliding_damping(one, unit, p * unit, V * unit, law(V))
    np.testing.assert_allclose(across, [0.0, -C[0, 0]], atol=1e-9)


def test_friction_damped_oscillator_through_the_term():
    """A mass of 8 kg on 315 N/m across the sliding, 1 N, mu 0.5, 10 m/s: zeta = 4.980e-4."""
    m, k, mu, N, V = 8.0, 315.0, 0.5, 1.0, 10.0
    area = np.array([2e-4])
    R = sp.csr_matrix([[1.0]])
    C = sliding_damping(R, area, N / area, np.array([V]), mu)
    assert C[0, 0] == pytest.approx(mu * N / V, rel=1e-14)
    modes = complex_modes(sp.csr_matrix([[m]]), C, sp.csr_matrix([[k]]), (0.0, 5.0))
    zeta = -modes.s.real / np.abs(modes.s)
    assert zeta == pytest.approx([mu * N / V / (2 * np.sqrt(k * m))], rel=1e-12)
    assert zeta == pytest.approx([4.980e-4], rel=1e-4)
    assert modes.verdict == ["stable"]


def test_stick_slip_oscillator_grows_with_falling_friction():
    """The same mass along the sliding, mu' = -0.01 s/m: alpha = -mu' N / 2 m, unstable."""
    m, k, N = 8.0, 315.0, 1.0
    C = velocity_slope(sp.csr_matrix([[1.0]]), np.ones(1), np.full(1, N), -0.01)
    modes = complex_modes(sp.csr_matrix([[m]]), C, sp.csr_matrix([[k]]), (0.0, 5.0))
    assert modes.s.real == pytest.approx([0.01 * N / (2 * m)], rel=1e-9)
    assert modes.verdict == ["unstable"]


def test_what_makes_no_sense_is_refused():
    one = sp.identity(1, format="csr")
    with pytest.raises(SceneError, match="alpha"):
        rayleigh(one, one, -1.0, 0.0)
    with pytest.raises(SceneError, match="no part"):
        loss_factor([], 1.0)
    with pytest.raises(SceneError, match="reference frequency"):
        loss_factor([(0.1, one)], 0.0)
    with pytest.raises(SceneError, match="negative"):
        loss_factor([(-0.1, one)], 1.0)
    with pytest.raises(SceneError, match="V > 0"):
        sliding_damping(one, np.ones(1), np.ones(1), np.zeros(1), 0.5)

"""Damped modes against closed forms."""

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.stability import complex_modes

TWO_PI = 2 * np.pi


def chain(n: int) -> tuple[sp.csr_matrix, np.ndarray]:
    """A chain of unit masses and springs of 1e8 N/m, fixed at both ends, and its omega."""
    K = 1e8 * sp.diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(n, n)).tocsr()
    return K, 2e4 * np.sin(np.pi * np.arange(1, n + 1) / (2 * (n + 1)))


def test_friction_damped_oscillator():
    """Sliding across the spring damps: c = mu N / V, zeta = c / (2 sqrt(k m)) = 4.980e-4."""
    m, k, mu, N, V = 8.0, 315.0, 0.5, 1.0, 10.0
    modes = complex_modes(
        sp.csr_matrix([[m]]), sp.csr_matrix([[mu * N / V]]), sp.csr_matrix([[k]]), (0.0, 5.0)
    )
    omega, zeta = np.sqrt(k / m), mu * N / V / (2 * np.sqrt(k * m))
    assert zeta == pytest.approx(4.980e-4, rel=1e-3)
    exact = omega * (-zeta + 1j * np.sqrt(1 - zeta**2))
    assert modes.s == pytest.approx([exact], rel=1e-12)
    assert modes.damping == pytest.approx([2 * zeta], rel=1e-6)
    assert modes.verdict == ["stable"]


@pytest.mark.parametrize("n", [50, 700])
def test_rayleigh_damped_chain(n):
    """C = a M + b K: zeta_i = a / (2 omega_i) + b omega_i / 2, dense and by block Arnoldi."""
    K, omega = chain(n)
    M, a, b = sp.identity(n, format="csr"), 3.0, 2e-6
    band = (0.0, 3000.0) if n < 300 else (100.0, 600.0)
    modes = complex_modes(M, a * M + b * K, K, band, zeta_max=0.025)
    zeta = a / (2 * omega) + b * omega / 2
    exact = omega * (-zeta + 1j * np.sqrt(1 - zeta**2))
    exact = exact[(exact.imag >= TWO_PI * band[0]) & (exact.imag <= TWO_PI * band[1])]
    assert len(modes) == len(exact) >= 39
    assert modes.s == pytest.approx(exact, rel=1e-9)
    assert np.all(np.abs(modes.s - exact) <= modes.error)
    assert modes.condition == pytest.approx(1.0, abs=0.1)


def test_negative_damping_is_unstable():
    """Falling friction: the same chain with C negative grows."""
    K, _ = chain(20)
    M = sp.identity(20, format="csr")
    modes = complex_modes(M, -2.0 * M, K, (0.0, 4000.0))
    assert set(modes.verdict) == {"unstable"}
    assert modes.s.real == pytest.approx(np.ones(20), rel=1e-9)


def test_gyroscopic_split():
    """x'' + w^2 x = 2 O y', y'' + w^2 y = -2 O x': omega = sqrt(w^2 + O^2) +- O, undamped."""
    w, O = 1000.0, 3.0
    M, K = sp.identity(2, format="csr"), sp.identity(2, format="csr") * w**2
    C = sp.csr_matrix([[0.0, -2 * O], [2 * O, 0.0]])
    modes = complex_modes(M, C, K, (0.0, 1e3))
    root = np.sqrt(w**2 + O**2)
    assert modes.s.imag == pytest.approx([root - O, root + O], rel=1e-12)
    assert np.abs(modes.s.real).max() < 1e-9 * w


def test_left_and_right_vectors_satisfy_their_equations():
    """Non-symmetric K and C: psi^H Q = 0 and Q phi = 0, also where eigenvalues repeat."""
    n = 700
    K, _ = chain(n)
    rng = np.random.default_rng(0)
    shift = sp.random(n, n, 0.002, random_state=rng.integers(1 << 30), format="csr") * 1e5
    M, K = sp.identity(n, format="csr"), (K + shift).tocsr()
    C = (0.5 * M + 1e-6 * shift).tocsr()
    modes = complex_modes(M, C, K, (200.0, 700.0))
    assert len(modes) > 50
    Q = [modes.s**2, modes.s]
    right = M @ modes.right * Q[0] + C @ modes.right * Q[1] + K @ modes.right
    conj = modes.left.conj()
    left = M.T @ conj * Q[0] + C.T @ conj * Q[1] + K.T @ conj
    size = np.abs(modes.s) ** 2
    assert np.max(np.linalg.norm(right, axis=0) / np.linalg.norm(modes.right, axis=0) / size) < 1e-9
    assert np.max(np.linalg.norm(left, axis=0) / np.linalg.norm(modes.left, axis=0) / size) < 1e-7

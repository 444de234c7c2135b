"""Damped modes, dense and by block Arnoldi: closed forms, companion matrices, counts."""

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.stability import complex_modes, contact_interface
from brake_fenicsx.stability.full import general

TWO_PI = 2 * np.pi


def chain(n: int) -> tuple[sp.csr_matrix, np.ndarray]:
    """A chain of unit masses and springs of 1e8 N/m, fixed at both ends, and its omega."""
    K = 1e8 * sp.diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(n, n)).tocsr()
    return K, 2e4 * np.sin(np.pi * np.arange(1, n + 1) / (2 * (n + 1)))


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


def test_rayleigh_chain_with_a_doublet_of_every_mode():
    """Two equal chains: pairs of equal lambda, each there twice, 1e-9."""
    n = 151
    K, omega = chain(n)
    K, omega = sp.block_diag([K, K]).tocsr(), np.repeat(omega, 2)
    M = sp.identity(2 * n, format="csr")
    edge = 0.5 * (omega[39] + omega[40])
    m = complex_modes(M, 2.0 * M + 1e-6 * K, K, (0.0, edge / TWO_PI))
    zeta = 1.0 / omega + 0.5e-6 * omega
    exact = omega[:40] * (-zeta[:40] + 1j * np.sqrt(1 - zeta[:40] ** 2))
    assert len(m) == 40
    np.testing.assert_allclose(np.sort_complex(m.s), np.sort_complex(exact), rtol=1e-8)
    # Within a doublet the vectors are any two: their condition is finite, not one.
    assert np.all((m.condition > 0.99) & (m.condition < 100))
    assert (m.count.kind, m.count.expected) == ("proven", 40) and "zeros of T(z)" in m.count.how


@pytest.mark.long
@pytest.mark.parametrize("withheld", [0, 1, 2])
def test_large_problems_are_counted(two_blocks, monkeypatch, withheld):
    """Loss, sliding and friction of low rank; pairs that the eigensolver withholds are noticed.

    Catches a count that only repeats what was found.
    """
    scene, mu = two_blocks("coarse"), 0.6
    rng = np.random.default_rng(3)
    k = 3e11 * 10 ** rng.uniform(-1, 1, scene.w.size)
    C = (1e-7 * scene.K + 100.0 * scene.M + 20.0 * (scene.R.T @ scene.R)).tocsr()
    friction = contact_interface(scene.N, scene.T, scene.w * k, mu)
    real = general.quadratic_modes

    def lossy(*given):
        s, right, left = real(*given)
        order = np.argsort(np.abs(np.abs(s.imag) - 3e5))
        keep = np.sort(order[2 * withheld :])
        return s[keep], right[:, keep], left[:, keep]

    monkeypatch.setattr(general, "quadratic_modes", lossy)
    band = (0.0, 90e3)
    if withheld:
        with pytest.raises(InaccurateResult, match="the reduced problem has"):
            complex_modes(scene.M, C, scene.tangent(k, mu), band, friction=friction)
        return
    for given in (friction, None):
        m = complex_modes(scene.M, C, scene.tangent(k, mu), band, friction=given)
        assert m.count.kind == "proven" and m.count.how.startswith("zeros of T(z)")
        assert m.count.expected == len(m) > 10


def test_a_small_problem_is_counted(monkeypatch):
    """The winding number of the quadratic determinant; a withheld mode is noticed."""
    K, _ = chain(20)
    M = sp.identity(20, format="csr")
    m = complex_modes(M, 2.0 * M, K, (0.0, 4e3))
    assert m.count.kind == "proven" and m.count.how.startswith("winding number")
    assert len(m) == 20
    real = general.dense_quadratic_modes

    def lossy(p, omega):
        s, right, left = real(p, omega)
        keep = np.abs(np.abs(s.imag) - np.sort(np.abs(s.imag))[7]) > 1e-6
        return s[keep], right[:, keep], left[:, keep]

    monkeypatch.setattr(general, "dense_quadratic_modes", lossy)
    with pytest.raises(InaccurateResult, match="winding number counts"):
        complex_modes(M, 2.0 * M, K, (0.0, 4e3))

"""Large damped problems in real arithmetic."""

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.stability import complex_modes, contact_interface
from brake_fenicsx.stability.damping_matrices import rayleigh
from brake_fenicsx.stability.full import damped
from dense_reference import all_damped

BAND = (0.0, 80e3)


def companion(M, C, K):
    """All eigenvalues with Im > 0."""
    s = all_damped(*(A.toarray() for A in (M, C, K)), 2 * np.pi * BAND[1])
    return s[s.imag > 0]


@pytest.mark.slow
@pytest.mark.parametrize("mu", [0.0, 1.0])
def test_damped_blocks_with_friction(two_blocks, mu):
    """Sliding blocks with Rayleigh damping and a gyroscopic coupling, against the companion."""
    scene = two_blocks("guided")
    K, M = scene.tangent(np.full(scene.w.size, 3e11), mu), scene.M
    C = rayleigh(M, scene.K, 50.0, 2e-8)
    if mu:
        odd = sp.random(M.shape[0], M.shape[0], 1e-3, random_state=0, format="csr")
        C = (C + 1e-2 * abs(C).max() * (odd - odd.T)).tocsr()
    m = complex_modes(M, C, K, BAND)
    exact = companion(M, C, K)
    exact = exact[(exact.imag <= 2 * np.pi * BAND[1]) & (np.abs(exact.real) < 0.1 * np.abs(exact))]
    assert len(m) == exact.size > 10
    distance = np.abs(m.s[:, None] - exact).min(axis=1)
    assert np.all(distance < 1e-6 * np.abs(m.s))
    left = m.left.conj().T
    r = (left @ M) * (m.s**2)[:, None] + (left @ C) * m.s[:, None] + left @ K
    assert np.all(np.linalg.norm(r, axis=1) < 1e-7 * np.linalg.norm(left @ K, axis=1))


def chain(n):
    """Unit masses, springs of 1e8 N/m between walls, and omega."""
    K = 1e8 * sp.diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(n, n)).tocsr()
    return K, 2e4 * np.sin(np.pi * np.arange(1, n + 1) / (2 * (n + 1)))


def test_rayleigh_chain_with_a_doublet_of_every_mode():
    """Two equal chains: pairs of equal lambda, each there twice, 1e-9."""
    n = 151
    K, omega = chain(n)
    K, omega = sp.block_diag([K, K]).tocsr(), np.repeat(omega, 2)
    M = sp.identity(2 * n, format="csr")
    edge = 0.5 * (omega[39] + omega[40])
    m = complex_modes(M, 2.0 * M + 1e-6 * K, K, (0.0, edge / 2 / np.pi))
    zeta = 1.0 / omega + 0.5e-6 * omega
    exact = omega[:40] * (-zeta[:40] + 1j * np.sqrt(1 - zeta[:40] ** 2))
    assert len(m) == 40
    np.testing.assert_allclose(np.sort_complex(m.s), np.sort_complex(exact), rtol=1e-8)
    # Within a doublet the vectors are any two: their condition is finite, not one.
    assert np.all((m.condition > 0.99) & (m.condition < 100))
    assert (m.count.kind, m.count.expected) == ("proven", 40) and "zeros of T(z)" in m.count.how


@pytest.mark.parametrize("withheld", [0, 1, 2])
def test_large_problems_are_counted(two_blocks, monkeypatch, withheld):
    """Loss, sliding and friction of low rank; pairs that the eigensolver withholds are noticed.

    Catches a count that only repeats what was found.
    """
    scene, k, mu = two_blocks("coarse"), None, 0.6
    rng = np.random.default_rng(3)
    k = 3e11 * 10 ** rng.uniform(-1, 1, scene.w.size)
    C = (1e-7 * scene.K + 100.0 * scene.M + 20.0 * (scene.R.T @ scene.R)).tocsr()
    friction = contact_interface(scene.N, scene.T, scene.w * k, mu)
    real = damped.quadratic_modes

    def lossy(*given):
        s, right, left = real(*given)
        order = np.argsort(np.abs(np.abs(s.imag) - 3e5))
        keep = np.sort(order[2 * withheld :])
        return s[keep], right[:, keep], left[:, keep]

    monkeypatch.setattr(damped, "quadratic_modes", lossy)
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
    real = damped.dense_quadratic_modes

    def lossy(p, omega):
        s, right, left = real(p, omega)
        keep = np.abs(np.abs(s.imag) - np.sort(np.abs(s.imag))[7]) > 1e-6
        return s[keep], right[:, keep], left[:, keep]

    monkeypatch.setattr(damped, "dense_quadratic_modes", lossy)
    with pytest.raises(InaccurateResult, match="winding number counts"):
        complex_modes(M, 2.0 * M, K, (0.0, 4e3))

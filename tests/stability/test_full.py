"""Full order: flutter of two degrees of freedom, chains of known spectrum, counts, conventions."""

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.stability import complex_modes
from brake_fenicsx.stability import modes as module
from brake_fenicsx.stability.eigensolvers import symmetric
from brake_fenicsx.stability.eigensolvers.eigenpairs import QuadraticPencil, residuals
from brake_fenicsx.stability.modes import Count, Modes, undamped_rows

WIDE = (0.0, 1.0)


def flutter(d, friction):
    """M = I, K = [[1 + d, a], [-a, 1 - d]]: omega^2 = 1 +- sqrt(d^2 - a^2)."""
    K = sp.csr_matrix(np.array([[1 + d, friction], [-friction, 1 - d]]))
    return complex_modes(sp.identity(2, format="csr"), None, K, WIDE)


@pytest.mark.parametrize("friction", [0.0, 0.05, 0.0999])
def test_below_flutter(friction):
    """Two frequencies on the axis, no verdict but stable."""
    m = flutter(0.1, friction)
    root = np.sqrt(0.01 - friction**2)
    np.testing.assert_allclose(m.s.imag, np.sqrt([1 - root, 1 + root]), rtol=1e-9)
    np.testing.assert_allclose(m.s.real, 0.0, atol=1e-12)
    np.testing.assert_allclose(m.frequency, m.s.imag / 2 / np.pi)
    assert m.verdict == ["stable", "stable"]
    # Condition of either eigenvalue: d / sqrt(d^2 - a^2).
    np.testing.assert_allclose(m.condition, 0.1 / root, rtol=1e-6)


@pytest.mark.parametrize("friction", [0.1001, 0.15, 0.9])
def test_beyond_flutter(friction):
    """One pair, two rows, +-alpha; the growing one alone is unstable."""
    m = flutter(0.1, friction)
    exact = 1j * np.sqrt(1 + 1j * np.sqrt(friction**2 - 0.01))
    wanted = np.array([-abs(exact.real), abs(exact.real)]) + 1j * abs(exact.imag)
    np.testing.assert_allclose(m.s, wanted, rtol=1e-9)
    assert m.verdict == ["stable", "unstable"]
    np.testing.assert_allclose(m.damping, -2 * wanted.real / wanted.imag, rtol=1e-9)
    assert m.damping[1] < 0


def test_square_root_law_at_the_exceptional_point():
    """Beyond a = d growth rises as the root of a - d, before it frequencies part likewise.

    Condition: |d| / sqrt(d^2 - a^2) before, a / sqrt(a^2 - d^2) after: it falls as the root does.
    """
    d = 0.1
    excess = 10.0 ** -np.arange(1, 7)
    growth, parting, before, after = [], [], [], []
    for e in excess:
        m = flutter(d, d * (1 + e))
        exact = np.sqrt(-(1 + 1j * d * np.sqrt(e * (2 + e))))
        np.testing.assert_allclose(m.s.real.max(), abs(exact.real), rtol=1e-7)
        growth.append(m.s.real.max())
        after.append(m.condition.max() * np.sqrt(e * (2 + e)) / (1 + e))
        m = flutter(d, d * (1 - e))
        parting.append(np.ptp(m.s.imag))
        before.append(m.condition.max() * np.sqrt(e * (2 - e)))
    for values in (growth, parting):
        slope = np.diff(np.log10(values[2:])) / np.diff(np.log10(excess[2:]))
        np.testing.assert_allclose(slope, 0.5, atol=2e-3)
    np.testing.assert_allclose(before, 1.0, rtol=1e-5)
    np.testing.assert_allclose(after, 1.0, rtol=1e-5)


def chain(n, fixed=True):
    """Unit masses and springs in a row; omega = 2 sin(k pi / (2 (n + 1))) between walls."""
    K = sp.diags([np.full(n, 2.0), -np.ones(n - 1), -np.ones(n - 1)], [0, 1, -1]).tolil()
    if not fixed:
        K[0, 0] = K[-1, -1] = 1.0
        exact = 2 * np.sin(np.arange(n) * np.pi / (2 * n))
    else:
        exact = 2 * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1)))
    return K.tocsr(), sp.identity(n, format="csr"), exact / (2 * np.pi)


@pytest.mark.parametrize("n", [12, 301])
def test_chain_between_walls(n):
    """All modes of the band, dense and by block Lanczos, none twice."""
    K, M, exact = chain(n)
    band = (0.0, 0.25)
    m = complex_modes(M, None, K, band)
    wanted = exact[exact <= band[1]]
    assert len(m) == wanted.size == m.count.expected
    np.testing.assert_allclose(m.frequency, wanted, rtol=1e-9)
    assert np.all(np.abs(m.s - 2j * np.pi * wanted) <= m.error + 1e-15)
    assert np.all(m.residual < 1e-8)
    np.testing.assert_array_equal(m.s.real, 0.0)


def test_band_with_a_lower_edge():
    """Only the modes of the band, and a count of these: catches a count from zero."""
    K, M, exact = chain(300)
    band = (0.1, 0.25)
    m = complex_modes(M, None, K, band)
    wanted = exact[(exact >= band[0]) & (exact <= band[1])]
    np.testing.assert_allclose(m.frequency, wanted, rtol=1e-9)
    assert m.count.expected == wanted.size


def test_free_chain_has_one_rigid_mode_that_is_not_unstable():
    """kappa = 0 comes out as +-1e-15: never a divergence. Catches round-off taken for growth."""
    for n in (10, 11, 40, 100):
        K, M, exact = chain(n, fixed=False)
        m = complex_modes(M, None, K, (0.0, 0.2))
        wanted = exact[exact <= 0.2]
        np.testing.assert_allclose(m.frequency[m.frequency > 1e-4], wanted[1:], rtol=1e-8)
        assert "unstable" not in m.verdict


@pytest.mark.parametrize(
    "kappa, skew, end",
    [([-0.01, 1.0, 4.0], 0.0, 1.0), ([-30.0, 1.0, 4.0], 0.0, 0.5), ([-30.0, 1.0, 4.0], 0.01, 0.5)],
)
def test_divergence_is_found_and_called_so(kappa, skew, end):
    """A negative spring, also beyond the reach of the first shift: one growing row."""
    K = np.diag(kappa)
    K[1, 2], K[2, 1] = skew, -skew
    m = complex_modes(sp.identity(3, format="csr"), None, sp.csr_matrix(K), (0.0, end))
    np.testing.assert_allclose(m.s, [np.sqrt(-kappa[0]), 1j, 2j], atol=2e-5 if skew else 1e-8)
    assert m.damping[0] == -np.inf and m.frequency[0] == 0.0
    assert m.verdict == ["unstable", "stable", "stable"]


@pytest.mark.parametrize("spring, found", [(-2.5, True), (-30.0, True), (-300.0, False)])
def test_divergence_of_a_large_symmetric_problem_is_found_or_refused(spring, found):
    """kappa from below zero to 75 times the band's end; beyond that the error names the cause."""
    K, M, _ = chain(301)
    K = K.tolil()
    K[150, 150] = spring
    band = (0.0, 0.1)
    if not found:
        with pytest.raises(InaccurateResult, match=r"not positive semi-definite.*negative spring"):
            complex_modes(M, None, K.tocsr(), band)
        return
    m = complex_modes(M, None, K.tocsr(), band)
    exact = la.eigvalsh(K.toarray())
    inside = exact <= (2 * np.pi * band[1]) ** 2
    assert len(m) == m.count.expected == inside.sum() and m.verdict[0] == "unstable"
    np.testing.assert_allclose(-(m.s**2).real, exact[inside], rtol=1e-8)


@given(seed=st.integers(0, 10**6))
@settings(max_examples=15, deadline=None)
def test_random_friction_against_dense(seed):
    """A spectrum with many flutter pairs: values, left and right vectors, condition numbers."""
    rng = np.random.default_rng(seed)
    n = 40
    omega2 = np.sort(rng.uniform(1, 10, n))
    S = rng.normal(0, 0.05, (n, n))
    K = np.diag(omega2) + S - S.T
    m = rng.uniform(0.5, 2, n)
    M = np.diag(m)
    K = np.sqrt(m)[:, None] * K * np.sqrt(m)
    band = (0.0, 0.45)
    found = complex_modes(sp.csr_matrix(M), None, sp.csr_matrix(K), band)
    kappa = la.eigvals(K, M)
    lam = np.sqrt(-kappa + 0j)
    lam = np.where(lam.imag < 0, -lam, lam)
    edge = np.abs(lam.imag / 2 / np.pi - band[1])
    if edge.min() < 1e-6:
        return
    lam = lam[lam.imag <= 2 * np.pi * band[1]]
    assert len(found) == lam.size
    distance = np.abs(found.s[:, None] - lam).min(axis=1)
    assert np.all(distance <= found.error + 1e-13 * found.condition)
    kappa = -(found.s**2)
    right = K @ found.right - M @ found.right * kappa
    assert np.linalg.norm(right, axis=0).max() < 1e-7 * np.linalg.norm(K @ found.right)
    left = found.left.conj().T @ K - kappa[:, None] * (found.left.conj().T @ M)
    assert np.linalg.norm(left, axis=1).max() < 1e-6 * np.linalg.norm(found.left.conj().T @ K)


def test_a_lost_mode_is_noticed(monkeypatch):
    """The inertia count is compared with what block Lanczos found."""
    lowest = symmetric.lowest_modes

    def lossy(*args, **more):
        m = lowest(*args, **more)
        return type(m)(m.Phi[:, 1:], m.kappa[1:])

    monkeypatch.setattr(symmetric, "lowest_modes", lossy)
    K, M, _ = chain(400)
    with pytest.raises(InaccurateResult, match="inertia counts"):
        complex_modes(M, None, K, (0.0, 0.05))


def record(s, error=0.0, real=None):
    s = np.asarray(s, dtype=complex)
    n = s.size
    none = np.zeros((0, n))
    real = np.zeros(n, bool) if real is None else np.asarray(real)
    return Modes(s, none, none, np.zeros(n), np.broadcast_to(error, n), np.ones(n),
                 Count("counted", "given", n), 0.0, real)  # fmt: skip


def test_conventions_of_frequency_and_damping():
    m = record([2j * np.pi * 100 + 3.0, 2j * np.pi * 100 - 3.0, 5.0, 0.0])
    np.testing.assert_allclose(m.frequency, [100, 100, 0, 0])
    np.testing.assert_allclose(m.damping[:2], [-6 / (200 * np.pi), 6 / (200 * np.pi)])
    assert m.damping[2] == -np.inf and np.isnan(m.damping[3])


@pytest.mark.parametrize(
    "alpha, error, verdict",
    [
        (1e-3, 1e-4, "unstable"),
        (-1e-3, 1e-4, "stable"),
        (1e-3, 1e-2, "neutral"),
        (-1e-3, 1e-2, "neutral"),
        (0.0, 1e-8, "stable"),
        (0.5e-6, 1e-8, "stable"),
        (2e-6, 1e-8, "unstable"),
        (1e-6, 1e-8, "neutral"),
    ],
)
def test_verdict_is_neutral_where_the_interval_straddles_the_threshold(alpha, error, verdict):
    """|lambda| = 1: the threshold lies at 1e-6."""
    assert module.THRESHOLD == 1e-6
    assert record([alpha + 1j], error).verdict == [verdict]


def test_symmetry_settles_the_verdict_of_a_simple_mode():
    assert record([1j], 1.0, [True]).verdict == ["stable"]


def test_undamped_rows_by_hand():
    """kappa = 4.41: i 2.1. kappa = -9: 3, growing. kappa = 3 +- 4i: alpha +-1, omega 2."""
    kappa = np.array([4.41, -9.0, 3 + 4j, 3 - 4j, 400.0], dtype=complex)
    error = np.array([0.042, 0.06, 0.1, 0.1, 0.4])
    order, lam, spread, real = undamped_rows(kappa, error, (0.0, 1.0))
    np.testing.assert_array_equal(order, [1, 2, 3, 0])
    np.testing.assert_allclose(lam, [3.0, -1 + 2j, 1 + 2j, 2.1j], atol=1e-15)
    # d lambda = d kappa / (2 |lambda|).
    np.testing.assert_allclose(spread, [0.01, 0.1 / (2 * np.sqrt(5)), 0.1 / (2 * np.sqrt(5)), 0.01])
    assert real[3] and not real[1] and not real[2]
    # A band that starts above zero holds no divergence.
    order, lam, _, _ = undamped_rows(kappa, error, (0.31, 1.0))
    np.testing.assert_allclose(sorted(lam, key=lambda z: z.real), [-1 + 2j, 2.1j, 1 + 2j])


def test_two_real_kappas_within_their_errors_are_not_surely_real():
    """They may be a complex pair that the error has split."""
    kappa = np.array([1.0, 1.0001, 2.0], dtype=complex)
    _, _, _, real = undamped_rows(kappa, np.array([1e-4, 1e-4, 1e-4]), (0.0, 1.0))
    assert real.tolist() == [False, False, True]
    _, _, _, real = undamped_rows(kappa, np.full(3, 1e-6), (0.0, 1.0))
    assert real.tolist() == [True, True, True]


def test_a_kappa_within_its_error_of_zero_may_be_a_divergence():
    """Real is not enough: kappa must surely be positive to keep the mode on the axis."""
    kappa = np.array([1e-9, -1e-9, 1.0], dtype=complex)
    _, lam, spread, real = undamped_rows(kappa, np.array([1e-8, 1e-8, 1e-8]), (0.0, 1.0))
    rows = record(lam, spread, real)
    assert rows.verdict.count("unstable") == 0 and rows.verdict[-1] == "stable"


@pytest.mark.parametrize("c", [None, 0.5])
def test_residual_and_backward_error_by_hand(c):
    """M = 1, C = diag(0, c), K = diag(1, 4), lambda = i, phi = (1, e): r = (0, (3 + c i) e)."""
    K, M = sp.diags([1.0, 4.0]).tocsr(), sp.identity(2, format="csr")
    C = None if c is None else sp.diags([0.0, c]).tocsr()
    X = np.array([[1.0], [1e-3]], dtype=complex)
    pencil, s = QuadraticPencil(M, C, K), np.array([1j])
    relative, backward = residuals(pencil, s, X, pencil.times(s, X), M @ X)
    size = 1e-3 * abs(3 + 1j * (c or 0.0))
    length = np.sqrt(1 + 1e-6)
    np.testing.assert_allclose(relative, size / length, rtol=1e-12)
    np.testing.assert_allclose(backward, size / ((1 + 4 + (c or 0.0)) * length), rtol=1e-12)

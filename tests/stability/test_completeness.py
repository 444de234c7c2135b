"""The count of modes that needs no eigensolver."""

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.stability import Reduced, complex_modes
from brake_fenicsx.stability.eigensolvers.argument_principle import (
    Trapezium,
    count_zeros,
    undamped_region,
)
from dense_reference import all_lambda

REGION = Trapezium(low=-0.02, high=1.0, slope=0.5, rise=1e-3)


def matrix(values: list[complex], seed: int = 0) -> np.ndarray:
    """A real matrix with the given eigenvalues, complex ones with their conjugates."""
    blocks = [np.array([[v.real, v.imag], [-v.imag, v.real]]) if v.imag else np.array([[v.real]])
              for v in map(complex, values)]  # fmt: skip
    n = sum(len(b) for b in blocks)
    A, at = np.zeros((n, n)), 0
    for b in blocks:
        A[at : at + len(b), at : at + len(b)] = b
        at += len(b)
    X = np.random.default_rng(seed).standard_normal((n, n))
    return np.linalg.solve(X, A @ X)


INSIDE = [0.1, 0.2, 0.2 + 1e-9, 0.5 + 0.1j, 0.9 + 0.3j, -0.01]
OUTSIDE = [-0.5, 1.001, 0.3 + 0.4j, 2.0, 5.0 + 1j]


@pytest.mark.parametrize("missed", [[], [0.1], [0.2 + 1e-9], [0.5 + 0.1j, 0.5 - 0.1j]])
@pytest.mark.parametrize("phantom", [[], [0.35], [0.6, 0.61]])
def test_missed_and_invented_zeros_are_seen(missed, phantom):
    """The count is the truth whatever the solver believed."""
    A = matrix(INSIDE + OUTSIDE)
    exact = np.linalg.eigvals(A)
    believed = [v for v in exact if not any(abs(v - m) < 1e-6 for m in missed)]
    got = count_zeros(lambda z: A - z * np.eye(len(A)), REGION, np.array(believed + phantom))
    assert got == 8


@pytest.mark.hard
@pytest.mark.parametrize("beyond", [4.3, 4.5, 4.7])
def test_many_modes_beyond_twice_the_band(beyond):
    """285 eigenvalues side by side, which turn the phase: the few modes of the band are counted."""
    rng, end = np.random.default_rng(0), 2 * np.pi * 1e3
    kappa = np.r_[rng.uniform(0.01, 0.97, 15), beyond + 1e-3 * rng.standard_normal(285)]
    K = sp.csr_matrix(end**2 * matrix(list(kappa)))
    modes = complex_modes(sp.identity(300, format="csr"), None, K, (0.0, 1e3), zeta_max=0.3)
    assert modes.count.expected == 15 and modes.count.how.startswith("winding number")
    np.testing.assert_allclose(np.sort(modes.s.imag), end * np.sqrt(np.sort(kappa[:15])), 1e-8)


def test_nothing_believed_still_counts():
    A = matrix(INSIDE + OUTSIDE)
    assert count_zeros(lambda z: A - z * np.eye(len(A)), REGION, np.zeros(0), points=30) == 8


def test_quadratic_function_is_counted_with_its_extra_zeros():
    """z^2 Q doubles the number of zeros; those inside the region count."""
    K, Q = np.diag([0.3, 0.4]), np.diag([0.0, 1.0])
    # 0.3 - z and 0.4 - 1.3 z + z^2 = (z - 0.5)(z - 0.8): three zeros inside.
    M = np.diag([1.0, 1.3])
    assert count_zeros(lambda z: K - z * M + z**2 * Q, REGION, np.array([0.3])) == 3


def test_zero_on_the_border_is_refused():
    A = matrix([0.2, 1.0])
    with pytest.raises(InaccurateResult, match="edge of the band"):
        count_zeros(lambda z: A - z * np.eye(2), REGION, np.zeros(0), most=400)


@pytest.mark.parametrize("zeta", [0.05, 0.1, 0.4])
def test_the_region_counted_holds_every_mode_of_the_band(zeta):
    """In lambda the band is a sector; a region of |Im kappa| <= 2 zeta Re kappa is too narrow.

    That one ends at zeta = 0.33 where 0.4 was meant, and cuts damped modes at the lower end.
    """
    rng, band = np.random.default_rng(0), (20.0, 90.0)
    omega = 2 * np.pi * np.r_[band, rng.uniform(*band, 400)]
    ratio = np.r_[zeta, zeta, rng.uniform(-zeta, zeta, 400)] * (1 - 1e-9)
    kappa = -((omega * (-ratio / np.sqrt(1 - ratio**2) + 1j)) ** 2)
    low, high = ((2 * np.pi * f) ** 2 for f in band)
    assert np.all(undamped_region(kappa, low, high, zeta).holds(kappa))


@pytest.mark.parametrize(
    "mu, low",
    [
        pytest.param(2.0, 0.0, marks=pytest.mark.slow),
        (4.0, 0.0),
        pytest.param(4.0, 30e3, marks=pytest.mark.slow),
    ],
)
def test_rows_and_count_agree_however_strong_the_flutter(two_blocks, mu, low):
    """Damping ratios of 0.35 and 0.67, and a band that starts above zero: as many as there are.

    The count said 20 where there are 22 rows, and refused every band that does not start at zero.
    """
    scene, band = two_blocks("guided"), (low, 90e3)
    k = 3e11 * 10 ** np.random.default_rng(1).uniform(-1, 1, scene.w.size)
    K = scene.tangent(k, mu)
    s = all_lambda(K, scene.M)
    inside = (s.imag >= 2 * np.pi * low) & (s.imag <= 2 * np.pi * band[1]) & (s.imag > 0)
    m = Reduced(scene.K, scene.M, scene.N, scene.T, scene.w, 1e11, band).modes(k, mu)
    assert len(m) == m.count.expected == inside.sum()
    m = complex_modes(scene.M, None, K, band, frictionless=scene.tangent(k, 0.0), zeta_max=0.4)
    assert "winding" in m.count.how and np.sum(np.abs(m.s.real) <= 0.4 * np.abs(m.s)) == np.sum(
        inside & (np.abs(s.real) <= 0.4 * np.abs(s))
    )

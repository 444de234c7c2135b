"""Close modes that see a disturbance together, against the disturbed problem itself."""

import numpy as np
import pytest
import scipy.linalg as la

from brake_fenicsx.stability.reduced.neighbours import close_groups, seen_together, separation

pytestmark = pytest.mark.alone

# A pair that merges at friction 0.1, and modes far from it [1/s^2].
FAR = (0.2e8, 0.5e8, 1.9e8, 3.1e8)
MIDST, HALF = 1e8, 0.5e3


def merging(friction):
    """K and M = 1 of a pair at MIDST, HALF * 0.1 apart at most, and FAR, in mixed coordinates."""
    K = np.diag([MIDST - 0.1 * HALF, MIDST + 0.1 * HALF, *FAR])
    K[0, 1], K[1, 0] = friction * HALF, -friction * HALF
    turn = la.qr(np.random.default_rng(4).standard_normal(K.shape))[0]
    return turn.T @ K @ turn


def eigenpairs(K):
    """Those without negative imaginary part, with left vectors."""
    kappa, left, right = la.eig(K, left=True, right=True)
    keep = np.flatnonzero(kappa.imag >= 0)
    keep = keep[np.argsort(kappa.real[keep])]
    return kappa[keep], right[:, keep], left[:, keep]


@pytest.mark.parametrize("friction", [0.0, 0.05, 0.0999, 0.1001, 0.15])
@pytest.mark.parametrize("size", [1e-8, 1e-7, 1e-6])
def test_a_disturbed_pair_near_its_merging(friction, size):
    K = merging(friction)
    n = len(K)
    disturbance = size * MIDST * np.random.default_rng(7).standard_normal((n, n))
    kappa, a, b = eigenpairs(K)
    pair = np.flatnonzero(np.abs(kappa - MIDST) < 10 * HALF)
    operators = K, np.eye(n), np.zeros((n, n))
    found, right, left = seen_together(
        operators, kappa[pair], a[:, pair], b[:, pair], disturbance @ a[:, pair]
    )
    exact = eigenpairs(K + disturbance)[0]
    exact = exact[np.abs(exact - MIDST) < 100 * HALF + 10 * size * MIDST]
    assert found.size == exact.size
    # What the others mix in is of second order; at the point itself the root of it is seen.
    second = (size * MIDST) ** 2 * n / 4e7
    apart = np.abs(exact[:, None] - exact.conj()).max()
    assert np.abs(np.sort_complex(found) - np.sort_complex(exact)).max() <= min(
        np.sqrt(second * HALF), second * (1 + 2 * HALF / apart)
    ) + 1e-13 * MIDST * (1 + HALF / apart)
    for z, x, y in zip(found, right.T, left.T, strict=True):
        # In the space of the pair nothing is left, from either side.
        r = (K - z * np.eye(n) + disturbance) @ x
        q = (K - z * np.eye(n) + disturbance).T @ y.conj()
        basis = np.hstack([b[:, pair].real, b[:, pair].imag])
        assert np.linalg.norm(basis.T @ r) < 1e-12 * MIDST
        assert np.linalg.norm(np.hstack([a[:, pair].real, a[:, pair].imag]).T @ q) < 1e-12 * MIDST


def test_groups():
    kappa = np.array([1.0, 2.0, 2.001, 3.0, 3.0005, 4.0 + 0.001j, 5.0 + 0.5j])
    assert close_groups(kappa, np.full(7, 1e-6)) == []
    groups = close_groups(kappa, np.array([1e-3, 1e-6, 1e-3, 1e-6, 1e-6, 1e-3, 1e-3]))
    # A complex mode is close to its own conjugate; one alone and safe is in no group.
    assert [g.tolist() for g in groups] == [[1, 2], [5]]


def test_distances():
    assert separation(np.zeros(0)).size == 0
    assert separation(np.array([1.0, 3.0, 4.0 + 0.25j])) == pytest.approx([2, abs(1 + 0.25j), 0.5])

"""Shares of parts in a mode, and the partners of flutter pairs, by closed form."""

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.errors import SceneError
from brake_fenicsx.stability import complex_modes
from brake_fenicsx.stability.participation import energy_shares, flutter_partners


def test_two_masses_on_springs():
    """m1 = 1, m2 = 4, k = 2 each, wall - 1 - 2: the kinetic shares from the 2 x 2 eigenproblem.

    kappa^2 m1 m2 - kappa (k m1 + 2 k m2) + k^2 = 0 and phi = (k, 2 k - kappa m1).
    """
    m1, m2, k = 1.0, 4.0, 2.0
    M = sp.diags([m1, m2]).tocsr()
    K = sp.csr_matrix([[2 * k, -k], [-k, k]])
    m = complex_modes(M, None, K, (0.0, 1.0))
    kappa = np.sort(np.roots([m1 * m2, -(k * m1 + 2 * k * m2), k**2]))
    np.testing.assert_allclose(m.s.imag**2, kappa, rtol=1e-10)
    first = m1 * k**2 / (m1 * k**2 + m2 * (2 * k - kappa * m1) ** 2)
    parts = {"one": sp.diags([m1, 0.0]).tocsr(), "two": np.array([0.0, m2])}
    shares = energy_shares(parts, m.right)
    np.testing.assert_allclose(shares["one"], first, rtol=1e-9)
    np.testing.assert_allclose(shares["one"] + shares["two"], 1.0, rtol=1e-12)


def test_phase_of_a_complex_mode_does_not_matter():
    """A travelling wave, sine on one part, cosine on the other: a half each, at any phase."""
    phi = np.array([[1.0], [1j]]) * np.exp(0.7j)
    shares = energy_shares({"a": np.array([3.0, 0.0]), "b": np.array([0.0, 3.0])}, phi)
    np.testing.assert_allclose([shares["a"][0], shares["b"][0]], 0.5)


def test_parts_of_a_shared_node():
    """One node of two bars: by each part's own consistent mass."""
    a = np.array([[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
    b = 2 * la.block_diag(0.0, [[2.0, 1.0], [1.0, 2.0]])
    shares = energy_shares({"a": sp.csr_matrix(a), "b": sp.csr_matrix(b)}, np.ones((3, 1)) + 0j)
    np.testing.assert_allclose(shares["a"], 6 / 18)


@pytest.mark.parametrize("parts", [{}, {"a": np.ones(2)}, {"a": np.zeros(3)}])
def test_what_is_refused(parts):
    with pytest.raises(SceneError, match="participation"):
        energy_shares(parts, np.ones((3, 1)) + 0j)


def test_partners_of_a_flutter_pair():
    """Two degrees of freedom past the onset, a third that stays by itself; one lone mode."""
    K = sp.csr_matrix(np.array([[1.1, 0.3, 0.0], [-0.3, 0.9, 0.0], [0.0, 0.0, 2.0]]))
    m = complex_modes(sp.identity(3, format="csr"), None, K, (0.0, 1.0))
    partner = flutter_partners(m.s)
    flutter = np.flatnonzero(partner >= 0)
    assert flutter.size == 2 and partner[flutter[0]] == flutter[1]
    assert partner[flutter[1]] == flutter[0]
    np.testing.assert_allclose(m.s[partner[flutter]], -m.s[flutter].conj(), rtol=1e-9)
    np.testing.assert_array_equal(flutter_partners(np.array([0.1 + 1j, 2j, 3.0 + 0j])), -1)

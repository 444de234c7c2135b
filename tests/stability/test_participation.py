"""Shares of parts in a mode, and the partners of flutter pairs, by closed form."""

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.elasticity import layer_masses
from brake_fenicsx.stability import ContactLinearisation, Reduced, complex_modes
from brake_fenicsx.stability.modes import (
    damped_partners,
    energy_shares,
    flutter_partners,
)


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
    parts = {"one": sp.diags([m1, 0.0]).tocsr(), "two": np.diag([0.0, m2])}
    shares = energy_shares(parts, m.right)
    np.testing.assert_allclose(shares["one"], first, rtol=1e-9)
    np.testing.assert_allclose(shares["one"] + shares["two"], 1.0, rtol=1e-12)


def test_phase_of_a_complex_mode_does_not_matter():
    """A travelling wave, sine on one part, cosine on the other: a half each, at any phase."""
    phi = np.array([[1.0], [1j]]) * np.exp(0.7j)
    shares = energy_shares({"a": np.diag([3.0, 0.0]), "b": np.diag([0.0, 3.0])}, phi)
    np.testing.assert_allclose([shares["a"][0], shares["b"][0]], 0.5)


def test_parts_of_a_shared_node():
    """One node of two bars: by each part's own consistent mass."""
    a = np.array([[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
    b = 2 * la.block_diag(0.0, [[2.0, 1.0], [1.0, 2.0]])
    shares = energy_shares({"a": sp.csr_matrix(a), "b": sp.csr_matrix(b)}, np.ones((3, 1)) + 0j)
    np.testing.assert_allclose(shares["a"], 6 / 18)


@pytest.mark.parametrize("parts", [{}, {"a": np.zeros((3, 3))}])
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


def damped(K, C):
    """Modes of unit masses, and the partners of those that grow."""
    M = sp.identity(len(K), format="csr")
    m = complex_modes(M, sp.csr_matrix(C), sp.csr_matrix(K), (0.0, 1.0), zeta_max=0.5)
    return m, damped_partners(m.s, m.right, M, np.array(m.verdict) == "unstable")


@pytest.mark.parametrize("damping", [1e-9, 0.02, 0.1])
def test_a_damped_flutter_pair_has_a_partner_though_no_exact_one(damping):
    """Damping of one mass alone pulls the two eigenvalues apart; a third mode stays by itself."""
    K = np.array([[1.1, 0.3, 0.0], [-0.3, 0.9, 0.0], [0.0, 0.0, 1.05]])
    m, partner = damped(K, np.diag([damping, 0.0, 0.5 * damping]))
    (i,) = np.flatnonzero(np.array(m.verdict) == "unstable")
    j = int(partner[i])
    assert partner[j] == i and np.sum(partner >= 0) == 2
    third = int(np.argmax(np.abs(m.right[2]) / np.linalg.norm(m.right, axis=0)))
    assert j != third
    if damping > 1e-3:
        assert flutter_partners(m.s)[i] == -1


def test_a_mode_that_falling_friction_drives_alone_has_no_partner():
    """Negative damping, symmetric stiffness: one mode grows, nothing coalesced."""
    m, partner = damped(np.diag([1.0, 1.02, 2.0]), np.diag([-0.01, 0.01, 0.01]))
    assert m.verdict.count("unstable") == 1
    np.testing.assert_array_equal(partner, -1)


def test_masses_of_the_layers_add_up(two_blocks, comm):
    """To the mass matrix, and each to its own density times volume."""
    scene = two_blocks("loose")
    density = {name: m.rho for name, m in scene.materials.items()}
    masses = layer_masses(scene.mesh, scene.free, density)
    assert abs(sum(masses.values()) - scene.M).max() < 1e-14 * abs(scene.M).max()
    one = lambda x: np.vstack([np.ones(x.shape[1]), 0 * x[0], 0 * x[0]])  # noqa: E731
    u = scene.field(pad=one, plate=one)
    assert u @ masses["pad.body"] @ u == pytest.approx(2510 * 12e-3 * 8e-3 * 5e-3, rel=1e-12)
    assert u @ masses["plate.body"] @ u == pytest.approx(7200 * 20e-3 * 14e-3 * 5e-3, rel=1e-12)


@pytest.mark.parametrize("mu", [0.3, 1.0])
def test_shares_of_reduced_modes_are_those_of_the_whole_ones(two_blocks, mu):
    """From the kept real modes alone: 1e-3 of the energy; and partners are those of full order."""
    scene, band = two_blocks("guided"), (0.0, 90e3)
    rng = np.random.default_rng(1)
    k = 3e11 * 10 ** rng.uniform(-1, 1, scene.w.size)
    red = Reduced(scene.elastic.K, scene.elastic.M, scene.N, scene.T, scene.w, 1e11, band)
    m = red.modes(k, mu)
    masses = layer_masses(scene.mesh, scene.free, {n: v.rho for n, v in scene.materials.items()})
    grams = {name: red.model.coordinates(A) for name, A in masses.items()}
    leading = energy_shares(grams, m.right)
    phi, _ = red.model.displacements([], ContactLinearisation.of(k, mu), m.s, m.right)
    whole = energy_shares(masses, phi)
    full = complex_modes(scene.M, None, scene.tangent(k, mu), band, zeta_max=0.4)
    for name in masses:
        np.testing.assert_allclose(leading[name], whole[name], atol=1e-3)
    assert len(full) == len(m)
    np.testing.assert_array_equal(flutter_partners(m.s), flutter_partners(full.s))

"""Lattices of springs: large matrices of known spectrum, with exact multiplets."""

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.macro.solver import Factor
from brake_fenicsx.stability import complex_modes
from brake_fenicsx.stability.eigensolvers.symmetric import lowest_modes

TWO_PI = 2 * np.pi


def lattice(shape):
    """Springs on a box lattice between walls: sums of 4 sin^2, many multiplets."""
    K, values = sp.csr_matrix((1, 1)), np.zeros(1)
    for n in shape:
        line = sp.diags([np.full(n, 2.0), -np.ones(n - 1), -np.ones(n - 1)], [0, 1, -1])
        K = sp.kron(K, sp.identity(n)) + sp.kron(sp.identity(K.shape[0]), line)
        own = 4 * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1))) ** 2
        values = (values[:, None] + own).ravel()
    return K.tocsr(), np.sort(values)


SIZES = [(12, 12, 12), pytest.param((46, 46, 46), marks=pytest.mark.slow)]


@pytest.mark.parametrize("shape", SIZES)
def test_undamped_lattice(shape):
    """Exact triplets and sextuplets up to 1e5 dofs: all there, 1e-9, proven by inertia."""
    K, kappa = lattice(shape)
    n = K.shape[0]
    edge = 0.5 * (kappa[56] + kappa[57]) if kappa[57] > kappa[56] * 1.01 else kappa[57] * 1.001
    m = complex_modes(sp.identity(n, format="csr"), None, K, (0.0, np.sqrt(edge) / TWO_PI))
    wanted = np.sqrt(kappa[kappa <= edge])
    assert len(m) == wanted.size == m.count.expected >= 57
    np.testing.assert_allclose(m.s.imag, wanted, rtol=1e-9)
    assert np.all(m.s.real == 0) and m.residual.max() < 1e-9
    assert m.count.kind == "proven" and m.count.how == "inertia of K - kappa M"


def sheared(shape, a, d):
    """Two lattices side by side, one coupled into the other on part of the dofs.

    K = A x 1 + 1 x [[d, a], [-a, -d]]: kappa = kappa_A +- sqrt(d^2 - a^2), each pair fluttering by
    the same amount; the coupling is of full rank.
    """
    K, kappa = lattice(shape)
    pair = np.array([[d, a], [-a, -d]])
    return sp.kron(K, sp.identity(2)) + sp.kron(sp.identity(K.shape[0]), pair), kappa


@pytest.mark.slow
def test_nonsymmetric_lattice_of_1e5_dofs():
    """No interface of low rank: slices, the record says that nothing was counted."""
    a, d = 2e-3, 1e-3
    K, kappa = sheared((36, 37, 38), a, d)
    n = K.shape[0]
    edge = 0.5 * (kappa[30] + kappa[31])
    m = complex_modes(sp.identity(n, format="csr"), None, K.tocsr(), (0.0, np.sqrt(edge) / TWO_PI))
    exact = np.sqrt(-(kappa[:60] + 1j * np.sqrt(a**2 - d**2)))
    exact = np.where(exact.imag < 0, -exact, exact)
    exact = exact[exact.imag <= np.sqrt(edge)]
    assert m.count.kind == "not counted"
    assert len(m) == 2 * exact.size
    grown = np.sort(m.s[m.s.real > 0].imag)
    np.testing.assert_allclose(grown, np.sort(exact.imag), rtol=1e-8)
    np.testing.assert_allclose(np.sort(m.s.real[m.s.real > 0]), np.sort(np.abs(exact.real)),
                               rtol=1e-6)  # fmt: skip


@pytest.mark.parametrize("shape", [(7, 8, 9), (12, 12, 12)])
def test_one_sided_lattice_of_known_spectrum(shape):
    """D A D^-1 has the spectrum of A, is not symmetric, and has exact multiplets."""
    K, kappa = lattice(shape)
    n = K.shape[0]
    D = np.exp(np.random.default_rng(0).uniform(-0.3, 0.3, n))
    edge = 0.5 * (kappa[25] + kappa[26]) if kappa[26] > 1.001 * kappa[25] else 1.001 * kappa[26]
    m = complex_modes(
        sp.identity(n, format="csr"), None, (sp.diags(D) @ K @ sp.diags(1 / D)).tocsr(),
        (0.0, np.sqrt(edge) / TWO_PI),
    )  # fmt: skip
    wanted = np.sqrt(kappa[kappa <= edge])
    assert len(m) == wanted.size
    np.testing.assert_allclose(np.sort(m.s.imag), wanted, rtol=1e-7)
    assert "unstable" not in m.verdict


def test_lowest_modes_below_everything_and_above_everything():
    """No mode below the cutoff, and all modes of a small problem."""
    values, one = np.array([1.0, 2.0, 3.0, 50.0]), sp.identity(4, format="csr")
    factor = Factor(sp.diags(values).tocsr())
    assert lowest_modes(factor, one, 0.5).kappa.size == 0
    np.testing.assert_allclose(lowest_modes(factor, one, 1e3).kappa, values, rtol=1e-12)


def test_one_degree_of_freedom():
    """The block of vectors is used up exactly after one step, without round-off."""
    one = sp.csr_matrix([[1.0]])
    found = lowest_modes(Factor(4 * one), one, 10.0)
    np.testing.assert_allclose(found.kappa, [4.0], rtol=1e-14)
    assert abs(found.Phi[0, 0]) == 1.0

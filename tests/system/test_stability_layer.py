"""Elastic layer sliding on a rigid base: finite elements against the exact dispersion relation."""

import numpy as np
import pytest

from sliding_layer import (
    HIGHEST,
    RHO,
    E,
    H,
    Layer,
    constrained,
    exact_modes,
    in_band,
    lambdas,
    match,
    penalised,
    solved,
    winding,
)

WAVES = (0.5, 1.5, 3.0)
POISSON = (0.3, 0.45)
FRICTION = (0.1, 0.4, 0.8)


@pytest.mark.parametrize("nu", POISSON)
@pytest.mark.parametrize("kh", WAVES)
def test_roots_of_the_dispersion_relation_are_all_there(kh, nu):
    """As many by the argument principle as were followed from mu = 0, each to 12 digits."""
    for mu in (0.0, *FRICTION):
        layer, roots = Layer(kh / H, nu, mu), exact_modes(kh / H, nu, mu)
        top = (2 * np.pi * HIGHEST) ** 2
        low, rise = 0.5 * np.abs(roots).min(), 0.5 * top
        inside = (roots.real < top) & (np.abs(roots.imag) < rise)
        assert winding(layer, low, top, rise) == np.count_nonzero(inside) > 3
        assert np.unique(np.round(roots / np.abs(roots).max(), 9)).size == roots.size


def test_known_limits_of_the_dispersion_relation():
    """k -> 0, mu = 0: shear waves at odd and pressure waves at whole multiples of quarter waves."""
    layer = Layer(1e-3 / H, 0.3, 0.0)
    f = np.sqrt(exact_modes(layer.k, layer.nu, 0.0).real) / 2 / np.pi
    c1, c2 = np.sqrt((layer.lame + 2 * layer.G) / RHO), np.sqrt(layer.G / RHO)
    shear, pressure = c2 * (2 * np.arange(9) + 1) / (4 * H), c1 * np.arange(1, 9) / (2 * H)
    wanted = np.sort(np.r_[shear, pressure])
    np.testing.assert_allclose(f, wanted[: f.size], rtol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("mu", FRICTION)
@pytest.mark.parametrize("nu", POISSON)
@pytest.mark.parametrize("kh", WAVES)
def test_finite_elements_give_frequency_and_growth(kh, nu, mu):
    """Every mode below 250 kHz; travelling pairs whose growth rates sum to zero."""
    exact = in_band(lambdas(exact_modes(kh / H, nu, mu)))
    modes = solved(*constrained(Layer(kh / H, nu, mu), 16))
    assert len(modes) == exact.size >= 8
    frequency, growth = match(modes.s, exact)
    assert frequency.max() < 1e-7 and growth.max() < 1e-5
    for s in modes.s:
        assert np.abs(modes.s + s.conj()).min() < 1e-9 * abs(s)
    assert abs(modes.s.real.sum()) < 1e-9 * np.abs(modes.s.real).sum()
    assert modes.verdict.count("unstable") == exact.size // 2


@pytest.mark.parametrize("degree", [2, 3])
def test_order_of_convergence(degree):
    """Eigenvalues converge at twice the degree."""
    layer = Layer(1.5 / H, 0.3, 0.4)
    exact = in_band(lambdas(exact_modes(layer.k, layer.nu, layer.mu)))[:1]
    cells = np.array([4, 8, 16]) if degree == 2 else np.array([3, 6, 12])
    errors = []
    for n in cells:
        found = solved(*constrained(layer, n, degree)).s
        errors.append(np.abs(found - exact[0]).min() / abs(exact[0]))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(rates > 2 * degree - 0.4), (errors, rates)


@pytest.mark.parametrize("nu", POISSON)
def test_penalty_tends_to_the_constraint(nu):
    """Error inversely proportional to the spring; at 1e6 E/h both answers agree to 1e-4."""
    layer = Layer(1.5 / H, nu, 0.4)
    exact = in_band(lambdas(exact_modes(layer.k, layer.nu, layer.mu)))
    worst = []
    for factor in (1e2, 1e4, 1e6):
        K, M, smooth = penalised(layer, 12, factor * E / H)
        frequency, growth = match(solved(K, M, smooth).s, exact)
        worst.append([frequency.max(), growth.max()])
    worst = np.array(worst)
    assert np.all(worst[2] < [1e-5, 1e-3]), worst
    assert np.all(np.abs(np.log10(worst[:-1] / worst[1:]) - 2) < 0.3), worst

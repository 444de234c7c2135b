"""Height distributions: the matched moments, density and quantiles of one and the same law."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.surface.hdf import Measured, kernel_density, match_moments, moments

CASES = [(-0.2410, 3.6549), (0.0, 3.0), (-0.25, 1.88), (1.0, 4.9), (2.0, 12.0), (0.17, 2.81)]


@pytest.mark.parametrize(("S_sk", "S_ku"), CASES)
def test_density_has_the_moments(S_sk, S_ku):
    """Integrals of the density itself, independent of how the parameters were found."""
    hdf = match_moments(2.0, S_sk, S_ku)
    low, high = hdf.ppf(np.array([1e-13, 1 - 1e-13]))
    z = np.linspace(low, high, 400_001)
    p = hdf.pdf(z)
    found = [np.sum(p * (z / 2.0) ** n) * (z[1] - z[0]) for n in range(5)]
    np.testing.assert_allclose(found, [1.0, 0.0, 1.0, S_sk, S_ku], atol=2e-4 * S_ku)


@pytest.mark.parametrize(("S_sk", "S_ku"), CASES)
def test_quantiles_invert_the_distribution(S_sk, S_ku):
    hdf = match_moments(33e-6, S_sk, S_ku)
    u = np.linspace(0.01, 0.99, 8)
    z = hdf.ppf(u)
    shares = [quad(hdf.pdf, a, b, epsabs=1e-10)[0] for a, b in pairwise(z)]
    np.testing.assert_allclose(shares, np.diff(u), rtol=1e-7)


@settings(max_examples=15, deadline=None)
@given(st.floats(-2.5, 2.5), st.floats(0.05, 15.0))
def test_every_possible_pair_of_moments_is_matched(S_sk, above):
    S_ku = 1.0 + S_sk**2 + above
    hdf = match_moments(1.0, S_sk, S_ku)
    assume(S_ku < 7.0)  # the tail beyond carries too much of the fourth moment to integrate
    u = (np.arange(500_000) + 0.5) / 500_000
    mean, S_q, skew, kurt = moments(hdf.ppf(u))
    assert abs(mean) < 1e-4 and S_q == pytest.approx(1.0, abs=2e-3)
    assert skew == pytest.approx(S_sk, abs=0.02)
    assert kurt == pytest.approx(S_ku, rel=0.03)


def test_samples_scatter_and_follow_the_law():
    """Another seed gives another highest summit; the mean over seeds has the moments."""
    hdf = match_moments(33.1e-6, -0.2410, 3.6549)
    rngs = np.random.default_rng(0).spawn(2) if hasattr(np.random.Generator, "spawn") else [
        np.random.default_rng(s) for s in (1, 2)
    ]  # fmt: skip
    a, b = (hdf.sample(16384, rng) for rng in rngs)
    assert abs(a.max() - b.max()) > 1e-7
    _, S_q, S_sk, S_ku = moments(hdf.sample(2_000_000, np.random.default_rng(3)))
    assert S_q == pytest.approx(33.1e-6, rel=2e-3)
    assert S_sk == pytest.approx(-0.2410, abs=0.01)
    assert S_ku == pytest.approx(3.6549, abs=0.04)


def test_measured_heights_come_back():
    z = np.sort(np.random.default_rng(0).gamma(2.0, 1.0, 4000))
    hdf = Measured(z)
    np.testing.assert_allclose(hdf.ppf((np.arange(4000) + 0.5) / 4000), z)
    _, S_q, S_sk, _ = moments(hdf.sample(400_000, np.random.default_rng(1)))
    assert S_q == pytest.approx(hdf.S_q, rel=0.01)
    assert S_sk == pytest.approx(moments(z)[2], rel=0.03)


def test_kernel_density_of_a_normal_sample():
    z = np.random.default_rng(0).standard_normal(20_000)
    x = np.linspace(-2, 2, 21)
    exact = np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi)
    np.testing.assert_allclose(kernel_density(z, x), exact, rtol=0.06)


def test_moments_of_a_flat_surface():
    assert moments(np.full(10, 0.1)) == (pytest.approx(0.1), 0.0, 0.0, 3.0)


@pytest.mark.parametrize(
    ("S_q", "S_sk", "S_ku"),
    [(0.0, 0.0, 3.0), (-1.0, 0.0, 3.0), (1.0, 1.0, 2.0), (1.0, 0.0, 0.9), (np.nan, 0.0, 3.0)],
)
def test_impossible_moments(S_q, S_sk, S_ku):
    with pytest.raises(SurfaceError, match="S_ku"):
        match_moments(S_q, S_sk, S_ku)


def test_flat_heights_have_no_density():
    with pytest.raises(SurfaceError, match="flat"):
        kernel_density(np.ones(5), np.zeros(2))

"""Areal parameters against closed forms on surfaces that are known exactly."""

import numpy as np
import pytest
from scipy.special import ellipe

from brake_fenicsx.surface import make_topography
from brake_fenicsx.surface.iso25178 import bearing_curve, iso_parameters

SIZE, SHAPE = (2e-3, 1.5e-3), (1000, 600)
A, WAVES = 5e-6, 8


@pytest.fixture(scope="module")
def wave():
    """A sin(k x), whole waves."""
    x = (np.arange(SHAPE[0]) + 0.5) / SHAPE[0]
    z = np.repeat(A * np.sin(2 * np.pi * WAVES * x)[:, None], SHAPE[1], axis=1)
    return make_topography(z, SIZE)


def test_a_wave_has_the_parameters_of_a_sine(wave):
    found, k = iso_parameters(wave), 2 * np.pi * WAVES / SIZE[0]
    assert found["S_a"] == pytest.approx(2 * A / np.pi, rel=1e-4)
    assert found["S_p"] == pytest.approx(A, rel=1e-3)
    assert found["S_v"] == pytest.approx(A, rel=1e-3)
    assert found["S_z"] == pytest.approx(2 * A, rel=1e-3)
    assert found["S_dq"] == pytest.approx(A * k / np.sqrt(2), rel=2e-3)
    # Length of the sine over a wave: a complete elliptic integral of the second kind.
    assert found["S_dr"] == pytest.approx(2 / np.pi * ellipe(-((A * k) ** 2)) - 1, rel=4e-3)
    # Of the overlap of two finite pieces, which is no whole number of waves.
    assert found["S_al"] == pytest.approx(np.arccos(0.2) / k, rel=0.02)
    # Along the crests the autocorrelation never falls.
    assert np.isnan(found["S_tr"])


def test_bearing_curve_of_a_wave_is_a_cosine(wave):
    share, height = bearing_curve(wave.heights)
    assert share[[0, -1]].tolist() == [0.0, 1.0]
    assert height == pytest.approx(A * np.cos(np.pi * share), abs=0.01 * A)


@pytest.mark.parametrize(("ratio", "n"), [(1.0, 1), (0.4, 2)])
def test_autocorrelation_of_a_random_surface_falls_where_its_spectrum_says(ratio, n):
    """Gaussian autocorrelation exp(-(x/a)^2 - (y/b)^2): 0.2 at a sqrt(ln 5), whatever is masked."""
    b = 20e-6
    a, shape = b * ratio, (1024, 1024)
    size = np.array([2e-3, 2e-3])
    k = [2 * np.pi * np.fft.fftfreq(m, length / m) for m, length in zip(shape, size, strict=True)]
    filtered = np.exp(-((a * k[0][:, None]) ** 2 + (b * k[1]) ** 2) / 8)
    noise = np.random.default_rng(n).standard_normal(shape)
    z = 1e-6 * np.fft.ifft2(np.fft.fft2(noise) * filtered).real
    z[100:130, 200:260] = np.nan
    found = iso_parameters(make_topography(z, size))
    assert found["S_al"] == pytest.approx(a * np.sqrt(np.log(5)), rel=0.05)
    assert found["S_tr"] == pytest.approx(ratio, abs=0.06)
    # Variance of the slopes of such a surface: 2 S_q^2 (1 / a^2 + 1 / b^2).
    S_q = np.nanstd(z)
    assert found["S_dq"] == pytest.approx(S_q * np.sqrt(2 / a**2 + 2 / b**2), rel=0.04)
    assert found["S_dr"] == pytest.approx(found["S_dq"] ** 2 / 2, rel=0.02)
    # Normal heights.
    assert found["S_a"] == pytest.approx(S_q * np.sqrt(2 / np.pi), rel=0.02)


def test_a_surface_without_roughness_has_no_decay_length():
    flat = iso_parameters(make_topography(np.zeros((32, 32)), (1e-3, 1e-3)))
    assert np.isnan(flat["S_al"]) and np.isnan(flat["S_tr"])
    assert flat["S_dr"] == flat["S_dq"] == flat["S_z"] == 0.0

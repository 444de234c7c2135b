"""Areal parameters against closed forms on surfaces that are known exactly."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import ellipe
from scipy.stats import norm

from brake_fenicsx.surface import make_topography
from brake_fenicsx.surface.hdf import bearing_curve, core_parameters, iso_parameters

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
    # Along the crests the autocorrelation never falls: as far as half of the scan reaches.
    longest = np.hypot(SIZE[1] / 2, found["S_al"])
    assert found["S_tr"] == pytest.approx(found["S_al"] / longest, rel=0.02)
    # Rays that reach the side before they have gone S_al across the crests.
    open_ = 2 / np.pi * np.arctan(found["S_al"] / (SIZE[1] / 2))
    assert found["S_tr_open"] == pytest.approx(open_, abs=0.01)


def test_bearing_curve_of_a_wave_is_a_cosine(wave):
    share, height = bearing_curve(wave.heights)
    assert share[[0, -1]].tolist() == [0.0, 1.0]
    assert height == pytest.approx(A * np.cos(np.pi * share), abs=0.01 * A)


def gaussian(a, b, shape, size, seed):
    """Heights with the autocorrelation exp(-(x/a)^2 - (y/b)^2)."""
    k = [2 * np.pi * np.fft.fftfreq(m, length / m) for m, length in zip(shape, size, strict=True)]
    filtered = np.exp(-((a * k[0][:, None]) ** 2 + (b * k[1]) ** 2) / 8)
    noise = np.random.default_rng(seed).standard_normal(shape)
    return 1e-6 * np.fft.ifft2(np.fft.fft2(noise) * filtered).real


@pytest.mark.parametrize(
    ("ratio", "points"), [(1.0, 15), (0.5, 15), (0.1, 100)], ids=["strip", "across", "grooves"]
)
def test_aspect_ratio_of_a_scan_shorter_than_the_decay_is_a_bound(ratio, points):
    """A cut whose half is shorter than b sqrt(ln 5): S_tr is no less than a / b, and says so."""
    b, pixel = 20e-6 if points < 50 else 200e-6, 2e-6
    z = gaussian(ratio * b, b, (8000, 500), (8000 * pixel, 500 * pixel), 3)[:, :points]
    found = iso_parameters(make_topography(z, (8000 * pixel, points * pixel)))
    assert points * pixel / 2 < b * np.sqrt(np.log(5))
    assert 0.8 * ratio < found["S_tr"] <= 1 and 0 < found["S_tr_open"] < 1
    assert found["S_al"] > 0.8 * ratio * b * np.sqrt(np.log(5))


@pytest.mark.parametrize(("ratio", "n"), [(1.0, 1), (0.4, 2)])
def test_autocorrelation_of_a_random_surface_falls_where_its_spectrum_says(ratio, n):
    """Gaussian autocorrelation exp(-(x/a)^2 - (y/b)^2): 0.2 at a sqrt(ln 5), whatever is masked."""
    b = 20e-6
    a, size = b * ratio, np.array([2e-3, 2e-3])
    z = gaussian(a, b, (1024, 1024), size, n)
    z[100:130, 200:260] = np.nan
    found = iso_parameters(make_topography(z, size))
    assert found["S_tr_open"] == 0
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


def core_of(curve):
    """S_k, S_pk, S_vk, S_mr1, S_mr2 of a bearing curve by quadrature; its core is named by hand."""
    height, (a, b) = curve
    # Straight line of least squares over the core: moments of the heights by quadrature.
    middle, width = (a + b) / 2, b - a
    mean = quad(height, a, b)[0] / width
    slope = quad(lambda m: (m - middle) * height(m), a, b)[0] / (width**3 / 12)
    upper = mean - slope * middle
    lower = upper + slope
    first = brentq(lambda m: height(m) - upper, 1e-12, middle)
    second = brentq(lambda m: height(m) - lower, middle, 1 - 1e-12)
    peaks = quad(lambda m: height(m) - upper, 0, first)[0]
    valleys = quad(lambda m: lower - height(m), second, 1)[0]
    return upper - lower, 2 * peaks / first, 2 * valleys / (1 - second), first, second


NAMES = ("S_k", "S_pk", "S_vk", "S_mr1", "S_mr2")


def test_a_straight_bearing_curve_is_all_core():
    heights = A * np.random.default_rng(0).permutation(np.linspace(-1, 1, 90000)).reshape(300, 300)
    found = core_parameters(heights)
    assert found["S_k"] == pytest.approx(2 * A, rel=1e-4)
    assert [found[n] for n in NAMES[1:]] == pytest.approx([0, 0, 0, 1], abs=1e-9)


def test_core_of_a_normal_surface():
    """Quantiles of the normal distribution; its curve is least steep about the middle."""
    n = 200_000
    found = core_parameters(norm.ppf((np.arange(n) + 0.5) / n))
    expected = core_of((lambda m: norm.ppf(1 - m), (0.3, 0.7)))
    assert [found[name] for name in NAMES] == pytest.approx(expected, rel=1e-3)
    # The symmetry of the distribution.
    assert found["S_pk"] == pytest.approx(found["S_vk"], rel=1e-3)
    assert found["S_mr1"] + found["S_mr2"] == pytest.approx(1, abs=1e-4)
    # Independent heights: the place of the core scatters, the parameters hardly do.
    drawn = core_parameters(np.random.default_rng(1).standard_normal((600, 600)))
    assert [drawn[name] for name in NAMES] == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("holes", [0, 5000])
def test_core_of_a_plateau_with_valleys(holes):
    """A straight core of 80 %, valleys with a straight curve of depth D: S_vk is D, S_mr2 is 0.8.

    Points without a height change nothing.
    """
    n, share, D = 100_000, 0.8, 20e-6
    core = np.linspace(A, -A, int(share * n))
    end = A - 2 * A / share  # the line of the core, at the ratio 1
    valleys = end - np.linspace(0, D, n - core.size)
    z = np.random.default_rng(2).permutation(np.concatenate([core, valleys, holes * [np.nan]]))
    found = core_parameters(z)
    assert found["S_k"] == pytest.approx(2 * A / share, rel=1e-4)
    assert found["S_vk"] == pytest.approx(D, rel=1e-3)
    assert found["S_mr2"] == pytest.approx(share, abs=1e-4)
    assert (found["S_pk"], found["S_mr1"]) == (0.0, 0.0)


@pytest.mark.parametrize("heights", [np.zeros((8, 8)), np.array([[0.0, 1.0]])])
def test_core_of_surfaces_of_few_heights(heights):
    """A flat surface has none; two heights are a core."""
    found = core_parameters(heights)
    assert all(np.isfinite(v) for v in found.values())
    assert found["S_pk"] == found["S_vk"] == 0.0 and found["S_mr2"] == 1.0
    assert found["S_k"] == pytest.approx(2 * np.ptp(heights))

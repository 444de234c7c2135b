"""From scan to statistics: what is reported of a scan, and how sure it is."""

import numpy as np
import pytest

from brake_fenicsx.surface import characterise, given_statistics, make_topography, synthesise
from brake_fenicsx.surface.hdf import Johnson

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)


def short_waved(seed, n=128):
    """A surface whose longest wave is a tenth of the scan."""
    rng = np.random.default_rng(seed)
    k = np.hypot(np.fft.fftfreq(n, 1 / n)[:, None], np.fft.rfftfreq(n, 1 / n))
    amplitude = np.where((k >= 10) & (k < 40), 1.0, 0.0)
    h = np.fft.irfft2(amplitude * np.fft.rfft2(rng.standard_normal((n, n))), s=(n, n))
    return make_topography(h * 1e-6 / h.std() + 5e-6, (1e-3, 1e-3))


def test_scan_with_tilt_noise_and_holes():
    """Everything an instrument adds is taken off or counted, and the statistics return."""
    rng = np.random.default_rng(1)
    size = (5.65e-3, 5.65e-3)
    clean = synthesise(PAPER.bifractal, PAPER.hdf, (256, 256), size, rng, "extend", "scan").heights
    h = clean + 7e-6 + 3e-3 * np.linspace(-1, 1, 256)[:, None] * 2e-3
    h += rng.normal(0.0, 20e-9, h.shape)
    h[10:14, 200:205] = np.nan
    h[100, 100] += 2e-3
    stats = characterise(make_topography(h, size))
    assert stats.missing == 20 and stats.outliers == 1 and stats.level == "plane"
    bare = characterise(make_topography(clean, size))
    assert stats.mean == pytest.approx(7e-6, abs=0.01e-6)
    assert stats.median - stats.mean == pytest.approx(bare.median - bare.mean, abs=0.01e-6)
    assert stats.S_q == pytest.approx(bare.S_q, rel=1e-3)
    assert stats.S_sk == pytest.approx(bare.S_sk, abs=5e-3)
    assert stats.S_ku == pytest.approx(bare.S_ku, abs=5e-3)
    assert stats.bifractal.c1 == pytest.approx(bare.bifractal.c1, abs=0.02)
    assert stats.bifractal.c2 == pytest.approx(bare.bifractal.c2, abs=0.02)
    # Levelling also takes the tilt of the longest waves: less than is lost by no scan.
    assert 0.8 * 33.1e-6 < bare.S_q < 33.1e-6
    assert abs(stats.heights.mean()) < 1e-18 and stats.heights.size == 256 * 256 - 21


def test_standard_errors_of_the_moments_are_honest():
    """Blocks left out in turn say how far one scan scatters from the next."""
    all_ = [characterise(short_waved(seed), level="mean") for seed in range(25)]
    found = np.array([(s.mean, s.S_q, s.S_sk, s.S_ku) for s in all_]).std(axis=0)
    told = np.median([s.errors for s in all_], axis=0)
    # The mean of a surface without long waves is fixed by its spectrum: no scatter to compare.
    ratio = told[2:] / found[2:]
    assert np.all((ratio > 0.6) & (ratio < 1.7)), ratio


def test_numbers_alone_are_statistics_too():
    assert (PAPER.S_q, PAPER.S_sk, PAPER.S_ku) == (33.1e-6, -0.2410, 3.6549)
    assert PAPER.psd is None and PAPER.topography is None
    band = PAPER.bifractal.band
    assert PAPER.bifractal.variance(*band) == pytest.approx(33.1e-6**2, rel=1e-12)
    assert isinstance(PAPER.hdf, Johnson)


def test_second_order_form_is_removed():
    x = np.linspace(-1, 1, 128)
    topo = short_waved(3)
    bowl = make_topography(topo.heights + 50e-6 * np.add.outer(x**2, -(x**2)), topo.size)
    plane, second = characterise(bowl), characterise(bowl, level="second-order")
    assert plane.S_q > 10e-6
    (text,) = [t for t in plane.warnings if "bow" in t]
    assert "100% of the variance" in text and 'surface.level = "second-order"' in text
    assert second.S_q == pytest.approx(1e-6, rel=0.01) and second.curvature < 1e-6
    assert not any("bow" in t for t in (*second.warnings, *characterise(topo).warnings))


def test_pixels_of_the_scan_above_a_separation():
    """Counted on the scan in the measure of surfaces that are twice as rough."""
    stats = characterise(short_waved(0))
    for share in (0.5, 0.9, 0.999):
        height = 2 * np.quantile(stats.heights, share)
        count = stats.pixels_above(height, 2 * stats.S_q)
        assert count == pytest.approx((1 - share) * stats.heights.size, abs=2)
    assert stats.pixels_above(1.0, stats.S_q) == 0

"""Translation fields: closed form of the mapped correlation, spectrum, heights, summits."""

import numpy as np
import pytest

from brake_fenicsx.surface import given_statistics, synthesise
from brake_fenicsx.surface.hdf import match_moments, moments
from brake_fenicsx.surface.psd import half_plane_weights, psd_2d, wave_numbers
from brake_fenicsx.surface.synthesis import expansion

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
SIZE = (2.825e-3, 2.825e-3)


def mapped_correlation(hdf, r):
    """Correlation of the mapped heights where that of the Gaussian field is r."""
    return np.polynomial.polynomial.polyval(r, expansion(hdf, np.linspace(-7, 7, 8001))[1])


def made(seeds, n=64, stats=PAPER, hdf=None):
    return [
        synthesise(stats.bifractal, hdf or stats.hdf, (n, n), SIZE, np.random.default_rng(seed))
        for seed in seeds
    ]


@pytest.mark.parametrize("sigma", [0.3, 0.6])
def test_correlation_of_the_lognormal_distribution(sigma):
    """Closed form: (exp(sigma^2 r) - 1) / (exp(sigma^2) - 1)."""

    class Lognormal:
        S_q = 1.0

        def ppf(self, u):
            from scipy.special import ndtri

            return np.exp(sigma * ndtri(u))

    r = np.linspace(-1, 1, 21)
    wanted = np.expm1(sigma**2 * r) / np.expm1(sigma**2)
    np.testing.assert_allclose(mapped_correlation(Lognormal(), r), wanted, atol=1e-8)


def test_normal_heights_keep_their_correlation():
    r = np.linspace(-1, 1, 11)
    np.testing.assert_allclose(mapped_correlation(match_moments(1.0), r), r, atol=1e-10)


@pytest.mark.parametrize("shape", [(-0.241, 3.6549), (-1.0, 6.0), (0.0, 3.0), (0.5, 2.5)])
def test_mean_spectrum_and_distribution_of_a_family(shape):
    """400 surfaces: density of every ring within its standard error, moments of all heights."""
    stats = given_statistics(33.1e-6, *shape)
    surfaces = made(range(400), 48, stats)
    assert surfaces[0].record.psd_error < 1e-3
    q = wave_numbers((48, 48), np.array(SIZE))
    ring = np.rint(q / q[q > 0].min()).astype(int).ravel()
    weights = np.broadcast_to(half_plane_weights((48, 48)), q.shape).ravel()
    powers = [np.bincount(ring, weights * psd_2d(s).ravel()) for s in surfaces]
    wanted = np.bincount(ring, weights * stats.bifractal(q, "flat").ravel())[1:]
    mean, error = np.mean(powers, axis=0)[1:], np.std(powers, axis=0)[1:] / np.sqrt(400)
    assert np.abs(mean - wanted).max() < 5 * np.max(error / wanted) * wanted.max()
    assert np.all(np.abs(mean - wanted) < 5 * error)
    _, S_q, S_sk, S_ku = moments(np.concatenate([s.heights.ravel() for s in surfaces]))
    assert S_q == pytest.approx(surfaces[0].record.S_q, rel=0.02)
    assert S_sk == pytest.approx(shape[0], abs=0.08) and S_ku == pytest.approx(shape[1], abs=0.3)


def test_highest_summit_does_not_rise_with_the_pixels():
    """128 to 512 pixels: by less than 0.1 S_q; independent heights by that of 16 times as many."""
    tops = {}
    for n in (128, 512):
        tops[n] = np.mean([s.heights.max() / s.record.S_q for s in made(range(24), n)])
    iid = {n: np.mean([PAPER.hdf.sample(n * n, np.random.default_rng(s)).max() for s in range(8)])
           for n in (128, 512)}  # fmt: skip
    assert (iid[512] - iid[128]) / PAPER.S_q > 0.8
    assert abs(tops[512] - tops[128]) < 0.45 * (iid[512] - iid[128]) / PAPER.S_q

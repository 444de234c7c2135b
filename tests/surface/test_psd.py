"""Spectrum: Parseval, its radial mean, its anisotropy, and the recovery of known parameters."""

import numpy as np
import pytest
import scipy.fft
from hypothesis import given, settings
from hypothesis import strategies as st

from brake_fenicsx.errors import SceneError, SurfaceError
from brake_fenicsx.surface import (
    characterise,
    fit_bifractal,
    given_statistics,
    make_topography,
    radial_psd,
)
from brake_fenicsx.surface import psd as psd_module
from brake_fenicsx.surface.psd import (
    RadialPsd,
    cosine_psd,
    half_plane_weights,
    psd_2d,
    radial_mean,
    seen_in_scans,
    wave_numbers,
)
from brake_fenicsx.surface.spectrum import BiFractal
from brake_fenicsx.surface.topography import form

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)


def random_surface(psd, n, length, rng, imposed=False):
    """Gaussian surface with random or imposed amplitudes, without the program's own synthesis."""
    q = 2 * np.pi * np.hypot(np.fft.fftfreq(n, length / n)[:, None], np.fft.rfftfreq(n, length / n))
    white = scipy.fft.rfft2(rng.standard_normal((n, n)))
    white = n * white / np.abs(white) if imposed else white
    density = np.where(q > 0, psd(np.where(q > 0, q, 1.0)), 0.0)
    return scipy.fft.irfft2(white * np.sqrt(density) * 2 * np.pi * n / length, s=(n, n))


@settings(max_examples=25, deadline=None)
@given(st.integers(2, 21), st.integers(2, 21), st.integers(0, 10**6))
def test_parseval(nx, ny, seed):
    """Sum of C over the wave vectors is the variance, for even and odd grids."""
    h = np.random.default_rng(seed).standard_normal((nx, ny))
    topo = make_topography(h, (1.3e-3, 0.7e-3), periodic=True)
    cell = (2 * np.pi) ** 2 / np.prod(topo.size)
    total = np.sum(psd_2d(topo) * half_plane_weights((nx, ny))) * cell
    assert total == pytest.approx(h.var(), rel=1e-12)


def test_single_wave_stands_at_its_wave_number():
    """cos(qx) of amplitude a has the variance a^2 / 2, all of it at q."""
    n, length, a = 64, 2e-3, 3e-6
    x = np.arange(n) / n
    h = np.repeat(a * np.cos(2 * np.pi * 5 * x)[:, None], n, axis=1)
    topo = make_topography(h, (length, length), periodic=True)
    C, q = psd_2d(topo), wave_numbers((n, n), topo.size)
    np.testing.assert_allclose(q[1e-3 * C.max() < C], 2 * np.pi * 5 / length, rtol=1e-12)
    cell = (2 * np.pi / length) ** 2
    assert np.sum(C * half_plane_weights((n, n))) * cell == pytest.approx(a**2 / 2, rel=1e-12)


@pytest.mark.parametrize("density", [psd_2d, cosine_psd])
def test_a_cut_keeps_the_level(density):
    """A cut of a white surface has the density of the surface, by both ways."""
    rng = np.random.default_rng(0)
    h = rng.standard_normal((256, 200))
    topo = make_topography(h, (256e-6, 200e-6))
    expected = 1e-12 / (4 * np.pi**2)  # variance 1 spread over (2 pi / pixel)^2
    inner = density(topo)[10:120, 10:]
    assert inner.mean() == pytest.approx(expected, rel=0.02)


def test_cosine_waves_hold_the_variance_and_weigh_all_points_alike():
    """Parseval; a single high pixel adds the same variance wherever it lies."""
    shape, size = (31, 22), np.array([1.3e-3, 0.7e-3])
    cell = (2 * np.pi) ** 2 / np.prod(size)
    for place in ((0, 0), (15, 11), (30, 3)):
        h = np.zeros(shape)
        h[place] = 1e-6
        total = cosine_psd(make_topography(h, size)).sum() * cell
        assert total == pytest.approx(h.var(), rel=1e-12)


@pytest.mark.parametrize("shape", [(7, 5), (6, 9)])
def test_what_scans_show_of_a_spectrum_is_the_mean_square_of_their_cosine_waves(shape):
    """The closed form against the covariance matrix of all points of small scans."""
    (n, m), size = shape, np.array([1.0, 0.8])
    kx, ky = (np.pi * np.arange(k + 1) / side for k, side in zip(shape, size, strict=True))
    C = 1 / (1 + np.hypot(kx[:, None], ky) ** 2)
    # Correlation of the surface of twice the sides: the sum over its wave vectors.
    x, y = np.arange(n) * size[0] / n, np.arange(m) * size[1] / m
    wave = [np.where(np.isin(np.arange(k + 1), (0, k)), 1, 2) for k in shape]
    R = np.einsum(
        "ij,i,j,ix,jy->xy", C, *wave, np.cos(np.outer(kx, x)), np.cos(np.outer(ky, y))
    ) * np.pi**2 / np.prod(size)  # fmt: skip
    dx, dy = (np.abs(np.subtract.outer(np.arange(k), np.arange(k))) for k in shape)
    covariance = R[dx[:, None, :, None], dy[None, :, None, :]].reshape(n * m, n * m)
    waves = [scipy.fft.dctn(e.reshape(shape), norm="ortho").ravel() for e in np.eye(n * m)]
    square = np.einsum("ik,ij,jk->k", waves, covariance, waves).reshape(shape)
    square *= np.prod(size) / (4 * np.pi**2 * n * m)
    topo = make_topography(np.arange(n * m).reshape(shape), size)
    seen = seen_in_scans(lambda q: 1 / (1 + q**2), topo)
    np.testing.assert_allclose(seen, radial_mean(square, topo)[1], rtol=1e-10)


@pytest.mark.parametrize("shape", [(300, 300), (400, 260)])
def test_groups_of_waves_show_what_every_wave_by_itself_shows(monkeypatch, shape):
    """Rings of a spectrum over two decades: 2e-3 at worst and 4e-4 rms; 2.5 % with wide groups."""
    topo = make_topography(np.zeros(shape) + np.arange(shape[1]), (1.8e-3, 1.4e-3))
    seen = {}
    for width in (1 / 48, 1 / 16, 1 / max(shape)):  # in the last every wave stands alone
        monkeypatch.setattr(psd_module, "GROUP", width)
        psd_module._groups.cache_clear()
        seen[width] = seen_in_scans(lambda q: PAPER.bifractal(q, "flat"), topo)
    psd_module._groups.cache_clear()
    exact = seen.pop(1 / max(shape))
    usual, wide = (np.abs(found / exact - 1) for found in seen.values())
    assert usual.max() < 2e-3 and np.sqrt(np.mean(usual**2)) < 4e-4
    assert wide.max() > 2 * usual.max()


def test_radial_integral_is_the_variance_of_the_model():
    """2 pi int C q dq of the broken power law against quadrature."""
    psd = PAPER.bifractal
    q = np.geomspace(*psd.band, 200_001)
    C = psd(q)
    numeric = 2 * np.pi * np.sum(0.5 * (C[1:] * q[1:] + C[:-1] * q[:-1]) * np.diff(q))
    assert psd.variance(*psd.band) == pytest.approx(numeric, rel=1e-7)
    assert numeric == pytest.approx(33.1e-6**2, rel=1e-7)


def test_model_below_the_band():
    psd = BiFractal(-2.0, -4.5, 1e4, 1.0, (1e3, 1e6))
    q = np.array([0.0, 100.0, 1e3, 1e4, 1e5])
    np.testing.assert_allclose(psd(q), [0.0, 1e4, 100.0, 1.0, 10**-4.5])
    np.testing.assert_allclose(psd(q, "flat"), [0.0, 100.0, 100.0, 1.0, 10**-4.5])
    with pytest.raises(SceneError, match="extend"):
        psd(q, "none")


def test_fit_returns_an_exact_broken_line():
    q = np.geomspace(1e3, 1e6, 40)
    truth = BiFractal(-1.2, -4.0, 2.3e4, 5e-20, (900.0, 1.1e6))
    fit = fit_bifractal(RadialPsd(q, truth(q), np.full(40, 1e-9), truth.band))
    np.testing.assert_allclose(
        [fit.c1, fit.c2, fit.q_c, fit.C0], [-1.2, -4.0, 2.3e4, 5e-20], rtol=1e-5
    )
    assert fit.rms < 1e-6


@pytest.mark.parametrize("c1", [-2.0, -0.8])
@pytest.mark.parametrize("n", [128, pytest.param(512, marks=pytest.mark.slow)])
def test_recovery_from_artificial_surfaces(n, c1):
    """20 seeds, imposed amplitudes: slopes to 0.05, q_c to 5 %, S_q to 2 %."""
    given_ = given_statistics(33.1e-6, -0.2410, 3.6549, c1=c1, c2=-4.0, q_c=25e3)
    found = []
    for seed in range(20 if n == 128 else 4):
        h = random_surface(given_.bifractal, n, 2.825e-3, np.random.default_rng(seed), True)
        h *= 33.1e-6 / h.std()
        stats = characterise(make_topography(h, (2.825e-3, 2.825e-3), periodic=True))
        fit = stats.bifractal
        found.append([fit.c1 - c1, fit.c2 + 4.0, fit.q_c / 25e3 - 1, stats.S_q / 33.1e-6 - 1])
    worst = np.abs(found).max(axis=0)
    assert np.all(worst < [0.05, 0.05, 0.05, 0.02]), worst


def test_recovery_from_random_amplitudes_without_bias():
    """20 seeds of an independent generator: the means return, each within its standard errors."""
    psd, found, errors = PAPER.bifractal, [], []
    for seed in range(20):
        h = random_surface(psd, 512, 5.65e-3, np.random.default_rng(seed))
        fit = fit_bifractal(radial_psd(make_topography(h, (5.65e-3, 5.65e-3), periodic=True)))
        found.append([fit.c1 + 2.0, fit.c2 + 4.5, np.log(fit.q_c / 30e3), np.log(fit.C0 / psd.C0)])
        errors.append(fit.errors)
    found, errors = np.array(found), np.array(errors)
    assert np.all(np.abs(found.mean(axis=0))[:3] < [0.05, 0.05, 0.05]), found.mean(axis=0)
    # Standard errors are honest: the scatter over seeds is what they say, within a factor 1.6.
    ratio = found.std(axis=0) / errors.mean(axis=0)
    assert np.all((ratio > 1 / 1.6) & (ratio < 1.6)), ratio


def test_recovery_from_cuts_without_bias():
    """Windowed, levelled cuts of a larger surface: the means over 20 seeds return."""
    found = []
    for seed in range(20):
        h = random_surface(PAPER.bifractal, 768, 8.475e-3, np.random.default_rng(seed))
        tilted = make_topography(h[:512, :512] + 1e-6 * np.arange(512)[:, None], (5.65e-3,) * 2)
        cut = make_topography(tilted.heights - form(tilted, "plane"), tilted.size)
        fit = fit_bifractal(radial_psd(cut))
        found.append([fit.c1 + 2.0, fit.c2 + 4.5, np.log(fit.q_c / 30e3)])
    mean = np.abs(np.mean(found, axis=0))
    error = np.std(found, axis=0) / np.sqrt(20)
    assert np.all(mean < 0.02 + 3 * error), (mean, error)
    assert np.all(error < [0.05, 0.01, 0.015])


def test_noise_ends_the_reliable_band():
    """White noise on a cut lowers the band's upper end, and the slope above q_c survives."""
    rng = np.random.default_rng(3)
    h = random_surface(PAPER.bifractal, 768, 5.4e-3, rng)[:384, :384]
    clean = make_topography(h, (2.7e-3, 2.7e-3))
    noisy = make_topography(h + 2e-6 * rng.standard_normal(h.shape), (2.7e-3, 2.7e-3))
    ends = [radial_psd(t).band[1] for t in (clean, noisy)]
    assert ends[1] < 0.7 * ends[0]
    assert characterise(noisy).bifractal.c2 == pytest.approx(-4.5, abs=0.25)


def test_instrument_cutoff_ends_the_band():
    h = np.random.default_rng(0).standard_normal((64, 64))
    topo = make_topography(h, (64e-6, 64e-6), periodic=True)
    assert radial_psd(topo, cutoff=8e-6).band[1] == pytest.approx(2 * np.pi / 8e-6)


def test_too_few_rings_are_named():
    topo = make_topography(np.random.default_rng(0).standard_normal((6, 6)), (1.0, 1.0))
    with pytest.raises(SurfaceError, match="rings"):
        fit_bifractal(radial_psd(topo))


@pytest.mark.parametrize("K", [1, 4, 16])
def test_the_mean_of_k_spectra_is_as_much_closer_to_the_truth(K):
    """Gaussian fields of a known spectrum: the density at a wave vector is exponential.

    The squared relative error of the mean of K is 1 / K, with the variance (2 + 6 / K) / K^2; so
    much does their mean over M independent wave vectors scatter.
    """
    n, length = 96, 1e-3
    size = np.array([length, length])
    q = wave_numbers((n, n), size)
    C = given_statistics(1e-6, c1=-1.0, c2=-3.0, q_c=5e4).bifractal(q)
    amplitude = np.sqrt(C * 4 * np.pi**2 / length**2) * n
    rng = np.random.default_rng(11)
    scans = [
        make_topography(
            np.fft.irfft2(np.fft.rfft2(rng.standard_normal((n, n))) * amplitude, s=(n, n)),
            size, periodic=True,
        )
        for _ in range(K)
    ]  # fmt: skip
    ratio = (psd_2d(scans)[:, 1 : n // 2] / C[:, 1 : n // 2]).ravel()
    scatter = np.sqrt((2 + 6 / K) / ratio.size)
    assert K * np.mean((ratio - 1) ** 2) == pytest.approx(1, abs=5 * scatter)
    # What a ring says of its own scatter, from which the fit has its weights.
    rings, first = radial_psd(scans), radial_psd(scans[0])
    said = np.median(rings.scatter / first.scatter)
    assert said == pytest.approx(1 / K, abs=5 * scatter / K + 5 * np.sqrt(8 / ratio.size) / K)
    inside = rings.reliable
    truth = given_statistics(1e-6, c1=-1.0, c2=-3.0, q_c=5e4).bifractal(rings.q[inside])
    chi = np.mean((rings.C[inside] / truth - 1) ** 2 / rings.scatter[inside])
    assert chi < 1 + 5 * np.sqrt(2 / inside.sum())


@pytest.mark.parametrize("shape", [(96, 96), (80, 117)])
def test_mean_of_scans_is_what_scans_show_of_their_spectrum(shape):
    """200 cuts of Gaussian surfaces whose spectrum has a gap of a factor 100 in half an octave."""
    psd = given_statistics(1e-6, c1=-1.0, c2=-3.0, q_c=5e4).bifractal

    def gapped(q):
        gap = np.exp(-((np.log(np.maximum(q, 1.0) / 5e4) / 0.3) ** 2))
        return psd(q, "flat") * 0.01**gap

    n, pixel = 256, 1e-5
    scans = []
    for seed in range(50):
        h = random_surface(gapped, n, n * pixel, np.random.default_rng(seed))
        for i in (0, n // 2):
            for j in (0, n // 2):
                part = np.roll(h, (-i, -j), (0, 1))[: shape[0], : shape[1]]
                scans.append(make_topography(part, (shape[0] * pixel, shape[1] * pixel)))
    found = radial_psd(scans)
    seen = seen_in_scans(gapped, scans[0])
    inside = found.reliable
    error = np.sqrt(found.scatter[inside])
    miss = np.abs(found.C[inside] / seen[inside] - 1) / error
    assert np.sqrt(np.mean(miss**2)) < 1.6 and miss.max() < 5
    # The ends of the scan fill the gap: what is seen is not the spectrum of the surface.
    assert np.max(seen[inside] / gapped(found.q[inside])) > 2

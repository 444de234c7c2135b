"""Artificial surfaces: heights and spectrum both imposed, errors reported, seeds obeyed."""

import numpy as np
import pytest

from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.surface import characterise, given_statistics, radial_psd, synthesise
from brake_fenicsx.surface.hdf import Measured, moments
from brake_fenicsx.surface.psd import half_plane_weights, psd_2d, wave_numbers

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
SIZE = (2.825e-3, 2.825e-3)


PROJECTION = {"method": "projection", "tolerance": 4e-3, "low": "extend"}


def make(seed=0, n=128, stats=PAPER, size=SIZE, **settings):
    rng = np.random.default_rng(seed)
    return synthesise(stats.bifractal, stats.hdf, (n, n), size, rng, **(PROJECTION | settings))


def radial_error(topo, psd):
    """Rms over rings one grid step wide of C / target - 1, target scaled to the variance."""
    C, q = psd_2d(topo), wave_numbers(topo.shape, topo.size)
    weights = np.broadcast_to(half_plane_weights(topo.shape), C.shape)
    target = psd(q)
    target *= np.sum(weights * C) / np.sum(weights * target)
    ring = np.rint(q / q[q > 0].min()).astype(int)
    found, wanted = (np.bincount(ring.ravel(), (weights * a).ravel())[1:] for a in (C, target))
    return np.sqrt(np.mean((found / wanted - 1) ** 2))


@pytest.mark.parametrize("seed", range(10))
def test_spectrum_within_half_a_percent(seed):
    """Measured from the heights, not taken from the record; the record says the same."""
    topo = make(seed)
    error = radial_error(topo, PAPER.bifractal)
    assert error < 5e-3
    assert topo.record.psd_error == pytest.approx(error, rel=1e-6)


def test_heights_are_those_drawn():
    """The surface is a permutation of the sample of its own generator: all moments exact."""
    topo = make(5, variance="scan")
    drawn = PAPER.hdf.sample(128 * 128, np.random.default_rng(5))
    np.testing.assert_allclose(
        np.sort(topo.heights, axis=None), np.sort(drawn - drawn.mean()), atol=1e-18
    )
    found, wanted = moments(topo.heights.ravel()), moments(drawn)
    np.testing.assert_allclose(found[1:], wanted[1:], rtol=1e-10)
    assert topo.record.height_error < 1e-6


def test_errors_fall_with_the_iterations():
    record = make(1, tolerance=1e-9, max_iterations=30).record
    assert record.psd_errors[-1] < 0.05 * record.psd_errors[0]
    assert record.iterations <= 30


def test_highest_summit_differs_from_surface_to_surface():
    """Fixed quantiles would make z_max one number and kill the scatter of the laws."""
    tops = [make(seed).heights.max() for seed in range(12)]
    assert np.std(tops) > 0.05 * PAPER.S_q


def test_seeds_reproduce_and_differ():
    np.testing.assert_array_equal(make(3).heights, make(3).heights)
    assert np.abs(make(3).heights - make(4).heights).max() > PAPER.S_q


@pytest.mark.parametrize("n", [512, pytest.param(2048, marks=pytest.mark.slow)])
def test_larger_grids(n):
    topo = make(0, n)
    assert radial_error(topo, PAPER.bifractal) < 5e-3


def test_grids_that_are_not_square():
    topo = synthesise(
        PAPER.bifractal, PAPER.hdf, (96, 63), (3e-3, 1.7e-3), np.random.default_rng(0), **PROJECTION
    )
    assert topo.shape == (96, 63) and topo.periodic
    assert topo.record.psd_error < 0.02


def test_patch_longer_than_the_scan():
    """Waves the scan never saw: extended they carry a quarter of the variance, flat far less."""
    extend, flat = make(0, low="extend"), make(0, low="flat")
    assert 0.2 < extend.record.low_share < 0.35
    assert flat.record.low_share < 0.7 * extend.record.low_share
    assert extend.heights.std() > flat.heights.std() > 33.1e-6


@pytest.mark.parametrize("low", ["flat", "extend"])
def test_variance_follows_from_the_spectrum(low):
    """The variance is the sum of the density over the grid's wave vectors; nothing is rescaled."""
    topo = make(1, low=low)
    C = PAPER.bifractal(wave_numbers((128, 128), np.array(SIZE)), low)
    weights = half_plane_weights((128, 128))
    S_q = 2 * np.pi * np.sqrt(np.sum(weights * C) / np.prod(SIZE))
    assert topo.heights.std() == pytest.approx(S_q, rel=1e-9)
    assert topo.record.C0_scale == pytest.approx(1.0)
    moved = moments(topo.heights.ravel())
    drawn = PAPER.hdf.sample(128 * 128, np.random.default_rng(1))
    np.testing.assert_allclose(moved[2:], moments(drawn)[2:], rtol=1e-9)


@pytest.mark.parametrize("method", ["projection", "translation"])
def test_spectrum_in_the_measured_band_is_the_scans(method):
    """A patch twice as long as the scan: the same density in the band, in the mean of surfaces."""
    scan = make(3, 256, size=(1.8e-3, 1.8e-3), variance="scan")
    stats = characterise(scan)
    assert isinstance(stats.hdf, Measured)
    found = [
        radial_psd(
            synthesise(
                stats.bifractal, stats.hdf, (256, 256), (3.6e-3, 3.6e-3),
                np.random.default_rng(seed), method=method,
            )
        )
        for seed in range(12)
    ]  # fmt: skip
    q, C = found[0].q, np.mean([f.C for f in found], axis=0)
    inside = (q > stats.psd.band[0]) & (q < 0.9 * found[0].band[1])
    own = np.interp(np.log(q[inside]), np.log(stats.psd.q), np.log(stats.psd.C))
    assert abs(np.mean(np.log(C[inside]) - own)) < 0.08


def test_the_sources_reading_lies_below_the_scan():
    """Variance of the scan forced on a longer patch: the spectrum falls below that of the scan."""
    topo = make(0, low="extend", variance="scan")
    assert topo.heights.std() == pytest.approx(33.1e-6, rel=0.03)
    assert 0.6 < topo.record.C0_scale < 0.8
    assert topo.record.C0_scale < make(0, low="flat", variance="scan").record.C0_scale


def test_measured_heights_can_be_imposed():
    """Plateaus and pits of a worn pad, as measured, instead of a fitted formula."""
    rng = np.random.default_rng(0)
    z = np.sort(-rng.gamma(4.0, 1e-6, 5000))
    topo = synthesise(PAPER.bifractal, Measured(z - z.mean()), (128, 128), SIZE, rng)
    assert moments(topo.heights.ravel())[2] == pytest.approx(moments(z)[2], abs=0.05)
    assert topo.record.psd_error < 0.02 and topo.warnings == ()


def test_heights_that_contradict_the_spectrum_are_reported():
    """Two plateaus have steps between them; no such surface has slopes of -4.5."""
    rng = np.random.default_rng(0)
    z = np.sort(np.concatenate([rng.normal(-1, 0.1, 3000), rng.normal(2, 0.1, 1500)])) * 1e-6
    topo = synthesise(PAPER.bifractal, Measured(z - z.mean()), (64, 64), SIZE, rng, low="extend")
    assert topo.record.psd_error > 0.1
    assert len(topo.warnings) == 1 and "PSD missed" in topo.warnings[0]


def test_waves_the_scan_never_saw_are_named():
    """A steep spectrum extended below the scan is nearly all extrapolation: said, not hidden."""
    steep = given_statistics(1e-6, c1=-3.6, c2=-4.0, band=(5.2e3, 4e5))
    topo = make(0, 64, steep, low="extend")
    assert topo.record.low_share > 0.5
    assert len(topo.warnings) == 1 and "waves longer than those that the scan" in topo.warnings[0]
    flat = make(0, 64, steep, low="flat")
    assert flat.record.low_share < topo.record.low_share


def test_any_function_of_q_is_a_spectrum():
    topo = synthesise(
        lambda q: np.exp(-((q / 3e4) ** 2)), PAPER.hdf, (64, 64), SIZE, np.random.default_rng(0),
        method="projection",
    )  # fmt: skip
    assert topo.record.psd_error < 0.05


@pytest.mark.parametrize(
    "arguments",
    [
        {"shape": (1, 5), "size": SIZE},
        {"shape": (8, 8), "size": (0.0, 1.0)},
        {"shape": (8, 8), "size": SIZE, "psd": lambda q: 0.0 * q},
        {"shape": (8, 8), "size": SIZE, "low": "cut"},
        {"shape": (8, 8), "size": SIZE, "method": "stones"},
        {"shape": (8, 8), "size": SIZE, "variance": "any"},
    ],
)
def test_what_cannot_be_made(arguments):
    settings = {"psd": PAPER.bifractal, "hdf": PAPER.hdf, "rng": np.random.default_rng(0)}
    with pytest.raises(SurfaceError):
        synthesise(**(settings | arguments))

"""Artificial surfaces: heights and spectrum of a family, errors reported, seeds obeyed."""

import numpy as np
import pytest

from brake_fenicsx.errors import SceneError, SurfaceError
from brake_fenicsx.surface import characterise, given_statistics, radial_psd, synthesise
from brake_fenicsx.surface.hdf import Measured, moments
from brake_fenicsx.surface.psd import half_plane_weights, wave_numbers
from brake_fenicsx.surface.spectrum import BiFractal

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
SIZE = (2.825e-3, 2.825e-3)


def make(seed=0, n=128, stats=PAPER, size=SIZE, **settings):
    rng = np.random.default_rng(seed)
    return synthesise(
        stats.spectrum, stats.hdf, (n, n), size, rng, **({"low": "extend"} | settings)
    )


def test_seeds_reproduce_and_differ():
    np.testing.assert_array_equal(make(3).heights, make(3).heights)
    assert np.abs(make(3).heights - make(4).heights).max() > PAPER.S_q


def test_grids_that_are_not_square():
    topo = synthesise(
        PAPER.bifractal, PAPER.hdf, (96, 63), (3e-3, 1.7e-3), np.random.default_rng(0)
    )
    assert topo.shape == (96, 63) and topo.periodic
    assert topo.record.psd_error < 2e-3


def test_patch_longer_than_the_scan():
    """Waves the scan never saw: extended they carry a quarter of the variance, flat far less."""
    extend, flat = make(0, low="extend"), make(0, low="flat")
    assert 0.2 < extend.record.low_share < 0.35
    assert flat.record.low_share < 0.7 * extend.record.low_share
    assert extend.record.S_q > flat.record.S_q > 33.1e-6


@pytest.mark.parametrize("low", ["flat", "extend"])
def test_variance_follows_from_the_spectrum(low):
    """The variance is the sum of the density over the grid's wave vectors; nothing is rescaled."""
    topo = make(1, low=low)
    C = PAPER.bifractal(wave_numbers((128, 128), np.array(SIZE)), low)
    weights = half_plane_weights((128, 128))
    S_q = 2 * np.pi * np.sqrt(np.sum(weights * C) / np.prod(SIZE))
    assert topo.record.S_q == pytest.approx(S_q, rel=1e-9)
    assert topo.record.C0_scale == pytest.approx(1.0)


@pytest.mark.parametrize("kind", ["fit", "measured"])
def test_spectrum_in_the_measured_band_is_the_scans(kind):
    """A patch twice as long as the scan: the same density in the band, in the mean of surfaces."""
    scan = make(3, 256, size=(1.8e-3, 1.8e-3), variance="scan")
    stats = characterise(scan, spectrum=kind)
    assert isinstance(stats.hdf, Measured)
    found = [
        radial_psd(
            synthesise(
                stats.spectrum, stats.hdf, (256, 256), (3.6e-3, 3.6e-3), np.random.default_rng(seed)
            )
        )
        for seed in range(12)
    ]
    q, C = found[0].q, np.mean([f.C for f in found], axis=0)
    inside = (q > stats.psd.band[0]) & (q < 0.9 * found[0].band[1])
    own = np.interp(np.log(q[inside]), np.log(stats.psd.q), np.log(stats.psd.C))
    assert abs(np.mean(np.log(C[inside]) - own)) < 0.1


def test_the_sources_reading_lies_below_the_scan():
    """Variance of the scan forced on a longer patch: the spectrum falls below that of the scan."""
    topo = make(0, low="extend", variance="scan")
    assert topo.record.S_q == pytest.approx(33.1e-6, rel=1e-9)
    assert 0.6 < topo.record.C0_scale < 0.8
    assert topo.record.C0_scale < make(0, low="flat", variance="scan").record.C0_scale


def test_measured_heights_can_be_imposed():
    """Plateaus and pits of a worn pad, as measured, instead of a fitted formula."""
    rng = np.random.default_rng(0)
    z = np.sort(-rng.gamma(4.0, 1e-6, 5000))
    hdf = Measured(z - z.mean())
    made = [synthesise(PAPER.bifractal, hdf, (128, 128), SIZE, rng) for _ in range(20)]
    heights = np.concatenate([m.heights.ravel() for m in made])
    assert moments(heights)[2] == pytest.approx(moments(z)[2], abs=0.1)
    assert made[0].record.psd_error < 0.02 and made[0].warnings == ()


def test_heights_that_contradict_the_spectrum_are_reported():
    """Two plateaus have steps between them; no such surface has slopes of -4.5."""
    rng = np.random.default_rng(0)
    z = np.sort(np.concatenate([rng.normal(-1, 0.1, 3000), rng.normal(2, 0.1, 1500)])) * 1e-6
    topo = synthesise(PAPER.bifractal, Measured(z - z.mean()), (64, 64), SIZE, rng, low="extend")
    assert topo.record.psd_error > 0.05
    assert len(topo.warnings) == 1 and "PSD missed" in topo.warnings[0]


def test_a_surface_of_the_wrong_slope_is_refused():
    """Steps between plateaus, and a spectrum without short waves: the cause is named."""
    z = np.repeat([-1e-6, 2e-6], [3000, 1500]) + np.linspace(-1, 1, 4500) * 1e-9
    steep = BiFractal(-1.0, -9.0, 1e4, 1e-18, (2e3, 3e5))
    with pytest.raises(SurfaceError, match=r"times the rms slope .* check the scan for steps"):
        synthesise(steep, Measured(z - z.mean()), (128, 128), SIZE, np.random.default_rng(0))


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
        lambda q: np.exp(-((q / 3e4) ** 2)), PAPER.hdf, (64, 64), SIZE, np.random.default_rng(0)
    )
    assert topo.record.psd_error < 0.05


@pytest.mark.parametrize(
    "arguments",
    [
        {"shape": (1, 5), "size": SIZE},
        {"shape": (8, 8), "size": (0.0, 1.0)},
        {"shape": (8, 8), "size": SIZE, "psd": lambda q: 0.0 * q},
        {"shape": (8, 8), "size": SIZE, "psd": lambda q: np.inf * q},
        {"shape": (8, 8), "size": SIZE, "low": "cut"},
        {"shape": (8, 8), "size": SIZE, "variance": "any"},
    ],
)
def test_what_cannot_be_made(arguments):
    settings = {"psd": PAPER.bifractal, "hdf": PAPER.hdf, "rng": np.random.default_rng(0)}
    with pytest.raises(SceneError):
        synthesise(**(settings | arguments))

"""The highest points of patches: they scatter as those of cuts of one long surface do."""

import numpy as np
import pytest
from scipy.stats import norm

from brake_fenicsx.micro import solve_contact
from brake_fenicsx.surface import characterise, given_statistics, make_topography, synthesise
from brake_fenicsx.surface.hdf import fit_tail, match_moments, measured, summits
from brake_fenicsx.surface.topography import form

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
L = 4.345e-3
E_STAR, HARDNESS = 2.373e9, 200e6
PRESSURES = np.array([0.05e6, 0.1e6, 0.2e6, 0.4e6])


def separations(heights, pixels=None):
    """Separation at the pressures [m], pressed with a hardness; or its limit of no elasticity.

    Where all touching points yield, the pressure is the hardness times the bearing area.
    """
    heights = heights - heights.mean()
    if pixels is None:
        return np.quantile(heights, 1 - PRESSURES / HARDNESS)
    given = {"hardness": HARDNESS, "tol": 1e-5}
    return np.array(
        [
            solve_contact(heights, (L, L), E_STAR, load=p * L**2, **given).separation
            for p in PRESSURES
        ]
    )


def cuts(psd, hdf, n, surfaces, side=4):
    """Independent patches of long surfaces."""
    for seed in range(surfaces):
        rng = np.random.default_rng([1, seed])
        h = synthesise(psd, hdf, (side * n, side * n), (side * L, side * L), rng).heights
        yield from (h[i : i + n, j : j + n] for i in range(0, side * n, n)
                    for j in range(0, side * n, n))  # fmt: skip


@pytest.mark.parametrize(
    ("n", "surfaces", "pressed"),
    [(200, 12, False), (100, 4, True), pytest.param(400, 6, True, marks=pytest.mark.slow)],
)
def test_separations_scatter_over_patches_as_over_cuts(n, surfaces, pressed):
    """Within 30 %: standard deviations of the separation at 0.05 to 0.4 MPa.

    Of N patches a standard deviation is known to 1 / sqrt(2 N): 16 N surfaces keep that below 8 %.
    """
    pixels = n if pressed else None
    long = np.array([separations(h, pixels) for h in cuts(PAPER.bifractal, PAPER.hdf, n, surfaces)])
    patches = np.array([
        separations(
            synthesise(PAPER.bifractal, PAPER.hdf, (n, n), (L, L), np.random.default_rng([2, seed])
            ).heights, pixels,
        )
        for seed in range(16 * surfaces)
    ])  # fmt: skip
    ratio = patches.std(axis=0) / long.std(axis=0)
    assert np.all((ratio > 0.7) & (ratio < 1.3)), ratio
    # The means agree as well as the scatter lets them be known.
    error = np.hypot(patches.std(axis=0), long.std(axis=0)) / np.sqrt(len(patches))
    assert np.all(np.abs(patches.mean(axis=0) - long.mean(axis=0)) < 4 * error + 0.05 * PAPER.S_q)


@pytest.mark.parametrize("shape", [(-0.2410, 3.6549), (-1.0, 5.0), (0.5, 3.0)])
def test_the_smooth_tail_is_nearer_to_the_truth_than_the_heights_of_one_scan(shape):
    """Heights that 0.1 to 0.001 % of a surface exceed, from 72 cuts with some 40 summits each."""
    stats, n = given_statistics(33.1e-6, *shape), 128
    above = np.array([1e-3, 1e-4, 1e-5])
    truth = stats.hdf.ppf(1 - above) / stats.S_q
    raw, smooth = [], []
    for seed in range(8):
        size = (6 * 1.8e-3, 6 * 1.4e-3)
        rng = np.random.default_rng(seed)
        whole = synthesise(stats.bifractal, stats.hdf, (6 * n, 6 * n), size, rng).heights
        for i in range(0, 6 * n, 2 * n):
            for j in range(0, 6 * n, 2 * n):
                scan = make_topography(whole[i : i + n, j : j + n], (1.8e-3, 1.4e-3))
                h = scan.heights - form(scan, "plane")
                hdf = measured([h])
                raw.append(np.quantile(h, 1 - above) / hdf.S_q)
                smooth.append(hdf.ppf(1 - above) / hdf.S_q)
    one, other = (np.sqrt(np.mean((np.array(v) - truth) ** 2, axis=0)) for v in (smooth, raw))
    # Where the distribution ends early, a normal tail is no better within the heights of a scan.
    assert np.all(one < [1.15 * other[0], 1.3 * other[1], 1.05 * other[2]]), (one, other)
    assert shape[0] == -1.0 or one[-1] < 0.75 * other[-1], (one, other)


def test_the_tail_of_independent_heights_is_that_of_their_distribution():
    """A normal sample: also far beyond its own highest height."""
    z = np.sort(np.random.default_rng(0).standard_normal(200_000))
    tail = fit_tail(z, 20_000)
    above = np.array([1e-3, 1e-4, 1e-5, 1e-6])
    np.testing.assert_allclose(tail.height(above), norm.isf(above), atol=0.15)
    assert tail.share == pytest.approx(5e-4, rel=0.01)
    whole = fit_tail(z, 100)
    np.testing.assert_allclose(whole.height(above), norm.isf(above), atol=0.03)


def test_quantiles_join_at_the_threshold_and_rise():
    scan = synthesise(PAPER.bifractal, PAPER.hdf, (128, 128), (L, L), np.random.default_rng(0))
    hdf = measured([scan.heights])
    u = np.sort(np.concatenate([np.linspace(0, 1, 4001), 1 - np.geomspace(1e-12, 0.2, 400)]))
    z = hdf.ppf(u)
    assert np.all(np.diff(z) >= 0) and np.isfinite(z).all()
    edge = 1 - hdf.tail.share
    low, high = hdf.ppf(np.array([edge - 1e-6, edge + 1e-6]))
    assert high - low < 1e-3 * hdf.S_q


@pytest.mark.parametrize("flat", [0.3, 0.02])
def test_a_plateau_stays_flat(flat):
    """No summit grows out of a top that was cut off."""
    h = np.random.default_rng(0).standard_normal((200, 200))
    h = np.minimum(h, np.quantile(h, 1 - flat))
    hdf = measured([h])
    assert hdf.tail is None
    assert hdf.ppf(np.array([1 - 1e-9])) == pytest.approx(h.max() - h.mean())


def test_summits_are_connected_regions_of_every_scan():
    x = np.linspace(0, 6 * np.pi, 300)
    waves = np.outer(np.sin(x), np.sin(x)) + 1e-3 * np.sin(0.1 * x)
    waves[:5, :5] = np.nan
    assert summits([waves]) == 18 and summits([waves, waves]) == 36


def test_tails_of_scans_are_in_the_statistics():
    rng = np.random.default_rng(3)
    scan = synthesise(PAPER.bifractal, PAPER.hdf, (128, 128), (1.8e-3, 1.8e-3), rng)
    stats = characterise(make_topography(scan.heights, scan.size))
    johnson = match_moments(stats.S_q, stats.S_sk, stats.S_ku)
    tops = [d.ppf(np.array([1 - 1e-5]))[0] for d in (stats.hdf, johnson)]
    assert 0.6 < tops[0] / tops[1] < 1.6

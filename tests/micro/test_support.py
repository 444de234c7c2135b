"""Pixels behind a law, and the band of its stiffness over scans of one surface."""

from dataclasses import replace

import numpy as np
import pytest

from brake_fenicsx.micro import LawRecipe, LawSettings, law_steps
from brake_fenicsx.micro.law import LawSteps
from brake_fenicsx.micro.library import (
    PRESSURES,
    LawSupport,
    drawn_law,
    law_support,
    loads_of,
    secant,
    stiffness,
)
from brake_fenicsx.surface import characterise, given_statistics, make_topography, synthesise

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)


def scan(seed):
    """A cut of a surface twice as long, as an instrument sees it."""
    whole = synthesise(
        PAPER.spectrum,
        PAPER.hdf,
        (256, 256),
        (3.6e-3, 3.6e-3),
        np.random.default_rng(seed),
        "extend",
    )
    return characterise(make_topography(whole.heights[:128, :128], (1.8e-3, 1.8e-3)))


def recipe_of(stats, n=160):
    side = n * 1.8e-3 / 128
    settings = LawSettings(2.37e9, hardness=200e6, max_pressure=0.8e6)
    return LawRecipe(stats.spectrum, stats.hdf, settings, (n, n), (side, side))


def support_of(stats, draws, seed=1, laws=4, n=160):
    """Support of a library of some laws of a scan, from some draws."""
    recipe = recipe_of(stats, n)
    found = [drawn_law(recipe, stats, seed, i) for i in range(draws)]
    return law_support(found, [recipe.law(seed, i) for i in range(laws)])


def test_secant_of_an_exponential_law():
    p = np.geomspace(1e3, 1e7, 400)
    steps = LawSteps(-1e-6 * np.log(p), p, p / 1e-6)
    wanted = 0.3 * np.array(PRESSURES) / (1e-6 * np.log(1.15 / 0.85))
    np.testing.assert_allclose(secant(steps), wanted, rtol=1e-4)


def test_pixels_of_scan_and_grid_follow_the_bearing_area():
    """Far below the hardness p = H times the touching share; the scan has as large a share."""
    stats, n = scan(0), 128
    found = support_of(stats, 5, n=n)
    share = found.pressure / 200e6
    assert np.all(found.grid_pixels >= 0.99 * share * n**2)
    assert np.all(found.grid_pixels < 2.0 * share * n**2)
    assert np.all(np.diff(found.scan_pixels) >= 0.0)
    assert np.all(found.k[0] <= found.k[1]) and np.all(found.v[1] <= found.v[2])
    recipe = recipe_of(stats, n)
    np.testing.assert_array_equal(drawn_law(recipe, stats, 1, 2), drawn_law(recipe, stats, 1, 2))


@pytest.mark.parametrize("hardness", [200e6, None])
def test_the_loads_of_the_band_alone_give_what_many_loads_give(hardness):
    """A patch of a scan at the loads of the band, over six times as many.

    k and v were wrong by 1.2 and 1.5 % rms where they were read between the steps of whole laws
    (``scripts/bench_laws.py band``).
    """
    stats = scan(3)
    settings = LawSettings(2.37e9, hardness=hardness)
    side = 160 * 1.8e-3 / 128
    recipe = LawRecipe(stats.spectrum, stats.hdf, settings, (160, 160), (side, side))
    patch, loads = recipe.surface(1, 0), loads_of(settings)
    many = np.union1d(loads, np.geomspace(loads[0], loads[-1], 72 if hardness else 300))
    alone, more = (law_steps(patch, settings, only=p) for p in (loads, many))
    np.testing.assert_allclose(alone.p, loads, rtol=1e-9)
    k, v = stiffness(alone) / stiffness(more)
    np.testing.assert_allclose(k, 1, rtol=1e-3 if hardness else 0.02)
    np.testing.assert_allclose(v, 1, rtol=1e-6 if hardness else 5e-3)


def test_bands_of_known_scatter():
    """Scans of a standard deviation of 0.1 in ln v, patches of 0.3: both bands by their sums."""
    rng, m, n = np.random.default_rng(0), len(PRESSURES), 4000
    scan, patch = 0.1 * rng.standard_normal((n, 1)), 0.3 * rng.standard_normal((n, 1))
    draws = np.ones((n, 8, m))
    draws[:, 2:4] = np.exp(scan + patch)[:, None]
    # Patches of the same random numbers differ, and hardly scatter by themselves.
    rest = 0.03 * rng.standard_normal((n, 2, 1))
    other = 0.03 * rng.standard_normal((n, 2, 1))
    draws[:, 4:6], draws[:, 6:] = np.exp(scan[:, None] + rest), 3 * np.exp(scan[:, None] + other)
    p = np.geomspace(1e3, 1e7, 400)
    laws = [LawSteps(-1e-6 * np.log(p), p, p / 1e-6, v * np.ones(400)) for v in (2.0, 8.0)]
    found = law_support(draws, laws)
    np.testing.assert_allclose(found.v[1], 4.0)
    for band, variance in ((found.v, 2 * 0.01 + 2 * 0.09 / 2), (found.v_patch, 0.02 + 0.09 * 1.5)):
        np.testing.assert_allclose(np.log(band[2] / band[1]), 1.645 * np.sqrt(variance), rtol=0.05)
        np.testing.assert_allclose(band[0] * band[2], band[1] ** 2)


def test_few_pixels_are_warned_of():
    band = np.array([[0.9] * 4, [1.0] * 4, [1.1] * 4])
    support = LawSupport(
        np.array(PRESSURES), np.array([20.0, 60.0, 130.0, 300.0]), np.full(4, 500.0),
        np.ones((3, 4)), band, np.ones((3, 4)), np.array([[0.5] * 4, [1.0] * 4, [2.0] * 4]),
    )  # fmt: skip
    text = support.warning()
    assert "0.1 MPa" in text and "60 pixels" in text
    assert "0.90 to 1.10 times" in text and "a single patch 0.50 to 2.00 times" in text
    assert replace(support, scan_pixels=np.full(4, 100.0)).warning() is None


@pytest.mark.slow
def test_coverage_over_forty_scans_drawn_anew():
    """Nine in ten libraries, and patches, of other scans lie in the bands about each of 40 scans.

    40 cuts of independent surfaces; bands as wide as those of four of them say, on average. The
    band of a patch, taken for that of a brake, held all of them.
    """
    n, laws = 96, 4
    scans = [scan(100 + j) for j in range(40)]
    each = np.log([
        [stiffness(recipe_of(s, n).law(1000 + j, i)) for i in range(laws)]
        for j, s in enumerate(scans)
    ])  # fmt: skip
    library = each.mean(axis=1)  # scans, k and v, pressures
    supports = [support_of(s, 16, 1000 + j, laws, n) for j, s in enumerate(scans[:4])]
    pairs = ~np.eye(40, dtype=bool)
    found = {}
    for i, (k, one) in enumerate((("k", "k_patch"), ("v", "v_patch"))):
        for name, others in ((k, library[:, i]), (one, each[:, 0, i])):
            reach = [np.log(getattr(s, name)[2] / getattr(s, name)[1]) for s in supports]
            apart = np.abs(library[:, None, i] - others[None])[pairs]
            found[name] = np.mean([apart < r for r in reach])
    assert all(0.85 < inside < 0.95 for inside in found.values()), found

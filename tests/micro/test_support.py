"""Pixels behind a law, and the band of its stiffness over scans of one surface."""

from dataclasses import replace

import numpy as np
import pytest

from brake_fenicsx.micro import LawRecipe, LawSettings
from brake_fenicsx.micro.law import LawSteps
from brake_fenicsx.micro.support import PRESSURES, LawSupport, drawn_law, law_support, secant
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


def drawn(stats, n, seed=1):
    recipe = LawRecipe(
        stats.spectrum, stats.hdf, LawSettings(2.37e9, hardness=200e6), (160, 160), (2.2e-3, 2.2e-3)
    )
    return [drawn_law(recipe, stats, seed, i) for i in range(n)]


def test_secant_of_an_exponential_law():
    p = np.geomspace(1e3, 1e7, 400)
    steps = LawSteps(-1e-6 * np.log(p), p, p / 1e-6)
    wanted = 0.3 * np.array(PRESSURES) / (1e-6 * np.log(1.15 / 0.85))
    np.testing.assert_allclose(secant(steps), wanted, rtol=1e-4)


def test_pixels_of_scan_and_grid_follow_the_bearing_area():
    """Far below the hardness p = H times the touching share; the scan has as large a share."""
    stats = scan(0)
    found = law_support(drawn(stats, 8))
    share = found.pressure / 200e6
    assert np.all(found.grid_pixels >= 0.99 * share * 160**2)
    assert np.all(found.grid_pixels < 2.0 * share * 160**2)
    assert np.all(np.diff(found.scan_pixels) >= 0.0)
    assert np.all(found.k[0] <= found.k[1]) and np.all(found.v[1] <= found.v[2])
    again = law_support(drawn(stats, 8))
    np.testing.assert_array_equal(found.v, again.v)


def test_few_pixels_are_warned_of():
    support = LawSupport(
        np.array(PRESSURES), np.array([20.0, 60.0, 130.0, 300.0]), np.full(4, 500.0),
        np.ones((3, 4)), np.array([[0.5] * 4, [1.0] * 4, [2.0] * 4]),
    )  # fmt: skip
    text = support.warning()
    assert "0.1 MPa" in text and "60 pixels" in text and "0.50 to 2.00" in text
    assert replace(support, scan_pixels=np.full(4, 100.0)).warning() is None


@pytest.mark.slow
def test_laws_of_other_scans_lie_in_the_band():
    """Bands of six scans hold the median law of all, and those of the others: nine in ten."""
    bands = [law_support(drawn(scan(seed), 30)) for seed in range(6)]
    for name in ("k", "v"):
        every = np.array([getattr(b, name) for b in bands])
        truth = np.median(every[:, 1], axis=0)
        inside = (every[:, 0] <= truth) & (truth <= every[:, 2])
        assert inside.mean() > 0.8, (name, inside)
        # Laws of 30 pairs at four pressures, of which only six scans are independent.
        others = np.array([
            (every[i, 0] <= every[j, 1]) & (every[j, 1] <= every[i, 2])
            for i in range(6) for j in range(6) if i != j
        ])  # fmt: skip
        assert others.mean() > 0.75, (name, others.mean())

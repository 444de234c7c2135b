"""Statistics drawn anew: as far apart as those of other scans of the same surface."""

import numpy as np
import pytest

from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.surface import (
    averaged,
    characterise,
    given_statistics,
    make_topography,
    resampled,
    synthesise,
)

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
SHARE = np.array([2e-3, 5e-4])  # of the surface that touches at 0.4 and 0.1 MPa of 200 MPa


def scan(seed, n=128, **settings):
    """A quarter of a surface twice as long."""
    rng = np.random.default_rng(seed)
    size = (3.6e-3, 2.8e-3)
    whole = synthesise(PAPER.bifractal, PAPER.hdf, (2 * n, 2 * n), size, rng, low="extend").heights
    return characterise(make_topography(whole[:n, :n], (1.8e-3, 1.4e-3)), **settings)


def numbers(stats):
    """Logarithms of S_q, of high quantiles over S_q, and of the variance of artificial patches."""
    q = np.geomspace(1.5e3, 3e5, 400)
    variance = np.sum(stats.spectrum(q, "flat") * q * np.gradient(q))
    return np.log([stats.S_q, *stats.hdf.ppf(1 - SHARE) / stats.hdf.S_q, variance])


@pytest.mark.slow
@pytest.mark.parametrize(("draws", "factor"), [(6, 2.2), (12, 1.65)])
def test_draws_scatter_as_scans_do(draws, factor):
    """Standard deviations over 30 scans against those of some draws of each of 5."""
    scans = [scan(seed, spectrum="fit") for seed in range(30)]
    true = np.std([numbers(s) for s in scans], axis=0)
    told = [
        np.var(
            [numbers(resampled(s, np.random.default_rng([k, i]))) for i in range(draws)],
            axis=0, ddof=1,
        )
        for k, s in enumerate(scans[:5])
    ]  # fmt: skip
    # One scan tells the deviation to some 30 %, 6 draws of it to 30 %, 12 to 21 %: five of them and
    # the 30 scans to some 24 % and 20 %.
    ratio = np.sqrt(np.mean(told, axis=0)) / true
    assert np.all((ratio > 1 / factor) & (ratio < factor)), ratio


def test_draws_have_the_statistics_of_the_scan_on_average():
    stats = scan(1)
    drawn = [numbers(resampled(stats, np.random.default_rng(i))) for i in range(12)]
    error = np.std(drawn, axis=0) / np.sqrt(12)
    # Levelling takes some of the longest waves once more.
    room = np.array([0.2, 0.05, 0.05, 0.1])
    assert np.all(np.abs(np.mean(drawn, axis=0) - numbers(stats)) < 4 * error + room)
    one, same = (resampled(stats, np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(one.hdf.sorted_heights, same.hdf.sorted_heights)
    assert one.spectrum == same.spectrum and one.spectrum.misfit is not None


@pytest.mark.slow
def test_four_scans_tell_more_than_one():
    """The draws of four scans scatter about half as much as those of one, the mean of the four."""
    scans = [scan(seed, spectrum="fit") for seed in range(4)]

    def variance(stats, draws):
        drawn = [numbers(resampled(stats, np.random.default_rng(i))) for i in range(draws)]
        return np.var(drawn, axis=0, ddof=1)

    one = np.sqrt(np.mean([variance(s, 12) for s in scans], axis=0))
    four = np.sqrt(variance(averaged(scans, spectrum="fit"), 20))
    assert np.mean(four / one) < 0.8


@pytest.mark.parametrize("distribution", ["johnson", "normal"])
def test_other_distributions_keep_their_kind(distribution):
    drawn = resampled(scan(0, distribution=distribution), np.random.default_rng(0))
    assert drawn.hdf.name == distribution and drawn.hdf.S_q == pytest.approx(drawn.S_q, rel=1e-9)


def test_numbers_cannot_be_drawn():
    with pytest.raises(SurfaceError, match="no scan"):
        resampled(PAPER, np.random.default_rng(0))

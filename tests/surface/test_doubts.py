"""What is doubtful about scans: sizes, units, piles, gaps and holes, each with its remedy."""

from dataclasses import replace

import numpy as np
import pytest

from brake_fenicsx.surface import characterise, given_statistics, make_topography, synthesise
from brake_fenicsx.surface.topography import implausible, where_missing

HEIGHTS = 1e-6 * np.random.default_rng(0).standard_normal((12, 9))
SIZE = (1.2e-3, 0.9e-3)
PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
N = 128


@pytest.fixture(scope="module")
def whole():
    """Heights of a scan of 1.8 x 1.8 mm."""
    rng = np.random.default_rng(0)
    made = synthesise(PAPER.bifractal, PAPER.hdf, (2 * N, 2 * N), (3.6e-3, 3.6e-3), rng)
    return made.heights[:N, :N]


def scan(heights):
    return make_topography(heights, (1.8e-3, 1.8e-3), source="a.npz")


@pytest.mark.parametrize(
    ("heights", "size", "remedy"),
    [
        (HEIGHTS, (1.2e6, 0.9e6), "'size'"),
        (HEIGHTS, (1.2e-3, 0.9e-5), "'size'"),
        (HEIGHTS * 1e4, SIZE, "'height_unit'"),
        (HEIGHTS * 1e-6, SIZE, "'height_unit'"),
    ],
)
def test_implausible_scans_are_named_with_the_remedy(heights, size, remedy):
    """For example NMS files, whose lateral size comes out 1e9 too large."""
    (text,) = implausible(make_topography(heights, size, source="a.npz"))
    assert remedy in text and text.startswith("a.npz: implausible")


def test_many_points_at_exactly_one_extreme_are_suspicious():
    """Missing points that nobody marked, or a detector at its limit."""
    heights = HEIGHTS.copy()
    heights[3:6, 2:7] = 5e-6
    assert "15 points at exactly 5 um" in implausible(make_topography(heights, SIZE))[0]
    # Steps of a coarse detector are not.
    assert implausible(make_topography(np.round(HEIGHTS, 6), SIZE)) == ()


def test_a_gap_in_the_heights_is_a_doubt_of_any_array(whole):
    """Signed numbers of 16 bits that are read as unsigned, as SurfaceTopography 1.18.2 does.

    Neither grooves nor a plateau have a gap of a quarter of their range.
    """
    wrapped = np.rint(whole / 5e-9).astype(np.int16).astype(np.uint16) * 5e-9
    texts = characterise(scan(wrapped)).warnings
    assert any("a.npz: implausible: no height between" in text for text in texts)
    groove = np.where(np.arange(N) % 16 < 4, -2e-4, 0.0)[:, None]
    for heights in (whole, whole + groove, np.minimum(whole, 1e-5)):
        assert not any("no height between" in text for text in implausible(scan(heights)))


@pytest.mark.parametrize("share", [0.02, 0.1, 0.4])
def test_where_points_are_missing(whole, share):
    """The deepest, the highest, single points anywhere, and discs anywhere."""
    rng = np.random.default_rng(1)
    x, y = np.indices(whole.shape)
    discs = np.zeros(whole.shape, bool)
    while discs.mean() < share:
        discs |= np.hypot(x - rng.integers(N), y - rng.integers(N)) < rng.integers(3, 12)
    masks = {
        "deepest": whole < np.quantile(whole, share),
        "highest": whole > np.quantile(whole, 1 - share),
        "anywhere": rng.random(whole.shape) < share,
    }
    found = {name: where_missing(np.where(mask, np.nan, whole)) for name, mask in masks.items()}
    assert found == {name: name for name in masks}
    assert where_missing(np.where(discs, np.nan, whole)) == "anywhere"
    # Single missing points beside the holes of the valleys do not hide them.
    both = masks["deepest"] | (rng.random(whole.shape) < 0.01)
    assert where_missing(np.where(both, np.nan, whole)) == "deepest" or share < 0.1
    assert where_missing(whole) == "anywhere"


def test_missing_valleys_and_summits_are_said(whole):
    low, high = np.quantile(whole, [0.3, 0.9])
    (text,) = characterise(scan(np.where(whole < low, np.nan, whole))).warnings
    assert "deepest 30% of the surface are missing" in text and "S_q" in text
    (text,) = characterise(scan(np.where(whole > high, np.nan, whole))).warnings
    assert "highest 10% of the surface are missing" in text
    assert characterise(scan(whole)).warnings == ()


def test_shares_are_of_measured_points(whole):
    """A bow over a corner of measured points is no more than all of their variance."""
    x = np.linspace(-1, 1, N)
    bowl = 1e-4 * np.add.outer(x**2, x**2)
    heights = np.full((N, N), np.nan)
    heights[:45, :45] = (0.02 * whole + bowl)[:45, :45]
    stats = characterise(scan(heights))
    assert 0.9 < stats.curvature <= 1.0


def test_many_spikes_are_a_doubt(whole):
    rng = np.random.default_rng(2)
    spikes = np.where(rng.random(whole.shape) < 0.2, rng.choice([-5e-4, 5e-4], whole.shape), 0)
    texts = characterise(scan(whole + spikes)).warnings
    assert any("20% of the points are spikes" in text for text in texts)


@pytest.mark.parametrize(("spectrum", "cause"), [("fit", "fit"), ("measured", "longer than")])
def test_another_variance_than_that_of_the_scan_is_named_with_its_cause(whole, spectrum, cause):
    """Twice the density is the root of two times S_q; a fifth more is not worth a line."""
    stats = characterise(scan(whole), spectrum=spectrum)
    assert stats.warnings == () and stats.variance_ratio == pytest.approx(1, abs=0.12)

    def times(factor):
        return replace(stats, spectrum=replace(stats.spectrum, C0=factor * stats.spectrum.C0))

    (text,) = times(2.0).warnings
    assert f"have {np.sqrt(2) * stats.variance_ratio:.2f} times its S_q" in text and cause in text
    assert times(1.2).warnings == ()

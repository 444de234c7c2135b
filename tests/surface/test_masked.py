"""Missing points and the place of roughness bias neither spectra nor laws."""

import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from brake_fenicsx.micro import LawRecipe, LawSettings, make_library
from brake_fenicsx.surface import characterise, given_statistics, make_topography, read_topography
from brake_fenicsx.surface.topography import fill
from places import PAD

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
SCANS = os.environ.get("BRAKE_FENICSX_SCANS")
N, SIDE = 128, 1.8e-3


def gaussian_scan(seed, n=N, side=SIDE):
    """A quarter of a normally distributed surface, not made by the program's own synthesis."""
    q = 2 * np.pi * np.hypot(*np.meshgrid(*[np.fft.fftfreq(2 * n, side / n)] * 2))
    noise = np.fft.fft2(np.random.default_rng(seed).standard_normal((2 * n, 2 * n)))
    h = np.fft.ifft2(noise * np.sqrt(PAPER.bifractal(q, "flat"))).real[:n, :n]
    return h * PAPER.S_q / h.std()


def mask_of(kind, n, seed=0):
    """Where points are missing: a share of them by the kind."""
    rng, (x, y) = np.random.default_rng(seed), np.indices((n, n)) / n
    name, share = kind
    if name == "points":
        return rng.random((n, n)) < share
    if name == "stripes":
        return (x * 12) % 1 < share
    if name == "half":
        return x < share
    if name == "centre":
        return np.maximum(np.abs(x - 0.5), np.abs(y - 0.5)) < 0.5 * np.sqrt(share)
    if name == "rim":
        return np.maximum(np.abs(x - 0.5), np.abs(y - 0.5)) > 0.5 * np.sqrt(1 - share)
    mask = np.zeros((n, n), bool)
    while mask.mean() < share:
        mask |= np.hypot(x - rng.random(), y - rng.random()) < rng.uniform(0.02, 0.1)
    return mask


KINDS = [
    ("points", 0.3), ("points", 0.7), ("discs", 0.1), ("discs", 0.3), ("discs", 0.5),
    ("discs", 0.7), ("stripes", 0.7), ("half", 0.5), ("centre", 0.3), ("rim", 0.5),
]  # fmt: skip


def some(kinds):
    """The hardest kinds of many and of large holes; the others in slow tests."""
    hardest = ("points", 0.7), ("discs", 0.7)
    return [k if k in hardest else pytest.param(k, marks=pytest.mark.slow) for k in kinds]


@cache
def whole_scan(seed):
    """Heights of a scan without holes, and its statistics, once for all kinds of holes."""
    h = gaussian_scan(seed)
    return h, characterise(make_topography(h, (SIDE, SIDE)))


def octaves(stats):
    """Variance of the spectrum in octaves below the Nyquist wave number; nan beyond the band."""
    ends = np.pi * N / SIDE * 2.0 ** np.arange(-5, 1)
    q = np.geomspace(ends[:-1], ends[1:], 50)
    return np.where(
        ends[1:] < 1.01 * stats.psd.band[1], np.sum(stats.spectrum(q) * q**2, 0), np.nan
    )


@pytest.mark.long
@pytest.mark.parametrize("kind", some(KINDS))
def test_missing_points_bias_no_octave(kind):
    """Octaves of scans with holes over those of the same scans without, the mean of 8 scans.

    Of one scan the measured part differs from the whole; on average it does not. The harmonic fill
    alone leaves .3 of the short waves where .7 are missing.
    """
    ratios, S_q = [], []
    for seed in range(8):
        h, whole = whole_scan(seed)
        mask = mask_of(kind, N, seed)
        seen = characterise(make_topography(np.where(mask, np.nan, h), (SIDE, SIDE)))
        ratios.append(np.log(octaves(seen) / octaves(whole)))
        S_q.append(seen.variance_ratio)
    seen_by_all = np.isfinite(ratios).all(axis=0)
    assert seen_by_all[:3].all() and seen_by_all.sum() >= 3
    found = np.array(ratios)[:, seen_by_all]
    error = found.std(axis=0, ddof=1) / np.sqrt(8)
    assert np.all(np.abs(found.mean(axis=0)) < np.log(1.15) + 2 * error), found.mean(axis=0)
    assert np.all(error < 0.3)
    assert np.all(np.abs(np.array(S_q) - 1) < 0.05), S_q


def laws(stats, surfaces=12):
    """Logarithms of k and v at 0.2 MPa of patches, shape (surfaces, 2)."""
    settings = LawSettings(2.37e9, hardness=200e6, max_pressure=0.5e6)
    recipe = LawRecipe(stats.spectrum, stats.hdf, settings, (200, 200), (1.4e-3, 1.4e-3))
    found = make_library([recipe.law(1, i) for i in range(surfaces)]).at_pressure(0.2e6)
    return np.log(np.stack([found.k, found.v], axis=1))


@pytest.fixture(scope="module")
def pad():
    """The example scan without its few holes, and the laws of it."""
    topo = read_topography(PAD)
    whole = make_topography(fill(topo.heights), topo.size)
    return whole, laws(characterise(whole))


@pytest.mark.long
@pytest.mark.parametrize("kind", some([*KINDS[1::2], ("discs", 0.5)]))
def test_laws_of_scans_with_holes_are_those_of_the_whole_scan(pad, kind):
    """k and v at 0.2 MPa within the scatter of 12 surfaces; k was 2.2 times with 70 % missing."""
    topo, whole = pad
    mask = mask_of(kind, len(topo.heights))
    found = laws(characterise(make_topography(np.where(mask, np.nan, topo.heights), topo.size)))
    assert np.all(np.abs(found.mean(0) - whole.mean(0)) < whole.std(0, ddof=1))


@pytest.mark.parametrize(("share", "room"), [(0.1, 0.1), (0.2, 0.15), (0.4, 0.25)])
def test_missing_valleys_leave_the_laws_as_they_are(pad, share, room):
    """The upper part carries the load: with the deepest 40 % missing k was 1.5 times, v 1.2."""
    topo, whole = pad
    z = topo.heights - characterise(topo).mean
    seen = np.where(z < np.quantile(z, share), np.nan, topo.heights)
    stats = characterise(make_topography(seen, topo.size))
    assert stats.lost == "deepest" and any("deepest" in text for text in stats.warnings)
    error = np.abs(laws(stats).mean(0) - whole.mean(0))
    assert np.all(error < np.log(1 + room) + whole.std(0, ddof=1) / np.sqrt(12)), np.exp(error)


@pytest.mark.parametrize("place", ["rim", "centre", "left"])
def test_heights_of_the_rim_count_as_those_of_the_centre(place):
    """Rough where a Hann window sees it or not: S_q was .3 of the scan's with a rough rim."""
    x, y = np.abs(np.indices((N, N)) / N - 0.5)
    rough = {"rim": np.maximum(x, y) > 0.35, "centre": np.maximum(x, y) < 0.25, "left": x < 0.1}
    times = 0.15 + 0.85 * gaussian_filter(rough[place].astype(float), 4.0)
    h = gaussian_scan(0) * times
    stats = characterise(make_topography(h, (SIDE, SIDE)))
    assert stats.variance_ratio == pytest.approx(1, abs=0.05)
    # Of the short waves alone, whose variance is that of differences between neighbours.
    q = np.geomspace(1e5, np.pi * N / SIDE, 200)
    whole = characterise(make_topography(gaussian_scan(0), (SIDE, SIDE)))
    share = np.sum(stats.spectrum(q) * q**2) / np.sum(whole.spectrum(q) * q**2)
    assert share == pytest.approx(np.mean(times**2), rel=0.15)


@pytest.mark.skipif(not SCANS, reason="BRAKE_FENICSX_SCANS names no folder of scans")
@pytest.mark.parametrize("level", ["plane", "second-order"])
@pytest.mark.parametrize(
    "name",
    ["wyko_wli_736x480.opd", "alicona_200x296.al3d", "truemap_300x300.tmd", "matrix_text.txt",
     pytest.param("sensofar_768x576.plu", marks=pytest.mark.slow)],
)  # fmt: skip
def test_artificial_surfaces_have_the_variance_of_real_scans(name, level):
    """It was 1.23, 1.00, .69, 1.02 and 1.04 times their S_q."""
    stats = characterise(read_topography(Path(SCANS) / name), level)
    assert stats.variance_ratio == pytest.approx(1, abs=0.05)
    assert not any("S_q: " in text for text in stats.warnings)

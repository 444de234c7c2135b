"""Hard cases of the surface stage: each gives a correct result or an error message."""

import numpy as np
import pytest

from brake_fenicsx.build.measured_surface import read_surface
from brake_fenicsx.errors import BrakeError, SceneError, SurfaceError
from brake_fenicsx.scene import read_scene
from brake_fenicsx.surface import characterise, given_statistics, make_topography, synthesise

pytestmark = pytest.mark.hard

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)


def scan(n=128, seed=0):
    topo = synthesise(
        PAPER.bifractal, PAPER.hdf, (2 * n, 2 * n), (3.6e-3, 3.6e-3), np.random.default_rng(seed)
    )
    return make_topography(topo.heights[:n, :n], (1.8e-3, 1.8e-3))


def plane(tilt, valid=slice(None)):
    h = np.full((64, 64), np.nan)
    h[valid] = (1e-3 + tilt * np.arange(64)[:, None] * np.ones(64))[valid]
    return make_topography(h, (1.0, 1.0))


@pytest.mark.parametrize(
    ("topo", "settings", "said"),
    [
        (plane(0.0), {}, "flat"),
        (plane(1e-2), {}, "flat"),
        (plane(0.0, (3, 4)), {}, "valid points"),
        (scan(32), {"cutoff": 0.5e-3}, "rings"),
        (scan(32), {"level": "cubic"}, "choose"),
        (scan(32), {"outlier_rule": "sigma"}, "choose"),
        (scan(32), {"distribution": "uniform"}, "choose"),
    ],
)
def test_scans_without_statistics_and_misspelt_settings_are_named(topo, settings, said):
    """Planes, one that is only tilted; one valid point; a cutoff that leaves too few rings."""
    with pytest.raises(BrakeError, match=said):
        characterise(topo, **settings)


def test_third_of_the_points_missing_and_a_block():
    """Moments are computed from valid points; the slope of the spectrum does not change."""
    topo = scan()
    full = characterise(topo)
    scattered = np.random.default_rng(1).random(topo.heights.shape) < 0.3
    block = np.zeros_like(scattered)
    block[40:70, 50:80] = True
    for holes in (scattered, block):
        part = characterise(make_topography(np.where(holes, np.nan, topo.heights), topo.size))
        assert part.missing == holes.sum()
        assert part.bifractal.c2 == pytest.approx(full.bifractal.c2, abs=0.2)
        if holes is scattered:
            assert part.S_q == pytest.approx(full.S_q, rel=0.02)
            assert part.S_sk == pytest.approx(full.S_sk, abs=0.05)
            room = full.bifractal.errors[0] + part.bifractal.errors[0]
            assert part.bifractal.c1 == pytest.approx(full.bifractal.c1, abs=room)


def test_spikes_do_not_change_the_moments():
    """Twelve spikes of a millimetre: all are masked, and the moments stay."""
    topo = scan()
    spiked = topo.heights.copy()
    rng = np.random.default_rng(2)
    where = tuple(rng.integers(0, 128, (2, 12)))
    spiked[where] += rng.choice([-1, 1], 12) * 1e-3
    clean, found = characterise(topo), characterise(make_topography(spiked, topo.size))
    assert found.outliers == np.unique(np.stack(where), axis=1).shape[1]
    assert found.S_ku == pytest.approx(clean.S_ku, rel=0.01)


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e6])
def test_units_only_scale(unit):
    """Heights and lengths in any unit: the same shape of the spectrum."""
    topo = scan(64)
    usual = characterise(topo)
    other = characterise(make_topography(topo.heights * unit, tuple(topo.size * unit)))
    assert other.S_q == pytest.approx(usual.S_q * unit, rel=1e-9)
    assert other.S_ku == pytest.approx(usual.S_ku, rel=1e-9)
    assert other.bifractal.c2 == pytest.approx(usual.bifractal.c2, abs=1e-5)
    assert other.bifractal.q_c == pytest.approx(usual.bifractal.q_c / unit, rel=1e-4)


def test_tiny_and_odd_patches_can_be_made():
    """Artificial surfaces of 2 x 2 pixels and more, also with odd numbers of pixels."""
    for shape in ((2, 2), (3, 3), (127, 129), (2, 64)):
        topo = synthesise(PAPER.bifractal, PAPER.hdf, shape, (1e-3, 1e-3), np.random.default_rng(0))
        assert np.isfinite(topo.heights).all() and topo.heights.std() > 0.0


@pytest.mark.parametrize(("c1", "c2"), [(1.0, -2.0), (-0.1, -1.5), (-3.0, -8.0), (-2.8, -3.2)])
def test_steep_and_rising_spectra(c1, c2):
    """Spectra with slopes from positive to -8, as in real scans: the fit finds the slope."""
    n, length, q_c = 256, 2.8e-3, 3e4
    k = 2 * np.pi * np.hypot(*np.meshgrid(*2 * [np.fft.fftfreq(n, length / n)], indexing="ij"))
    x = np.where(k > 0, k, q_c) / q_c
    density = np.where(k > 0, np.where(x < 1, x**c1, x**c2), 0.0)
    white = np.fft.fft2(np.random.default_rng(0).standard_normal((n, n)))
    h = np.fft.ifft2(np.sqrt(density) * white / np.maximum(np.abs(white), 1e-300)).real
    fit = characterise(make_topography(h, (length, length), periodic=True)).bifractal
    assert fit.c1 == pytest.approx(c1, abs=0.02)
    assert fit.c2 == pytest.approx(c2, abs=0.02)
    assert fit.q_c == pytest.approx(q_c, rel=0.02 if c2 - c1 < -1 else 0.3)


@pytest.mark.parametrize(
    "numbers",
    [
        {"S_q": -1.0},
        {"S_q": 1e-6, "c2": 0.5},
        {"S_q": 1e-6, "q_c": 0.0},
        {"S_q": 1e-6, "band": (10.0, 1.0)},
        {"S_q": 1e-6, "S_sk": 2.0, "S_ku": 3.0},
    ],
)
def test_impossible_numbers_are_named(numbers):
    """Statistics that no surface can have: named error."""
    with pytest.raises(SurfaceError):
        given_statistics(**numbers)


def test_heights_of_statistics_without_a_scan():
    """Statistics without a scan have no heights: named error."""
    with pytest.raises(SurfaceError, match="numbers"):
        _ = PAPER.heights


@pytest.fixture
def scene_of(tmp_path):
    """A scene of some scans, from their names as TOML and their heights and sizes by name."""

    def write(scans, **files):
        for name, (heights, size) in files.items():
            np.savez(tmp_path / f"{name}.npz", heights=heights, size=np.array(size))
        path = tmp_path / "scene.toml"
        path.write_text(f'stages = ["surface"]\n[surface]\nscan = {scans}\n')
        return path

    return write


@pytest.mark.parametrize(
    ("scans", "other", "named"),
    [
        ("[]", None, r"surface.scan = \[\]: an empty list; name the file"),
        ('["a.npz", "none.npz"]', None, "surface.scan = 'none.npz': no such file"),
        ('["a.npz", ""]', None, "surface.scan = '': .*no such file"),
        ('["a.npz", "./a.npz"]', None, "'./a.npz' is the same file as 'a.npz'"),
        ('["a.npz", "b.npz"]', "coarse", "surface.scan = 'b.npz': pixels of 30 x 30 um, and of"),
        ('["a.npz", "b.npz"]', "short", r"surface.scan = 'b.npz': 96 x 128 pixels, .* 128 x 128"),
        ('["a.npz", "b.npz"]', "missing", "surface.scan = 'b.npz': .*no valid point"),
        ('["a.npz", "b.npz"]', "flat", "surface.scan = 'b.npz': .*the scan is flat"),
    ],
)
def test_lists_of_scans_that_cannot_be_averaged(scene_of, scans, other, named):
    """No scan, a file twice or not there, other pixels, one scan empty or flat: named error."""
    first = scan()
    others = {
        "coarse": (scan(64, 1).heights, (1.92e-3, 1.92e-3)),
        "short": (scan(128, 1).heights[:96], (1.35e-3, 1.8e-3)),
        "missing": (np.full((128, 128), np.nan), (1.8e-3, 1.8e-3)),
        "flat": (np.zeros((128, 128)), (1.8e-3, 1.8e-3)),
    }
    files = {"b": others[other]} if other else {}
    path = scene_of(scans, a=(first.heights, first.size), **files)
    with pytest.raises(SceneError, match=named) as said:
        read_surface(read_scene(path))
    assert str(path) in str(said.value)


def test_sizes_rounded_by_a_file_are_the_same_pixels(scene_of):
    """Pixels that differ in the seventh digit: the scans are averaged on the grid of the first."""
    first, second = scan(128, 0), scan(128, 1)
    files = {"a": (first.heights, first.size), "b": (second.heights, 1.0000003 * first.size)}
    found = read_surface(read_scene(scene_of('["a.npz", "b.npz"]', **files)))
    assert all(np.array_equal(t.size, first.size) for t in found.topographies)
    assert np.array_equal(found.scans[0].psd.q, found.scans[1].psd.q)


def test_one_of_two_scans_is_mostly_missing(scene_of):
    """Both scans weigh the same: the variance is the mean, not that of most of the points."""
    first, second = scan(128, 0), scan(128, 1)
    holes = 2 * second.heights
    holes[np.random.default_rng(2).random(holes.shape) < 0.6] = np.nan
    files = {"a": (first.heights, first.size), "b": (holes, first.size)}
    found = read_surface(read_scene(scene_of('["a.npz", "b.npz"]', **files)))
    each = [s.S_q for s in found.scans]
    assert found.S_q == pytest.approx(np.sqrt(np.mean(np.square(each))), rel=1e-12)
    assert found.hdf.S_q == pytest.approx(found.S_q, rel=1e-12)
    assert found.missing == np.isnan(holes).sum()

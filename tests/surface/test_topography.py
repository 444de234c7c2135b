"""Levelling, outliers, missing points, and what counts as a scan."""

import numpy as np
import pytest

from brake_fenicsx.arguments import number, real
from brake_fenicsx.errors import SceneError, SurfaceError
from brake_fenicsx.surface import make_topography
from brake_fenicsx.surface.topography import fill, form, outliers


def grid(nx=40, ny=30):
    return np.linspace(0, 1, nx)[:, None], np.linspace(0, 1, ny)[None, :]


@pytest.mark.parametrize(
    ("level", "shape"),
    [
        ("mean", lambda x, y: 0.0 * x * y + 3.0),
        ("plane", lambda x, y: 1e-3 * x - 2e-3 * y + 5.0),
        ("second-order", lambda x, y: x - y + 0.2 * x**2 - 0.4 * x * y + 0.7 * y**2),
    ],
)
def test_form_finds_what_it_models_with_points_missing(level, shape):
    x, y = grid()
    h = shape(x, y)
    holes = h.copy()
    holes[3:9, 5:20] = np.nan
    found = form(make_topography(holes, (1.0, 2.0)), level)
    np.testing.assert_allclose(found, h, atol=1e-12 * np.abs(h).max())


def test_form_is_the_best_fit():
    """The residual of a plane is orthogonal to 1, x and y."""
    x, y = grid()
    h = np.random.default_rng(0).standard_normal((40, 30))
    rest = h - form(make_topography(h, (1.0, 1.0)), "plane")
    for term in (np.ones_like(h), x + 0 * y, y + 0 * x):
        assert abs(np.vdot(rest, term)) < 1e-10 * np.linalg.norm(term)


def test_a_far_zero_of_the_instrument_costs_no_digits():
    x, y = grid()
    h = 1e-7 * np.sin(20 * x * y)
    near = form(make_topography(h, (1.0, 1.0)), "plane")
    far = form(make_topography(h + 0.1, (1.0, 1.0)), "plane")
    np.testing.assert_allclose(far - 0.1, near, atol=1e-16)


def test_fill_is_harmonic_and_stays_between_its_neighbours():
    rng = np.random.default_rng(1)
    h = rng.standard_normal((20, 25))
    holes = h.copy()
    holes[5:9, 7:12] = np.nan
    holes[0:3, 0:2] = np.nan
    full = fill(holes)
    known = np.isfinite(holes)
    np.testing.assert_array_equal(full[known], h[known])
    inner = full[6:8, 8:11]
    mean = (full[5:7, 8:11] + full[7:9, 8:11] + full[6:8, 7:10] + full[6:8, 9:12]) / 4
    np.testing.assert_allclose(inner, mean, atol=1e-12)
    assert full[~known].max() <= h[known].max() and full[~known].min() >= h[known].min()


def test_spikes_are_found_and_summits_are_not():
    """A summit of 8 standard deviations with flanks stays; one pixel as high goes."""
    rng = np.random.default_rng(2)
    x, y = np.meshgrid(np.arange(80), np.arange(80), indexing="ij")
    h = np.sin(x / 9.0) + np.cos(y / 7.0) + 0.05 * rng.standard_normal(x.shape)
    h += 8.0 * h.std() * np.exp(-((x - 40) ** 2 + (y - 20) ** 2) / 50.0)
    h[60, 60] += 8.0 * h.std()
    h[5, 5] = np.nan
    found = outliers(h, "spike")
    assert found.sum() == 1 and found[60, 60]
    assert outliers(h, "mad", 5.0)[40, 20]
    assert not outliers(h, "none").any()


@pytest.mark.parametrize(
    ("heights", "size", "named"),
    [
        (np.zeros(5), (1.0, 1.0), "shape"),
        (np.zeros((1, 5)), (1.0, 1.0), "2 x 2"),
        (np.full((3, 3), np.nan), (1.0, 1.0), "no valid point"),
        (np.zeros((3, 3)), (1.0, 0.0), "size"),
        (np.zeros((3, 3)), (np.nan, 1.0), "size"),
        (np.zeros((3, 3)), "wide", "size.*real numbers"),
        (np.eye(3) + 1j, (1.0, 1.0), "complex128; give real numbers"),
        ([[1, 2], [3]], (1.0, 1.0), "give real numbers"),
        ([["a", "b"], ["c", "d"]], (1.0, 1.0), "give real numbers"),
    ],
)
def test_what_is_no_scan(heights, size, named):
    with pytest.raises(SurfaceError, match=named):
        make_topography(heights, size)


def test_unknown_rules_are_named():
    topo = make_topography(np.eye(4), (1.0, 1.0))
    with pytest.raises(SceneError, match="second-order"):
        form(topo, "cubic")
    with pytest.raises(SceneError, match="spike"):
        outliers(topo.heights, "sigma")
    lonely = np.full((4, 4), np.nan)
    lonely[0, 0] = 1.0
    with pytest.raises(SurfaceError, match="1 valid points"):
        form(make_topography(lonely, (1.0, 1.0)), "plane")


def test_what_is_masked_is_missing():
    """A masked array keeps a number under its mask, which is no height."""
    h = np.random.default_rng(0).standard_normal((20, 20))
    masked = np.ma.array(h, mask=np.zeros(h.shape, bool))
    masked.data[3, 4], masked.data[5, 6] = 1e4, np.inf
    masked.mask[3, 4] = True
    topo = make_topography(masked, (1.0, 1.0))
    assert np.argwhere(~topo.valid).tolist() == [[3, 4], [5, 6]]
    assert np.nanmax(np.abs(topo.heights)) < 10
    counts = np.ma.masked_equal(np.array([[1, 2], [-9, 4]], dtype=np.int16), -9)
    np.testing.assert_array_equal(real("counts", counts), [[1, 2], [np.nan, 4]])


@pytest.mark.parametrize("value", [0, -1.0, np.nan, np.inf, "a", [1, 2], None, 1j])
def test_what_is_no_positive_number(value):
    with pytest.raises(SceneError, match=r"^cutoff"):
        number("cutoff", value, least=0.0)
    with pytest.raises(SceneError, match="threshold"):
        outliers(np.eye(4), "mad", value)

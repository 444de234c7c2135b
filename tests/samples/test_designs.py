"""Designs of points, and laws by their quantiles."""

from functools import partial

import numpy as np
import pytest
from scipy import stats

from brake_fenicsx.build.values import quantile
from brake_fenicsx.errors import SceneError
from brake_fenicsx.samples.designs import design_points, design_size, roughness_of
from brake_fenicsx.scene import Distribution
from brake_fenicsx.scene.samples_section import Plan

SEED = np.random.SeedSequence(5)


@pytest.mark.parametrize("design", ["latin-hypercube", "rbd-fast"])
def test_latin_hypercube_has_one_point_in_every_slice(design):
    """A design that is redrawn or permuted on one axis alone loses this."""
    x = design_points(Plan(37, design, 1), 3, SEED)
    for axis in x.T:
        assert sorted((axis * 37).astype(int)) == list(range(37))


def test_sobol_sequence_grows_without_moving_its_points():
    """A resumed run with more samples keeps those it has."""
    few, many = (design_points(Plan(n, "sobol", 1), 3, SEED) for n in (16, 40))
    np.testing.assert_array_equal(few, many[:16])
    assert sorted((few[:, 1] * 16).astype(int)) == list(range(16))


def test_saltelli_crosses_two_blocks():
    """Rows A, A with column j of B, B: what the analysis reads them as."""
    x = design_points(Plan(100, "saltelli", 1), 3, SEED).reshape(16, 5, 3)
    for j in range(3):
        crossed = x[:, 0].copy()
        crossed[:, j] = x[:, 4, j]
        np.testing.assert_array_equal(x[:, 1 + j], crossed)


def test_saltelli_crosses_the_roughness_as_one_more_input():
    """Rows A and A with an input of B have the roughness of A, a row A and the row B that of B."""
    plan = Plan(100, "saltelli", 1, rough=True)
    x = design_points(plan, 3, SEED).reshape(16, 6, 3)
    np.testing.assert_array_equal(x[:, 4], x[:, 0])
    for j in range(3):
        crossed = x[:, 0].copy()
        crossed[:, j] = x[:, 5, j]
        np.testing.assert_array_equal(x[:, 1 + j], crossed)
    assert [roughness_of(plan, 3, k) for k in range(6, 12)] == [6, 6, 6, 6, 11, 11]
    assert [roughness_of(Plan(100, "saltelli", 1), 3, k) for k in range(4)] == [0, 1, 2, 3]
    with pytest.raises(SceneError, match="3 inputs and the roughness; take 48 or more"):
        design_size(Plan(47, "saltelli", 1, rough=True), 3)


def test_no_point_lies_on_a_face_of_the_cube(monkeypatch):
    """An unbounded law is infinite there; so begins a sequence that is not scrambled."""
    monkeypatch.setattr(stats.qmc, "Sobol", partial(stats.qmc.Sobol, scramble=False))
    x = design_points(Plan(64, "sobol", 1), 2, SEED)
    np.testing.assert_array_equal(x[0], 1e-12)
    np.testing.assert_array_equal(x[1], 0.5)


def test_fast_curves_visit_every_axis_evenly_and_differ():
    """Uniform on each axis; curves of one phase would give no interval."""
    plan = Plan(1600, "fast", 2)
    x = design_points(plan, 4, SEED)
    assert x.shape == (1600, 4)
    for axis in x.T:
        assert stats.kstest(axis, "uniform").statistic < 0.05
    assert not np.allclose(x[:800], x[800:])


@pytest.mark.parametrize("design", ["random", "latin-hypercube", "sobol", "fast", "saltelli"])
def test_design_is_its_seed_and_leaves_the_global_generator_alone(design):
    """The layout of FAST is drawn from NumPy's global generator, which others may rely on."""
    np.random.seed(3)  # noqa: NPY002
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    a, b = (design_points(Plan(400, design, 1), 2, seed_again()) for _ in range(2))
    assert (a is None and design == "random") or np.array_equal(a, b)
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002


def seed_again():
    return np.random.SeedSequence(9)


def test_too_few_samples_for_a_design_are_refused():
    with pytest.raises(SceneError, match="2400 or more"):
        design_size(Plan(700, "fast", 3), 4)
    with pytest.raises(SceneError, match="48 or more"):
        design_size(Plan(40, "saltelli", 1), 4)


U = (np.arange(200000) + 0.5) / 200000


def test_lognormal_law_has_the_mean_and_deviation_of_the_value():
    """Not those of the logarithm."""
    x = quantile(Distribution("lognormal", mean=3.0, sd=1.5), U)
    assert x.mean() == pytest.approx(3.0, rel=1e-3)
    assert x.std() == pytest.approx(1.5, rel=5e-3)
    cut = quantile(Distribution("lognormal", mean=3.0, sd=1.5, min=2.0, max=5.0), U)
    assert cut.min() >= 2.0
    assert cut.max() <= 5.0
    inside = (x >= 2.0) & (x <= 5.0)
    assert cut.mean() == pytest.approx(x[inside].mean(), rel=1e-3)


@pytest.mark.parametrize(("low", "high"), [(-np.inf, np.inf), (1.0, 2.5), (4.0, 6.0), (0.1, 0.4)])
def test_truncated_normal_law_is_that_of_scipy(low, high):
    """In both tails too, seven standard deviations from the mean."""
    u = np.linspace(1e-3, 1 - 1e-3, 200)
    x = quantile(Distribution("normal", mean=2.0, sd=0.3, min=low, max=high), u)
    a, b = (low - 2.0) / 0.3, (high - 2.0) / 0.3
    np.testing.assert_allclose(x, stats.truncnorm.ppf(u, a, b, loc=2.0, scale=0.3), rtol=1e-12)


def test_measured_values_are_drawn_as_they_are_with_equal_chance():
    x = quantile(Distribution("measured", values=(0.5, 0.3, 0.4, 9.0), max=1.0), U)
    found, counts = np.unique(x, return_counts=True)
    np.testing.assert_array_equal(found, [0.3, 0.4, 0.5])
    assert np.ptp(counts) <= 1
    assert quantile(Distribution("measured", values=(1.0, 2.0)), 1.0) == 2.0


def test_spread_is_relative_to_the_scene():
    x = quantile(Distribution("uniform", spread=0.2), U, 50.0)
    assert (x.min(), x.max()) == pytest.approx((40.0, 60.0), rel=1e-4)

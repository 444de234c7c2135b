"""Laws of fine surfaces on two grids, and laws with a hardness."""

import numpy as np
import pytest

from brake_fenicsx.micro import LawRecipe, contact_law, law_library, load_laws, save_laws
from brake_fenicsx.micro.law import LawLibrary
from brake_fenicsx.micro.law_of_surface import low_passed
from brake_fenicsx.micro.scaled import scaled_laws
from brake_fenicsx.surface import given_statistics, synthesise

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
SIZE = (2.825e-3, 2.825e-3)
E_STAR = 2373.4e6
HARD = 400e6


def surface(seed, n=256):
    return synthesise(PAPER.bifractal, PAPER.hdf, (n, n), SIZE, np.random.default_rng(seed))


def test_low_passed_keeps_the_waves_of_the_coarse_grid():
    """A sum of waves: those that the coarse grid resolves come back exactly, the others go."""
    x = np.arange(96) / 96
    y = np.arange(60) / 60
    long = np.cos(2 * np.pi * (3 * x[:, None] + 2 * y)) + np.sin(2 * np.pi * 5 * y)
    h = long + np.cos(2 * np.pi * 40 * x)[:, None]
    coarse = low_passed(h, (32, 20))
    np.testing.assert_allclose(coarse, long[::3, ::3], atol=1e-12)


@pytest.mark.parametrize("hardness", [None, HARD])
def test_two_grids_agree_with_one(hardness):
    """Rms over six surfaces: separation within 0.04 S_q, pressure at 5 MPa within 10 %."""
    at = np.array([0.05e6, 0.2e6, 1e6, 5e6])
    misses = []
    for seed in range(6):
        topo = surface(seed)
        two, one = (
            contact_law(topo, E_STAR, 10e6, steps=20, hardness=hardness, grids=grids)
            for grids in ("two", "one")
        )
        d = [np.interp(np.log(at), np.log(law.steps[1]), law.steps[0]) for law in (two, one)]
        misses.append((d[0] - d[1]) / topo.record.S_q)
        assert np.all(np.diff(two.steps[0]) < 0)
        assert two.first_touch == pytest.approx(one.first_touch)
    rms = np.sqrt(np.mean(np.square(misses), axis=0))
    assert np.all(rms < 0.04)
    assert np.all(rms[:1] < 1e-9)  # few touch: both are the fine grid's


def test_two_grids_are_one_where_the_surface_is_coarse():
    topo = surface(0, 128)
    two, one = (contact_law(topo, E_STAR, 5e6, grids=grids) for grids in ("two", "one"))
    for a, b in zip(two.steps, one.steps, strict=True):
        np.testing.assert_array_equal(a, b)


def test_stiffness_of_vibration_of_an_elastic_law_is_that_of_loading():
    law = contact_law(surface(1, 64), E_STAR, 5e6)
    d = np.linspace(-2, 5, 200) * PAPER.S_q
    np.testing.assert_array_equal(law.vibration(d), law.stiffness(d))


def test_hardness_makes_vibrations_stiffer_than_loading(tmp_path):
    """Softer under load than the elastic surface, stiffer for vibrations; kept on disk, scaled."""
    recipe = LawRecipe(PAPER.bifractal, PAPER.hdf, E_STAR, (96, 96), SIZE, hardness=100e6)
    laws = law_library(recipe, 4, 1)
    assert laws.ratio is not None and np.all(laws.ratio >= 1)
    elastic = law_library(LawRecipe(PAPER.bifractal, PAPER.hdf, E_STAR, (96, 96), SIZE), 4, 1)
    ratios = []
    for own, other in zip(laws, elastic, strict=True):
        d, p = own.steps[:2]
        at = np.exp(np.interp(np.log(2e5), np.log(p), np.log(own.steps[3])))
        d_e, p_e = other.steps[:2]
        ratios.append(at / np.exp(np.interp(np.log(2e5), np.log(p_e), np.log(other.steps[2]))))
        x = np.linspace(d[-1], own.first_touch, 300)
        # Interpolated between the steps, exact at them; energy and pressure belong together.
        np.testing.assert_allclose(own.vibration(d), own.steps[3], rtol=1e-9)
        assert np.all(own.vibration(x) >= own.stiffness(x))
        step = 1e-6 * PAPER.S_q
        slope = (own.energy(x - step) - own.energy(x + step)) / (2 * step)
        np.testing.assert_allclose(slope, own.pressure(x), rtol=1e-4, atol=1e-6 * p[-1])
        # A surface that yields lies nearer to the plane at the same pressure.
        assert np.interp(np.log(1e6), np.log(p), d) < np.interp(np.log(1e6), np.log(p_e), d_e)
    assert 1.5 < np.median(ratios) < 8
    save_laws(tmp_path / "laws.npz", laws)
    again = load_laws(tmp_path / "laws.npz")
    assert isinstance(again, LawLibrary)
    index, x = np.array([0, 3]), np.array([2.0, 1.0]) * PAPER.S_q
    np.testing.assert_array_equal(again.vibration(index, x), laws.vibration(index, x))
    doubled = scaled_laws(laws, 2.0)
    np.testing.assert_allclose(doubled.vibration(index, x), 2 * laws.vibration(index, x))


def test_a_high_hardness_is_the_elastic_limit():
    """No pixel yields: both stiffnesses are those of the elastic law, between the steps too."""
    topo = surface(2, 96)
    hard, elastic = (contact_law(topo, E_STAR, 5e6, hardness=h) for h in (1e13, None))
    d = np.linspace(elastic.steps[0][-1], 0.95 * elastic.first_touch, 300)
    np.testing.assert_array_equal(hard.vibration(d), hard.stiffness(d))
    np.testing.assert_allclose(hard.pressure(d), elastic.pressure(d), rtol=0.02)

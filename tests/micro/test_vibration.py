"""The stiffness that the modes read, between the steps of a law and against a dense sweep."""

from dataclasses import replace

import numpy as np
import pytest

from brake_fenicsx.micro import LawSettings, LawSteps, make_library
from brake_fenicsx.micro.law_of_surface import WIDTH, law_steps, local_lines, with_vibration
from brake_fenicsx.surface import given_statistics, synthesise

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
E_STAR = 2373.4e6


def regression(x, y, at):
    """Value and slope of the weighted line about ``at``, by ``numpy.polyfit``."""
    weight = np.maximum(1.0 - (2.0 * (x - at) / WIDTH) ** 2, 0.0)
    slope, value = np.polyfit(x - at, y, 1, w=np.sqrt(weight))
    return value, slope


def test_local_lines_against_weighted_least_squares():
    rng = np.random.default_rng(0)
    x = np.linspace(0.0, 4.0, 400)
    y = np.cumsum(rng.standard_normal(400))
    value, slope = local_lines(x, y)
    for i in (0, 5, 200, 399):
        wanted = regression(x, y, x[i])
        np.testing.assert_allclose((value[i], slope[i]), wanted, rtol=1e-6, atol=1e-6)


def test_exponential_law_in_closed_form():
    """p = p0 exp(-d / u0): the lines are exact, v = p / u0 and dv/dd = -p / u0^2."""
    p = np.geomspace(1e3, 1e8, 150)
    d = -1e-6 * np.log(p / 1e6)
    library = make_library([with_vibration(LawSteps(d, p, p / 1e-6))])
    x = np.linspace(d[-1], d[0], 1001)[1:-1]
    v, slope = library.vibration(np.zeros(x.size, int), x)
    np.testing.assert_allclose(v, 1e12 * np.exp(-x / 1e-6), rtol=1e-9)
    np.testing.assert_allclose(slope, -1e18 * np.exp(-x / 1e-6), rtol=1e-3)


def errors_between_steps(seed, hardness, n=625, side=4.345e-3):
    """Ratios law over dense sweep of v, dv/dd and p where the brake presses, .05 to .45 MPa.

    The dense sweep has 25 times the steps, 1000 per decade of load, on the same grid. Its v under
    a hardness is the solver's, point by point; its v without one, and its dv/dd, are regressions.
    """
    rng = np.random.default_rng(seed)
    topo = synthesise(PAPER.bifractal, PAPER.hdf, (n, n), (side, side), rng)
    top = 0.9e6  # half a width above the pressures that are looked at
    usual = LawSettings(E_STAR, top, hardness=hardness, grids="one")
    library = make_library([law_steps(topo, usual)])
    steps = round(1000 * np.log10(top / 2.5e4))
    dense = law_steps(topo, replace(usual, min_pressure=2.5e4, steps=steps))
    x = np.log(dense.p)
    at = np.flatnonzero((dense.p > 5e4) & (dense.p < 4.5e5))[::7]
    d_line = np.array([regression(x, dense.d, x[i])[1] for i in at])
    v = dense.p[at] / -d_line if hardness is None else dense.v[at]
    ln_v = np.log(dense.p / dense.k) if hardness is None else np.log(dense.v)
    if hardness is None:  # the smooth v at every point, of which the line is taken
        lines = [regression(x, dense.d, a)[1] for a in x]
        ln_v = x - np.log(-np.array(lines))
    level, rise = np.array([regression(x, ln_v, x[i]) for i in at]).T
    slope = np.exp(level) * rise / d_line
    index = np.zeros(at.size, dtype=int)
    v_law, slope_law = library.vibration(index, dense.d[at])
    p_law, _ = library.loading(index, dense.d[at])
    return v_law / v, slope_law / slope, p_law / dense.p[at]


def rms(ratios):
    return np.sqrt(np.mean((np.concatenate(ratios) - 1.0) ** 2))


@pytest.mark.long
@pytest.mark.parametrize("hardness", [None, 400e6])
def test_laws_are_right_between_their_steps(hardness):
    """One patch of 402 pixels; the slow test looks at the demo's patch and more surfaces."""
    found = [errors_between_steps(0, hardness, 402, 2.825e-3)]
    v, slope, p = zip(*found, strict=True)
    assert rms(v) < 0.03 and rms(slope) < 0.15 and rms(p) < 0.006, (rms(v), rms(slope), rms(p))
    assert np.concatenate(slope).min() > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("hardness", [None, 100e6, 200e6, 400e6])
def test_laws_are_right_between_their_steps_on_the_patch_of_the_demo(hardness):
    v, slope, p = zip(*[errors_between_steps(seed, hardness) for seed in range(2)], strict=True)
    assert rms(v) < 0.02 and rms(slope) < 0.15 and rms(p) < 0.004, (rms(v), rms(slope), rms(p))
    assert np.concatenate(slope).min() > 0.0

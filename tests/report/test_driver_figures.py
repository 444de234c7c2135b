"""Bars and maps of what drives a mode, against the synthetic tables."""

import numpy as np
import pytest

from brake_fenicsx.report.input_figures import draw_driver_maps, draw_drivers
from run_tables import read_run


@pytest.fixture(scope="module")
def run(run_directory):
    return read_run(run_directory)


def test_bars_are_the_first_sample_and_diamonds_the_median(run):
    """Each in its own step; what is not trusted is hollow; a family without the first sample."""
    axes = [axis for axis in draw_drivers(run).axes if axis.get_visible()]
    classical, rough, missed = axes[0], axes[2], axes[3]
    steps = np.array([1e-2] * 5 + [1e-3])
    widths = [bar.get_width() for bar in classical.patches]
    np.testing.assert_allclose(widths, steps * (300.0 - 200.0 * np.arange(6)))
    assert [bar.get_facecolor()[3] for bar in classical.patches] == [1, 1, 1, 0, 1, 1]
    assert [t.get_text() for t in classical.get_yticklabels()] == [
        "friction, pad_disc", "load, pad.piston", "contact stiffness", "stiffness, disc.body",
        "mass, disc.body", "loss factor, disc.body",
    ]  # fmt: skip
    for axis in (rough, missed):
        diamonds = [line.get_xdata()[0] for line in axis.lines if line.get_marker() == "D"]
        np.testing.assert_allclose(diamonds, [3.0, 1.0, -1.0])
    assert len(rough.patches) == 6 and not missed.patches


def test_maps_show_both_pads_per_area(run):
    """The derivative grows along x alone; colours are centred at zero."""
    figure = draw_driver_maps(run)
    panels = [axis for axis in figure.axes if axis.get_title()]
    assert len(panels) == 2 * 2 * 2
    patches = panels[0].collections[0]
    low, high = patches.get_clim()
    assert low == -high < 0
    x = np.array([path.vertices[:, 0].mean() for path in patches.get_paths()])
    density = 0.1 * x / 1e3 / 2.825e-3**2 * 1e-4
    # Corners close each path: the first counts twice.
    np.testing.assert_allclose(patches.get_array(), density, atol=0.05 * np.abs(density).max())


def test_a_run_without_drivers_has_no_figure(run):
    from dataclasses import replace

    assert draw_drivers(replace(run, drivers=None)) is None
    assert draw_driver_maps(replace(run, driver_maps=None)) is None

"""Bars and maps of which input moves squeal, against the synthetic tables."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from brake_fenicsx.report.input_figures import draw_driver_maps, draw_drivers, draw_sensitivity
from brake_fenicsx.report.style import house_style
from brake_fenicsx.results.tables import write_rows
from run_tables import SENSITIVITY, read_run

NAMES = ("contact.pad_disc.friction", "materials.lining.E_3")


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
        (diamonds,) = (line.get_xdata() for line in axis.lines if line.get_marker() == "D")
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
    assert draw_drivers(replace(run, drivers=None)) is None
    assert draw_driver_maps(replace(run, driver_maps=None)) is None


def row(scope, where, outcome, name, first, total=None):
    ends = [None] * 3 if total is None else [total, total - 0.1, total + 0.1]
    values = [first, first - 0.05, first + 0.05, *ends]
    return ["parametric", 0.0, scope, where, 1900.0, outcome, name, *values, "RBD-FAST", 40, 0]


def drawn(run_directory, folder, rows):
    shutil.copytree(run_directory, folder)
    write_rows(folder / "sensitivity.csv", SENSITIVITY, rows)
    with house_style():
        return draw_sensitivity(read_run(folder))


def test_bars_are_the_indices_of_growth(run_directory, tmp_path):
    """Bars of the verdict, of another input or of a single band would be no smaller."""
    rows = [
        row("band", "0-16000", "growth", NAMES[0], 0.6, 0.7),
        row("band", "0-16000", "growth", NAMES[1], 0.2),
        row("band", "0-16000", "squeal", NAMES[0], 0.11),
        row("band", "0-2000", "growth", NAMES[0], 0.12),
        row("family", "3", "growth", NAMES[0], 0.5),
    ]
    figure = drawn(run_directory, tmp_path / "run", rows)
    heights = sorted(bar.get_height() for bar in figure.axes[0].patches)
    np.testing.assert_allclose(heights, [0.2, 0.5, 0.6])
    assert figure.axes[0].get_xticklabels()[0].get_text() == "0-16000 Hz"


def test_no_table_or_no_index_draws_nothing(run_directory, tmp_path):
    shutil.copytree(run_directory, tmp_path / "c")
    (tmp_path / "c" / "sensitivity.csv").unlink()
    assert draw_sensitivity(read_run(tmp_path / "c")) is None
    empty = [
        ["parametric", 0.0, "family", "3", 1.0, "growth", NAMES[0], *[None] * 6, "RBD-FAST", 4, 0]
    ]
    assert drawn(run_directory, tmp_path / "a", empty) is None
    assert drawn(run_directory, tmp_path / "b", []) is None

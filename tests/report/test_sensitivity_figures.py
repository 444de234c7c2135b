"""The figure of sensitivity indices."""

import shutil

import numpy as np

from brake_fenicsx.report.input_figures import draw_sensitivity
from brake_fenicsx.report.style import house_style
from brake_fenicsx.results.tables import write_rows
from run_tables import SENSITIVITY, read_run

NAMES = ("contact.pad_disc.friction", "materials.lining.E_3")


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

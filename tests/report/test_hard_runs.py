"""Hard cases of the report: single items, open contact, no unstable mode, failed samples only."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from brake_fenicsx.errors import SceneError
from brake_fenicsx.report.figures import make_figures
from brake_fenicsx.report.html import write_report
from brake_fenicsx.results.answer import approach_rows, summary_table
from brake_fenicsx.results.tables import MODES, SAMPLES, write_rows
from run_tables import CONTACT, cells, read_run

pytestmark = pytest.mark.hard
MODE = ["classical", 0, 0, 1000.0, 0.0, 0.0, 0.0, 0.0, float("nan"), "neutral", -1]


@pytest.fixture
def painted(monkeypatch):
    """Figures are laid out and drawn, but not written."""

    def paint(figure, directory, name):
        FigureCanvasAgg(figure).draw()
        return [directory / f"{name}.png"]

    monkeypatch.setattr("brake_fenicsx.report.figures.save", paint)


def names(directory):
    return {path.stem for path in make_figures(read_run(directory))}


def test_one_neutral_mode_without_error_estimate(tmp_path, without_pixels):
    """One mode, neutral and without error estimate: figures, table and page."""
    write_rows(tmp_path / "modes.csv", MODES, [MODE])
    assert names(tmp_path) == {"figure9_squeal_map"}
    assert cells(approach_rows(read_run(tmp_path)))[0][1:7] == [1, 0, 1, 0, 1, 0]
    assert "none" in summary_table(read_run(tmp_path))
    write_report(read_run(tmp_path))


def test_no_mode_in_the_band(tmp_path, painted):
    """No mode in the band: tables and counts, but no squeal map."""
    write_rows(tmp_path / "modes.csv", MODES, [])
    write_rows(tmp_path / "samples.csv", SAMPLES, [["parametric", k, "ok", k] for k in range(5)])
    drawn = names(tmp_path)
    assert "figure9_squeal_map" not in drawn
    assert "unstable_per_sample" in drawn
    assert cells(approach_rows(read_run(tmp_path)))[0][:7] == ["parametric", 5, 0, 0, 0, 0, 0]


def test_all_samples_failed(tmp_path):
    """Failed samples only: a page that says so."""
    write_rows(tmp_path / "modes.csv", MODES, [])
    write_rows(tmp_path / "samples.csv", SAMPLES, [["parametric", 0, "singular", 1]])
    assert names(tmp_path) == set()
    assert cells(approach_rows(read_run(tmp_path)))[0][:7] == ["parametric", 0, 1, 0, 0, 0, 0]
    assert "Parametric" in write_report(read_run(tmp_path)).read_text()


def test_all_contact_open_and_a_single_element(tmp_path, painted):
    """One contact element, open: its figure is drawn."""
    row = ["classical", 0, 0, 0.1, 0.0, 0.01, 8e-6, 1e-5, 0.0, 0.0, 0.0, 0.0, -1]
    write_rows(tmp_path / "contact.csv", CONTACT, [row])
    assert names(tmp_path) == {"contact_pressure"}


def test_a_single_linear_law(tmp_path, painted):
    """One linear law: its figure is drawn."""
    d = np.linspace(0.0, -1e-6, 5)[None]
    p = -2e13 * d
    np.savez(tmp_path / "laws.npz", d=d, p=p, k=np.full(d.shape, 2e13), seed=[0])
    assert names(tmp_path) == {"figure8_laws"}


def test_maps_without_any_contact(tmp_path, painted):
    """Contact maps without a touching point: their figure is drawn."""
    empty = np.zeros((1, 8, 8))
    np.savez(
        tmp_path / "contact_maps.npz", size=[1e-3, 1e-3], p_over_E=[0.0], pressures=empty,
        area_fraction=[0.0],
    )  # fmt: skip
    assert names(tmp_path) == {"figure7_contact_maps"}


@pytest.mark.parametrize(
    "heights", [np.zeros((4, 4)), np.full((4, 4), np.nan)], ids=["flat", "lost"]
)
def test_a_scan_without_roughness_or_without_points(tmp_path, save_scan, heights, painted):
    """A flat scan, or one without points: its figures are drawn."""
    save_scan(tmp_path, heights, [1e-3, 1e-3])
    assert names(tmp_path) == {"figure4_topography", "figure5_statistics"}


def test_text_that_looks_like_markup_stays_text(tmp_path, without_pixels):
    """Names that look like markup stay text on the page."""
    write_rows(tmp_path / "modes.csv", MODES, [["<i>a</i> & $x_$", *MODE[1:]]])
    page = write_report(read_run(tmp_path)).read_text()
    assert "<i>" not in page
    assert "&lt;i&gt;a&lt;/i&gt; &amp; $x_$" in page


def test_a_missing_array_is_named(tmp_path):
    """A result file without an array: named error."""
    np.savez(tmp_path / "laws.npz", d=[[0.0]], p=[[0.0]])
    with pytest.raises(SceneError, match=r"laws\.npz: array k is missing"):
        make_figures(read_run(tmp_path))

"""Several scans of one pad: their mean spectrum and variance, pooled heights, and their scatter."""

import json
import os
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.build.measured_surface import read_surface
from brake_fenicsx.cli import main
from brake_fenicsx.errors import SceneError
from brake_fenicsx.pipeline import run
from brake_fenicsx.report.figure_inputs import surface_arrays
from brake_fenicsx.report.style import SKY
from brake_fenicsx.report.surface_figures import draw_bearing_curve, draw_statistics
from brake_fenicsx.results.run import read_run
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.digest import laws_key, result_digest
from brake_fenicsx.surface import given_statistics, read_topography, synthesise
from run_tables import read_columns, read_rows

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
SCANS = os.environ.get("BRAKE_FENICSX_SCANS")


def write_scans(folder, n=128, names="abc"):
    for k, name in enumerate(names):
        topo = synthesise(PAPER.bifractal, PAPER.hdf, (2 * n, 2 * n), (2e-5 * n, 2e-5 * n),
                          np.random.default_rng(k))  # fmt: skip
        np.savez(folder / f"{name}.npz", heights=topo.heights[:n, :n], size=topo.size / 2)


@pytest.fixture
def scene(tmp_path):
    """A scene of a surface alone, from the value of ``surface.scan`` and more lines."""
    write_scans(tmp_path)

    def write(scan='["a.npz", "b.npz", "c.npz"]', more="", stages='["surface"]'):
        file = tmp_path / "scene.toml"
        file.write_text(f"stages = {stages}\n[surface]\nscan = {scan}\n{more}\n")
        return read_scene(file)

    return write


def test_a_list_of_one_file_is_the_file(scene):
    """The same hashes, so that results of either are found, and the same numbers to the last."""
    single, one = scene('"a.npz"'), scene('["a.npz"]')
    assert result_digest(one) == result_digest(single) and laws_key(one) == laws_key(single)
    first, second = (surface_arrays(read_surface(s), None) for s in (single, one))
    assert first.keys() == second.keys() and first["heights"].ndim == 2
    for name, values in first.items():
        assert values.tobytes() == second[name].tobytes()


def test_results_depend_on_every_file_of_a_list(scene, tmp_path):
    two, other = scene('["a.npz", "b.npz"]'), scene('["a.npz", "c.npz"]')
    before = result_digest(two), laws_key(two)
    assert before[0] != result_digest(other) and before[1] != laws_key(other)
    with np.load(tmp_path / "b.npz") as file:
        np.savez(tmp_path / "b.npz", heights=2 * file["heights"], size=file["size"])
    assert before[0] != result_digest(two) and before[1] != laws_key(two)


def test_means_over_scans(scene):
    """Variance, spectrum and mean height are means, heights are pooled, each scan is kept."""
    found = read_surface(scene())
    each = [read_surface(scene(f'"{name}.npz"')) for name in "abc"]
    assert found.S_q**2 == pytest.approx(np.mean([s.S_q**2 for s in each]), rel=1e-12)
    assert found.mean == pytest.approx(np.mean([s.mean for s in each]), rel=1e-12)
    heights = np.concatenate([s.heights for s in each])
    assert found.S_sk == pytest.approx(np.mean(heights**3) / np.mean(heights**2) ** 1.5, rel=1e-9)
    assert found.hdf.ppf(np.array([0.1, 0.8])) == pytest.approx(
        np.quantile(heights, [0.1, 0.8], method="hazen"), rel=1e-9
    )
    # The slope within a ring is found from the mean spectrum: rings differ by that alone.
    rings = np.mean([s.psd.C for s in each], axis=0)
    inside = found.psd.reliable
    assert found.psd.C[inside] == pytest.approx(rings[inside], rel=0.05)
    assert [s.S_q for s in found.scans] == [s.S_q for s in each]
    S_q = [s.S_q for s in each]
    assert found.errors[1] == pytest.approx(np.std(S_q, ddof=1) / np.sqrt(3), rel=1e-12)


def test_equal_scans_have_the_statistics_of_one(scene, tmp_path):
    (tmp_path / "b.npz").write_bytes((tmp_path / "a.npz").read_bytes())
    two, one = read_surface(scene('["a.npz", "b.npz"]')), read_surface(scene('"a.npz"'))
    assert two.S_q == pytest.approx(one.S_q, rel=1e-12)
    assert pytest.approx(one.psd.C, rel=1e-12) == two.psd.C
    # The fit ends where its sum of squares stands still to 1e-8: far within its standard error.
    assert two.bifractal.c2 == pytest.approx(one.bifractal.c2, abs=1e-3 * one.bifractal.errors[1])
    assert two.errors == (0, 0, 0, 0)


def test_scans_of_other_numbers_of_pixels_are_to_be_cut(scene, tmp_path):
    with np.load(tmp_path / "b.npz") as file:
        part = file["heights"][:100, :90]
        size = file["size"] * part.shape / np.array(file["heights"].shape)
    np.savez(tmp_path / "b.npz", heights=part, size=size)
    said = r"surface.scan = 'b.npz': 100 x 90 pixels, and .* cut both to 100 x 90 pixels"
    with pytest.raises(SceneError, match=said):
        read_surface(scene())


def test_commands_know_lists(scene, tmp_path, capsys):
    file = scene('"a.npz"').file
    assert main(["check", str(file), "--set", 'surface.scan=["a.npz", "b.npz"]']) == 0
    said = capsys.readouterr().out
    assert [name in said for name in ("a.npz", "b.npz", "c.npz")] == [True, True, False]
    out = str(tmp_path / "out")
    assert main(["run", str(file), "-o", out, "--set", 'surface.scan=["a.npz", "b.npz"]']) == 0
    settings = json.loads((tmp_path / "out" / "summary.json").read_text())["in_effect"]
    assert settings["surface"]["scan"] == ["a.npz", "b.npz"]
    # Another list is another scene.
    assert main(["run", str(file), "-o", out, "--set", 'surface.scan=["a.npz", "c.npz"]']) == 2
    assert "contains results of another scene" in capsys.readouterr().err


def check_results(folder, count):
    """Tables, figures and page of a run of several scans."""
    rows = {row["parameter"]: row for row in read_rows(folder / "tables" / "surface.csv")}
    for name in ("S_a", "S_q", "S_k", "S_pk", "S_vk", "S_mr1", "S_mr2", "S_dq"):
        each = [rows[name][f"scan_{k}"] for k in range(1, count + 1)]
        assert rows[name]["mean"] == pytest.approx(np.mean(each), rel=1e-9)
        assert rows[name]["standard_deviation"] == pytest.approx(np.std(each, ddof=1), rel=1e-9)
    assert rows["S_a"]["value"] == rows["S_a"]["mean"]
    S_q = [rows["S_q"][f"scan_{k}"] for k in range(1, count + 1)]
    assert rows["S_q"]["value"] == pytest.approx(np.sqrt(np.mean(np.square(S_q))), rel=1e-9)
    spectrum = read_columns(folder / "tables" / "spectrum.csv")
    curve = read_columns(folder / "tables" / "bearing_curve.csv")
    data = read_run(folder)
    for k in range(count):
        assert np.array_equal(spectrum[f"C_scan_{k + 1}_m4"], data.surface["scan_C"][k])
        assert curve[f"height_scan_{k + 1}_m"][0] == np.nanmax(data.surface["heights"][k])
    for figure in (draw_statistics(data), draw_bearing_curve(data)):
        lines = [line for axes in figure.axes for line in axes.lines]
        (together,) = (line for line in lines if f"{count} scans" in str(line.get_label()))
        thin = [line for line in lines if line.get_color() == SKY]
        assert len(thin) == count
        assert all(together.get_linewidth() > 2 * line.get_linewidth() for line in thin)
    page = (folder / "report.html").read_text()
    assert f"scan {count}" in page and "standard deviation" in page


def test_a_run_of_several_scans(scene, tmp_path, without_pixels):
    """From three scans to laws, tables, figures and page."""
    more = '[micro]\npatch = "0.8 mm"\npixels = 48\nlaws = 2\nscans = 2\nhardness = "200 MPa"'
    file = scene(more=more, stages='["surface", "micro", "report"]').file
    run(file, MPI.COMM_SELF, tmp_path / "out")
    check_results(tmp_path / "out", 3)
    assert (tmp_path / "out" / "contact_maps.npz").exists()


@pytest.mark.skipif(not SCANS, reason="BRAKE_FENICSX_SCANS names no folder of scans")
def test_two_fields_of_a_real_instrument(scene, tmp_path, without_pixels):
    """The halves of an interferometer's scan, with its missing points."""
    topo = read_topography(Path(SCANS) / "wyko_wli_736x480.opd")
    for name, heights in (("a", topo.heights[:368]), ("b", topo.heights[368:])):
        np.savez(tmp_path / f"{name}.npz", heights=heights, size=heights.shape * topo.pixel)
    file = scene('["a.npz", "b.npz"]', stages='["surface", "report"]').file
    run(file, MPI.COMM_SELF, tmp_path / "out")
    check_results(tmp_path / "out", 2)
    stats = json.loads(str(read_run(tmp_path / "out").surface["stats"]))
    assert sum(scan["missing"] for scan in stats["scans"]) == np.isnan(topo.heights).sum()

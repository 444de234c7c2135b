"""Surface and laws as tables for other programs."""

import shutil

import numpy as np
import pytest

from brake_fenicsx.report.surface_page import write_surface_tables
from brake_fenicsx.surface import read_topography
from run_tables import read_columns, read_rows, read_run


@pytest.fixture
def written(run_directory, tmp_path):
    """A run of a surface and laws, whose laws have different numbers of steps."""
    shutil.copy(run_directory / "surface.npz", tmp_path)
    with np.load(run_directory / "laws.npz") as file:
        laws = dict(file)
    laws["count"] = np.array([60 - i for i in range(30)])
    laws["v"] = 2.0 * laws["k"]
    np.savez(tmp_path / "laws.npz", **laws)
    run = read_run(tmp_path)
    return run, {path.name: path for path in write_surface_tables(run)}


def test_laws_are_the_steps_of_the_library(written):
    run, paths = written
    found = read_columns(paths["laws.csv"])
    assert found["law"].size == sum(60 - i for i in range(30))
    own = found["law"] == 7
    assert np.array_equal(found["p_Pa"][own], run.laws["p"][7, :53])
    assert np.array_equal(found["k_vibration_Pa_per_m"][own], 2 * run.laws["k"][7, :53])


def test_the_artificial_surface_is_read_again_as_a_scan(written):
    run, paths = written
    heights, size = run.surface["artificial"], run.surface["artificial_size"]
    same = read_topography(paths["artificial_surface.npz"])
    assert np.array_equal(same.heights, heights) and np.array_equal(same.size, size)
    text = read_topography(paths["artificial_surface.csv"], tuple(size), "m")
    assert text.heights == pytest.approx(heights, rel=1e-7)


def test_parameters_spectrum_and_bearing_curve(written):
    run, paths = written
    rows = {row["parameter"]: row for row in read_rows(paths["surface.csv"])}
    assert rows["S_q"]["value"] == pytest.approx(1e6 * np.nanstd(run.surface["heights"]))
    assert rows["c1"] == {"parameter": "c1", "value": -2.01, "standard_error": 0.04, "unit": "-"}
    spectrum = read_columns(paths["spectrum.csv"])
    assert np.array_equal(spectrum["C_m4"], run.surface["C"])
    inside = (spectrum["reliable"] == "yes") & (spectrum["fit_m4"] > 0)
    assert inside.any() and np.array_equal(inside, np.isfinite(spectrum["fit_m4"]))
    curve = read_columns(paths["bearing_curve.csv"])
    assert curve["height_m"][0] == np.nanmax(run.surface["heights"])


def test_a_run_of_a_brake_keeps_its_artificial_surface_to_itself(run_directory, tmp_path):
    directory = tmp_path / "run"
    shutil.copytree(run_directory, directory)
    names = {path.name for path in write_surface_tables(read_run(directory))}
    assert names == {"surface.csv", "spectrum.csv", "bearing_curve.csv"}

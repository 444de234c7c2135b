"""The script of speed against error, with small models: every panel has points that make sense."""

import csv
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "scripts" / "speed_against_error.py"


@pytest.mark.slow
def test_every_panel_has_points(tmp_path):
    """More pixels, finer cells and a sharper tolerance have smaller errors, and all are finite."""
    subprocess.run([sys.executable, SCRIPT, "--quick", "--folder", tmp_path], check=True)
    with (tmp_path / "speed_against_error.csv").open() as file:
        rows = list(csv.DictReader(file))
    error = {(row["curve"], row["setting"]): float(row["error"]) for row in rows}
    assert {row["panel"] for row in rows} == {"laws", "brake", "complex modes", "probability"}
    assert all(float(row["seconds"]) > 0 and 0 <= float(row["error"]) < 100 for row in rows)
    assert error["elastic: pixels", "78 pixels"] < error["elastic: pixels", "19 pixels"]
    sizes = [e for (curve, _), e in error.items() if curve == "tetrahedra: frequencies"]
    assert sizes == sorted(sizes, reverse=True)
    tolerance = [error["undamped: tolerance", t] for t in ("0.001", "1e-05", "1e-07")]
    assert tolerance[0] >= tolerance[1] >= tolerance[2] and tolerance[2] < 1e-6
    assert (tmp_path / "speed_against_error.png").stat().st_size > 20_000

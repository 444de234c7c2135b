"""Two surfaces and their laws side by side: numbers of both runs, their ratio, one page."""

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.cli import main
from brake_fenicsx.extras.variants.surfaces import _median, differing, pressures, surface_rows
from brake_fenicsx.micro import load_laws
from brake_fenicsx.pipeline import run
from brake_fenicsx.results.run import read_run
from brake_fenicsx.surface import given_statistics, synthesise
from run_tables import read_rows

SCENE = """\
stages = ["surface", "micro"]
[surface]
scan = "a.npy"
size = ["3 mm", "3 mm"]
height_unit = "m"
level = "none"
[micro]
patch = "3 mm"
pixels = 64
laws = 4
E = "2 GPa"
nu = 0.4
scans = 0
hardness = "200 MPa"
"""


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A scan with two hardnesses, and another scan twice as high."""
    folder = tmp_path_factory.mktemp("surfaces")
    (folder / "s.toml").write_text(SCENE)
    paper = given_statistics(20e-6, 0.0, 3.0)
    h = synthesise(paper.spectrum, paper.hdf, (64, 64), (3e-3, 3e-3), np.random.default_rng(0))
    np.save(folder / "a.npy", h.heights)
    np.save(folder / "b.npy", 2 * h.heights)
    for name, change in (
        ("a", []), ("hard", ["micro.hardness='400 MPa'"]), ("high", ["surface.scan=b.npy"]),
        ("same", []),
    ):  # fmt: skip
        run(folder / "s.toml", MPI.COMM_SELF, folder / name, change)
    return folder


def test_a_surface_twice_as_high(runs):
    rows = {(r[0], r[2]): r for r in surface_rows((read_run(runs / "a"), read_run(runs / "high")))}
    assert rows["S_q", None][7] == pytest.approx(2.0)
    assert rows["S_sk", None][7] == pytest.approx(1.0)
    x, ex, y, ey = rows["S_q", None][3:7]
    assert rows["S_q", None][9] == pytest.approx((y - x) / np.hypot(ex, ey))
    assert rows["S_q", None][8] == pytest.approx(2.0 * np.hypot(ex / x, ey / y))
    assert ("mean", None) not in rows and ("median", None) not in rows
    # As high as it is twice, and no other shape: separations double, too.
    assert rows["separation", 0.2e6][7] > 1.0
    said = differing([*rows.values()])
    assert "S_q" in said and "S_sk" not in said and "+-" in said


def test_what_differs_at_several_pressures_is_said_once():
    """At both ends, with how many there are; what differs by less is left out."""
    rows = [
        ["loading stiffness", "N/mm³", p, 1.0, 0.1, r, 0.1, r, 0.2, far]
        for p, r, far in ((5e4, 3.0, 9.0), (1e5, 1.2, 1.0), (2e5, 4.0, 8.0), (4e5, 5.0, -7.0))
    ]
    assert differing(rows).endswith(
        "in: loading stiffness at 0.05 MPa 1 and 3 N/mm³, 3 +- 0.2 times, and at 0.4 MPa 1 and 5"
        " N/mm³, 5 +- 0.2 times (3 pressures)."
    )
    assert differing(rows[:1]).endswith("at 0.05 MPa 1 and 3 N/mm³, 3 +- 0.2 times.")


def test_the_standard_error_of_a_median_is_that_of_its_scatter():
    """Over many libraries of 101 laws; of normal values sqrt(pi / 2) of that of the mean."""
    rng, n = np.random.default_rng(0), 101
    found = np.array([_median(rng.normal(5.0, 2.0, n), 1e-3) for _ in range(3000)])
    scatter, stated = found[:, 0].std(), np.sqrt(np.mean(found[:, 1] ** 2))
    assert scatter == pytest.approx(2e-3 * np.sqrt(np.pi / 2 / n), rel=0.05)
    assert stated == pytest.approx(scatter, rel=0.15)
    assert _median(np.array([3.0]), 1.0) == (3.0, None) and _median(None, 1.0) == (None, None)


def test_units_and_errors_of_a_table(runs):
    """Separations in um as heights are, stiffnesses as the axis of the picture has them."""
    rows = {(r[0], r[2]): r for r in surface_rows((read_run(runs / "a"), read_run(runs / "hard")))}
    at = load_laws(runs / "a" / "laws.npz").at_pressure(2e5)
    row = rows["separation", 2e5]
    assert row[1] == "µm" and row[3] == pytest.approx(1e6 * np.median(at.d)) and row[4] > 0
    row = rows["loading stiffness", 2e5]
    assert row[1] == "N/mm³" and row[3] == pytest.approx(1e-9 * np.median(at.k)) and row[8] > 0


def test_two_hardnesses_side_by_side(runs, tmp_path, capsys):
    """The ratio of the medians over the laws; the surfaces are the same."""
    assert main(["compare", str(runs / "a"), str(runs / "hard"), "-o", str(tmp_path)]) == 0
    assert "stiffness of vibrations at 0.2 MPa" in capsys.readouterr().out
    rows = read_rows(tmp_path / "compare_surface.csv")
    assert all(row["ratio"] in (1.0, None) for row in rows if row["pressure_Pa"] is None)
    (own,) = [r for r in rows if r["quantity"] == "stiffness of vibrations"
              and r["pressure_Pa"] == 0.2e6]  # fmt: skip
    a, b = (np.median(load_laws(runs / n / "laws.npz").at_pressure(2e5).v) for n in ("a", "hard"))
    assert (own["a"], own["b"], own["ratio"]) == pytest.approx((1e-9 * a, 1e-9 * b, b / a))
    page = (tmp_path / "compare.html").read_text()
    assert "hardness 200 MPa" in page and "hardness 400 MPa" in page and "<img" in page


def test_surfaces_that_are_the_same_are_compared_too(runs, tmp_path, capsys):
    assert main(["compare", str(runs / "a"), str(runs / "same"), "-o", str(tmp_path)]) == 0
    assert {row["ratio"] for row in read_rows(tmp_path / "compare_surface.csv")} <= {1.0, None}
    assert "same folder" not in capsys.readouterr().out
    assert main(["compare", str(runs / "a"), str(runs / "a"), "-o", str(tmp_path)]) == 0
    assert "A and B are the same folder" in capsys.readouterr().out
    assert "A and B are the same folder" in (tmp_path / "compare.html").read_text()


def test_the_status_of_a_surface_promises_no_samples(runs, capsys):
    assert main(["status", str(runs / "a")]) == 0
    assert capsys.readouterr().out.startswith("samples: none\n")


def test_laws_are_compared_at_the_pressure_of_the_brake(runs):
    one = read_run(runs / "a")
    one.summary.update(pressed_N=600.0, face_area_mm2=2000.0)
    assert 0.3e6 in pressures((one, read_run(runs / "hard")))

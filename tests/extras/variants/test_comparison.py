"""Two runs compared: published intervals, the same run, another mesh, another friction."""

import json
import shutil

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.cli import main
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.variants.comparison import compare_runs, write_comparison
from brake_fenicsx.pipeline import run
from brake_fenicsx.results.ensemble_statistics import difference
from coarse_block import BLOCK
from coarse_block import ROUGH as SMALL
from run_tables import read_rows

COMM = MPI.COMM_SELF
ROUGH = [*SMALL[:4], "stability.band=['0 Hz','30 kHz']", "stability.method=reduced", "samples.n=6",
         "parts.plate.size='14 mm'"]  # fmt: skip


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """The block on two meshes, and with a friction at which nothing squeals."""
    out = tmp_path_factory.mktemp("runs")
    for name, change in (
        ("coarse", ["parts.block.size='10 mm'"]),
        ("fine", ["parts.block.size='8 mm'"]),
        ("smooth", ["parts.block.size='10 mm'", "contact.block_plate.friction=0.05"]),
    ):
        run(BLOCK, COMM, out / name, [*ROUGH, *change])
    return out


@pytest.mark.parametrize(
    ("hits", "of", "expected"),
    [  # R. G. Newcombe, Statistics in Medicine 17 (1998) 873, table II, method 10
        ((56, 48), (70, 80), (0.0524, 0.3339)),
        ((9, 3), (10, 10), (0.1705, 0.8090)),
        ((5, 0), (56, 29), (-0.0381, 0.1926)),
        ((10, 0), (10, 10), (0.6075, 1.0000)),
    ],
)
def test_intervals_of_independent_shares_are_the_published_ones(hits, of, expected):
    second, first = (np.arange(n) < k for k, n in zip(hits, of, strict=True))
    _, low, high = difference(first, second, paired=False)
    assert (round(low, 4), round(high, 4)) == expected


def test_paired_intervals_hold_the_truth():
    """Correlated outcomes: 95 % intervals hold the difference at their rate, and are narrower."""
    rng, held, widths = np.random.default_rng(3), 0, []
    for _ in range(400):
        u = rng.random(60)
        first, second = u < 0.6, (u < 0.5) ^ (rng.random(60) < 0.05)
        truth = 0.5 * 0.95 + 0.5 * 0.05 - 0.6
        change, low, high = difference(first, second, paired=True)
        assert low <= change <= high
        held += low <= truth <= high
        _, *wide = difference(first, second, paired=False)
        widths.append((high - low) / (wide[1] - wide[0]))
    assert 0.92 <= held / 400 <= 0.995
    assert np.median(widths) < 0.8


def test_a_run_against_itself(runs):
    rows = compare_runs(runs / "coarse", runs / "coarse")
    assert len(rows) > 1
    for row in rows:
        assert row["change"] == 0 and row["paired"] == "yes"
        assert row["change_low"] <= 0 <= row["change_high"]
    assert all(row["mac"] == pytest.approx(1.0, abs=1e-5) for row in rows[1:])


def test_families_are_found_again_on_another_mesh(runs):
    rows = compare_runs(runs / "coarse", runs / "fine")
    strong = [r for r in rows[1:] if max(r["probability_a"], r["probability_b"]) > 0.9]
    assert strong
    for row in strong:
        assert row["mac"] is not None and row["mac"] > 0.5
        assert row["frequency_b_hz"] == pytest.approx(row["frequency_a_hz"], rel=0.1)


def test_families_that_are_gone_have_no_match(runs, capsys):
    rows = compare_runs(runs / "coarse", runs / "smooth")
    assert rows[0]["change"] == -1.0 and rows[0]["change_high"] < 0
    assert all(r["family_b"] is None and r["probability_b"] == 0 for r in rows[1:])
    out = runs / "page"
    assert main(["compare", str(runs / "coarse"), str(runs / "smooth"), "-o", str(out)]) == 0
    assert "change (95 % interval)" in capsys.readouterr().out
    assert len(read_rows(out / "compare.csv")) == len(rows)
    page = (out / "compare.html").read_text()
    assert "Two runs compared" in page and "<script" not in page
    assert "Warning" not in page


def test_runs_with_two_thresholds_are_warned_of(runs, tmp_path, capsys):
    """Their shares are not those of the same modes."""
    other = shutil.copytree(runs / "coarse", tmp_path / "other")
    summary = json.loads((other / "summary.json").read_text())
    summary["in_effect"]["stability"]["threshold"] = 0.045
    (other / "summary.json").write_text(json.dumps(summary))
    said = (
        "A counts squeal below -0.045, B below 0; set one stability.threshold and run both again"
        " (no sample is computed again)"
    )
    assert main(["compare", str(other), str(runs / "coarse"), "-o", str(tmp_path)]) == 0
    assert said in capsys.readouterr().out.splitlines()
    assert f"<p>Warning: {said}.</p>" in (tmp_path / "compare.html").read_text()


def test_mistakes_are_one_line(runs, tmp_path, capsys):
    assert main(["compare", str(runs / "coarse"), str(tmp_path / "none")]) == 2
    assert "no such run directory" in capsys.readouterr().err
    assert main(["compare", str(BLOCK), str(BLOCK)]) == 2
    assert "a file, and no folder of results; run the scene first" in capsys.readouterr().err
    (tmp_path / "out").mkdir()
    run(BLOCK, COMM, tmp_path / "out", ["stages=['equilibrium']"])
    with pytest.raises(SceneError, match=r"contains no modes to compare; .*or both with a surface"):
        write_comparison(runs / "coarse", tmp_path / "out", tmp_path / "page")
    assert not (tmp_path / "page").exists()

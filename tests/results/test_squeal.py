"""Counts against a table small enough to count by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from brake_fenicsx.report.input_figures import correlations, draw_correlations
from brake_fenicsx.results.answer import (
    approach_rows,
    error_rows,
    family_rows,
    limit_rows,
    open_points,
    speed_rows,
    stage_rows,
    summary_table,
    write_tables,
)
from brake_fenicsx.results.ensemble_statistics import wilson
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.squeal import kilohertz
from brake_fenicsx.results.tables import MODES, SAMPLES, write_rows
from run_tables import cells, mode, read_columns, read_rows, read_run


@pytest.fixture
def run(tmp_path):
    """Four samples of one approach, of which one failed and one is stable; one of another."""
    modes = [
        mode("parametric", 0, 0, 950.0, -0.01, 0),
        mode("parametric", 0, 1, 1050.0, -0.02, 1),
        mode("parametric", 0, 2, 5000.0, 0.0, -1),
        mode("parametric", 1, 0, 970.0, -0.03, 0, error=1e-4),
        mode("parametric", 2, 0, 960.0, 0.01, 0),
        mode("parametric", 3, 0, 980.0, -0.04, 0),
        mode("classical", 0, 0, 4000.0, -0.05, -1),
    ]
    write_rows(tmp_path / "modes.csv", MODES, modes)
    samples = [["parametric", k, "ok" if k < 3 else "no equilibrium", k] for k in range(4)]
    write_rows(tmp_path / "samples.csv", SAMPLES, [*samples, ["classical", 0, "ok", 0]])
    return read_run(tmp_path)


def test_failed_samples_do_not_count(run):
    c = run.squeal.count("parametric")
    assert (c.samples, c.failed, c.modes, c.unstable, c.squeal_samples) == (3, 1, 5, 3, 2)
    assert c.per_sample.tolist() == [2, 1, 0]


def test_families_are_counted_by_sample(run):
    first, second = run.squeal.families("parametric")
    assert (first.number, first.share.hits, first.share.n) == (0, 2, 3)
    assert first.frequency == pytest.approx(960.0)
    assert first.worst == -0.03
    assert (second.number, second.share.hits) == (1, 1)
    (lone,) = run.squeal.families("classical")
    assert (lone.number, lone.frequency) == (-1, 4000.0)


def test_bands_count_samples_not_modes(run):
    """Bands of 500 Hz: two samples squeal below 1 kHz, one of them at 1050 Hz too."""
    shares = run.squeal.share_per_band("parametric")
    assert [s.hits for s in shares] == [0, 2, 1, *[0] * 7]
    assert {s.n for s in shares} == {3}
    wide = [mode("parametric", k, j, 1e3 * (19 + j), -0.01, j) for k in (0, 1) for j in (0, 1)]
    columns = dict(zip(MODES, map(np.array, zip(*wide, strict=True)), strict=True))
    shares = RunData(run.directory, modes=columns).squeal.share_per_band("parametric")
    assert [s.hits for s in shares] == [*[0] * 19, 2]  # the last band includes its upper edge


def test_band_edges_are_round_and_cover_the_modes(run):
    edges = run.squeal.edges
    assert edges[0] == 0.0
    assert edges[-1] >= 5000.0 > edges[-2]
    assert np.allclose(np.diff(edges), 500.0)


@pytest.mark.parametrize(("hits", "n"), [(1, 3), (5, 40), (39, 40), (150, 300)])
def test_wilson_bounds_solve_the_score_equation(hits, n):
    z, share = 1.959963984540054, wilson(hits, n)

    def score(p):
        return (hits / n - p) ** 2 - z**2 * p * (1 - p) / n

    assert share.low == pytest.approx(brentq(score, 1e-12, hits / n), rel=1e-9)
    assert share.high == pytest.approx(brentq(score, hits / n, 1 - 1e-12), rel=1e-9)


def test_wilson_at_the_ends():
    assert (wilson(0, 10).low, wilson(10, 10).high) == (0.0, 1.0)
    assert 0.2 < wilson(0, 10).high < 0.35
    assert (wilson(0, 0).low, wilson(0, 0).high) == (0.0, 1.0)


def test_tables_carry_the_numbers_of_the_run(run):
    written = {path.stem: path for path in write_tables(run)}
    assert set(written) == {
        "approaches", "limits", "families", "probability_per_band", "eigenvalue_errors",
    }  # fmt: skip
    classical, fast = read_rows(written["approaches"])
    assert (fast["samples"], fast["failed"], fast["unstable_modes"]) == (3, 1, 3)
    assert fast["share"] == 2 / 3
    assert classical["share"] is None
    assert fast["most_severe"] == "0.960 kHz (2/3, -0.02); 1.050 kHz (1/3, -0.02)"
    assert read_columns(written["families"])["frequency_hz"].tolist() == [4000.0, 960.0, 1050.0]
    bands = read_rows(written["probability_per_band"])
    assert sum(row["squeal_samples"] for row in bands if row["approach"] == "parametric") == 3
    assert [list(row) for row in cells(approach_rows(run))] == [
        list(row.values()) for row in read_rows(written["approaches"])
    ]
    assert len(cells(family_rows(run))) == 3


def test_errors_of_the_run(run):
    classical, fast = cells(error_rows(run))
    assert fast[1] == 6
    # Relative: of the size of the eigenvalue, damping -0.03 at 970 Hz.
    assert fast[6] == pytest.approx(1e-4 / (2 * np.pi * 970 * np.hypot(1, 0.015)), rel=1e-12)
    assert fast[4] == pytest.approx(1e-6 / (2 * np.pi * 970), rel=0.02)
    assert classical[7] == 2.0


def test_speed_stands_beside_the_error_of_the_same_run(run):
    """A row for what is reduced, one for its check at full order; what is unknown is empty."""
    facts = {
        "samples": {
            "parametric": {"good": 3, "seconds_per_equilibrium": 0.1, "counted_by": "inertia",
                           "seconds_per_stability": 0.5},
            "classical": {"good": 1},
        },
        "verification": {"samples_compared": 2, "largest_relative_error": 3e-7,
                         "median_relative_error": 1e-9, "wrong_verdicts": 0, "eigenvalues": 9,
                         "errors_beyond_estimates": 4},
    }  # fmt: skip
    rows = cells(speed_rows(replace(run, summary=facts)))
    assert rows[0][:4] == ["classical", 1, None, None]
    assert rows[1][:4] == ["parametric", 3, 0.1, 0.5]
    assert rows[1][4] == cells(error_rows(run))[1][4]
    assert rows[2][0] == "against full order"
    assert rows[2][4:6] == [1e-9, 3e-7]
    assert rows[2][6] == "0 wrong of 9 verdicts, 4 errors beyond their estimates"
    assert cells(speed_rows(run)) == []


def test_stages_keep_their_order_and_gaps():
    summary = {"seconds": {"b": 2, "a": 1.5}, "peak_memory_mb": {"a": 10.0, "c": 3.0}}
    assert cells(stage_rows(summary)) == [["b", 2.0, None], ["a", 1.5, 10.0], ["c", None, 3.0]]
    assert cells(stage_rows({"seconds": "fast"})) == []


def test_summary_names_every_approach(run):
    lines = summary_table(run).splitlines()
    assert lines[0] == "squeal: unstable modes with damping below 0 (stability.threshold)"
    assert lines[3].split()[:8] == ["Classical", "1", "0", "1", "1", "0", "1", "1"]
    assert lines[4].split()[:8] == ["Parametric", "3", "1", "5", "3", "1", "3", "2"]


def test_representative_modes_are_of_median_damping(run):
    found = run.squeal.representatives("parametric")
    assert [(m.sample, m.mode) for m in found] == [(0, 0), (0, 1)]
    assert (found[0].frequency, found[0].damping) == (950.0, -0.01)
    (lone,) = run.squeal.representatives("classical")
    assert (lone.sample, lone.mode, lone.frequency) == (0, 0, 4000.0)
    assert len(run.squeal.representatives("parametric", most=1)) == 1


def test_families_of_one_frequency_have_names_of_their_own(tmp_path):
    """Their pictures and fields overwrote each other."""
    modes = [mode("parametric", 0, j, 1500.0 + 0.2 * j, -0.01 * (3 - j), j) for j in range(2)]
    write_rows(tmp_path / "modes.csv", MODES, [*modes, mode("parametric", 0, 2, 2e3, -0.001, 2)])
    names = [m.name for m in read_run(tmp_path).squeal.representatives("parametric")]
    assert names == ["01500Hz", "01500Hz_family1", "02000Hz"]


def beyond(run, threshold):
    return replace(run, summary={"in_effect": {"stability": {"threshold": threshold}}})


def test_a_threshold_leaves_weak_modes_out_of_every_count(run):
    """Damping just at the threshold is not below it."""
    strict = beyond(run, 0.02)
    c = strict.squeal.count("parametric")
    assert (c.unstable, c.squeal, c.squeal_samples) == (3, 1, 1)
    assert c.per_sample.tolist() == [0, 1, 0]
    (only,) = strict.squeal.families("parametric")
    assert (only.number, only.share.hits, only.median) == (0, 1, -0.03)
    assert [s.hits for s in strict.squeal.share_per_band("parametric")] == [0, 1, *[0] * 8]
    assert [m.sample for m in strict.squeal.representatives("parametric")] == [1]
    (row,) = [r for r in cells(approach_rows(strict)) if r[0] == "parametric"]
    assert "damping below -0.02" in summary_table(read_run(strict))
    assert row[6:9] == [0.02, 1, 1]
    assert beyond(run, 0.06).squeal.families("classical") == []


def test_what_squeals_seldom_and_strongly_ranks_before_what_hardly_grows(tmp_path):
    """1.5 kHz in half of the samples at -0.075 before 14 kHz in all of them at -8e-6."""
    modes = [mode("parametric", k, 0, 14e3, -8e-6, 1) for k in range(4)]
    modes += [mode("parametric", k, 1, 1500.0, -0.07 - 0.01 * k, 2) for k in range(2)]
    write_rows(tmp_path / "modes.csv", MODES, modes)
    run = read_run(tmp_path)
    first, second = run.squeal.families("parametric")
    assert (first.frequency, first.share.hits, first.median) == (1500.0, 2, pytest.approx(-0.075))
    assert first.severity == pytest.approx(0.5 * 0.075)
    assert second.severity == pytest.approx(8e-6)
    assert cells(approach_rows(run))[0][-1] == "1.500 kHz (2/4, -0.075); 14.000 kHz (4/4, -8e-06)"
    assert [m.frequency for m in run.squeal.representatives("parametric")] == [1500.0, 14e3]
    written = {path.stem: path for path in write_tables(run)}
    table = read_rows(written["families"])
    assert [row["family"] for row in table] == [2, 1]
    assert table[0]["share"] == 0.5
    for name in ("approaches", "families", "probability_per_band"):
        assert {row["threshold"] for row in read_rows(written[name])} == {0.0}


def test_what_is_left_open_is_one_line(run):
    """Nothing where nothing is."""
    about = {"good": 3, "modes": 60, "tolerance_missed": 0, "not_complete": 0}
    assert open_points(replace(run, summary={"samples": {"parametric": about}})) == ""
    facts = {
        "parametric": about | {"tolerance_missed": 7, "largest_error": 3e-5},
        "joint": about | {"not_complete": 2},
    }
    line = open_points(replace(run, summary={"samples": facts}))
    assert "Parametric: tolerance not reached: 7 of 60 modes have an error estimate above" in line
    assert "the largest 3.0e-05 of |lambda|" in line
    assert "Joint: in 2 of 3 samples the number of modes is not proven" in line


@pytest.mark.parametrize(
    ("law", "gap", "name"),
    [
        ({"linear": 1e13}, "none", "Smooth contact"),
        ("library", "none", "Multi-scale"),
        ({"linear": 1e13}, "hdf", "Multi-scale"),
    ],
)
def test_contact_without_roughness_is_not_called_multi_scale(run, law, gap, name):
    scene = {"contact": {"block_plate": {"law": law, "gap": gap}}}
    smooth = replace(run, summary={"in_effect": scene})
    assert smooth.label("multi-scale") == name
    assert smooth.label("joint") == "Joint"


def driven_run(tmp_path, n=40):
    """Unstable modes grow in number with ``a``; ``b`` is noise and ``c`` stands still."""
    rng = np.random.default_rng(1)
    a, b = rng.random(n), rng.random(n)
    order = rng.permutation(n)
    rows = [["joint", k, "ok", k, a[k], b[k], 5.0] for k in order]
    modes = tuple(
        np.array(column)
        for column in zip(
            *(mode("joint", k, j, 900.0 + j, -0.1, 0) for k in order for j in range(int(9 * a[k]))),
            strict=True,
        )
    )
    write_rows(tmp_path / "samples.csv", [*SAMPLES, "a", "b", "c"], rows)
    samples = read_columns(tmp_path / "samples.csv")
    return RunData(tmp_path, modes=dict(zip(MODES, modes, strict=True)), samples=samples)


def test_correlations_find_the_input_that_matters(tmp_path):
    run = driven_run(tmp_path)
    (name, first), (other, second) = correlations(run, "joint")
    assert (name, other) == ("a", "b")
    assert first.rho > 0.97 and first.low > 0.9
    assert second.low < 0 < second.high
    axis = draw_correlations(run).axes[0]
    assert [p.get_width() for p in axis.patches] == [first.rho, second.rho]
    assert [t.get_text() for t in axis.get_yticklabels()] == ["a", "b"]


def test_few_samples_have_no_correlations(tmp_path):
    run = driven_run(tmp_path, n=9)
    assert correlations(run, "joint") == []
    assert draw_correlations(run) is None


def test_limits_are_rows_of_a_table(run):
    """With the limit 0.02 of the scene one sample squeals, with any growth two of three."""
    rows = cells(limit_rows(beyond(run, 0.02), ["parametric", "classical"]))
    assert [row[2:6] for row in rows] == [
        [-0.02, 1, 1, 3], [-0.01, 2, 2, 3], [0.0, 3, 2, 3],
        [-0.02, 1, 1, 1], [-0.01, 1, 1, 1], [0.0, 1, 1, 1],
    ]  # fmt: skip
    assert rows[2][6:] == wilson(2, 3).cells
    assert rows[3][6:] == [None] * 3  # one run
    lines = summary_table(beyond(run, 0.02)).splitlines()
    found = [line.split()[0] for line in lines[6:] if "customary limit in Abaqus" in line]
    assert found == ["Classical", "Parametric"]


def test_one_sample_has_no_interval():
    assert wilson(1, 1).cells == [1.0, None, None]
    assert wilson(0, 0).cells == [None] * 3
    assert np.isnan([wilson(0, 1).low, wilson(0, 1).high]).all()


def test_frequencies_have_the_digits_that_tell_them_apart(tmp_path):
    """Doublets of less than a hertz; what differs by less than 0.01 Hz reads alike."""
    assert kilohertz([4647.0, 4654.0]) == ["4.647", "4.654"]
    assert kilohertz([4647.1, 4647.3, 900.0]) == ["4.6471", "4.6473", "0.900"]
    assert kilohertz([4647.11, 4647.14]) == ["4.64711", "4.64714"]
    assert kilohertz([4647.1, 4647.1 + 1e-4]) == ["4.647", "4.647"]
    modes = [mode("parametric", k, n, 4647.1 + 0.2 * n, -0.02, n) for k in (0, 1) for n in (0, 1)]
    write_rows(tmp_path / "modes.csv", MODES, modes)
    (row,) = cells(approach_rows(read_run(tmp_path)))
    assert row[-1] == "4.6471 kHz (2/2, -0.02); 4.6473 kHz (2/2, -0.02)"

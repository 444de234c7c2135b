"""Limit cycles in a run: tables, page, resumption, processes, Python, and what is refused."""

import re
import shutil
import subprocess
import sys

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import prepare, run
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.limit_cycle import cycles as module
from brake_fenicsx.extras.limit_cycle.cycles import MEASURES, limit_cycles
from brake_fenicsx.extras.limit_cycle.growth import EXACTLY, verdict
from brake_fenicsx.extras.limit_cycle.loudness import (
    CYCLES,
    FAMILIES,
    _families,
    cycle_blocks,
    draw_growth,
    draw_loudness,
    loudness_text,
)
from brake_fenicsx.results.run import read_run
from brake_fenicsx.scene import read_scene
from places import SQUEALING
from processes import parallel
from run_tables import read_columns

PLAIN = [
    "stages=['surface','equilibrium','stability','uncertainty']", "samples.n=2",
    "countermeasures=[]", "contact.block_plate.friction=0.5",
    "stability.damping={ rayleigh = ['0 1/s', '2e-7 s'] }",
]  # fmt: skip
GIVEN = [
    *PLAIN,
    "limit_cycle={ harmonics = 3, points = 20, largest = '10 um', radiating = ['block.sides'] }",
]  # fmt: skip
TABLES = ("limit_cycle.csv", "limit_cycle_growth.csv", "limit_cycle_families.csv")


@pytest.fixture(scope="module")
def done(tmp_path_factory, all_without_pixels):
    """A run with the page; all figures are made, and stored as one pixel each."""
    folder = tmp_path_factory.mktemp("run") / "out"
    stages = GIVEN[0].replace("'uncertainty'", "'uncertainty','report'")
    run(SQUEALING, MPI.COMM_SELF, folder, [stages, *GIVEN[1:]])
    return folder


def same_numbers(folder, other, tables):
    """Tables are equal within the solvers' tolerances."""
    for name in tables:
        one, two = (read_columns(where / name) for where in (folder, other))
        for column, values in two.items():
            if values.dtype.kind == "f":
                small = 1e-6 * np.nanmax(np.abs(values))
                if column == "alpha_1_s":
                    # Newton's tolerance is a share of |lambda|, of which growth is a small part.
                    small = EXACTLY * 2 * np.pi * np.nanmax(two["frequency_hz"])
                np.testing.assert_allclose(one[column], values, rtol=1e-4, atol=small)
            else:
                assert np.array_equal(one[column], values)


def test_tables_say_how_large_and_how_loud(done):
    cycles, growth, families = (read_columns(done / name) for name in TABLES)
    assert len(cycles["outcome"]) == 2 and set(MEASURES) < {*cycles}
    exponents = (cycles[f"exponent_{name}"] for name in ("1_s", "error_1_s", "hz"))
    for outcome, f, *exponent, at in zip(
        cycles["outcome"], cycles["frequency_hz"], *exponents, strict=True
    ):
        assert outcome == verdict(*exponent, at / f)
    assert np.all(cycles["linear_alpha_1_s"] > 0)
    assert np.all(cycles["amplitude_um"] > 0.3)
    assert np.all(cycles["amplitude_um"] < cycles["gap_um"])
    # A vibration at one frequency moves by velocity over omega.
    omega = 2 * np.pi * cycles["frequency_hz"]
    np.testing.assert_allclose(cycles["pad_mm_s"], 1e-3 * omega * cycles["pad_um"], rtol=0.3)
    assert np.all(np.abs(cycles["level_1m_db"] - 90) < 30)
    assert np.all(cycles["time_s"] > np.log(95) / growth["alpha_1_s"].max())
    for sample in (0, 1):
        own = growth["sample"] == sample
        assert growth["alpha_1_s"][own][0] > 0 > growth["alpha_1_s"][own][-1]
    assert families["cycles"].sum() == 2 and families["rank_by_loudness"][0] == 1


def test_page_has_a_section(done):
    figures = [draw(read_run(done)) for draw in (draw_growth, draw_loudness)]
    for figure in figures:
        figure.draw_without_rendering()
    # Unclipped markers of no points squeeze the axes.
    assert all(line.get_xdata().size for axis in figures[0].axes for line in axis.get_lines()[:-1])
    page = (done / "report.html").read_text()
    assert "How loud" in page and "rank by loudness" in page
    assert {f.name for f in (done / "figures").glob("limit_cycle*.png")} == {
        "limit_cycle_growth.png", "limit_cycle_loudness.png",
    }  # fmt: skip


def test_one_family_has_one_frequency_on_the_page(done):
    """In the table, the legend of growth and under the box: the mean of its squeal modes."""
    data = read_run(done)
    family = data.squeal.families("multi-scale")[0]
    growth, loudness = draw_growth(data), draw_loudness(data)
    legend = growth.axes[0].get_legend().get_texts()[0].get_text()
    ticks = loudness.axes[0].get_xticklabels()[0].get_text()
    (_, table) = cycle_blocks(data)
    row = dict(zip(table.heads, table.rows[0], strict=True))
    assert legend == f"{family.kilohertz} kHz"
    assert ticks.startswith(legend) and row["frequency [kHz]"] == family.kilohertz
    ends = row["how growth ends"]
    assert "stable" in ends and "gives" not in ends
    said = loudness_text(data, "multi-scale", family.key)
    assert said == f"{ends}; {float(row['level at 1 m [dB]']):.0f} dB at 1 m"


def test_a_cycle_that_gives_way_has_no_loudness(monkeypatch):
    """What takes its place was 3.3 times as large by time steps; its amplitude stays."""
    monkeypatch.setattr(module, "verdict", lambda *_: "gives way: its period doubles")
    (cycle,) = limit_cycles(prepare(SQUEALING, GIVEN), sample=1)
    assert cycle["outcome"].startswith("gives way") and cycle["amplitude_um"] > 0.3
    assert np.isnan(cycle["level_1m_db"]) and np.isnan(cycle["sound_power_db"])


def test_loudness_of_families_is_that_of_what_is_heard():
    """Cycles that give way count in the words of a row, not in its numbers or ranks."""

    def cycle(family, sample, outcome, level, gap):
        values = dict.fromkeys(CYCLES) | {"approach": "joint", "sample": sample, "mode": 3}
        values |= {"family": family, "outcome": outcome, "level_1m_db": level, "gap_um": gap}
        return [*(values | {"linear_alpha_1_s": 9.0, "linear_frequency_hz": 2e3}).values()]

    doubles = "gives way: its period doubles"
    rows = [
        cycle(0, 0, doubles, None, 9.0), cycle(0, 1, "gives way: a second frequency", None, 8.0),
        cycle(1, 0, "stable", 80.0, 1.0), cycle(1, 1, doubles, None, 7.0),
        cycle(2, 0, "undecided", 85.0, 2.0), cycle(2, 1, "none: lost", None, None),
    ]  # fmt: skip
    found = [dict(zip(FAMILIES, row, strict=True)) for row in _families(rows)]
    assert [f["family"] for f in found] == [2, 1, 0]
    assert [f["rank_by_loudness"] for f in found] == [1, 2, None]
    assert [f["level_1m_db_50"] for f in found] == [85.0, 80.0, None]
    assert [f["gap_um_50"] for f in found] == [2.0, 1.0, None]
    words = ["1 undecided, 1 no end", "1 gives way, 1 stable", "2 gives way"]
    assert [f["outcomes"] for f in found] == words


def test_a_killed_run_goes_on_with_the_same_numbers(done, tmp_path):
    folder = shutil.copytree(done, tmp_path / "again")
    samples = sorted((folder / "samples").rglob("*.npz"))
    samples[-1].unlink()
    for name in TABLES:
        (folder / name).unlink()
    stages = GIVEN[0].replace("'uncertainty'", "'uncertainty','report'")
    run(SQUEALING, MPI.COMM_SELF, folder, [stages, *GIVEN[1:]])
    same_numbers(folder, done, TABLES)
    for name in TABLES[:2]:  # what was kept is not computed again
        kept = [
            [x for x in (where / name).read_text().splitlines() if x.split(",")[1] == "0"]
            for where in (folder, done)
        ]
        assert kept[0] == kept[1]


@pytest.mark.slow
def test_two_processes_give_the_cycles_of_one(done, tmp_path):
    mpirun = shutil.which("mpirun")
    if mpirun is None:
        pytest.skip("no mpirun")
    given = [w for text in GIVEN for w in ("--set", text)]
    words = [mpirun, "-n", "2", "--oversubscribe", sys.executable, "-m", "brake_fenicsx", "run"]
    subprocess.run(
        [*words, str(SQUEALING), "-o", str(tmp_path / "two"), *given], check=True, **parallel()
    )
    same_numbers(tmp_path / "two", done, TABLES[:2])


def test_python_gives_what_the_table_says(done):
    model = prepare(SQUEALING, GIVEN)
    (cycle,) = limit_cycles(model, sample=1)
    cycles = read_columns(done / "limit_cycle.csv")
    assert cycle["outcome"] == cycles["outcome"][1] and cycle["mode"] == cycles["mode"][1]
    for name in ("amplitude_um", "frequency_hz", "level_1m_db"):
        assert cycle[name] == pytest.approx(cycles[name][1], rel=1e-3)
    amplitude, s = cycle["branch"]
    assert amplitude[0].real < 1e-6 * cycle["amplitude_um"] and s[0].real > 0 > s[-1].real
    with pytest.raises(SceneError, match="limit_cycle: the section is missing"):
        limit_cycles(prepare(SQUEALING, PLAIN))


def test_a_mode_that_grows_less_than_the_threshold_is_not_followed(done):
    """It is unstable all the same, and has a cycle where the threshold is zero."""
    cycles = read_columns(done / "limit_cycle.csv")
    growth = cycles["linear_alpha_1_s"] / (np.pi * cycles["linear_frequency_hz"])
    threshold = f"stability.threshold={1.1 * growth.max()}"
    assert limit_cycles(prepare(SQUEALING, [*GIVEN, threshold]), sample=1) == []


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["stability.method=full"], 'limit_cycle: needs .* method = "reduced"'),
        (["limit_cycle.points=6"], "limit_cycle.points = 6: more than twice"),
        (["limit_cycle.harmonic=6"], "harmonic = 6: unknown key"),
        (["limit_cycle.largest=20"], "limit_cycle.largest"),
    ],
)
def test_what_cannot_be_computed_is_refused(more, said):
    with pytest.raises(SceneError, match=said):
        read_scene(SQUEALING, [*GIVEN, *more])


def test_a_face_that_is_not_there_is_named(tmp_path):
    with pytest.raises(SceneError, match=re.escape("limit_cycle.radiating[0]: no face 'block.up'")):
        prepare(SQUEALING, [*GIVEN, "limit_cycle.radiating=['block.up']"])


@pytest.mark.hard
def test_one_sample_takes_the_reduced_model_for_its_cycles(done, tmp_path):
    """One sample with [limit_cycle]: the method that the scene names, the numbers of the others."""
    run(SQUEALING, MPI.COMM_SELF, tmp_path / "one", [*GIVEN, "samples.n=1"])
    for name in TABLES[:2]:
        rows = [(f / name).read_text().splitlines() for f in (done, tmp_path / "one")]
        assert len(rows[1]) > 1 and rows[1] == [x for x in rows[0] if x.split(",")[1] != "1"]


@pytest.mark.hard
def test_samples_that_full_order_takes_lose_their_cycles_alone(tmp_path):
    """[limit_cycle] with a tolerance that no mode keeps: modes of full order, cycles named lost."""
    more = ["stability.tolerance=1e-12", "stability.on_tolerance='full order'"]
    run(SQUEALING, MPI.COMM_SELF, tmp_path / "full", [*GIVEN, *more])
    samples, modes = (read_columns(tmp_path / "full" / f"{n}.csv") for n in ("samples", "modes"))
    assert list(samples["status"]) == ["ok", "ok"] and "unstable" in set(modes["verdict"])
    assert not (tmp_path / "full" / TABLES[0]).read_text().splitlines()[1:]
    log = (tmp_path / "full" / "log.txt").read_text()
    assert "limit cycles" in log and "at full order has none" in log


def test_the_log_says_why_a_lone_sample_is_at_full_order(tmp_path):
    """method = "reduced" with one sample, and nothing that only a reduced model has."""
    run(SQUEALING, MPI.COMM_SELF, tmp_path / "out", [*PLAIN, "samples.n=1", "stability.verify=1"])
    log = (tmp_path / "out" / "log.txt").read_text()
    assert "one sample, at full order although" in log and "nothing to verify" in log

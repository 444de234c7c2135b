"""Countermeasures of a scene: against runs of the changed scene and analytic derivatives."""

import re
import shutil
from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.cli import main
from brake_fenicsx.errors import NotConverged, SceneError
from brake_fenicsx.extras.variants import countermeasures as module
from brake_fenicsx.extras.variants import runs
from brake_fenicsx.extras.variants.comparison import compare_runs
from brake_fenicsx.pipeline import run
from brake_fenicsx.results.run import read_run
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.digest import result_digest
from coarse_block import BLOCK, FRICTION, HEIGHT, ROUGH, levers
from run_tables import read_rows

pytestmark = pytest.mark.long

COMM = MPI.COMM_SELF
STIFFNESS = "materials.iron.E"
LEVERS = levers((STIFFNESS, "'200 GPa'"), (FRICTION, "0.05"), (HEIGHT, "'30 mm'"))


def words(out, *changes):
    sets = [w for change in changes for w in ("--set", change)]
    return ["countermeasures", str(BLOCK), "-o", str(out), *sets]


def loud(before, after):
    """Share in which the worst family of a run squeals in another one, and frequency before."""
    rows = compare_runs(before, after)
    worst = max(rows[1:], key=lambda r: (r["probability_a"], -(r["median_damping_a"] or 0)))
    return worst["probability_b"], worst["frequency_a_hz"]


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """Folder and rows by key, of one search; under mpirun each process makes its own."""
    out = tmp_path_factory.mktemp("countermeasures") / "out"
    module.find_countermeasures(BLOCK, COMM, out, [*ROUGH, LEVERS])
    return out, {row["key"]: row for row in read_rows(out / "countermeasures.csv")}


def test_smallest_friction_is_that_of_runs_at_this_value_and_before_it(found, tmp_path):
    """A run with 1 % of the range less change still squeals, the one with the change does not."""
    out, rows = found
    row = rows[FRICTION]
    assert 0.05 <= row["smallest_value"] < 0.5
    # Three samples of which none squeals show nothing.
    assert row["verified"] == "no" and row["samples_needed"] == 59
    assert "59 samples would show it" in (out / "countermeasures.html").read_text()
    after = out / f"after-{row['rank']}"
    friction = read_run(after).summary["in_effect"]["contact"]["block_plate"]["friction"]
    assert friction == row["smallest_value"]
    assert row["share_before"] == 1.0 and row["share_after"] == loud(out / "before", after)[0] == 0
    assert row["share_after_low"] == 0 < row["share_after_high"]
    less = row["smallest_value"] + 0.01 * 0.45
    run(BLOCK, COMM, tmp_path / "less", [*ROUGH, f"{FRICTION}={less}"])
    assert loud(out / "before", tmp_path / "less")[0] > 0.05


def test_first_order_effect_is_the_analytic_derivative(found, tmp_path):
    """That of drivers.csv, from both eigenvectors and the change of the equilibrium."""
    out, rows = found
    run(BLOCK, COMM, tmp_path / "drivers", [*ROUGH, "samples.n=1", "stability.drivers=true"])
    _, frequency = loud(out / "before", out / "before")
    (slope,) = (
        r["ddamping_dp"]
        for r in read_rows(tmp_path / "drivers" / "drivers.csv")
        if r["kind"] == "friction" and abs(r["frequency_hz"] / frequency - 1) < 0.01
    )
    assert rows[FRICTION]["first_order"] == pytest.approx(slope * (0.05 - 0.5), rel=0.02)


def test_ranks_follow_the_first_order_effect(found):
    _, rows = found
    by_rank = sorted(rows.values(), key=lambda r: r["rank"])
    assert [r["rank"] for r in by_rank] == [1, 2, 3]
    effects = [r["first_order"] for r in by_rank]
    assert effects == sorted(effects, reverse=True)


def test_a_length_changes_the_mesh_and_is_verified(found):
    out, rows = found
    row, folder = rows[HEIGHT], out / f"after-{rows[HEIGHT]['rank']}"
    assert row["unit"] == "m" and 0.02 < row["smallest_value"] <= 0.03
    after = read_run(folder)
    height = after.summary["in_effect"]["parts"]["block"]["parameters"]["height"]
    assert height == row["smallest_value"]
    assert row["share_after"] == loud(out / "before", folder)[0]
    assert row["any_after"] == pytest.approx(
        np.unique(after.modes["sample"][after.modes["damping"] < -1e-3]).size / 3
    )
    assert (folder / "compare.html").is_file()


def test_what_does_not_help_says_so(found):
    """A stiffer plate: none is enough, as a run at the farthest value agrees."""
    out, rows = found
    row = rows[STIFFNESS]
    assert row["smallest_value"] is None and row["verified"] == "no" and row["any_after"] is None
    assert row["share_after"] == 1.0 and "not sufficient even at the limit" in row["note"]
    farthest = out.with_name("farthest")
    run(BLOCK, COMM, farthest, [*ROUGH, f"{STIFFNESS}=200 GPa"])
    assert loud(out / "before", farthest)[0] == 1.0


def test_another_mode_that_wakes_is_told(found):
    out, rows = found
    for row in rows.values():
        if row["any_after"] is not None:
            count = read_run(out / f"after-{row['rank']}").squeal.families("multi-scale")
            told = "other modes squeal" in (row["note"] or "")
            assert told == any(f.share.value > 0.05 for f in count)


def test_two_numbers_together_are_those_of_runs(found, tmp_path, capsys):
    """On the grid of both, against runs; with the folder of the search of single ones."""
    out = tmp_path / "out"
    shutil.copytree(found[0], out)
    more = ["--together", HEIGHT, FRICTION, "--points", "3"]
    assert main([*words(out, *ROUGH, LEVERS), *more]) == 0
    rows = {(r["value_1"], r["value_2"]): r for r in read_rows(out / "together.csv")}
    assert len(rows) == 9 and {r["samples"] for r in rows.values()} == {3}
    assert rows[0.5, 0.02]["share"] == 1.0 and rows[0.05, 0.03]["share"] == 0.0
    (best,) = [pair for pair, row in rows.items() if row["smallest"] == "yes"]
    assert rows[best]["enough"] == "yes"
    for friction, height in (best, (0.275, 0.02)):
        folder = tmp_path / f"{friction}"
        changes = [f"{FRICTION}={friction}", f"{HEIGHT}={height} m"]
        run(BLOCK, COMM, folder, [*ROUGH, *changes, "countermeasures=[]"])
        assert loud(out / "before", folder)[0] == rows[friction, height]["share"]
    page = (out / "together.html").read_text()
    assert "59 samples would show it" in page and 'href="after-together/compare.html"' in page
    capsys.readouterr()
    assert main([*words(out, *ROUGH, LEVERS), "--together", HEIGHT, "no.key"]) == 2
    assert "name two of the scene's countermeasures" in capsys.readouterr().err
    assert main([*words(out, *ROUGH, LEVERS), *more[:3], "--points", "1"]) == 2
    assert "--points 1: give 2 to 50" in capsys.readouterr().err


def test_a_random_number_moves_with_its_distribution(tmp_path):
    """The search and the run after it: all friction coefficients by one factor."""
    key = f'samples.random."{FRICTION}"'
    laws = ["law='normal', mean=0.48, sd=0.05, min=0.3", "law='measured', values=[0.35, 0.4, 0.5]"]
    for i, law in enumerate(laws):
        out = tmp_path / f"{i}"
        changes = [*ROUGH, f"{key}={{ {law} }}", levers((FRICTION, "0.05"))]
        (row,) = read_rows(
            module.find_countermeasures(BLOCK, COMM, out, changes).with_suffix(".csv")
        )
        before, after = (read_run(out / f).samples[FRICTION] for f in ("before", "after-1"))
        assert np.unique(before).size > 1
        np.testing.assert_allclose(after, before * row["smallest_value"] / 0.5, rtol=1e-12)
        assert row["share_before"] > 0 == row["share_after"] and "confirm" not in row["note"]
        assert f"{FRICTION} is random: its distribution moves by the same factor" in row["note"]


def test_page_holds_table_figure_and_links(found):
    out, rows = found
    page = (out / "countermeasures.html").read_text()
    assert "<script" not in page and "data:image/png;base64," in page
    for key, row in rows.items():
        assert key in page
        link = f'href="after-{row["rank"]}/compare.html"'
        assert (link in page) == (row["any_after"] is not None)


def test_what_is_finished_is_not_done_again(found, tmp_path, monkeypatch, capsys):
    """The same call: no search, no sample, the same table. Ended in a search: that one again."""
    out = tmp_path / "out"
    shutil.copytree(found[0], out)
    table = (out / "countermeasures.csv").read_bytes()
    kept = {p: p.stat().st_mtime_ns for p in out.glob("*/samples/*.npz")}
    (out / "countermeasures.csv").unlink()

    def searched(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "smallest_change", searched)
    assert main(words(out, *ROUGH, LEVERS)) == 0
    assert (out / "countermeasures.csv").read_bytes() == table
    assert kept == {p: p.stat().st_mtime_ns for p in out.glob("*/samples/*.npz")}
    assert "smallest sufficient value" in capsys.readouterr().out
    other = tmp_path / "other"
    assert main(words(other, *ROUGH, levers((FRICTION, "0.05")))) == 130
    monkeypatch.undo()
    assert main(words(other, *ROUGH, levers((FRICTION, "0.05")))) == 0
    (row,) = read_rows(other / "countermeasures.csv")
    assert row["smallest_value"] == found[1][FRICTION]["smallest_value"]


@pytest.mark.slow
@pytest.mark.together
def test_two_processes_give_the_table_of_one(found, processes):
    comm, folder = processes
    page = module.find_countermeasures(BLOCK, comm, folder / "out", [*ROUGH, LEVERS])
    comm.Barrier()
    for row in read_rows(page.with_suffix(".csv")):
        for column, value in found[1][row["key"]].items():
            if isinstance(value, float):
                assert row[column] == pytest.approx(value, rel=1e-6, abs=1e-9), column
            else:
                assert row[column] == value, column


def test_a_folder_of_other_countermeasures_is_refused(found, capsys):
    out, _ = found
    assert main(words(out, *ROUGH, levers((FRICTION, "0.1")))) == 2
    assert "choose another folder with -o" in capsys.readouterr().err
    assert main(words(out / "before", *ROUGH, LEVERS)) == 2
    assert re.search("contains '.*' and no countermeasures", capsys.readouterr().err)


def test_a_folder_is_taken_after_a_call_that_ended_at_its_mesh(tmp_path, capsys):
    for _ in range(2):
        assert main(words(tmp_path / "out", *ROUGH, LEVERS, "mesh.quality=0.9")) == 2
        assert "the worst cell" in capsys.readouterr().err


def test_nothing_to_stop(tmp_path, capsys):
    smooth = [*ROUGH, f"{FRICTION}=0.05", "samples.n=2", levers((FRICTION, "0.01"))]
    assert main(words(tmp_path / "out", *smooth)) == 0
    assert "there is nothing to stop" in capsys.readouterr().err
    assert not (tmp_path / "out" / "countermeasures.csv").exists()


def test_a_run_that_fails_is_named(tmp_path, monkeypatch):
    """The search found a value, and the run with it ends in an error: a row that says so."""
    whole = runs.pipeline.run

    def failing(scene, comm, directory, *rest, **more):
        if directory.name.startswith("after"):
            raise NotConverged("all samples failed")
        return whole(scene, comm, directory, *rest, **more)

    monkeypatch.setattr(runs.pipeline, "run", failing)
    changes = [*ROUGH, "samples.n=2", levers((FRICTION, "0.05"))]
    page = module.find_countermeasures(BLOCK, COMM, tmp_path, changes)
    (row,) = read_rows(page.with_suffix(".csv"))
    assert row["note"] == "the run failed: all samples failed" and row["verified"] == "no"
    assert row["smallest_value"] is not None and row["any_after"] is None


def test_countermeasures_change_no_result_of_a_run():
    plain, more = (read_scene(BLOCK, [*ROUGH, *c]) for c in ([], [LEVERS]))
    assert result_digest(plain) == result_digest(more)


def test_ends_in_si_units_and_what_gives_the_scene_a_value():
    rayleigh = "stability.damping={ rayleigh = ['20 1/s', '1e-8 s'], sliding = true }"
    changes = [*ROUGH, rayleigh, levers(
        (HEIGHT, "'2.5 cm'"), ("loads.\"block.top\".pressure", "'0.2 MPa'"),
        ("stability.damping.rayleigh.beta", "'0.02 us'"), ("motion.speed", "'20 cm/s'"),
        ("materials.iron.rho", "'7 g/cm^3'"),
    )]  # fmt: skip
    scene = read_scene(BLOCK, changes)
    ends = [(c.start, c.stop, c.unit) for c in scene.countermeasures]
    expected = [
        (0.02, 0.025, "m"), (5e5, 2e5, "Pa"), (1e-8, 2e-8, "s"), (1.0, 0.2, "m/s"),
        (7200.0, 7000.0, "kg/m^3"),
    ]  # fmt: skip
    for (*values, unit), (*right, its) in zip(ends, expected, strict=True):
        assert values == pytest.approx(right) and unit == its
    # Any value goes through a scene and back to the same number.
    for c in scene.countermeasures:
        x = c.start + (c.stop - c.start) / 3
        again = read_scene(BLOCK, [*changes[:-1], c.override(scene, x)])
        assert f"{x!r}" in str(again.table)


@pytest.mark.parametrize(
    ("lever", "said"),
    [
        (("contact.none.friction", "0.1"), "there is no [contact.none]"),
        (("parts.block.axis", "0.2"), "with --set parts.block.axis=VALUE, and compare the runs"),
        (("parts.block.z", "'1 mm'"), "with --set parts.block.z=VALUE, and compare the runs"),
        (("materials.iron.loss", "0.1"), "needs stability.damping"),
        (("parts.block.builder", "'pad'"), "only these lengths may vary on one brake"),
        (('loads."block.top".steps', "4"), "=VALUE, and compare the runs"),
        (("contact.block_plate.friction.static", "0.2"), "=VALUE, and compare the runs"),
        (("parts.block.size", "'5 mm'"), "with --set parts.block.size=VALUE, and compare the runs"),
        (("samples.n", "5"), "=VALUE, and compare the runs"),
        (("samples.classical.penalty", "'1e13 Pa/m'"), "perfect contact alone"),
        (("materials.lining.E_3", "'2 GPa'"), "is random"),
        (("materials.iron.C11", "'200 GPa'"), "is not written by C11"),
        (("no key", "1"), "not a dotted key"),
        ((FRICTION, "0.5"), "is the scene's own value"),
        ((FRICTION, "'1 m'"), "write number or table"),
        ((HEIGHT, "'1 bar'"), "wrong unit"),
        ((HEIGHT, "12"), "the unit is missing"),
        ((HEIGHT, "'-1 mm'"), "must be positive"),
        ((HEIGHT, "'60 m'"), "longest length of the part"),
        (("materials.iron.nu", "0.6"), "positive definite"),
        (("materials.lining.rho", "'-1 kg/m^3'"), "must be positive"),
        (("motion.speed", "'2 m/s'"), "nothing depends on the speed"),
        (("materials.lining.C11", "'5 GPa'"), "is random"),
    ],
)  # fmt: skip
def test_mistakes_are_one_line_and_nothing_is_written(lever, said, tmp_path, capsys):
    random = "samples.random.\"materials.lining.C44\"={ law='uniform', spread=0.1 }"
    assert main(words(tmp_path / "out", *ROUGH, random, levers(lever))) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"brake-fenicsx: {BLOCK}: ") and said in line and lever[0] in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ([levers()], "there are none"),
        ([levers((FRICTION, "0.1"), (FRICTION, "0.2"))], "named twice"),
        ([LEVERS, "samples.approaches=['classical']"], "no rough samples"),
        ([LEVERS, "stages=['surface','equilibrium','stability']", "samples.n=1"], "uncertainty"),
    ],
)
def test_what_a_scene_must_have(changes, said, tmp_path):
    with pytest.raises(SceneError, match=said):
        module.find_countermeasures(BLOCK, COMM, tmp_path / "out", [*ROUGH, *changes])
    assert not (tmp_path / "out").exists()


def test_computed_laws_follow_the_modulus_behind_them(tmp_path):
    """In the run as in the samples of the search: E* of an isotropic lining goes with its E."""
    library = [
        *ROUGH, "stages=['surface','micro','equilibrium','stability','uncertainty']",
        "contact.block_plate.law=library", "micro={ E='1.5 GPa', nu=0.4, hardness='300 MPa' }",
        "materials.lining={ model='isotropic', E='2 GPa', nu=0.3, rho='2500 kg/m^3' }",
    ]  # fmt: skip
    key = "materials.lining.E"
    search = module.Search(BLOCK, COMM, tmp_path, [*library, levers((key, "'3 GPa'"))], None)
    (c,) = search.scene.countermeasures
    scene = read_scene(BLOCK, [*library, *search.changes({c: 2.5e9})])
    assert scene.materials["lining"].E == 2.5e9
    assert (scene.micro.E, scene.micro.hardness) == pytest.approx((1.25 * 1.5e9, 1.25 * 300e6))
    assert search.changes({replace(c, key="materials.iron.E"): 2e11}) == [
        'materials.iron.E="200000000000.0 Pa"'
    ]

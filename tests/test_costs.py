"""Costs that check foretells, and those of an earlier run; nothing is timed here."""

import re

from mpi4py import MPI

import pytest

from brake_fenicsx.description import (
    count_solves,
    describe,
    earlier_run,
    time_text,
)
from brake_fenicsx.pipeline import run
from brake_fenicsx.scene import read_scene
from places import SCENES


def test_full_order_is_told_from_reduced():
    """As the measured runs did; 300 samples taken for reduced would be hours off."""
    scene = read_scene(SCENES / "disc_brake.toml")
    changed = "reduced with bodies of their own"
    many, alone = {"multi-scale": 300, "classical": 1}, {"multi-scale": 1, "classical": 1}
    assert count_solves(scene, many) == {"reduced": 301, changed: 0, "at full order": 2}
    assert count_solves(scene, alone) == {"reduced": 0, changed: 0, "at full order": 2}
    full = read_scene(SCENES / "disc_brake.toml", ["stability.method=full"])
    assert count_solves(full, many) == {"reduced": 0, changed: 0, "at full order": 301}
    study = read_scene(SCENES / "disc_brake_study.toml")
    four = {"multi-scale": 300, "parametric": 300, "classical": 1, "joint": 100}
    wanted = {"reduced": 301, changed: 400, "at full order": study.stability.verify}
    assert count_solves(study, four) == wanted
    one = read_scene(
        SCENES / "disc_brake.toml", ["stages=['surface','micro','equilibrium']", "samples.n=1"]
    )
    assert count_solves(one, many) == {}


def test_check_says_it_all_and_writes_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    describe(SCENES / "block_on_plate.toml", MPI.COMM_SELF)
    text = capsys.readouterr().out
    dofs = re.search(r"(\d+) cells, (\d+) free dofs, (\d+) contact elements", text)
    assert int(dofs[2]) > 3 * int(dofs[1])
    assert re.search(r"contact elements with a mean side of \d\.\d{3} mm", text)
    assert "\ndamping" not in text
    said = "1 at full order", "memory: about", "disc: about", "by a second of work", "estimates"
    for words in said:
        assert words in text
    assert list(tmp_path.iterdir()) == []


def test_check_prints_what_the_run_of_the_scene_took(tmp_path, monkeypatch, capsys):
    """As it was measured, beside the estimate; without its summary the estimate alone."""
    monkeypatch.chdir(tmp_path)
    scene = SCENES / "block_on_plate.toml"
    coarse = ["parts.block.size='14 mm'", "parts.plate.size='20 mm'"]
    changes = [*coarse, "stages=['equilibrium', 'stability']"]
    done = run(scene, MPI.COMM_SELF, None, changes)
    facts = earlier_run(tmp_path / "block_on_plate-results")
    assert facts["seconds"].keys() == done.seconds.keys()
    describe(scene, MPI.COMM_SELF, coarse)
    text = capsys.readouterr().out
    took = time_text(sum(facts["seconds"].values()))
    assert f"measured: the run in block_on_plate-results took {took} (brake" in text
    assert re.search(r"^measured: .*\) on 1 process$", text, re.M)
    assert "time: about" in text
    (tmp_path / "block_on_plate-results" / "summary.json").write_text("{}")
    describe(scene, MPI.COMM_SELF, coarse)
    text = capsys.readouterr().out
    assert "by a second of work on this machine" in text
    assert "measured" not in text


@pytest.mark.parametrize(
    "diameter, told",
    [("54 mm", "outline of pad (2078 of 2290 mm^2); 0.5 MPa gives 1039 N each, not 1145 N"),
     ("40 mm", "")],
)  # fmt: skip
def test_check_says_what_is_left_of_a_piston(diameter, told, capsys):
    """A circle that the plate cuts off presses with less than pressure times circle."""
    changes = ["stages=['equilibrium']", "contact.pad_disc.law={ linear = '1e12 Pa/m' }",
               "contact.pad_disc.gap=none", "parts.disc.size=30 mm", "parts.pad.size=16 mm",
               "parts.pad.plate_size=20 mm", f"parts.pad.piston_diameter={diameter}",
               "samples.n=1"]  # fmt: skip
    describe(SCENES / "disc_brake.toml", MPI.COMM_SELF, changes)
    lines = [x for x in capsys.readouterr().out.splitlines() if 'loads."pad.piston"' in x]
    assert len(lines) == bool(told)
    assert all(told in x for x in lines)


def test_check_names_the_damping(capsys):
    describe(SCENES / "block_on_plate.toml", MPI.COMM_SELF, ["stability.damping.sliding=true"])
    assert "\ndamping: sliding\n" in capsys.readouterr().out

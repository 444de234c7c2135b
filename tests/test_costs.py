"""Costs that check foretells from an earlier run; nothing is timed here."""

import json
import re
from pathlib import Path

from mpi4py import MPI

import pytest

from brake_fenicsx.costs import count_solves, earlier_run, scaled_seconds
from brake_fenicsx.description import describe
from brake_fenicsx.pipeline import run
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.in_effect import in_effect

ROOT = Path(__file__).parents[1]
SCENES = ROOT / "scripts" / "scenes"


def facts_of(scene, count, dofs, elements, **seconds):
    """What a run of a scene would have written."""
    each = seconds.get("samples", 0.0) / max(sum(count.values()), 1)
    solved = {name: {"good": n, "seconds_per_equilibrium": each} for name, n in count.items()}
    return {
        "in_effect": in_effect(scene), "samples": solved, "processes": 1, "seconds": seconds,
        "dofs": dofs, "contact_elements": elements,
    }  # fmt: skip


def test_samples_that_were_there_already_count_with_their_solves():
    """A run that went on took 2 s for its last samples, and 10 s in all."""
    scene = read_scene(SCENES / "disc_brake.toml")
    facts = facts_of(scene, {"multi-scale": 100}, 1000, 100, samples=2.0, offline=1.0)
    each = {"seconds_per_equilibrium": 0.15, "seconds_per_stability": 0.05}
    facts["samples"]["multi-scale"] |= each
    facts |= {"processes": 2, "reduced_model": {"seconds": 7.0}}
    seconds = scaled_seconds(facts, scene, {"multi-scale": 300}, 1000, 100)
    assert seconds == pytest.approx({"samples": 30.0, "offline": 7.0})


def test_samples_verified_and_of_other_approaches_are_counted_apart():
    """The demo: 20 samples of 0.2 s, one of 15 s at full order, and 27 s for one verified."""
    scene = read_scene(SCENES / "disc_brake_demo.toml")
    count = {"multi-scale": 20, "classical": 1}
    facts = facts_of(scene, count, 40_745, 576, samples=46.0)
    for name, each in (("multi-scale", 0.2), ("classical", 15.0)):
        facts["samples"][name]["seconds_per_equilibrium"] = each
    for n in (20, 200):
        seconds = scaled_seconds(facts, scene, {"multi-scale": n, "classical": 1}, 40_745, 576)
        assert seconds["samples"] == pytest.approx(0.2 * n + 15.0 + 27.0)


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
    for words in ("1 at full order", "memory: about", "disc: about", "time: unknown", "estimates"):
        assert words in text
    assert list(tmp_path.iterdir()) == []


def test_check_takes_times_from_the_run_of_the_scene(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    scene = SCENES / "block_on_plate.toml"
    coarse = ["parts.block.size='14 mm'", "parts.plate.size='20 mm'"]
    changes = [*coarse, "stages=['equilibrium', 'stability']"]
    done = run(scene, MPI.COMM_SELF, None, changes)
    facts = earlier_run(tmp_path / "block_on_plate-results")
    assert facts["seconds"].keys() == done.seconds.keys()
    describe(scene, MPI.COMM_SELF, changes, as_json=True)
    found = json.loads(capsys.readouterr().out)
    assert found["seconds"] == pytest.approx(facts["seconds"], rel=0.2, abs=0.01)
    describe(scene, MPI.COMM_SELF, coarse)
    text = capsys.readouterr().out
    assert re.search(r"time: about .*on 1 process as in block_on_plate-results: brake", text)
    (tmp_path / "block_on_plate-results" / "summary.json").write_text("{}")
    describe(scene, MPI.COMM_SELF, coarse)
    assert "time: unknown" in capsys.readouterr().out


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

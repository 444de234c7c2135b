"""Programs for designs of experiments call the model as a plain function of plain numbers."""

import runpy
import sys

import numpy as np
import pytest

from brake_fenicsx import prepare, sample
from brake_fenicsx.errors import SceneError
from places import ROOT

DOE = ROOT / "scripts" / "doe"
FRICTION, PRESSURE = "contact.block_plate.friction", 'loads."block.top".pressure'


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """The block on coarse cells."""
    text = (ROOT / "scripts" / "scenes" / "block_on_plate.toml").read_text()
    for old, new in (('"6 mm"', '"12 mm"'), ('"8 mm"', '"16 mm"'), ('"40 kHz"', '"20 kHz"')):
        assert old in text
        text = text.replace(old, new)
    path = tmp_path_factory.mktemp("doe") / "block.toml"
    path.write_text(text)
    return path


@pytest.fixture
def called(monkeypatch, capsys):
    """``called(script, *arguments)``: what a script prints."""

    def call(script, *arguments):
        monkeypatch.setattr(sys, "argv", [script, *map(str, arguments)])
        runpy.run_path(str(DOE / script), run_name="__main__")
        return capsys.readouterr().out

    return call


def test_a_sample_is_the_scene_with_its_inputs(scene):
    """Numbers in SI by dotted key; the scene's own for what is not named."""
    model = prepare(scene)
    found = sample(model, {FRICTION: 0.45, PRESSURE: 3e5})
    other = prepare(scene, [f"{FRICTION}=0.45", "loads.'block.top'.pressure='3 bar'"]).modes()
    np.testing.assert_allclose(found.s, other.s, rtol=1e-7)
    np.testing.assert_allclose(sample(model).s, prepare(scene).modes().s, rtol=1e-9)
    with pytest.raises(SceneError, match="only these lengths may vary"):
        sample(model, {"parts.block.size": 1e-3})


def test_sobol_indices_by_salib(scene, called):
    pytest.importorskip("SALib")
    out = called("salib_sobol.py", scene, "block_plate", "block.top", 2)
    assert "ST" in out
    assert FRICTION in out


def test_samples_that_fail_are_named_and_give_no_indices(scene, called, capsys, monkeypatch):
    """A friction at which the block finds no equilibrium: those rows, by number and inputs."""
    design = pytest.importorskip("SALib.sample.sobol")
    points = [[0.45, 3e5], [40.0, 5e5], [0.45, 5e5]]
    monkeypatch.setattr(design, "sample", lambda *a, **k: np.array(points))
    with pytest.raises(SystemExit, match=r"1 of 3 samples failed: no indices; narrow the bounds"):
        called("salib_sobol.py", scene, "block_plate", "block.top", 2)
    said = capsys.readouterr()
    (line,) = said.err.splitlines()
    assert line.startswith(f"sample 1 failed, {{{FRICTION!r}: 40.0, {PRESSURE!r}: 500000.0}}: ")
    assert "equilibrium" in line and said.out == ""


def test_search_by_optuna(scene, called):
    pytest.importorskip("optuna")
    out = called("optuna_search.py", scene, "block.top", 3)
    assert "pressure" in out


def test_file_interface_of_dakota(scene, tmp_path, called):
    """Parameters as Dakota writes them; the second evaluation takes what the first one made."""
    values = []
    for friction, pressure in ((0.45, 3e5), (0.45, 5e5), (40.0, 5e5)):
        (tmp_path / "params.in").write_text(
            f"                    2 variables\n  {friction:.16e} {FRICTION}\n  {pressure:.16e}"
            f" {PRESSURE}\n                    1 functions\n                    1 ASV_1:growth\n"
        )
        given = tmp_path / "prepared", tmp_path / "params.in", tmp_path / "results.out"
        called("dakota_driver.py", scene, *given)
        value, name = (tmp_path / "results.out").read_text().split(maxsplit=1)
        if friction > 1:
            assert value == "FAIL" and "equilibrium" in name
            break
        assert name == "growth\n"
        values.append(float(value))
    exact = sample(prepare(scene), {FRICTION: 0.45, PRESSURE: 5e5}).s.real.max()
    assert values[1] == pytest.approx(exact, rel=1e-6, abs=1e-6)

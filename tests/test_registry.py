"""The registry: the core alone, what it says of absent extras, and extras of others."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import brake_fenicsx
from brake_fenicsx import prepare, sample
from coarse_block import BLOCK, ROUGH
from run_tables import read_columns

PACKAGE = Path(brake_fenicsx.__file__).parent
GUIDE = PACKAGE.parent / "docs" / "developer_guide.md"
FILE = "mesh={ file='deck.inp', unit='mm', groups={ EALL='cap.all' } }"
BODY = "parts.cap={ material='iron' }"
CAP = (
    "parts.cap={ matrices={ stiffness='K.mtx', mass='M.mtx', nodes='nodes.csv',"
    " units=['mm','t','s'] } }"
)
PAGE = "stages=['surface','equilibrium','stability','uncertainty','report']"


def program(path, *words, folder=None):
    """Run the command line of a package that lies in a folder."""
    code = "import sys; from brake_fenicsx.cli import main; sys.exit(main(sys.argv[1:]))"
    env = {**os.environ, "PYTHONPATH": str(path)}
    words = [sys.executable, "-c", code, *map(str, words)]
    return subprocess.run(words, capture_output=True, text=True, env=env, cwd=folder)


def changes(*given):
    return [word for text in given for word in ("--set", text)]


@pytest.fixture(scope="module")
def core(tmp_path_factory):
    """A copy of the package without extras."""
    root = tmp_path_factory.mktemp("core")
    aside = shutil.ignore_patterns("extras", "__pycache__")
    shutil.copytree(PACKAGE, root / "brake_fenicsx", ignore=aside)
    assert not (root / "brake_fenicsx" / "extras").exists()
    return root


@pytest.mark.long
def test_the_chain_runs_without_extras(core, tmp_path):
    """Surface to page, with the modes of the whole program."""
    out = tmp_path / "out"
    done = program(core, "run", BLOCK, "-o", out, "--no-pictures", *changes(*ROUGH[1:], PAGE))
    assert done.returncode == 0, done.stderr
    found = read_columns(out / "modes.csv")
    first, modes = found["sample"] == 0, sample(prepare(BLOCK, ROUGH))
    np.testing.assert_allclose(found["frequency_hz"][first], modes.frequency, rtol=1e-9)
    assert (found["damping"] < -1e-3).any()
    page = (out / "report.html").read_text()
    assert "Squeal map" in page and "How loud" not in page


@pytest.mark.long
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["check", BLOCK, *changes("limit_cycle={}")], "limit_cycle = {}: .* extra limit_cycle"),
        (["check", BLOCK, *changes("countermeasures=[]")], "countermeasures = .* extra variants"),
        (["init", "deck.inp"], "init: .* extra decks"),
        (["compare", "a", "b"], "compare: .* extra variants"),
        (["correlate", BLOCK, "x.unv"], "correlate: .* extra measured"),
        (["check", BLOCK, *changes(FILE, BODY)], r"mesh.file = '.*deck.inp': .inp: .* extra decks"),
        (["check", BLOCK, *changes(CAP)], r"parts\.cap\.matrices: .* extra decks"),
    ],
    ids=lambda x: x[0] if isinstance(x, list) else "",
)
def test_an_absent_extra_is_named_with_what_to_install(words, said, core, tmp_path):
    done = program(core, *words, folder=tmp_path)
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert re.search(said, done.stderr), done.stderr
    assert "pip install 'brake_fenicsx[" in done.stderr


def installed(folder, group, *points):
    """Metadata of a package whose modules lie in a folder."""
    info = folder / "their-1.2.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: their\nVersion: 1.2\n")
    (info / "entry_points.txt").write_text("\n".join([f"[{group}]", *points, ""]))


@pytest.fixture(scope="module")
def theirs(tmp_path_factory):
    """The extra of the developer guide, installed beside the package."""
    root = tmp_path_factory.mktemp("theirs")
    (root / "brake_fenicsx").symlink_to(PACKAGE)
    blocks = re.findall(r"```(?:python|ini)\n# (\S+)\n(.*?)```", GUIDE.read_text(), re.S)
    for name, text in blocks:
        (root / name).parent.mkdir(exist_ok=True)
        (root / name).write_text(text)
    named = tomllib.loads((root / "pyproject.toml").read_text())["project"]["entry-points"]
    points = named["brake_fenicsx.extras"].items()
    installed(root, "brake_fenicsx.extras", *(f"{name} = {value}" for name, value in points))
    return root


@pytest.mark.long
def test_an_extra_of_another_package(theirs, tmp_path):
    """Section, stage, table, page and command; friction takes mu F V, whatever the contact."""
    out, stages = tmp_path / "out", "stages=['equilibrium','report']"
    given = [stages, "parts.block.size='14 mm'", "parts.plate.size='20 mm'", "friction_power={}"]
    done = program(theirs, "run", BLOCK, "-o", out, "--no-pictures", *changes(*given))
    assert done.returncode == 0, done.stderr
    assert "friction_power: done in" in done.stderr
    table = read_columns(out / "friction_power.csv")
    assert table["W"] == pytest.approx(0.5 * 5e5 * 40e-3 * 20e-3 * 1.0, rel=1e-6)
    assert table["disc_W"] == pytest.approx(0.9 * table["W"])
    assert "Power of friction" in (out / "report.html").read_text()
    assert program(theirs, "power", out).stdout == "200 W\n"


@pytest.mark.long
def test_a_broken_extra_costs_itself(tmp_path):
    (tmp_path / "brake_fenicsx").symlink_to(PACKAGE)
    installed(tmp_path, "brake_fenicsx.extras", "lost = not_there:EXTRA")
    done = program(tmp_path, "check", BLOCK, "-q")
    assert done.returncode == 0 and "extra lost left out: not_there:EXTRA: No module" in done.stderr

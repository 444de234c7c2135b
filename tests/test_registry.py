"""The registry: the core alone, what it says of an extra that is not there, and extras of others."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import brake_fenicsx
from brake_fenicsx.results.tables import read_columns, read_rows
from coarse_block import BLOCK, ROUGH

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
    # The pattern has taken no module of the core with it.
    assert not (root / "brake_fenicsx" / "extras").exists()
    assert (root / "brake_fenicsx" / "folder" / "extras.py").is_file()
    return root


def test_the_chain_runs_without_extras(core, tmp_path):
    """Surface to page; two families squeal in all samples of this block."""
    out = tmp_path / "out"
    done = program(core, "run", BLOCK, "-o", out, *changes(*ROUGH[1:], PAGE))
    assert done.returncode == 0, done.stderr
    modes = read_columns(out / "modes.csv")
    loud = modes["damping"] < -1e-3
    for sample in range(3):
        assert len({*modes["family"][loud & (modes["sample"] == sample)]}) == 2
    page = (out / "report.html").read_text()
    assert "Squeal map" in page and "How loud" not in page


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

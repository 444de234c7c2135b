"""Every script of the gallery runs from an empty folder, draws its picture and finds its number."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

GALLERY = Path(__file__).parents[1] / "docs" / "gallery"
SCRIPTS = sorted(GALLERY.glob("*.py"))
FAST = ("flutter",)  # a whole brake; the others are slow


@pytest.mark.parametrize(
    "script",
    [
        pytest.param(path, marks=[] if path.stem in FAST else pytest.mark.slow, id=path.stem)
        for path in SCRIPTS
    ],
)
def test_script(script, tmp_path):
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert (tmp_path / f"{script.stem}.png").stat().st_size > 10_000


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_page(script):
    """Title, picture and number in the light format; a line in the index, a small file."""
    text = script.read_text()
    assert re.match(r"# # \w.*\n#\n", text)
    assert f"]({script.stem}.png)" in text
    assert text.count("\n# +\n") == text.count("\n# -\n") > 0
    assert text.rstrip().splitlines()[-1].startswith("assert ")
    assert 10_000 < (GALLERY / f"{script.stem}.png").stat().st_size < 250_000
    assert (GALLERY / "index.md").read_text().count(f"]({script.name})") == 2

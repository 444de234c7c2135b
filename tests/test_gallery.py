"""Every script of the gallery runs from an empty folder, draws its picture and finds its number."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

GALLERY = Path(__file__).parents[1] / "docs" / "gallery"
SCRIPTS = sorted(GALLERY.glob("*.py"))
FAST = ("flutter",)  # a whole brake; the others are slow


@pytest.mark.long
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


def lines_of(notebook):
    """Text and code of a notebook as lines of a script."""
    for cell in json.loads(notebook.read_text())["cells"]:
        sign = "" if cell["cell_type"] == "code" else "# "
        yield from (f"{sign}{line}" for line in "".join(cell["source"]).splitlines())


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_notebook(script):
    """It is the script, was executed, and prints something; the picture is in it."""
    notebook = script.with_suffix(".ipynb")
    marks = {"", "#", "# +", "# -"}
    own, its = (
        [x.rstrip() for x in lines if x.strip() not in marks]
        for lines in (script.read_text().splitlines(), lines_of(notebook))
    )
    assert own == its, f"scripts/gallery_notebooks.py {script.stem}"
    outputs = [o for c in json.loads(notebook.read_text())["cells"] for o in c.get("outputs", [])]
    assert any(o["output_type"] == "stream" and o["text"] for o in outputs)
    assert not any(o["output_type"] == "error" for o in outputs)
    assert notebook.stat().st_size < 400_000


def test_first_page_shows_every_example():
    shown = (GALLERY.parent / "index.md").read_text()
    for path in SCRIPTS:
        title = path.read_text().splitlines()[0].removeprefix("# # ")
        assert f'[![{title}](gallery/{path.stem}.png)](gallery/{path.stem}.py "{title}")' in shown


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

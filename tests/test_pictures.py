"""Every picture of README and docs is in docs/pictures.toml, and is made by its command there."""

import base64
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from places import ROOT

DOCS = ROOT / "docs"
MADE = tomllib.loads((DOCS / "pictures.toml").read_text())
# Words that make a command short: its picture has fewer points then.
SHORT = {
    "squeal_map.png": [
        "--set", "samples.n=2", "--set", "samples.joint={ n=4, design='latin-hypercube' }",
        "--set", "samples.parametric={ n=4, design='latin-hypercube' }", "--set", "micro.laws=4",
        "--set", "parts.disc.size='16 mm'", "--set", "parts.pad.size='9 mm'", "--set",
        "parts.pad.plate_size='10 mm'", "--set", "stability.band=['0 Hz', '8 kHz']",
    ],
    "laws.png": ["--samples", "2"],
    "speed_against_error.png": ["--quick"],
}  # fmt: skip
# Height over width of a picture made again, relative.
SHAPE = 0.03


def test_every_picture_is_in_the_table_and_has_its_command_beside_it():
    """Those of the gallery are made by the script that they link to (tests/test_gallery.py)."""
    shown = set()
    for page in [ROOT / "README.md", *DOCS.rglob("*.md")]:
        text = page.read_text()
        for match in re.finditer(r"^!\[[^]]*\]\(([^)]+)\)\n\n((?:.+\n)+)", text, re.M):
            name = Path(match[1]).name
            assert name in MADE, (page.name, name)
            assert re.search(r"`(brake-fenicsx|scripts/)|commands\s+above", match[2]), name
            shown.add(name)
        linked = re.findall(r"\[!\[[^]]*\]\(([^)]+)\.png\)\]\(([^) ]+)\.py", text)
        assert all(picture == script for picture, script in linked)
        every = re.findall(r"!\[[^]]*\]\(([^)]+)\)", text)
        assert len(every) == len(linked) + len(re.findall(r"^!\[", text, re.M)), page.name
    assert shown == MADE.keys()


def commands_of(name):
    """Words of each command of a picture, as one types them; those of a page that it names."""
    text = []
    for line in MADE[name]["run"]:
        if line.endswith(".md"):
            block = re.search(r"```sh\n(.*?)```", (DOCS / line).read_text(), re.S)[1]
            text += block.replace("\\\n", "").splitlines()
        else:
            text.append(line)
    return [shlex.split(line) for line in text]


def test_commands_and_places_of_pictures_are_there():
    """Scripts and scenes exist, and figures have names that the report writes."""
    written = "".join(p.read_text() for p in (ROOT / "brake_fenicsx" / "report").glob("*.py"))
    for name, row in MADE.items():
        assert row.keys() <= {"run", "from"} and row["run"], name
        for words in commands_of(name):
            assert words[0] == "brake-fenicsx" or (ROOT / words[0]).is_file(), words
            assert all((ROOT / w).exists() for w in words if w.startswith("scripts/")), words
        figure = re.search(r"figures/(\w+)\.png$", row.get("from", ""))
        assert not figure or f'"{figure[1]}"' in written, name


def run(words, folder):
    """One command of this checkout, in a folder; of the demo what follows the installation."""
    if words == ["scripts/demo"]:
        scene = "scripts/scenes/disc_brake_demo.toml"
        words = ["brake-fenicsx", "run", scene, "-o", "demo-results"]
    program = ["-m", "brake_fenicsx"] if words[0] == "brake-fenicsx" else words[:1]
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, *program, *words[1:]], cwd=folder, capture_output=True, text=True,
        env=os.environ | {"PYTHONPATH": path},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]


def drawn(path):
    """Size, number of colours and share of pixels that are not of the most frequent colour."""
    image = pytest.importorskip("PIL.Image").open(path)
    assert image.format == "PNG"
    pixels = np.asarray(image.convert("RGB")).reshape(-1, 3) @ [65536, 256, 1]
    _, counts = np.unique(pixels, return_counts=True)
    return image.size, counts.size, 1 - counts.max() / pixels.size


@pytest.mark.slow
@pytest.mark.parametrize("name", MADE)
def test_its_command_makes_the_picture(name, tmp_path):
    """In an empty folder beside the scripts: of the same shape, and as much drawn in it."""
    if name == "report.png":
        pytest.importorskip("playwright")
        if shutil.which("chromium") is None:
            pytest.skip("no chromium")
    for folder in ("scripts", "tests"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    (tmp_path / "docs").mkdir()
    *first, last = commands_of(name)
    for words in [*first, last + SHORT.get(name, [])]:
        run(words, tmp_path)
    made = tmp_path / MADE[name].get("from", f"docs/{name}")
    if made.suffix == ".html":
        shown = re.search(r"data:image/png;base64,([\w+/=]+)", made.read_text())[1]
        made = tmp_path / name
        made.write_bytes(base64.b64decode(shown))
    (width, height), colours, full = drawn(made)
    (w, h), _, before = drawn(DOCS / name)
    assert width >= 800 and height / width == pytest.approx(h / w, rel=SHAPE)
    assert colours > 50 and before / 3 < full < 3 * before

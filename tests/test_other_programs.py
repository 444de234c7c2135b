"""The table of what other programs do, and the form of the scripts in ``findings/``."""

import os
import re

import pytest

from places import ROOT

PAGE = (ROOT / "docs" / "what_other_programs_do.md").read_text()
ROWS = [
    [cell.strip() for cell in line.strip("|").split(" | ")]
    for line in PAGE.splitlines()
    if line.startswith("| ") and not line.startswith(("| behaviour", "| ---"))
]
SCRIPTS = sorted((ROOT / "findings").glob("*.sh"))


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0][:40])
def test_each_line_names_its_version_and_the_test_that_holds_it(row):
    behaviour, program, seen, here, held = row
    assert behaviour.endswith(".") and seen and here
    assert re.search(r"[A-Za-z].* \d+\.\d+", program)
    ((file, name),) = re.findall(r"^`(tests/[\w/]+\.py)::(test_\w+)`$", held)
    assert re.search(rf"^def {name}\(", (ROOT / file).read_text(), re.M)


def test_no_line_comes_twice_and_the_page_is_in_the_index():
    assert len({row[0] for row in ROWS}) == len(ROWS) > 20
    assert re.search(r"^what_other_programs_do$", (ROOT / "docs" / "index.md").read_text(), re.M)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_each_finding_has_the_form_of_the_guide(script):
    """Version, guess, behaviour, why, output; pinned packages; this program is not used."""
    text = script.read_text()
    head, _, body = text.partition("set -euo pipefail\n")
    assert text.startswith("#!/usr/bin/env bash\n# ") and os.access(script, os.X_OK)
    assert re.search(r"\d+\.\d+", head.splitlines()[1])
    for part in ("Guess:", "Behaviour:", "Why the guess fails:", "Output seen"):
        assert f"# {part}" in head
    assert "mktemp -d" in body and "brake" not in body
    packages = re.findall(r"pip\" install --quiet (.*)", body)
    assert all("==" in package for line in packages for package in line.split())
    assert packages or "apt-get install" in body

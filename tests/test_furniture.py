"""Version, packages, changelog and citation agree."""

import re
import subprocess
import sys
import tomllib
from importlib.metadata import metadata

from brake_fenicsx import __version__
from places import ROOT


def test_the_version_stands_in_one_place():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert "version" in project["project"]["dynamic"]
    assert (
        project["tool"]["setuptools"]["dynamic"]["version"]["attr"] == "brake_fenicsx.__version__"
    )
    assert metadata("brake_fenicsx")["Version"] == __version__, "run scripts/setup"
    assert metadata("brake_fenicsx")["Author"] == "brake_fenicsx developers"


def test_an_installed_copy_has_every_package():
    """setuptools finds folders with an __init__.py, the linked builders of geometry/ included."""
    find = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    assert find == {"find": {"include": ["brake_fenicsx*"], "namespaces": False}}
    package = ROOT / "brake_fenicsx"
    folders = {file.parent for file in package.rglob("*.py")} | {package / "geometry"}
    assert all((folder / "__init__.py").is_file() for folder in folders)


def test_the_changelog_begins_with_this_version():
    versions = re.findall(
        r"^## \[([\d.]+)\] - \d{4}-\d\d-\d\d$", (ROOT / "CHANGELOG.md").read_text(), re.M
    )
    assert versions[0] == __version__
    assert versions == sorted(versions, reverse=True)


def test_the_citation_names_this_version_and_the_paper():
    text = (ROOT / "CITATION.cff").read_text()
    assert f"\nversion: {__version__}\n" in text
    assert "doi: 10.3390/lubricants11080344" in text
    assert re.search(r"^title: .*brake_fenicsx", text, re.M)


def test_one_list_of_dependencies():
    """Of pyproject.toml, conda/meta.yaml, pixi.toml and the bounds in scripts/setup."""
    recipe = re.search(r"\n  run:\n(.*?)\n\n", (ROOT / "conda" / "meta.yaml").read_text(), re.S)[1]
    conda = {}
    for name, *wanted in (line.split() for line in re.findall(r"^    - (.*)", recipe, re.M)):
        conda[name] = wanted or ["*"]
    pixi = tomllib.loads((ROOT / "pixi.toml").read_text())
    assert conda == {
        name: [wanted] if isinstance(wanted, str) else list(wanted.values())
        for name, wanted in pixi["dependencies"].items()
    }
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert conda["python"] == [project["requires-python"]]
    extras = project["optional-dependencies"]
    there = {name.lower().removesuffix("-base"): "".join(own) for name, own in conda.items()}
    there |= {name.lower(): own for name, own in pixi["pypi-dependencies"].items()}
    bounds = dict(re.findall(r'"([\w-]+)(<[\d.]+)"', (ROOT / "scripts" / "setup").read_text()))
    for text in sum(
        (extras[e] for e in ("mesh", "uncertainty", "report", "modal")), project["dependencies"]
    ):
        name, bound = re.fullmatch(r"([\w-]+)(.*)", text).groups()
        assert there[name.lower()] == (bound or bounds.get(name, "*")), name
    by_pip = re.search(r"pip install (\".*)", (ROOT / "conda" / "meta.yaml").read_text())[1]
    assert by_pip.replace('"', "").split() == [
        name + own.strip("*")
        for name, own in pixi["pypi-dependencies"].items()
        if isinstance(own, str)
    ]


def test_the_table_of_tested_versions_has_this_system():
    """Up to the patch level, which a distribution may raise."""
    script = [sys.executable, str(ROOT / "scripts" / "tested_versions.py")]
    row = subprocess.run(script, check=True, capture_output=True, text=True).stdout
    cells = [cell.strip() for cell in row.strip("| \n").split("|")]
    assert len(cells) == 8 and all(re.fullmatch(r"\d+(\.\d+)+\S*", c) for c in cells[1:])
    page = (ROOT / "docs" / "installation.md").read_text()
    there = re.search(rf"^\| {re.escape(cells[0])} \|.*", page, re.M)
    if cells[0] in ("Debian 12", "Debian 13"):
        known = [cell.strip() for cell in there[0].split("|")[2:9]]
        minor = [[".".join(v.split(".")[:2]) for v in own] for own in (known, cells[1:])]
        assert minor[0] == minor[1], "scripts/tested_versions.py --write"

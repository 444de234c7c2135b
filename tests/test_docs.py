"""The documentation site: it builds without a warning, is complete, and needs no network."""

import json
import os
import re
from importlib import import_module

import pytest

from places import ROOT

DOCS = ROOT / "docs"


@pytest.fixture
def site():
    """What scripts/docs, which takes warnings for errors, has built; it names the folder."""
    if "BRAKE_FENICSX_SITE" not in os.environ:
        pytest.skip("BRAKE_FENICSX_SITE names no folder in which scripts/docs has built the site")
    return ROOT / os.environ["BRAKE_FENICSX_SITE"]


def test_every_page_is_on_the_site_and_in_its_search(site):
    files = [*DOCS.rglob("*.md"), *DOCS.glob("gallery/*.py")]
    pages = {p.relative_to(DOCS).with_suffix("").as_posix() for p in files}
    assert all((site / f"{page}.html").is_file() for page in pages)
    found = (site / "searchindex.js").read_text()
    assert pages == set(json.loads(found[found.index("{") : found.rindex("}") + 1])["docnames"])


def test_pages_on_the_site_load_nothing_from_a_network(site):
    loaded = re.compile(r'<(?:script|link|img)[^>]*(?:src|href)="(?:https?:)?//[^"]*"')
    for page in site.rglob("*.html"):
        assert not loaded.findall(page.read_text()), page.name
    assert not any("@import" in css.read_text() for css in site.rglob("*.css"))


def test_the_schema_of_a_scene_is_on_the_site(site):
    assert "stability" in json.loads((site / "scene.schema.json").read_text())["properties"]


def test_every_public_function_is_on_the_site(site):
    """Autodoc writes an anchor for each; a name that moved would leave none."""
    page = "".join(path.read_text() for path in (site / "api").glob("*.html"))
    names = ["run", "assemble", "prepare", "sample", "sweep", "scene.read_scene"]
    for package in ("surface", "micro", "macro", "stability"):
        public = import_module(f"brake_fenicsx.{package}").__all__
        names += [f"{package}.{name}" for name in public]
    assert [name for name in names if f'id="brake_fenicsx.{name}"' not in page] == []


@pytest.mark.long
@pytest.mark.parametrize("page", sorted((DOCS / "api").glob("*.md")), ids=lambda path: path.stem)
def test_each_page_of_the_interface_has_an_example_that_runs(page, tmp_path, monkeypatch, capsys):
    """As it stands, in a folder that has the scenes, and with something to say."""
    (code,) = re.findall(r"^```python\n(.*?)^```$", page.read_text(), re.M | re.S)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scripts").symlink_to(ROOT / "scripts")
    exec(compile(code, page.name, "exec"), {})
    assert capsys.readouterr().out


def test_every_name_that_the_interface_shows_is_there():
    """Without the site, so that a name that moved is seen before the site is built."""
    pattern = re.compile(r"^\.\. auto(?:function|class|data|exception):: (\S+)\.(\w+)$", re.M)
    text = "\n".join(path.read_text() for path in (DOCS / "api").glob("*.md"))
    shown = pattern.findall(text)
    assert len(shown) > 20
    assert [name for name in shown if not hasattr(import_module(name[0]), name[1])] == []


def test_pages_written_by_hand_stay_short():
    """README and pages, without those that a script writes, in words as `wc -w` counts them."""
    pages = [(ROOT / "README.md").read_text(), *(p.read_text() for p in DOCS.glob("*.md"))]
    by_hand = [page for page in pages if "\nWritten by `scripts/" not in page]
    assert len(pages) - len(by_hand) == 4
    assert sum(len(page.split()) for page in by_hand) <= 30_000


def test_tests_that_pages_name_are_there():
    for page in DOCS.rglob("*.md"):
        for file, name in re.findall(r"`?(tests/[\w/]+\.py)(?:::(\w+))?", page.read_text()):
            text = (ROOT / file).read_text()
            assert not name or f"def {name}(" in text, (page.name, file, name)


def test_the_example_of_an_array_of_heights_runs(capsys):
    page = (DOCS / "tutorial_surface.md").read_text()
    exec(re.search(r"```python\n# own_array.py\n(.*?)```", page, re.S)[1], {})
    pressure, area = re.search(
        r"p = ([\d.e+]+) Pa at .*\n.*: ([\d.]+) % of the area", capsys.readouterr().out
    ).groups()
    assert float(pressure) >= 1e6 and 0.1 < float(area) < 50

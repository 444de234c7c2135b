"""Small files of each kind have their right values; docs/supported_files.md says what is read."""

import tomllib

import pytest

from places import ROOT
from processes import script

pytest.importorskip("pyNastran")
pytest.importorskip("pyuff")
pytest.importorskip("meshio")
FILES = ROOT / "tests" / "files"
pages = script("supported_files.py")
RIGHT = tomllib.loads((FILES / "right.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", RIGHT)
def test_a_file_has_its_right_values(name):
    """By hand from how the file was made, tests/files/right.toml."""
    right = {key: value for key, value in RIGHT[name].items() if key != "written"}
    assert pages.facts(FILES / name) == right


def test_every_file_has_right_values():
    files = {path.name for path in FILES.iterdir() if path.suffix not in (".toml", ".inc")}
    assert files == RIGHT.keys()


def test_page_is_what_the_script_writes():
    """A keyword, an option or a file added without the page being written again."""
    page = (ROOT / "docs" / "supported_files.md").read_text(encoding="utf-8")
    assert page == pages.page(), "run scripts/supported_files.py"

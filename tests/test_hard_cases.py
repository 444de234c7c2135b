"""docs/hard_cases.md lists the tests with the marker hard, one sentence each."""

import pytest

from places import ROOT
from processes import script

generator = script("hard_cases.py")


def test_page_is_what_the_script_writes():
    """A hard case added, renamed or taken away without the page being written again."""
    page = (ROOT / "docs" / "hard_cases.md").read_text()
    assert page == generator.page(), "run scripts/hard_cases.py"
    assert page.count("\n| ") > 60


MARKED = """
import pytest
def test_plain():
    "Not hard."
@pytest.mark.hard
def test_own_mark():
    "Marked itself."
"""


def test_cases_are_found_by_mark_and_by_folder(tmp_path):
    file = tmp_path / "test_it.py"
    file.write_text(MARKED)
    assert list(generator.cases(file)) == [("test_own_mark", "Marked itself.")]
    file.write_text(f"{MARKED}pytestmark = [pytest.mark.slow, pytest.mark.hard]")
    assert len(list(generator.cases(file))) == 2
    (tmp_path / "hard").mkdir()
    file = tmp_path / "hard" / "test_it.py"
    file.write_text(MARKED)
    assert len(list(generator.cases(file))) == 2


def test_a_hard_case_without_a_sentence_is_refused(tmp_path):
    file = tmp_path / "test_it.py"
    file.write_text("import pytest\npytestmark = pytest.mark.hard\ndef test_silent(): pass")
    with pytest.raises(ValueError, match="test_silent"):
        list(generator.cases(file))

"""Scripts name what the package has: those that no other test runs too."""

import runpy

import pytest

from places import SCRIPTS

GUARDED = [p for p in sorted(SCRIPTS.glob("*.py")) if '__name__ == "__main__"' in p.read_text()]
# Packages that not every set-up has.
OPTIONAL = {"jupytext", "nbclient", "playwright"}


@pytest.mark.parametrize("path", GUARDED, ids=lambda path: path.stem)
def test_a_script_can_be_imported(path, monkeypatch):
    monkeypatch.syspath_prepend(str(SCRIPTS))
    try:
        runpy.run_path(str(path), run_name="imported")
    except ModuleNotFoundError as error:
        if error.name not in OPTIONAL:
            raise
        pytest.skip(str(error))

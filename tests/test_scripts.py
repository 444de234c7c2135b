"""Scripts name what the package has: those that no other test runs too."""

import runpy
import subprocess
import sys

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


def test_what_the_roofline_counts_is_there():
    """It replaces functions by name, in a process of its own."""
    work = "from bench_roofline import *; count_factors(), count_transforms(), count_samples()"
    subprocess.run([sys.executable, "-c", work], cwd=SCRIPTS, check=True)

"""Which modules of stability/ may import which, read from the sources."""

import ast
from pathlib import Path

import pytest

STABILITY = Path(__file__).parents[2] / "brake_fenicsx" / "stability"
FOLDERS = ("eigensolvers", "full", "substructures")
# eigensolvers lie below full order and the reduced model, which do not know each other.
BELOW = {
    "eigensolvers": {"eigensolvers"},
    "full": {"eigensolvers", "full", "modes"},
    "substructures": {"eigensolvers", "substructures", "modes"},
}


def imported(file):
    """First names below stability/ that a module imports."""
    package = ("brake_fenicsx", "stability", *file.relative_to(STABILITY).parts[:-1])
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom):
            base = package[: len(package) + 1 - node.level] if node.level else ()
            names = [a.name for a in node.names]
            for name in [node.module] if node.module else names:
                yield from below_stability((*base, *name.split(".")), names)
        elif isinstance(node, ast.Import):
            for alias in node.names:
                yield from below_stability(tuple(alias.name.split(".")), [])


def below_stability(path, names):
    """What a path names below stability/; the names themselves where it ends there."""
    if path[:2] == ("brake_fenicsx", "stability"):
        yield from [path[2]] if len(path) > 2 else names


@pytest.mark.parametrize("folder", FOLDERS)
def test_imports_go_one_way(folder):
    files = sorted((STABILITY / folder).glob("*.py"))
    assert len(files) > 5
    assert {name for file in files for name in imported(file)} <= BELOW[folder]


def test_one_module_connects_full_order_and_the_reduced_model():
    """The count of damped modes at full order is that of a reduced model."""
    two = {"full", "substructures"}
    both = {file.name for file in STABILITY.glob("*.py") if two <= {*imported(file)}}
    assert both == {"__init__.py", "damped_count.py"}

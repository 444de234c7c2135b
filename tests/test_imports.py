"""The order of the folders; what a command loads."""

import ast
import re
import subprocess
import sys
from collections import Counter
from pkgutil import resolve_name

import pytest

from source_tree import ROOT, imports, sources, tree

BLOCK = ROOT / "scripts" / "scenes" / "block_on_plate.toml"
ORDER = (
    "folder",
    "scene",
    "surface",
    "micro",
    "meshing",
    "macro",
    "stability",
    "build",
    "samples",
    "results",
    "sweeps",
    "report",
    "extras",
)
# eigensolvers lie below full order and the reduced model, which do not know each other.
BELOW = {
    "eigensolvers": {"eigensolvers"},
    "full": {"eigensolvers", "full", "modes"},
    "substructures": {"eigensolvers", "substructures", "modes"},
}


def folders(name):
    """Folder and, within it, module or folder of all that a module of the package imports."""
    return {tuple(m.split(".")[1:3]) for m in imports(name) if "." in m}


def modules(*above):
    """Modules below a folder."""
    found = [n for n in sources() if n.split(".")[1 : 1 + len(above)] == [*above]]
    assert len(found) > 3
    return found


@pytest.mark.parametrize("folder", ORDER)
def test_folders_import_those_before_them(folder):
    later = {*ORDER[ORDER.index(folder) + 1 :]}
    found = {(name, path[0]) for name in modules(folder) for path in folders(name)}
    assert not {(name, other) for name, other in found if other in later}


def test_the_core_imports_no_extra():
    core = [name for name in sources() if name.split(".")[1:2] != ["extras"]]
    assert len(core) > 150
    assert not {name for name in core for path in folders(name) if path[0] == "extras"}


def test_no_two_classes_have_one_name():
    names = Counter(
        node.name
        for path in sources().values()
        for node in tree(path).body
        if isinstance(node, ast.ClassDef)
    )
    assert len(names) > 100 and max(names.values()) == 1, names.most_common(3)


def stability(name):
    """Modules and folders of stability that a module imports."""
    return {path[1] for path in folders(name) if path[0] == "stability" and len(path) > 1}


@pytest.mark.parametrize("folder", list(BELOW))
def test_full_order_and_reduced_model_share_what_lies_below(folder):
    assert all(stability(name) <= BELOW[folder] for name in modules("stability", folder))


def test_one_module_connects_full_order_and_the_reduced_model():
    """The count of damped modes at full order is that of a reduced model."""
    both = {n for n in modules("stability") if {"full", "substructures"} <= stability(n)}
    assert both == {"brake_fenicsx.stability", "brake_fenicsx.stability.eigen"}


@pytest.mark.parametrize(
    ("command", "left_out"),
    [
        (["--help"], ["mpi4py.MPI", "numpy", "dolfinx"]),
        (
            ["check", str(BLOCK)],
            ["brake_fenicsx.surface", "scipy.stats", "pandas", "pint", "matplotlib", "SALib"],
        ),
    ],
)
def test_a_command_starts_without_what_it_does_not_need(command, left_out):
    """What takes longest at the start: MPI for help, and surfaces where a scene has none."""
    code = (
        "import sys\nfrom brake_fenicsx.cli import main\n"
        f"try:\n    main({command!r})\nexcept SystemExit:\n    pass\n"
        f"print('found', [name for name in {left_out!r} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "found []", done.stdout


def test_names_that_tests_replace_are_there():
    """Texts such as "brake_fenicsx.mac.mac" in tests, slow ones too: a move would leave them."""
    text = "".join(path.read_text() for path in (ROOT / "tests").rglob("*.py"))
    places = sorted(set(re.findall(r'"(brake_fenicsx(?:\.\w+)+)"', text)))
    assert len(places) > 10
    for place in places:
        resolve_name(place)

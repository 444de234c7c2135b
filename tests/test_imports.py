"""The order of the folders; what a command loads."""

import ast
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "brake_fenicsx"
BLOCK = PACKAGE.parent / "scripts" / "scenes" / "block_on_plate.toml"
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


def imported(file, tree=None):
    """Paths below the package that a module imports, or part of it; names in them included."""
    package = file.relative_to(PACKAGE).parts[:-1]
    for node in ast.walk(tree or ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom):
            module = tuple(node.module.split(".")) if node.module else ()
            if node.level:
                base = (*package[: len(package) + 1 - node.level], *module)
            elif module[0] == PACKAGE.name:
                base = module[1:]
            else:
                continue
            yield from ((*base, alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            for alias in node.names:
                path = alias.name.split(".")
                if path[0] == PACKAGE.name:
                    yield tuple(path[1:])


@pytest.mark.parametrize("folder", ORDER)
def test_folders_import_those_before_them(folder):
    files = sorted((PACKAGE / folder).rglob("*.py"))
    assert len(files) > 3
    later = {*ORDER[ORDER.index(folder) + 1 :]}
    found = {(str(f.relative_to(PACKAGE)), p[0]) for f in files for p in imported(f) if p}
    assert not {(file, name) for file, name in found if name in later}


def test_the_core_imports_no_extra():
    core = [file for file in sources() if file.relative_to(PACKAGE).parts[0] != "extras"]
    assert len(core) > 200
    assert not {str(file) for file in core for path in imported(file) if path[:1] == ("extras",)}


def sources():
    """Modules of the package; geometry is a link to a folder beside it."""
    return [*PACKAGE.rglob("*.py"), *(PACKAGE / "geometry").glob("*.py")]


def statements(tree, types):
    """Imports that run when a module is imported, and those for annotations if asked for."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        elif isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            yield from statements(node, types) if types else ()
        elif not isinstance(node, ast.FunctionDef):
            yield from statements(node, types)


def graph(types):
    """Module -> modules of the package that it imports; the package's own names load lazily."""
    paths = {file.relative_to(PACKAGE).with_suffix("").parts: file for file in sources()}
    modules = {path[:-1] if path[-1] == "__init__" else path: file for path, file in paths.items()}
    modules.pop(())
    out = {}
    for module, file in modules.items():
        tree = ast.Module([*statements(ast.parse(file.read_text()), types)], [])
        found = [p if p in modules else p[:-1] for p in imported(file, tree)]
        out[module] = {p for p in found if p in modules} - {module}
    return out


@pytest.mark.parametrize("types", [False, True])
def test_no_module_imports_itself_through_others(types):
    """Neither when it is imported nor, with the imports of its annotations, for a type checker."""
    left = graph(types)
    assert len(left) > 200 and sum(map(len, left.values())) > 700
    while ready := [module for module, needs in left.items() if not needs & {*left}]:
        for module in ready:
            del left[module]
    # What only leads to a circle is none of it.
    while ends := [m for m in left if not any(m in needs for needs in left.values())]:
        for module in ends:
            del left[module]
    assert not left


def test_no_two_classes_have_one_name():
    names = Counter(
        node.name
        for file in sources()
        for node in ast.parse(file.read_text()).body
        if isinstance(node, ast.ClassDef)
    )
    assert len(names) > 100 and max(names.values()) == 1, names.most_common(3)


@pytest.mark.parametrize("folder", list(BELOW))
def test_full_order_and_reduced_model_share_what_lies_below(folder):
    files = sorted((PACKAGE / "stability" / folder).glob("*.py"))
    assert len(files) > 5
    paths = [path for file in files for path in imported(file)]
    assert {p[1] for p in paths if p[0] == "stability"} <= BELOW[folder]


def test_one_module_connects_full_order_and_the_reduced_model():
    """The count of modes at full order is that of a reduced model."""
    two, both = {"full", "substructures"}, set()
    for file in (PACKAGE / "stability").glob("*.py"):
        if two <= {p[1] for p in imported(file) if p[0] == "stability"}:
            both.add(file.name)
    assert both == {"__init__.py", "reduced_count.py"}


@pytest.mark.parametrize(
    ("command", "left_out"),
    [
        (["--help"], ["mpi4py.MPI", "numpy", "dolfinx"]),
        (
            ["check", str(BLOCK)],
            ["brake_fenicsx.surface", "scipy.stats", "pandas", "matplotlib", "SALib"],
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

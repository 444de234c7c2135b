"""Sizes of the house, measured on its source: tests/gates.toml."""

import ast
import tokenize
import tomllib
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
GATES = tomllib.loads((ROOT / "tests" / "gates.toml").read_text())
NO_CODE = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENCODING, tokenize.ENDMARKER,
}  # fmt: skip
MECHANICS = ("macro", "stability", "surface", "micro", "meshing")
BRANCHES = (
    ast.If, ast.For, ast.While, ast.ExceptHandler, ast.IfExp, ast.BoolOp, ast.comprehension,
    ast.match_case,
)  # fmt: skip


@cache
def sources():
    """Modules of the package by dotted name; geometry is a link to a folder beside it."""
    files = [p for p in (ROOT / "brake_fenicsx").rglob("*.py") if "geometry" not in p.parts]
    files += (ROOT / "geometry").glob("*.py")
    names = {p: list(p.relative_to(ROOT).with_suffix("").parts) for p in files}
    for parts in names.values():
        if parts[0] == "geometry":
            parts.insert(0, "brake_fenicsx")
        if parts[-1] == "__init__":
            parts.pop()
    return {".".join(parts): p for p, parts in names.items()}


@cache
def tree(path):
    return ast.parse(path.read_text())


def lines(path):
    """Lines with code: without blank ones, comments and docstrings."""
    out, texts = set(), set()
    with path.open("rb") as file:
        for token in tokenize.tokenize(file.readline):
            if token.type not in NO_CODE:
                out |= {*range(token.start[0], token.end[0] + 1)}
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            texts |= {*range(node.lineno, node.end_lineno + 1)}
    return len(out - texts)


def imports(name, path):
    """Modules that a module imports anywhere."""
    for node in ast.walk(tree(path)):
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            yield from names_of(name, path, node)


def for_types(path):
    """Statements below ``if TYPE_CHECKING``."""
    for node in tree(path).body:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            yield from node.body


def circles(graph):
    """Groups of more than one module that reach each other."""

    @cache
    def reached(name):
        found, new = set(), {name}
        while new:
            new = {other for one in new for other in graph[one]} - found
            found |= new
        return found

    return {frozenset(o for o in reached(n) if n in reached(o)) for n in graph if n in reached(n)}


def graph(types):
    """Imports between modules at import; with those for types too."""
    out = {}
    for name, path in sources().items():
        if name == "brake_fenicsx":  # its names are loaded when they are asked for
            out[name] = set()
            continue
        skipped = {id(n) for n in for_types(path)}
        out[name] = set()
        package = {name} | ({name.rpartition(".")[0]} if path.name == "__init__.py" else set())
        for node in [*tree(path).body, *(for_types(path) if types else ())]:
            if isinstance(node, (ast.Import, ast.ImportFrom)) and (
                types or id(node) not in skipped
            ):
                out[name] |= {m for m in names_of(name, path, node) if m in sources()} - package
    return out


def names_of(name, path, node):
    """Modules that a statement imports."""
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    module = node.module.split(".") if node.module else []
    base = [*package[: len(package) + 1 - node.level], *module] if node.level else module
    wholes = [".".join([*base, alias.name]) for alias in node.names]
    return [whole if whole in sources() else ".".join(base) for whole in wholes]


def measured(gate):
    every = sources()
    core = {name: p for name, p in every.items() if ".extras" not in name}
    code = sum(lines(p) for p in every.values())
    nodes = [n for p in every.values() for n in ast.walk(tree(p))]
    match gate:
        case "circles":
            return len(circles(graph(types=False)))
        case "circles_outside_scene":
            found = circles(graph(types=True))
            return sum(not all(".scene" in name for name in circle) for circle in found)
        case "scene_in_mechanics":
            below = [
                (n, p)
                for n, p in every.items()
                if n.split(".")[1:2] and n.split(".")[1] in MECHANICS
            ]
            return sum(m.startswith("brake_fenicsx.scene") for n, p in below for m in imports(n, p))
        case "names_twice":
            names = Counter(p.stem for p in core.values() if p.stem != "__init__")
            return sum(n > 1 for n in names.values())
        case "code_lines":
            return code
        case "core_lines":
            return sum(lines(p) for p in core.values())
        case "test_lines":
            return sum(lines(p) for p in (ROOT / "tests").rglob("*.py"))
        case "modules":
            return len(every)
        case "import_share":
            those = [n for n in nodes if isinstance(n, (ast.Import, ast.ImportFrom))]
            return sum(n.end_lineno - n.lineno + 1 for n in those) / code
        case "fmt_skip":
            return sum(p.read_text().count("fmt: skip") for p in every.values())
        case "many_branches":
            functions = [n for n in nodes if isinstance(n, ast.FunctionDef)]
            return sum(sum(isinstance(x, BRANCHES) for x in ast.walk(f)) > 15 for f in functions)


@pytest.mark.parametrize("gate", GATES["met"])
def test_gates_that_are_met(gate):
    assert measured(gate) <= GATES["met"][gate]


@pytest.mark.parametrize("gate", GATES["open"])
def test_gates_that_are_open_are_above_their_limit(gate):
    """A gate that is reached moves to those that are met, and stays there."""
    assert measured(gate) > GATES["open"][gate]

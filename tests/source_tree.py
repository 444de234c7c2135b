"""Modules of the package as trees, and what they import."""

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = "brake_fenicsx"


@cache
def sources():
    """Modules of the package by dotted name; geometry is a link to a folder beside it."""
    files = [p for p in (ROOT / PACKAGE).rglob("*.py") if "geometry" not in p.parts]
    files += (ROOT / "geometry").glob("*.py")
    names = {p: list(p.relative_to(ROOT).with_suffix("").parts) for p in files}
    for parts in names.values():
        if parts[0] == "geometry":
            parts.insert(0, PACKAGE)
        if parts[-1] == "__init__":
            parts.pop()
    return {".".join(parts): p for p, parts in names.items()}


@cache
def tree(path):
    return ast.parse(path.read_text())


def imported(name, node):
    """Modules, and names of packages, that a statement of a module imports."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    package = name.split(".") if sources()[name].stem == "__init__" else name.split(".")[:-1]
    base = package[: len(package) + 1 - node.level] if node.level else []
    base = ".".join(base + (node.module.split(".") if node.module else []))
    wholes = [f"{base}.{alias.name}" for alias in node.names]
    return [whole if whole in sources() or base == PACKAGE else base for whole in wholes]


def imports(name):
    """What a module imports anywhere, of the package."""
    nodes = (
        n for n in ast.walk(tree(sources()[name])) if isinstance(n, ast.Import | ast.ImportFrom)
    )
    return [m for node in nodes for m in imported(name, node) if m.split(".")[0] == PACKAGE]


def at_import(body, types):
    """Statements that import when a module is; those below ``if TYPE_CHECKING`` if asked for."""
    for node in body:
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        elif isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            yield from at_import(node.body, types) if types else ()
        elif not isinstance(node, ast.FunctionDef):
            yield from at_import(ast.iter_child_nodes(node), types)


def circles(types):
    """Groups of modules that import each other; with the imports of annotations too."""
    graph = {}
    for name, path in sources().items():
        # The package's own names are loaded when they are asked for.
        nodes = at_import(tree(path).body if name != PACKAGE else (), types)
        above = {name} | ({name.rpartition(".")[0]} if path.stem == "__init__" else set())
        graph[name] = {m for n in nodes for m in imported(name, n) if m in sources()} - above

    @cache
    def reached(name):
        found, new = set(), {name}
        while new:
            new = {other for one in new for other in graph[one]} - found
            found |= new
        return found

    return {frozenset(o for o in reached(n) if n in reached(o)) for n in graph if n in reached(n)}

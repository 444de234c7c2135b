#!/usr/bin/env python3
"""Write docs/hard_cases.md, the list of all tests with pytest's marker "hard".

Run as: scripts/hard_cases.py [FILE]
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
OUT = ROOT / "docs" / "hard_cases.md"

HEAD = """\
# Hard cases

Written by `scripts/hard_cases.py` from the tests with pytest's marker `hard`; do not edit it here.

Each case either gives the correct result or stops with an error message of one line.
`python -m pytest -m hard` runs them all.
"""


def is_hard(node: ast.Module | ast.FunctionDef) -> bool:
    """Whether a module or a test carries the marker itself."""
    if isinstance(node, ast.FunctionDef):
        return any("mark.hard" in ast.unparse(mark) for mark in node.decorator_list)
    marks = (s for s in node.body if isinstance(s, ast.Assign) and "pytestmark" in ast.unparse(s))
    return any("mark.hard" in ast.unparse(mark) for mark in marks)


def cases(path: Path) -> Iterator[tuple[str, str]]:
    """Name and first docstring line of each hard test of a file.

    Raises:
        ValueError: a hard test without a docstring.
    """
    module = ast.parse(path.read_text(encoding="utf-8"))
    every = path.parent.name == "hard" or is_hard(module)
    for node in module.body:
        if not isinstance(node, ast.FunctionDef) or not node.name.startswith("test_"):
            continue
        if every or is_hard(node):
            if not (said := ast.get_docstring(node)):
                raise ValueError(f"{path}: {node.name}: say in a docstring what must hold")
            yield node.name, said.splitlines()[0]


def page() -> str:
    """The whole page: a table for each file that has hard tests."""
    parts = [HEAD]
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        if not (found := list(cases(path))):
            continue
        title = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or path.stem
        name = path.relative_to(ROOT).as_posix()
        rows = [f"| {_words(test)} | {said.replace('|', chr(92) + '|')} |" for test, said in found]
        head = f"## {title.splitlines()[0].rstrip('.')}\n\n`{name}`\n"
        parts.append("\n".join([head, "| case | what is tested |", "| --- | --- |", *rows, ""]))
    return "\n".join(parts)


def _words(test: str) -> str:
    return test.removeprefix("test_").replace("_", " ")


if __name__ == "__main__":
    from generated_page import write_page

    write_page(__doc__, OUT, page)

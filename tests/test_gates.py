"""Sizes of the house, measured on its source: tests/gates.toml."""

import ast
import sys
import tempfile
import tokenize
import tomllib
from collections import Counter
from functools import cache

from mpi4py import MPI

import pytest

from brake_fenicsx.pipeline import run
from brake_fenicsx.samples.sampling import SampleInput
from brake_fenicsx.samples.solve import reduced_modes
from brake_fenicsx.samples.study import Study
from brake_fenicsx.stability.substructures.sample_problem import SampleProblem
from source_tree import ROOT, circles, imports, sources, tree

GATES = tomllib.loads((ROOT / "tests" / "gates.toml").read_text())
BLOCK = ROOT / "scripts" / "scenes" / "block_on_plate.toml"
ROUGH = [
    "stages=['surface','equilibrium','stability','uncertainty']", "samples.n=2",
    "surface.statistics={ S_q = '3 um' }", "contact.block_plate.gap=hdf",
    "parts.block.size='14 mm'", "parts.plate.size='20 mm'", "stability.method=reduced",
]  # fmt: skip
NO_CODE = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENCODING, tokenize.ENDMARKER,
}  # fmt: skip
IMPORTS = (ast.Import, ast.ImportFrom)
MECHANICS = ("macro", "stability", "surface", "micro", "meshing")
BRANCHES = (
    ast.If, ast.For, ast.While, ast.ExceptHandler, ast.IfExp, ast.BoolOp, ast.comprehension,
    ast.match_case,
)  # fmt: skip


@cache
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


def nodes(*kinds):
    return (n for p in sources().values() for n in ast.walk(tree(p)) if isinstance(n, kinds))


def code(paths=None):
    return sum(map(lines, sources().values() if paths is None else paths))


def core():
    return [path for name, path in sources().items() if ".extras" not in name]


def scene_in_mechanics():
    below = [n for n in sources() if n.split(".")[1:2] and n.split(".")[1] in MECHANICS]
    return sum(m.startswith("brake_fenicsx.scene") for n in below for m in imports(n))


def names_twice():
    names = Counter(path.stem for path in core() if path.stem != "__init__")
    return sum(number > 1 for number in names.values())


def circles_outside_scene():
    return sum(not all(".scene" in n for n in circle) for circle in circles(types=True))


def branches(function):
    return sum(isinstance(node, BRANCHES) for node in ast.walk(function))


@cache
def handed():
    """Functions that get a sample or its reduced problem: on its way to modes, and in a task."""
    task, modes, work = set(), set(), Study.work
    active, samples = [task], (SampleInput, SampleProblem)

    def note(frame, event, _):
        code = frame.f_code
        if code is reduced_modes.__code__ and event == "return":
            active.pop()
        if event != "call" or "brake_fenicsx" not in code.co_filename:
            return
        if code is reduced_modes.__code__:
            active.append(modes)
        given = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        if any(isinstance(frame.f_locals.get(name), samples) for name in given):
            for functions in active:
                functions.add(code)

    def noted(*given):
        sys.setprofile(note)
        try:
            return work(*given)
        finally:
            sys.setprofile(None)

    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(Study, "work", noted)
        run(BLOCK, MPI.COMM_SELF, folder, ROUGH)
    return len(modes), len(task)


MEASURED = {
    "functions_to_modes": lambda: handed()[0],
    "functions_of_task": lambda: handed()[1],
    "circles": lambda: len(circles(types=False)),
    "circles_outside_scene": circles_outside_scene,
    "scene_in_mechanics": scene_in_mechanics,
    "names_twice": names_twice,
    "code_lines": code,
    "core_lines": lambda: code(core()),
    "test_lines": lambda: code((ROOT / "tests").rglob("*.py")),
    "modules": lambda: len(sources()),
    "import_share": lambda: sum(n.end_lineno - n.lineno + 1 for n in nodes(*IMPORTS)) / code(),
    "fmt_skip": lambda: sum(p.read_text().count("fmt: skip") for p in sources().values()),
    "many_branches": lambda: sum(branches(n) > 15 for n in nodes(ast.FunctionDef)),
}


@pytest.mark.parametrize("gate", GATES["met"])
def test_gates_that_are_met(gate):
    assert MEASURED[gate]() <= GATES["met"][gate]


@pytest.mark.parametrize("gate", GATES["open"])
def test_gates_that_are_open_are_above_their_limit(gate):
    """A gate that is reached moves to those that are met, and stays there."""
    assert MEASURED[gate]() > GATES["open"][gate]

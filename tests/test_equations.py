"""docs/theory.md says what each equation of the paper states and which function codes it."""

import ast
import re
from functools import cache

import pytest

from places import ROOT

THEORY = (ROOT / "docs" / "theory.md").read_text()
# What each equation states, read in the paper; the code says the same words beside its number.
TITLES = {
    1: "static balance of momentum",
    2: "small strain",
    3: "Hooke's law",
    4: "Hertz-Signorini-Moreau conditions",
    5: "weighted residual",
    6: "integration by parts",
    7: "split of the boundary term",
    8: "normal gap",
    9: "weak form",
    10: "penalty law",
    11: "balance of virtual work",
    12: "virtual work of contact",
    13: "virtual work of the solids",
    14: "contact potential with critical gaps",
    15: "a law of its own for each contact element",
    16: "distribution of the shifted gap",
    17: "bi-fractal spectrum",
}
DERIVATION = {1, 4, 5, 6, 7, 9}
ROWS = {
    int(number): (title, coded)
    for number, title, coded in re.findall(r"^\| \((\d+)\) \| (.+?) \| (.+?) \|", THEORY, re.M)
}


@cache
def tagged():
    """Docstrings that name an equation: "module.function" -> (number, first line)."""
    found = {}
    for path in sorted((ROOT / "brake_fenicsx").rglob("*.py")):
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for above, node in definitions(ast.parse(path.read_text())):
            first = (ast.get_docstring(node) or "").split("\n")[0]
            if number := re.search(r"Eq\. \((\d+)\)", first):
                found[f"{module}.{above}{node.name}"] = (int(number[1]), first)
    return found


def definitions(tree, above=""):
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield above, node
            if isinstance(node, ast.ClassDef):
                yield from definitions(node, f"{above}{node.name}.")


def test_the_table_gives_every_equation_its_title():
    assert {number: title for number, (title, _) in ROWS.items()} == TITLES


@pytest.mark.parametrize("number", TITLES)
def test_the_code_of_an_equation_says_its_title(number):
    """A number beside another statement, as eleven of seventeen once were."""
    coded = re.findall(r"`([\w.]+)`", ROWS[number][1])
    if number in DERIVATION:
        assert coded == []
        assert "derivation only" in ROWS[number][1]
        return
    places = tagged()
    assert coded == [name for name, (found, _) in places.items() if found == number]
    assert coded
    for name in coded:
        assert TITLES[number].lower() in places[name][1].lower()


def test_what_has_no_number_in_the_paper_has_none_here():
    """Friction, sliding direction, inertia and the complex modes."""
    numbered = {name.rpartition(".")[2] for name in tagged()}
    assert not numbered & {"friction_traction", "slip_frame", "mass_form", "complex_modes"}
    _, friction = (
        (ROOT / "brake_fenicsx/macro/contact_forces.py").read_text().split("\nclass Rotation")
    )
    assert "class SlidingFriction" in friction and "Eq. (" not in friction

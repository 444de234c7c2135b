"""Each equation of the source is coded in one place, and the README says where."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]


def _tags() -> dict[int, set[str]]:
    found: dict[int, set[str]] = {n: set() for n in range(1, 18)}
    for path in sorted((ROOT / "brake_fenicsx").rglob("*.py")):
        for line in re.findall(r'"""([^"\n]*Eq\. \(\d+\)\.)', path.read_text()):
            for number in re.findall(r"Eq\. \((\d+)\)", line):
                found[int(number)].add(str(path.relative_to(ROOT)))
    return found


def test_each_equation_is_tagged_in_exactly_one_module():
    assert {n: len(files) for n, files in _tags().items()} == dict.fromkeys(range(1, 18), 1)


def test_readme_table_agrees_with_the_tags():
    table = dict(
        (int(number), file)
        for number, file in re.findall(
            r"^\| \((\d+)\) \|.*\| `([\w/.]+)` \|", (ROOT / "README.md").read_text(), re.M
        )
    )
    assert table == {n: next(iter(files)) for n, files in _tags().items()}

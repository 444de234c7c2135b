"""What the README and the pages promise is so."""

import re
import runpy
import sys
import tomllib

import pytest

from brake_fenicsx.cli import main
from brake_fenicsx.commands import parser
from places import ROOT
from processes import script

README = (ROOT / "README.md").read_text()


def section(title, page=README):
    return page.split(f"\n## {title}\n")[1].split("\n## ")[0]


def code(kind):
    return re.findall(rf"^```{kind}\n(.*?)^```$", README, re.M | re.S)


def test_scene_of_the_readme_is_part_of_the_one_it_names():
    name = re.search(r"\]\((scripts/scenes/\w+\.toml)\)", README)[1]
    whole = tomllib.loads((ROOT / name).read_text())

    def within(part, above):
        if not isinstance(part, dict):
            return part == above
        return all(key in above and within(value, above[key]) for key, value in part.items())

    shown = tomllib.loads(code("toml")[0])
    assert len(shown) == 5
    assert within(shown, whole)


def test_figures_of_the_readme_are_those_of_the_measured_tables():
    measured = "".join(
        (ROOT / "docs" / name).read_text() for name in ("benchmarks.md", "contact.md", "laws.md")
    )
    rows = section("How good, how fast").split("| --- | --- | --- |\n")[1].split("\n\n")[0]
    figures = [
        number
        for row in rows.splitlines()
        for cell in row.strip("|").split("|")[1:]
        for number in re.findall(r"\d[\d.e-]*", cell)
    ]
    assert len(figures) >= 7
    for number in figures:
        assert re.search(rf"(?<![\d.]){re.escape(number)}(?![\d])", measured), number


def test_every_page_and_script_named_is_there():
    pages = [README, *(p.read_text() for p in (ROOT / "docs").glob("*.md"))]
    for page, folder in zip(pages, [ROOT, *[ROOT / "docs"] * (len(pages) - 1)], strict=True):
        for target in re.findall(r"\]\(([\w./]+)\)", page):
            assert (folder / target).exists(), target
        for name in re.findall(r"`(scripts/[\w./]+)", page):
            assert (ROOT / name.rstrip(".")).exists(), name


def test_page_of_the_command_line_is_what_its_script_writes():
    """Commands, options and exit states, from the help."""
    page = (ROOT / "docs" / "cli.md").read_text()
    assert page == script("cli_reference.py").page(), "run scripts/cli_reference.py"
    states = re.findall(r"^\| (\d+) \|", page, re.M)
    assert states == ["0", "1", "2", "130", "141", "143"]


def test_help_names_every_command_and_fits_a_terminal(capsys):
    for words in (["--help"], ["check", "--help"], ["run", "--help"], ["report", "--help"]):
        with pytest.raises(SystemExit) as stop:
            main(words)
        assert stop.value.code == 0
        text = capsys.readouterr().out
        assert max(map(len, text.splitlines())) <= 100
    top = parser().format_help()
    assert all(f"brake-fenicsx {name} " in top for name in ("check", "run", "report"))


def test_every_option_written_in_a_page_is_one_of_its_command():
    pages = [README, *(p.read_text() for p in (ROOT / "docs").glob("*.md"))]
    commands = parser()._subparsers._group_actions[0].choices
    seen = set()
    for page in pages:
        for name, words in re.findall(r"brake-fenicsx (check|run|report)\b([^#`|\n]*)", page):
            for option in re.findall(r"(?<=\s)--?[a-z]+(?:-[a-z]+)*", words.split(" -- ")[0]):
                assert option in commands[name]._option_string_actions, (name, option)
                seen.add(option)
    assert {"--set", "-o"} <= seen


@pytest.mark.parametrize("name", [
    "bench_limit_cycle", "cli_reference", "example_inputs", "hard_cases", "make_scan",
    "measured_solids", "mesh_picture", "scene_reference",
])  # fmt: skip
def test_help_of_a_script_that_takes_a_file_makes_none(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    with pytest.raises(SystemExit) as stop:
        runpy.run_path(str(ROOT / "scripts" / f"{name}.py"), run_name="__main__")
    assert stop.value.code == 0 and capsys.readouterr().out.startswith("usage:")
    assert not [*tmp_path.iterdir()]


def test_interruption_ends_with_130(monkeypatch, tmp_path, capsys):
    from brake_fenicsx import pipeline

    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(pipeline, "run", stop)
    assert main(["run", str(tmp_path / "any.toml")]) == 130
    assert "resumes" in capsys.readouterr().err

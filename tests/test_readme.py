"""What the README says of tests, files and exit states is so."""

import ast
import re
from pathlib import Path

import pytest

from brake_fenicsx.cli import EPILOG, main, parser

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


def section(title):
    return README.split(f"\n## {title}\n")[1].split("\n## ")[0]


def test_every_hard_case_of_the_table_is_a_test():
    files = [*(ROOT / "tests" / "hard").glob("*.py"), ROOT / "tests" / "report/test_hard_runs.py"]
    there = {
        node.name
        for file in files
        for node in ast.parse(file.read_text()).body
        if isinstance(node, ast.FunctionDef)
    }
    named = re.findall(r"`(test_\w+)`", section("Hard cases"))
    assert len(named) > 40
    assert set(named) <= there


def test_every_page_and_script_named_is_there():
    pages = [README, *(p.read_text() for p in (ROOT / "docs").glob("*.md"))]
    for page, folder in zip(pages, [ROOT, *[ROOT / "docs"] * (len(pages) - 1)], strict=True):
        for target in re.findall(r"\]\(([\w./]+)\)", page):
            assert (folder / target).exists(), target
        for name in re.findall(r"`(scripts/[\w./]+)", page):
            assert (ROOT / name.rstrip(".")).exists(), name


def test_exit_states_are_the_same_in_readme_and_help():
    table = README.split("| exit status | meaning |")[1].split("\n\n")[0]
    states = re.findall(r"^\| (\d+) \| (\w+)", table, re.M)
    assert [s for s, _ in states] == ["0", "1", "2", "130", "141", "143"]
    told = re.findall(r"^  (\d+) +(\w+)", EPILOG, re.M)
    assert [s for s, _ in told] == [s for s, _ in states]


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
            for option in re.findall(r"(?<=\s)--?[a-z]+", words.split(" -- ")[0]):
                assert option in commands[name]._option_string_actions, (name, option)
                seen.add(option)
    assert {"--set", "-o", "--from", "--cache"} <= seen


def test_interruption_ends_with_130(monkeypatch, tmp_path, capsys):
    from brake_fenicsx import pipeline

    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(pipeline, "run", stop)
    assert main(["run", str(tmp_path / "any.toml")]) == 130
    assert "goes on" in capsys.readouterr().err

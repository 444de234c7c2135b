#!/usr/bin/env python3
"""Write docs/cli.md, the commands and options of the command line, from their help.

Run as: scripts/cli_reference.py [FILE]
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

import brake_fenicsx
from brake_fenicsx.commands import parser

OUT = Path(__file__).parents[1] / "docs" / "cli.md"
HEAD = """\
# Command line

Written by `scripts/cli_reference.py` from the help of the commands; do not edit it here.
`brake-fenicsx COMMAND --help` prints the same. `mpirun -n 8 brake-fenicsx run SCENE.toml`, or
`scripts/launch 8 run SCENE.toml` from the checkout, runs a scene on eight processes; job scripts:
[on a cluster](tutorial_cluster.md). More on single commands: [init](meshes.md#a-first-scene),
[budget](budget.md), [countermeasures](countermeasures.md), [compare](sweeps.md#two-runs-compared),
[correlate and export](correlation.md), [identify](identify.md).
"""
OPTIONS = ["| option | meaning |", "| --- | --- |"]
STATES = ["## Exit status", "", "| exit status | meaning |", "| --- | --- |"]
EVERYWHERE = ("quiet", "verbose", "help")


def linked(text: str) -> str:
    """Text with pages as links and `|` as itself in a table."""
    return re.sub(r"docs/(\w+)\.md", r"[\1](\1.md)", text).replace("|", r"\|")


def options(command: argparse.ArgumentParser, everywhere: bool = False) -> list[str]:
    """Rows of the options of a command, of those that all have or of the others."""
    formatter = command._get_formatter()
    rows = []
    for action in command._get_optional_actions():
        if (action.dest in EVERYWHERE) == everywhere and action.dest != "help":
            words = formatter._format_action_invocation(action)
            rows.append(f"| `{words}` | {linked(formatter._expand_help(action))} |")
    return [*OPTIONS, *rows, ""] if rows else []


def described(command: argparse.ArgumentParser) -> list[str]:
    """Usage, purpose and options of a command."""
    names = " ".join(str(a.metavar or a.dest) for a in command._get_positional_actions())
    said = linked(command.description or "")
    lines = [f"## {command.prog.split()[-1]}", "", f"`{f'{command.prog} {names}'.strip()}`", ""]
    lines += [f"{said[0].upper()}{said[1:]}.", ""]
    return lines + ([linked(command.epilog), ""] if command.epilog else []) + options(command)


def page() -> str:
    """The whole page."""
    top = parser()
    (commands,) = (a for a in top._actions if isinstance(a, argparse._SubParsersAction))
    lines = [HEAD]
    for command in commands.choices.values():
        lines += described(command)
    lines += ["## Every command", "", *options(command, everywhere=True)]
    lines += ["Without a command:", "", *options(top)]
    states = brake_fenicsx.__doc__.split("exit status:\n")[1].split("\n\n")[0]
    rows = re.findall(r"^  (\d+) +(.*)$", states, re.M)
    return "\n".join([*lines, *STATES, *(f"| {n} | {linked(said)} |" for n, said in rows)]) + "\n"


if __name__ == "__main__":
    from generated_page import write_page

    write_page(__doc__, OUT, page)

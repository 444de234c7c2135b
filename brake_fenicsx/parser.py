"""The parser of the command line: commands of the program and of its extras, and their help."""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Sequence
from typing import Any, NoReturn

from brake_fenicsx.commands import COMMANDS, QUIET, VERBOSE
from brake_fenicsx.endings import MESH_FILES
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import absent, extras, load

DESCRIPTION = """\
Predicts which vibration modes of a disc brake will squeal, with what probability, and which inputs
cause it: from a measured scan of the pad surface to the complex modes of hundreds of random brakes.

Everything is written in one scene file: parts, materials, contact, loads, and the stages to run.
scripts/scenes/ holds examples; docs/scene.md lists every key, docs/cli.md every command;
docs/own_scan_own_mesh.md is a first study."""

EPILOG = """\
first steps:
  brake-fenicsx init brake.inp            writes brake.toml, a first scene of your own mesh file
  brake-fenicsx check brake.toml          sizes, memory and time of a run; refuses mistakes
  brake-fenicsx run brake.toml            results in ./brake-results; open its report.html
  brake-fenicsx run brake.toml            the same again: resumes an interrupted run
  brake-fenicsx prepare brake.toml        for a job array: then run --share 1/8, ... 8/8, run
  brake-fenicsx status brake-results      how far a run is, and who is at work
  brake-fenicsx report brake-results      regenerates figures and report, without computing
  brake-fenicsx countermeasures brake.toml    what would stop the squeal, if the scene names some
  brake-fenicsx export brake-results      mode shapes as a universal file, modes.unv
  brake-fenicsx correlate brake.toml disc.unv --part disc    modes of a part against its test
  brake-fenicsx identify brake.toml --part pad --peaks peaks.csv    constants from resonances
  brake-fenicsx schema > scene.json       keys of a scene, for editors (docs/scene.md)

variations:
  brake-fenicsx run brake.toml --set samples.n=20 -o trial
  brake-fenicsx run brake.toml --set contact.pad_disc.friction=0.4 -o other
  brake-fenicsx run brake.toml --from report
  mpirun -n 8 brake-fenicsx run brake.toml
      as root, as in a container, Open MPI asks for OMPI_ALLOW_RUN_AS_ROOT=1 and
      OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 in the environment
  eval "$(brake-fenicsx --completion bash)"    completes command lines in this shell
  brake-fenicsx run brake.toml -- -brake_compliance_mat_mumps_icntl_4 2

exit status:
  0    done
  1    a computation failed, or every sample; the error is named, finished samples are kept
  2    wrong input; one line names file, key, value and remedy, nothing was written
  130  interrupted (Ctrl-C); the same command resumes it (mpirun answers with its own status)
  141  the reader of the output closed it, as "| head" does
  143  ended by SIGTERM; the sample in progress was stored, the same command resumes the run

"brake-fenicsx COMMAND --help" lists the options of a command."""

# Where launchers leave the rank of a process.
RANKS = ("OMPI_COMM_WORLD_RANK", "PMI_RANK", "PMIX_RANK", "SLURM_PROCID")


class Parser(argparse.ArgumentParser):
    """Arguments whose mistakes are one line, as every other mistake is."""

    def error(self, message: str) -> NoReturn:
        """Refuse a command line; of a file without a command the command is named."""
        given = re.search(r"COMMAND: invalid choice: '([^']+)'", message)
        if given and (extra := absent(given[1])):
            raise SceneError(f"{given[1]}: {extra}")
        ending = os.path.splitext(given[1])[1].lower() if given else ""
        if given and ending in {*MESH_FILES, ".toml"}:
            command = "run" if ending == ".toml" else "init"
            message = f"{given[1]}: no command; write {self.prog} {command} {given[1]}"
        raise SceneError(f'{message}; "{self.prog} --help" lists what there is')

    def _print_message(self, message: str, file: Any = None) -> None:
        """Help is printed by the first process of mpirun or srun alone, before MPI starts."""
        if all(os.environ.get(name, "0") == "0" for name in RANKS):
            super()._print_message(message, file)


def parser() -> argparse.ArgumentParser:
    """Arguments of the command line; ``options.command`` is the command that was given."""
    top = Parser(
        prog="brake-fenicsx",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    top.add_argument("--version", action=_Version, help="versions of the program, DOLFINx, ...")
    top.add_argument("--completion", action=_Completion, choices=("bash", "zsh", "tcsh"),
                     help="print a shell-completion script")  # fmt: skip
    words = top.add_subparsers(dest="word", required=True, metavar="COMMAND")
    ours = [load(name) for extra in extras() for name in extra.commands]
    for command in (*COMMANDS, *ours):
        raw = argparse.RawDescriptionHelpFormatter
        kind = raw if command.epilog else argparse.HelpFormatter
        one = words.add_parser(
            command.run.__name__, help=command.text, description=command.text,
            epilog=command.epilog, formatter_class=kind,
        )  # fmt: skip
        one.set_defaults(command=command)
        for names, options in (*command.arguments, QUIET, VERBOSE):
            given = {key: value for key, value in options.items() if key != "complete"}
            added = one.add_argument(*names, **given)
            added.kind = options.get("complete", "")  # type: ignore[attr-defined]
    return top


class _Version(argparse.Action):
    """Versions of the program and of the solvers it would use."""

    def __init__(self, option_strings: Sequence[str], dest: str, help: str):
        super().__init__(option_strings, dest, nargs=0, help=help)

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        from brake_fenicsx.results.versions import solver_versions

        print("\n".join(f"{name} {number}" for name, number in solver_versions().items()))
        parser.exit()


class _Completion(argparse.Action):
    """Completion of a shell, made by shtab."""

    def __call__(self, parser: argparse.ArgumentParser, _: Any, shell: Any, *__: Any) -> NoReturn:
        try:
            import shtab
        except ImportError:
            raise SceneError("--completion needs shtab: pip install shtab") from None
        kinds = {"file": shtab.FILE, "folder": shtab.DIRECTORY}
        for command in parser._subparsers._group_actions[0].choices.values():  # type: ignore
            for action in command._actions:
                if kind := kinds.get(getattr(action, "kind", "")):
                    action.complete = kind
        print(shtab.complete(parser, shell))
        parser.exit()

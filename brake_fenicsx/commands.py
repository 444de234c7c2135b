"""Commands and options of the command line, and their help."""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Sequence
from typing import Any, NoReturn

from brake_fenicsx.endings import MESH_FILES
from brake_fenicsx.errors import SceneError

STAGES = ("surface", "micro", "equilibrium", "stability", "uncertainty", "report")

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

AFTER_CHECK = """\
Nothing is written. Memory and disc are estimates from the sizes of the scene; times are those of
its run in ./SCENE-results, scaled to the scene as it is now, or, without one, by a second of work
on this machine."""

AFTER_RUN = """\
The results folder holds report.html, figures/ (PNG, SVG), tables (modes.csv, samples.csv, ...),
fields/ for ParaView, summary.json (sizes, times, seeds, versions) and log.txt; docs/results.md
lists them all. A folder that holds results of another scene is refused, and so is a second run in a
folder where one is at work. Options after -- go to PETSc."""

AFTER_COUNTERMEASURES = """\
The results folder holds countermeasures.html and .csv, the run of the scene (before/), and one run
for each countermeasure that is enough (after-1/, ...), compared with it. The same command resumes
an interrupted search. docs/countermeasures.md says what is searched and how."""


# Where launchers leave the rank of a process.
RANKS = ("OMPI_COMM_WORLD_RANK", "PMI_RANK", "PMIX_RANK", "SLURM_PROCID")


class Parser(argparse.ArgumentParser):
    """Arguments whose mistakes are one line, as every other mistake is."""

    def error(self, message: str) -> NoReturn:
        """Refuse a command line; of a file without a command the command is named."""
        given = re.search(r"COMMAND: invalid choice: '([^']+)'", message)
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
    """Arguments of the command line."""
    top = Parser(
        prog="brake-fenicsx",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    top.add_argument("--version", action=_Version, help="versions of the program, DOLFINx, ...")
    top.add_argument("--completion", action=_Completion, choices=("bash", "zsh", "tcsh"),
                     help="print a shell-completion script")  # fmt: skip
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    raw = argparse.RawDescriptionHelpFormatter
    text = "read a scene; report what a run builds, and estimate its memory, disc and time"
    checks = commands.add_parser("check", help=text, description=text, epilog=AFTER_CHECK,
                                 formatter_class=raw)  # fmt: skip
    text = "run a scene, or resume its run"
    runs = commands.add_parser("run", help=text, description=text, epilog=AFTER_RUN,
                               formatter_class=raw)  # fmt: skip
    text = "compute the data shared by all samples, the first step of a job array (run --share)"
    prepares = commands.add_parser("prepare", help=text, description=text)
    text = "run a scene and its refinements: how much each changes the probability of squeal"
    budgets = commands.add_parser("budget", help=text, description=text)
    text = "find the smallest change of each of the scene's countermeasures that stops the squeal"
    remedies = commands.add_parser("countermeasures", help=text, description=text,
                                   epilog=AFTER_COUNTERMEASURES, formatter_class=raw)  # fmt: skip
    text = "compare the modes of a part of a scene with those of a modal test: frequencies and MAC"
    correlates = commands.add_parser("correlate", help=text, description=text)
    text = "identify the constants of a part's material from the frequencies of its resonances"
    identifies = commands.add_parser("identify", help=text, description=text)
    for command in (checks, prepares, runs, budgets, remedies, correlates, identifies):
        command.add_argument("scene", metavar="SCENE.toml", help="the scene file")
        command.add_argument("--set", action="append", default=[], metavar="KEY=VALUE",
                             help="replace a key of the scene (docs/scene.md), as often as"
                             " needed; the value is TOML, or a bare word")  # fmt: skip
    for command in (checks, runs):
        command.add_argument("--json", action="store_true",
                             help="print the outcome as JSON, for other programs")  # fmt: skip
    again = f"recompute this stage and all later ones: {', '.join(STAGES)}"
    runs.add_argument("--from", dest="from_stage", choices=STAGES, metavar="STAGE", help=again)
    runs.add_argument("--share", nargs="?", const="", metavar="I/N", help="compute the I-th of N"
                      " parts of the samples, in a folder that `prepare` made; without I that of"
                      " this task of a job array, without N too where the scheduler says"
                      " it")  # fmt: skip
    correlates.add_argument("test", metavar="TEST.unv", help="universal file: nodes and modes (55)")
    identifies.add_argument("--peaks", required=True, metavar="PEAKS.csv", help="table with the"
                            " column frequency_hz or frequency_khz, and q, specimen if there are"
                            " any; or a universal file of modes (55)")  # fmt: skip
    identifies.add_argument("--material", metavar="NAME", help="the material, if not the lining")
    for name, percent, text in (("prior", 30.0, "each constant around the scene's"),
                                ("error", 0.5, "a frequency, model and measurement")):  # fmt: skip
        identifies.add_argument(f"--{name}", type=float, default=percent, metavar="PERCENT",
                                help=f"standard deviation of {text}; %(default)s")  # fmt: skip
    for command in (correlates, identifies):
        command.add_argument("--part", metavar="NAME", help="the part, where the scene has several")
        command.add_argument("--supported", action="store_true", help="with the supports, springs"
                             " and masses of the part's faces; free if not given")  # fmt: skip
    folders = [(prepares, "results"), (runs, "results"), (budgets, "budget")]
    folders += [(remedies, "countermeasures"), (correlates, "correlation"),
                (identifies, "identified")]  # fmt: skip
    for command, name in folders:
        command.add_argument("-o", dest="directory", metavar="DIR",
                             help=f"results folder, ./SCENE-{name}")  # fmt: skip
    for command in (prepares, runs, budgets, remedies):
        command.add_argument("--cache", metavar="DIR", help="share laws and reduced models with"
                             " runs of scenes that differ in seed, samples, friction or"
                             " loads")  # fmt: skip
    budgets.add_argument("--minutes", type=float, metavar="T",
                         help="run only the refinements that fit in this time")  # fmt: skip
    text = "write a first scene of a mesh file: parts, faces, materials, contact, supports, loads"
    inits = commands.add_parser("init", help=text, description=text)
    inits.add_argument("deck", metavar="MESH", help="mesh file: .inp, .cdb, .bdf, .msh, ...")
    inits.add_argument("-o", dest="scene", metavar="SCENE.toml", help="the scene, ./MESH.toml")
    inits.add_argument("--units", nargs=3, metavar=("mm", "t", "s"), help="consistent units of"
                       " length, mass and time of the file; guessed if not given")  # fmt: skip
    inits.add_argument("--shells", choices=["solid"], help="make solids of the shells of a deck")
    text = "print the JSON Schema of a scene, by which editors complete and check its keys"
    commands.add_parser("schema", help=text, description=text)
    text = "regenerate the figures and the report of a results folder"
    reports = commands.add_parser("report", help=text, description=text)
    reports.add_argument("directory", metavar="DIR", help="results folder of a run")
    reports.add_argument("--csv", action="store_true",
                         help="write modes.csv too, where a run wrote modes.parquet")  # fmt: skip
    for command in (runs, reports):
        command.add_argument("--no-pictures", dest="pictures", action="store_false",
                             help="tables and page alone, without figures")  # fmt: skip
    text = "how far a run is: samples done, who is at work, time to go"
    states = commands.add_parser("status", help=text, description=text)
    states.add_argument("directory", metavar="DIR", help="results folder of a run")
    states.add_argument("--json", action="store_true", help="print it as JSON, for other programs")
    text = "write the stored mode shapes of a results folder as a universal file, modes.unv"
    exports = commands.add_parser("export", help=text, description=text)
    exports.add_argument("directory", metavar="DIR", help="results folder of a run")
    text = "compare two runs: families, change of probability; or two surfaces and their laws"
    compares = commands.add_parser("compare", help=text, description=text)
    compares.add_argument("first", metavar="A", help="results folder of a run")
    compares.add_argument("second", metavar="B", help="results folder of another run")
    compares.add_argument("-o", dest="directory", metavar="DIR", default=".",
                          help="folder of the comparison, . if not given")  # fmt: skip
    for command in commands.choices.values():
        command.add_argument("-q", dest="quiet", action="store_true",
                             help="show only warnings and errors")  # fmt: skip
        command.add_argument("-v", dest="verbose", action="store_true",
                             help="show more messages, and the traceback of an error")  # fmt: skip
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
        for command in parser._subparsers._group_actions[0].choices.values():  # type: ignore
            for action in command._actions:
                if action.dest in (
                    "scene",
                    "test",
                    "deck",
                    "directory",
                    "cache",
                    "first",
                    "second",
                ):
                    file = action.dest in ("scene", "test", "deck")
                    action.complete = shtab.FILE if file else shtab.DIRECTORY
        print(shtab.complete(parser, shell))
        parser.exit()

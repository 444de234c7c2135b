"""Commands of the command line, each a function with its arguments, and the parser of all.

A function gets the options and the processes, and returns what the first process prints. It imports
what it needs by itself: help comes before anything large is loaded.
"""

import argparse
import json
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NoReturn

from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import MESH_FILES, absent, extras, load

STAGES = ("surface", "micro", "equilibrium", "stability", "uncertainty", "report")

AFTER_CHECK = """\
Nothing is written. Memory and disc are estimates from the sizes of the scene, the time one by a
second of work on this machine; where ./SCENE-results holds a run, its time as measured stands
below."""

AFTER_RUN = """\
The results folder holds report.html, figures/ (PNG, SVG), tables (modes.csv, samples.csv, ...),
fields/ for ParaView, summary.json (sizes, times, seeds, versions) and log.txt; docs/results.md
lists them all. A folder that holds results of another scene is refused, and so is a second run in a
folder where one is at work. Options after -- go to PETSc."""


Argument = tuple[tuple[str, ...], dict[str, Any]]  # words, and options of ``argparse``
Function = Callable[[Any, Any], str | None]


@dataclass(frozen=True, slots=True)
class Command:
    """A command: a function, its arguments, and text below its help.

    Attributes:
        alone: whether the first process alone runs it.
    """

    run: Function
    arguments: tuple[Argument, ...]
    epilog: str | None = None
    alone: bool = False

    @property
    def text(self) -> str:
        """What it does: the docstring of the function."""
        said = (self.run.__doc__ or "").rstrip(".")
        return said[:1].lower() + said[1:]


def argument(*words: str, **options: Any) -> Argument:
    """An argument of a command, as ``argparse`` takes it."""
    return words, options


def command(
    *arguments: Argument, epilog: str | None = None, alone: bool = False
) -> Callable[[Function], Command]:
    """Make a command of the function below, by whose name it is called."""
    return lambda run: Command(run, arguments, epilog, alone)


def folder_of(name: str) -> Argument:
    """The argument -o, a folder named after the scene if not given."""
    text = f"results folder, ./SCENE-{name}"
    return argument("-o", dest="directory", metavar="DIR", help=text)


SCENE = argument("scene", metavar="SCENE.toml", help="the scene file")
SET = argument("--set", action="append", default=[], metavar="KEY=VALUE",
               help="replace a key of the scene (docs/scene.md), as often as needed; the value is"
               " TOML, or a bare word")  # fmt: skip
ALLOW = argument("--allow-extensions", dest="set", action="append_const",
                 const="extensions.allow=true",
                 help="run code beside the scene that it names in [extensions]")  # fmt: skip
JSON = argument("--json", action="store_true",
                help="print the outcome as JSON, for other programs")  # fmt: skip
CACHE = argument("--cache", metavar="DIR", help="share laws and reduced models with runs of scenes"
                 " that differ in seed, samples, friction or loads")  # fmt: skip
PICTURES = argument("--no-pictures", dest="pictures", action="store_false",
                    help="tables and page alone, without figures")  # fmt: skip
DIRECTORY = argument("directory", metavar="DIR", help="results folder of a run")
QUIET = argument("-q", dest="quiet", action="store_true", help="show only warnings and errors")
VERBOSE = argument("-v", dest="verbose", action="store_true",
                   help="show more messages, and the traceback of an error")  # fmt: skip


@command(SCENE, SET, ALLOW, JSON, epilog=AFTER_CHECK)
def check(options: Any, comm: Any) -> None:
    """Read a scene; report what a run builds, and estimate its memory, disc and time."""
    from brake_fenicsx.description import describe

    describe(options.scene, comm, options.set, options.json, options.quiet)


@command(
    SCENE, SET, ALLOW, JSON,
    argument("--from", dest="from_stage", choices=STAGES, metavar="STAGE",
             help=f"recompute this stage and all later ones: {', '.join(STAGES)}"),
    argument("--share", nargs="?", const="", metavar="I/N", help="compute the I-th of N parts of"
             " the samples, in a folder that `prepare` made; without I that of this task of a job"
             " array, without N too where the scheduler says it"),
    folder_of("results"), CACHE, PICTURES, epilog=AFTER_RUN,
)  # fmt: skip
def run(options: Any, comm: Any) -> str | None:
    """Run a scene, or resume its run."""
    from brake_fenicsx import pipeline
    from brake_fenicsx.folder.lock import read_share

    share = None if options.share is None else read_share(options.share)
    if share is not None and options.from_stage is not None:
        raise SceneError("--from: of no use with --share; prepare the folder with it")
    done = pipeline.run(
        options.scene, comm, options.directory, options.set, options.from_stage, options.cache,
        share, pictures=options.pictures,
    )  # fmt: skip
    return json.dumps(done.outcome(), indent=1) if options.json else None


@command(SCENE, SET, ALLOW, folder_of("results"), CACHE)
def prepare(options: Any, comm: Any) -> None:
    """Compute the data shared by all samples, the first step of a job array (run --share)."""
    from brake_fenicsx import pipeline

    scene, directory, changes = options.scene, options.directory, options.set
    pipeline.run(scene, comm, directory, changes, cache=options.cache, prepare=True)


@command(alone=True)
def schema(options: Any, comm: Any) -> str:
    """Print the JSON Schema of a scene, by which editors complete and check its keys."""
    from brake_fenicsx.scene import scene_type
    from brake_fenicsx.scene.keys import json_schema

    return json.dumps(json_schema(scene_type()), indent=1)


@command(
    DIRECTORY,
    argument("--csv", action="store_true",
             help="write modes.csv too, where a run wrote modes.parquet"),
    PICTURES, alone=True,
)  # fmt: skip
def report(options: Any, comm: Any) -> None:
    """Regenerate the figures and the report of a results folder."""
    from brake_fenicsx import pipeline

    pipeline.report(Path(options.directory), pictures=options.pictures)
    if options.csv:
        from brake_fenicsx.results.tables import write_csv

        write_csv(Path(options.directory, "modes.csv"))


@command(
    DIRECTORY,
    argument("--json", action="store_true", help="print it as JSON, for other programs"),
    alone=True,
)  # fmt: skip
def status(options: Any, comm: Any) -> str:
    """How far a run is: samples done, who is at work, time to go."""
    from brake_fenicsx.folder.status import read_status

    found = read_status(options.directory)
    return json.dumps(asdict(found), indent=1) if options.json else found.text()


COMMANDS = (check, run, prepare, schema, report, status)


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
            one.add_argument(*names, **options)
    return top


class _Version(argparse.Action):
    """Versions of the program and of the solvers it would use."""

    def __init__(self, option_strings: Sequence[str], dest: str, help: str):
        super().__init__(option_strings, dest, nargs=0, help=help)

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        from brake_fenicsx.results.versions import solver_versions

        print("\n".join(f"{name} {number}" for name, number in solver_versions().items()))
        parser.exit()

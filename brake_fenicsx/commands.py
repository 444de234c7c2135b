"""Commands of the command line, each a function with its arguments, and the parser of all.

A function gets the options and the processes, and returns what the first process prints. It imports
what it needs by itself: help comes before anything large is loaded.
"""

import argparse
import inspect
import json
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NoReturn

import brake_fenicsx
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import MESH_FILES, absent, extras, load

STAGES = ("surface", "micro", "equilibrium", "stability", "uncertainty", "report")

Argument = tuple[tuple[str, ...], dict[str, Any]]  # words, and options of ``argparse``
Function = Callable[[Any, Any], str | None]


@dataclass(frozen=True, slots=True)
class Command:
    """A command: a function, whose docstring is its help, and its arguments.

    Attributes:
        alone: whether the first process alone runs it.
    """

    run: Function
    arguments: tuple[Argument, ...]
    alone: bool = False


def argument(*words: str, **options: Any) -> Argument:
    """An argument of a command, as ``argparse`` takes it."""
    return words, options


def command(*arguments: Argument, alone: bool = False) -> Callable[[Function], Command]:
    """Make a command of the function below, by whose name it is called."""
    return lambda run: Command(run, arguments, alone)


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
JSON = argument("--json", action="store_true", help="print the outcome as JSON, for other programs")
CSV = argument(
    "--csv", action="store_true", help="write modes.csv too, where a run wrote modes.parquet"
)
CACHE = argument("--cache", metavar="DIR", help="share laws and reduced models with runs of scenes"
                 " that differ in seed, samples, friction or loads")  # fmt: skip
PICTURES = argument("--no-pictures", dest="pictures", action="store_false",
                    help="tables and page alone, without figures")  # fmt: skip
DIRECTORY = argument("directory", metavar="DIR", help="results folder of a run")
QUIET = argument("-q", dest="quiet", action="store_true", help="show only warnings and errors")
VERBOSE = argument("-v", dest="verbose", action="store_true",
                   help="show more messages, and the traceback of an error")  # fmt: skip


@command(SCENE, SET, ALLOW, JSON)
def check(options: Any, comm: Any) -> None:
    """Read a scene; report what a run builds, and estimate its memory, disc and time.

    Nothing is written. Memory and disc are estimates from the sizes of the scene, the time one by a
    second of work on this machine; where ./SCENE-results holds a run, its time as measured stands
    below.
    """
    from brake_fenicsx.description import describe

    describe(options.scene, comm, options.set, options.json, options.quiet)


@command(
    SCENE, SET, ALLOW, JSON,
    argument("--from", dest="from_stage", choices=STAGES, metavar="STAGE",
             help=f"recompute this stage and all later ones: {', '.join(STAGES)}"),
    argument("--share", nargs="?", const="", metavar="I/N", help="compute the I-th of N parts of"
             " the samples, in a folder that `prepare` made; without I that of this task of a job"
             " array, without N too where the scheduler says it"),
    folder_of("results"), CACHE, PICTURES,
)  # fmt: skip
def run(options: Any, comm: Any) -> str | None:
    """Run a scene, or resume its run.

    The results folder holds report.html, figures/ (PNG, SVG), tables (modes.csv, samples.csv, ...),
    fields/ for ParaView, summary.json (sizes, times, seeds, versions) and log.txt; docs/results.md
    lists them all. A folder that holds results of another scene is refused, and so is a second run
    in a folder where one is at work. Options after -- go to PETSc.
    """
    from brake_fenicsx import pipeline
    from brake_fenicsx.folder.lock import read_share

    share = None if options.share is None else read_share(options.share)
    if share is not None and options.from_stage is not None:
        raise SceneError("--from: of no use with --share; prepare the folder with it")
    given = options.scene, comm, options.directory, options.set, options.from_stage, options.cache
    done = pipeline.run(*given, share, pictures=options.pictures)
    return json.dumps(done.outcome(), indent=1) if options.json else None


@command(SCENE, SET, ALLOW, folder_of("results"), CACHE)
def prepare(options: Any, comm: Any) -> None:
    """Compute the data shared by all samples, the first step of a job array (run --share)."""
    from brake_fenicsx import pipeline

    given = options.scene, comm, options.directory, options.set
    pipeline.run(*given, cache=options.cache, prepare=True)


@command(alone=True)
def schema(options: Any, comm: Any) -> str:
    """Print the JSON Schema of a scene, by which editors complete and check its keys."""
    from brake_fenicsx.scene import scene_type
    from brake_fenicsx.scene.keys import json_schema

    return json.dumps(json_schema(scene_type()), indent=1)


@command(DIRECTORY, CSV, PICTURES, alone=True)
def report(options: Any, comm: Any) -> None:
    """Regenerate the figures and the report of a results folder."""
    from brake_fenicsx import pipeline

    pipeline.report(Path(options.directory), pictures=options.pictures)
    if options.csv:
        from brake_fenicsx.results.tables import write_csv

        write_csv(Path(options.directory, "modes.csv"))


@command(DIRECTORY, JSON, alone=True)
def status(options: Any, comm: Any) -> str:
    """How far a run is: samples done, who is at work, time to go."""
    from brake_fenicsx.folder.store import read_status

    found = read_status(options.directory)
    return json.dumps(asdict(found), indent=1) if options.json else found.text()


COMMANDS = (check, run, prepare, schema, report, status)

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
    form, said = argparse.RawDescriptionHelpFormatter, brake_fenicsx.__doc__ or ""
    first, steps, more = said.partition("first steps:")
    top = Parser("brake-fenicsx", None, first, steps + more, formatter_class=form)
    top.add_argument("--version", action=_Version, help="versions of the program, DOLFINx, ...")
    words = top.add_subparsers(dest="word", required=True, metavar="COMMAND")
    ours = [load(name) for extra in extras() for name in extra.commands]
    for command in (*COMMANDS, *ours):
        text, _, epilog = (inspect.getdoc(command.run) or "").partition("\n\n")
        text = text[:1].lower() + text[1:].rstrip(".")
        about: dict[str, Any] = {"help": text, "description": text}
        if epilog:
            about |= {"epilog": epilog, "formatter_class": form}
        one = words.add_parser(command.run.__name__, **about)
        one.set_defaults(command=command)
        for names, options in (*command.arguments, QUIET, VERBOSE):
            one.add_argument(*names, **options)
    return top


class _Version(argparse.Action):
    """Versions of the program and of the solvers it would use."""

    def __init__(self, option_strings: Sequence[str], dest: str, help: str):
        super().__init__(option_strings, dest, nargs=0, help=help)

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        from brake_fenicsx.libraries import solver_versions

        print("\n".join(f"{name} {number}" for name, number in solver_versions().items()))
        parser.exit()

"""Commands of the command line: each a function with its arguments; those of the core.

A function gets the options and the processes, and returns what the first process prints. It imports
what it needs by itself: help comes before anything large is loaded.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from brake_fenicsx.errors import SceneError

STAGES = ("surface", "micro", "equilibrium", "stability", "uncertainty", "report")

AFTER_CHECK = """\
Nothing is written. Memory and disc are estimates from the sizes of the scene; times are those of
its run in ./SCENE-results, scaled to the scene as it is now, or, without one, by a second of work
on this machine."""

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
    """An argument of a command; a shell completes it as ``complete`` says, "file" or "folder"."""
    return words, options


def command(
    *arguments: Argument, epilog: str | None = None, alone: bool = False
) -> Callable[[Function], Command]:
    """Make a command of the function below, by whose name it is called."""
    return lambda run: Command(run, arguments, epilog, alone)


def folder_of(name: str) -> Argument:
    """The argument -o, a folder named after the scene if not given."""
    text = f"results folder, ./SCENE-{name}"
    return argument("-o", dest="directory", metavar="DIR", complete="folder", help=text)


SCENE = argument("scene", metavar="SCENE.toml", complete="file", help="the scene file")
SET = argument("--set", action="append", default=[], metavar="KEY=VALUE",
               help="replace a key of the scene (docs/scene.md), as often as needed; the value is"
               " TOML, or a bare word")  # fmt: skip
ALLOW = argument("--allow-extensions", dest="set", action="append_const",
                 const="extensions.allow=true",
                 help="run code beside the scene that it names in [extensions]")  # fmt: skip
JSON = argument("--json", action="store_true",
                help="print the outcome as JSON, for other programs")  # fmt: skip
CACHE = argument("--cache", metavar="DIR", complete="folder",
                 help="share laws and reduced models with runs of scenes that differ in seed,"
                 " samples, friction or loads")  # fmt: skip
PICTURES = argument("--no-pictures", dest="pictures", action="store_false",
                    help="tables and page alone, without figures")  # fmt: skip
DIRECTORY = argument("directory", metavar="DIR", complete="folder", help="results folder of a run")
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
    return json.dumps(found.facts(), indent=1) if options.json else found.text()


COMMANDS = (check, run, prepare, schema, report, status)

"""Command line: check, run, report."""

from __future__ import annotations

import os

# One BLAS thread per process, before any library is loaded.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import argparse  # noqa: E402
import sys  # noqa: E402
from collections.abc import Sequence  # noqa: E402
from typing import NoReturn  # noqa: E402

from brake_fenicsx import __version__  # noqa: E402
from brake_fenicsx.errors import BrakeError, SceneError  # noqa: E402

STAGES = ("surface", "micro", "equilibrium", "stability", "uncertainty", "report")

DESCRIPTION = """\
Which vibration modes of a disc brake will squeal, how sure that is, and what drives them: from a
measured scan of the pad's surface to the complex modes of hundreds of random samples.

Everything is written in one scene file: parts, materials, contact, loads, and the stages to run.
scripts/scenes/ holds examples, docs/scene.md every key, docs/own_scan_own_mesh.md a first study."""

EPILOG = """\
first steps:
  brake-fenicsx check brake.toml          what it builds: dofs, laws, samples; memory, time
  brake-fenicsx run brake.toml            results in ./brake-results; open its report.html
  brake-fenicsx run brake.toml            once more: goes on where it was interrupted
  brake-fenicsx report brake-results      figures and page again, without computing

variations:
  brake-fenicsx run brake.toml --set samples.n=20 -o trial
  brake-fenicsx run brake.toml --set contact.pad_disc.friction=0.4 -o other
  brake-fenicsx run brake.toml --from report
  mpirun -n 8 brake-fenicsx run brake.toml
  brake-fenicsx run brake.toml -- -brake_compliance_mat_mumps_icntl_4 2

exit status:
  0    done
  1    a computation or every sample failed; a named error is printed, finished samples are kept
  2    wrong input; one line names file, key, value and remedy, nothing was written
  130  interrupted; started again it goes on (mpirun answers with a status of its own)

"brake-fenicsx COMMAND --help" lists the options of a command."""

AFTER_CHECK = """\
Nothing is written. Memory and time are estimates from measured runs, for one core."""

AFTER_RUN = """\
The results folder holds report.html, figures/ (PNG, SVG), tables (modes.csv, samples.csv, ...),
fields/ for ParaView, summary.json (sizes, times, seeds, versions) and log.txt; docs/results.md
lists them all. A folder that holds results of another scene is refused."""


class Parser(argparse.ArgumentParser):
    """Arguments whose mistakes are one line, as every other mistake is."""

    def error(self, message: str) -> NoReturn:
        """Refuse a command line."""
        raise SceneError(f'{message}; "{self.prog} --help" lists what there is')


def parser() -> argparse.ArgumentParser:
    """Arguments of the command line."""
    top = Parser(
        prog="brake-fenicsx",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    top.add_argument("--version", action="version", version=__version__)
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    raw = argparse.RawDescriptionHelpFormatter
    text = "read a scene; say what it will build and about how long it will take"
    checks = commands.add_parser("check", help=text, description=text, epilog=AFTER_CHECK,
                                 formatter_class=raw)  # fmt: skip
    text = "run a scene, or go on with it"
    runs = commands.add_parser("run", help=text, description=text, epilog=AFTER_RUN,
                               formatter_class=raw)  # fmt: skip
    for command in (checks, runs):
        command.add_argument("scene", metavar="SCENE.toml", help="the scene file")
        command.add_argument("--set", action="append", default=[], metavar="KEY=VALUE",
                             help="replace a key of the scene: any of docs/scene.md, as often as"
                             " wanted; the value is TOML, or a bare word")  # fmt: skip
    afresh = f"compute it and all later stages afresh: {', '.join(STAGES)}"
    runs.add_argument("--from", dest="from_stage", choices=STAGES, metavar="STAGE", help=afresh)
    runs.add_argument("-o", dest="directory", metavar="DIR", help="results folder, ./SCENE-results")
    runs.add_argument("--cache", metavar="DIR", help="share laws and reduced models with runs of"
                      " scenes that differ in seed, samples, friction or loads")  # fmt: skip
    runs.add_argument("petsc", nargs="*", metavar="-- PETSC_OPTIONS", help="go to PETSc")
    text = "draw the figures of a results folder and write its page again"
    reports = commands.add_parser("report", help=text, description=text)
    reports.add_argument("directory", metavar="DIR", help="results folder of a run")
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Returns:
        Exit status: 0 done, 1 a computation failed, 2 wrong input, 130 interrupted.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    given = words[words.index("--") + 1 :] if "--" in words else []
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    try:
        options = parser().parse_args(words[: words.index("--")] if "--" in words else words)
        _run(options, given, comm)
    except BrakeError as error:
        if comm.rank == 0:
            print(f"brake-fenicsx: {' '.join(str(error).split())}", file=sys.stderr)
        return 2 if isinstance(error, SceneError) else 1
    except KeyboardInterrupt:
        if comm.rank == 0:
            print("brake-fenicsx: interrupted; the same command goes on from here", file=sys.stderr)
        return 130
    except BaseException:
        # One process that dies alone would leave the others waiting for ever.
        if comm.size > 1:
            import traceback

            traceback.print_exc()
            comm.Abort(1)
        raise
    return 0


def _run(options: argparse.Namespace, petsc: Sequence[str], comm: object) -> None:
    """Do what was asked."""
    from brake_fenicsx.log import start_log

    start_log(getattr(comm, "rank", 0))
    if petsc:
        import petsc4py

        petsc4py.init(["brake-fenicsx", *petsc])
    from brake_fenicsx import pipeline

    if options.command == "run":
        pipeline.run(
            options.scene, comm, options.directory, options.set, options.from_stage, options.cache,  # type: ignore[arg-type]
        )  # fmt: skip
    elif options.command == "check":
        from brake_fenicsx.description import describe

        describe(options.scene, comm, options.set)  # type: ignore[arg-type]
    elif getattr(comm, "rank", 0) == 0:
        from pathlib import Path

        pipeline.report(Path(options.directory))


if __name__ == "__main__":
    raise SystemExit(main())

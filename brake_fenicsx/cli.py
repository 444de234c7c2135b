"""Command line: check, run, report."""

from __future__ import annotations

import os

# One BLAS thread per process, before any library is loaded.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import argparse  # noqa: E402
import sys  # noqa: E402
from collections.abc import Sequence  # noqa: E402

from brake_fenicsx import __version__  # noqa: E402
from brake_fenicsx.errors import BrakeError, SceneError  # noqa: E402

STAGES = ("surface", "micro", "equilibrium", "stability", "uncertainty", "report")

EPILOG = """\
A run writes modes.csv, samples.csv, contact.csv, laws.npz, summary.json, figures, fields and
report.html into its folder. Started again after an interruption it goes on where it stopped.

  brake-fenicsx run brake.toml
  brake-fenicsx run brake.toml --set samples.n=20 --set contact.pad_disc.friction=0.4 -o trial
  mpirun -n 8 brake-fenicsx run brake.toml
  brake-fenicsx run brake.toml -- -brake_eigen_eps_monitor

Exit status: 0 done; 1 a computation failed (its named error is printed); 2 wrong input, nothing
was written."""


def parser() -> argparse.ArgumentParser:
    """Arguments of the command line."""
    top = argparse.ArgumentParser(
        prog="brake-fenicsx",
        description="Disc-brake squeal from a scan of the pad surface.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    top.add_argument("--version", action="version", version=__version__)
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    checks = commands.add_parser("check", help="read a scene and say what it will build")
    runs = commands.add_parser("run", help="run a scene, or go on with it")
    for command in (checks, runs):
        command.add_argument("scene", metavar="SCENE.toml")
        command.add_argument("--set", action="append", default=[], metavar="KEY=VALUE",
                             help="replace a key of the scene")  # fmt: skip
    afresh = f"compute it and all later stages afresh: {', '.join(STAGES)}"
    runs.add_argument("--from", dest="from_stage", choices=STAGES, metavar="STAGE", help=afresh)
    runs.add_argument("-o", dest="directory", metavar="DIR", help="results folder, ./SCENE-results")
    runs.add_argument("petsc", nargs="*", metavar="-- PETSC_OPTIONS", help="go to PETSc")
    reports = commands.add_parser("report", help="figures and HTML page of a results folder")
    reports.add_argument("directory", metavar="DIR")
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Returns:
        Exit status: 0 done, 1 a computation failed, 2 wrong input.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    given = words[words.index("--") + 1 :] if "--" in words else []
    options = parser().parse_args(words[: words.index("--")] if "--" in words else words)
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    try:
        _run(options, given, comm)
    except BrakeError as error:
        if comm.rank == 0:
            print(f"brake-fenicsx: {' '.join(str(error).split())}", file=sys.stderr)
        return 2 if isinstance(error, SceneError) else 1
    except KeyboardInterrupt:
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
        pipeline.run(options.scene, comm, options.directory, options.set, options.from_stage)  # type: ignore[arg-type]
    elif options.command == "check":
        pipeline.describe(options.scene, comm, options.set)  # type: ignore[arg-type]
    elif getattr(comm, "rank", 0) == 0:
        from pathlib import Path

        pipeline.report(Path(options.directory))


if __name__ == "__main__":
    raise SystemExit(main())

"""Command line: init, check, prepare, run, countermeasures, report, export, correlate, identify."""

from __future__ import annotations

import os
import sys

from brake_fenicsx.folder.kernels import best_kernels

# One BLAS thread per process, and kernels for the processor, before any library is loaded.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
# Where NumPy is loaded already, child processes shall take the same kernels as this one.
if "numpy" not in sys.modules and (_kernels := best_kernels()) is not None:
    os.environ.setdefault("OPENBLAS_CORETYPE", _kernels)

INTERRUPTED = "brake-fenicsx: interrupted; the same command resumes the run"
try:
    import traceback
    from collections.abc import Sequence
    from pathlib import Path
    from typing import TYPE_CHECKING, Any

    from brake_fenicsx.commands import parser
    from brake_fenicsx.errors import BrakeError, SceneError, StorageError
    from brake_fenicsx.folder.termination import STATUS, Terminated, watching
except KeyboardInterrupt:
    # Ctrl-C in the first moments; no other module is sure to be there.
    os.write(2, f"{INTERRUPTED}\n".encode())
    raise SystemExit(130) from None

if TYPE_CHECKING:
    import argparse


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Returns:
        Exit status: 0 done, 1 a computation failed, 2 wrong input, 130 interrupted, 141 the output
        is read no more, 143 ended by SIGTERM.
    """
    with watching():
        return _main(list(sys.argv[1:] if arguments is None else arguments))


def _main(words: list[str]) -> int:
    """Run the command line; what went wrong is one line and a status."""
    given = words[words.index("--") + 1 :] if "--" in words else []
    comm: Any = None
    verbose = False
    try:
        options, mistake = None, None
        try:
            # Before MPI starts, which takes longer.
            options = parser().parse_args(words[: words.index("--")] if "--" in words else words)
        except SceneError as error:
            mistake = error
        from mpi4py import MPI

        comm = MPI.COMM_WORLD
        if options is None:
            raise mistake or SceneError("no command")
        verbose = options.verbose
        _run(options, given, comm)
        sys.stdout.flush()
    except BrakeError as error:
        status = _end(comm, verbose, str(error), 2 if isinstance(error, SceneError) else 1)
        if isinstance(error, StorageError) and comm.size > 1 and comm.rank == 0:
            comm.Abort(status)  # it may be the only one that writes, and the others wait
        return status
    except KeyboardInterrupt:
        return _end(comm, verbose, INTERRUPTED, 130)
    except Terminated as error:
        message = (
            "terminated; finished laws and samples are stored, the same command resumes the run"
        )
        status = _end(comm, verbose, message, STATUS)
        if comm is not None and comm.size > 1 and not error.together:
            comm.Abort(status)
        return status
    except BrokenPipeError:
        _discard_output()
        return 141
    except BaseException as error:
        # One process that dies alone would leave the others waiting for ever.
        alone = comm is None or comm.size == 1
        if isinstance(error, OSError) and error.strerror:
            message = f"{error.filename or 'the output'}: {error.strerror}"
            if not error.filename:
                _discard_output()
            status = _end(comm if alone else None, verbose, message, 1)
            return status if alone else comm.Abort(status)
        if not alone and not isinstance(error, SystemExit):
            traceback.print_exc()
            comm.Abort(1)
        raise
    return 0


def _discard_output() -> None:
    """Python would write what is left of the output once more at its end, and fail again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _end(comm: Any, verbose: bool, message: str, status: int) -> int:
    """Say on the first process how it ended."""
    if comm is None or comm.rank == 0:
        if verbose:
            traceback.print_exc()
        message = f"brake-fenicsx: {message.removeprefix('brake-fenicsx: ')}"
        print(" ".join(message.split()), file=sys.stderr)
    return status


def _run(options: argparse.Namespace, petsc: Sequence[str], comm: Any) -> None:
    """Do what was asked."""
    from brake_fenicsx.folder.log import start_log

    level = "WARNING" if options.quiet else "DEBUG" if options.verbose else "INFO"
    start_log(comm.rank, level=level)
    if petsc:
        from brake_fenicsx.petsc import start_petsc

        start_petsc(petsc)
    from brake_fenicsx import pipeline
    from brake_fenicsx.folder.lock import read_share

    if options.command == "prepare":
        pipeline.run(
            options.scene, comm, options.directory, options.set, cache=options.cache, prepare=True
        )
    elif options.command == "run":
        share = None if options.share is None else read_share(options.share)
        if share is not None and options.from_stage is not None:
            raise SceneError("--from: of no use with --share; prepare the folder with it")
        done = pipeline.run(
            options.scene, comm, options.directory, options.set, options.from_stage, options.cache,
            share, pictures=options.pictures,
        )  # fmt: skip
        if options.json and comm.rank == 0:
            _print_json(done.outcome())
    elif options.command == "budget":
        from brake_fenicsx.extras.variants.budget import run_budget

        page = run_budget(
            options.scene, comm, options.directory, options.set, options.cache, options.minutes
        )
        if comm.rank == 0:
            print(f"open {page}")
    elif options.command == "check":
        from brake_fenicsx.description import describe

        describe(options.scene, comm, options.set, options.json, options.quiet)
    elif options.command == "countermeasures":
        from brake_fenicsx.extras.variants.countermeasures import find_countermeasures
        from brake_fenicsx.extras.variants.countermeasures_page import countermeasures_text
        from brake_fenicsx.results.tables import read_rows

        found = find_countermeasures(
            options.scene, comm, options.directory, options.set, options.cache
        )
        if comm.rank == 0 and found is not None:
            print(countermeasures_text(read_rows(found.with_suffix(".csv"))))
            print(f"open {found}")
    elif comm.rank == 0 and options.command == "schema":
        from brake_fenicsx.scene import Scene
        from brake_fenicsx.scene.tables import json_schema

        _print_json(json_schema(Scene))
    elif comm.rank == 0 and options.command == "compare":
        from brake_fenicsx.extras.variants.comparison import comparison_text, write_comparison

        page = write_comparison(options.first, options.second, options.directory)
        print(comparison_text(options.first, options.second))
        print(f"open {page}")
    elif options.command == "correlate":
        from brake_fenicsx.extras.measured.study import correlate

        given = options.scene, options.test, options.part, options.supported
        text = correlate(*given, options.directory, options.set, write=comm.rank == 0)
        if comm.rank == 0:
            print(text)
    elif options.command == "identify":
        from brake_fenicsx.extras.measured.identify import identify

        text = identify(
            options.scene, options.peaks, options.part, options.material, options.supported,
            0.01 * options.prior, 0.01 * options.error, options.directory, options.set,
            comm.rank == 0,
        )  # fmt: skip
        if comm.rank == 0:
            print(text)
    elif options.command == "init":
        from brake_fenicsx.extras.decks.draft.text import (
            write_scene,  # starts PETSc on all processes
        )

        scene = Path(options.scene or f"{Path(options.deck).stem}.toml")
        if comm.rank == 0:
            print(write_scene(Path(options.deck), scene, options.units, bool(options.shells)))
            print(f"next: brake-fenicsx check {scene}")
    elif comm.rank == 0 and options.command == "status":
        from brake_fenicsx.folder.status import read_status

        status = read_status(options.directory)
        print(status.text()) if not options.json else _print_json(status.facts())
    elif comm.rank == 0 and options.command == "export":
        from brake_fenicsx.extras.measured.universal import export_modes

        print(f"wrote {export_modes(options.directory)}")
    elif comm.rank == 0:
        pipeline.report(Path(options.directory), pictures=options.pictures)
        if options.csv:
            from brake_fenicsx.results.columns import write_csv

            write_csv(Path(options.directory, "modes.csv"))


def _print_json(content: Any) -> None:
    import json

    print(json.dumps(content, indent=1))


if __name__ == "__main__":
    raise SystemExit(main())

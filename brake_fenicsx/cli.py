"""The command line: a command, how it ended, and the status that says so."""

import os
import sys

YOUNG = 10_000  # new objects between two searches of the garbage collector
INTERRUPTED = "brake-fenicsx: interrupted; the same command resumes the run"
try:
    from brake_fenicsx.libraries import best_kernels

    # One BLAS thread per process, and kernels for the processor, before any library is loaded.
    for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(_name, "1")
    # Where NumPy is loaded already, child processes shall take the same kernels as this one.
    if "numpy" not in sys.modules and (_kernels := best_kernels()) is not None:
        os.environ.setdefault("OPENBLAS_CORETYPE", _kernels)

    import argparse
    import gc
    import traceback
    from collections.abc import Sequence
    from typing import Any

    from brake_fenicsx.commands import parser
    from brake_fenicsx.errors import BrakeError, SceneError, StorageError
    from brake_fenicsx.folder.processes import STATUS, Terminated, watching
except KeyboardInterrupt:
    # Ctrl-C in the first moments; no other module is sure to be there.
    os.write(2, f"{INTERRUPTED}\n".encode())
    raise SystemExit(130) from None


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Returns:
        Exit status: 0 done, 1 a computation failed, 2 wrong input, 130 interrupted, 141 the output
        is read no more, 143 ended by SIGTERM.
    """
    # Python searches all young objects for cycles at every 700th new one: a percent of a run.
    gc.set_threshold(YOUNG)
    with watching():
        return _main(list(sys.argv[1:] if arguments is None else arguments))


def _main(words: list[str]) -> int:
    """Run the command line; what went wrong is one line and a status."""
    end = words.index("--") if "--" in words else len(words)
    comm: Any = None
    verbose = False
    try:
        options, mistake = None, None
        try:
            # Before MPI starts, which takes longer.
            options = parser().parse_args(words[:end])
        except SceneError as error:
            mistake = error
        from mpi4py import MPI

        comm = MPI.COMM_WORLD
        if options is None:
            raise mistake or SceneError("no command")
        verbose = options.verbose
        _run(options, words[end + 1 :], comm)
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
        if said := _of_the_system(error):
            status = _end(comm if alone else None, verbose, said, 1)
            return status if alone else comm.Abort(status)
        if not alone and not isinstance(error, SystemExit):
            traceback.print_exc()
            comm.Abort(1)
        raise
    return 0


def _of_the_system(error: BaseException) -> str | None:
    """What the system refuses, and of which file; or which compiled module a full disc cut off."""
    if isinstance(error, OSError) and error.strerror:
        if not error.filename:
            _discard_output()
        return f"{error.filename or 'the output'}: {error.strerror}"
    # Python up to 3.13 writes compiled modules without looking at how much was written.
    innermost = [frame for frame, _ in traceback.walk_tb(error.__traceback__)][-1]
    if not isinstance(error, EOFError) or "bytecode_path" not in innermost.f_locals:
        return None
    places = " and ".join(dict.fromkeys([sys.prefix, os.path.dirname(__file__)]))
    return (
        f"{innermost.f_locals['bytecode_path']}: cut off, as a full disc leaves compiled modules; "
        f"delete every folder __pycache__ below {places}"
    )


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
    command = options.command
    if command.alone and comm.rank:
        return
    # A process that works alone would wait for the others, which do not start it.
    own = command.alone and comm.size > 1
    if petsc or own:
        from mpi4py import MPI

        from brake_fenicsx.libraries import start_petsc

        start_petsc(petsc, MPI.COMM_SELF if own else None)
    said = command.run(options, comm)
    if comm.rank == 0 and said is not None:
        print(said)


if __name__ == "__main__":
    raise SystemExit(main())

"""PETSc, started without the option files and variables of an account.

PETSc would read ~/.petscrc, .petscrc and petscrc in the working directory and PETSC_OPTIONS, and
solve with the tolerances and orderings that stand there. Options of a run are those after "--" on
its command line.
"""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from brake_fenicsx.errors import BrakeError
from brake_fenicsx.folder.log import logger

# It would answer a closed pipe and SIGTERM with its own banner and MPI_Abort.
OPTIONS = ("brake-fenicsx", "-skip_petscrc", "-no_signal_handler")


def start_petsc(options: Sequence[str] = (), comm: Any = None) -> None:
    """Start PETSc; of no effect where it was started before.

    Args:
        options: words of a command line for it.
        comm: its processes; all if not given.
    """
    if "petsc4py.PETSc" in sys.modules:
        return
    if given := os.environ.pop("PETSC_OPTIONS", "").strip():
        logger.warning("PETSC_OPTIONS = %r: not read; write options after -- of the command", given)
    with beside_dolfinx("petsc4py"):
        import petsc4py

        petsc4py.init([*OPTIONS, *options], comm=comm)
    origins = [getattr(find_spec(name), "origin", None) or "" for name in ("h5py", "mpi4py")]
    if len({Path(origin).parents[1] for origin in origins if origin}) == 2:
        # Not the distribution's, as mpi4py is: a wheel has an HDF5 of its own, and the two bear one
        # another if it is loaded first.
        with beside_dolfinx("h5py"):
            import_module("h5py")


@contextmanager
def beside_dolfinx(name: str) -> Iterator[None]:
    """Name what pip installed beside the DOLFINx of a distribution, where a library cannot load.

    Args:
        name: of the library.

    Raises:
        BrakeError: why, and the remedy.
    """
    try:
        yield
    except (ImportError, ValueError) as error:
        numpy = find_spec("numpy")
        raise BrakeError(f"""{name} does not load with {numpy.origin if numpy else "no numpy"}
            ({error}): NumPy, SciPy and h5py must be those that DOLFINx is installed with, see
            docs/installation.md, "Wheel" """) from error

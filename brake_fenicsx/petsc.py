"""PETSc, started without the option files and variables of an account.

PETSc would read ~/.petscrc, .petscrc and petscrc in the working directory and PETSC_OPTIONS, and
solve with the tolerances and orderings that stand there. Options of a run are those after "--" on
its command line.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Any

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
    import petsc4py

    petsc4py.init([*OPTIONS, *options], comm=comm)

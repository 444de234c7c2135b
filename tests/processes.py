"""Programs that tests start: their environment says nothing of the tests' own MPI."""

import os
import subprocess
import sys


def parallel():
    """Keyword arguments of ``subprocess`` under which mpirun starts, also as root.

    What the test process inherited of another mpirun, and the pipe that a worker of the tests has
    for its standard input, would end it without a word.
    """
    own = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_", "PMIX_", "ORTE_"))}
    own |= {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    own |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    return {"env": own, "stdin": subprocess.DEVNULL}


def command(scene, out, changes):
    """Words that run a scene into a folder, in a process of its own."""
    code = "import sys; from brake_fenicsx.cli import main; sys.exit(main(sys.argv[1:]))"
    sets = [word for change in changes for word in ("--set", change)]
    return [sys.executable, "-c", code, "run", str(scene), "-o", str(out), *sets]

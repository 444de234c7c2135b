"""Programs that tests start, and scripts that they import."""

import os
import subprocess
import sys
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path


def script(name):
    """A script of the project as a module."""
    loader = SourceFileLoader(name, str(Path(__file__).parents[1] / "scripts" / name))
    module = module_from_spec(spec_from_loader(name, loader))
    loader.exec_module(module)
    return module


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

"""From a scan of the pad surface to the squealing modes of a disc brake.

Predicts which vibration modes will squeal, with what probability, and which inputs cause it, from
the complex modes of hundreds of random brakes.

Everything is written in one scene file: parts, materials, contact, loads, and the stages to run.
scripts/scenes/ holds examples; docs/scene.md lists every key, docs/cli.md every command;
docs/own_scan_own_mesh.md is a first study.

first steps:
  brake-fenicsx init brake.inp            writes brake.toml, a first scene of your own mesh file
  brake-fenicsx check brake.toml          sizes, memory and time of a run; refuses mistakes
  brake-fenicsx run brake.toml            results in ./brake-results; open its report.html
  brake-fenicsx run brake.toml            the same again: resumes an interrupted run
  brake-fenicsx prepare brake.toml        for a job array: then run --share 1/8, ... 8/8, run
  brake-fenicsx status brake-results      how far a run is, and who is at work
  brake-fenicsx report brake-results      regenerates figures and report, without computing
  brake-fenicsx countermeasures brake.toml    what would stop the squeal, if the scene names some
  brake-fenicsx export brake-results      mode shapes as a universal file, modes.unv
  brake-fenicsx correlate brake.toml disc.unv --part disc    modes of a part against its test
  brake-fenicsx identify brake.toml --part pad --peaks peaks.csv    constants from resonances
  brake-fenicsx schema > scene.json       keys of a scene, for editors (docs/scene.md)

variations:
  brake-fenicsx run brake.toml --set samples.n=20 -o trial
  brake-fenicsx run brake.toml --set contact.pad_disc.friction=0.4 -o other
  brake-fenicsx run brake.toml --from report
  mpirun -n 8 brake-fenicsx run brake.toml
      as root, as in a container, Open MPI asks for OMPI_ALLOW_RUN_AS_ROOT=1 and
      OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 in the environment
  brake-fenicsx run brake.toml -- -brake_compliance_mat_mumps_icntl_4 2

exit status:
  0    done
  1    a computation failed, or every sample; the error is named, finished samples are kept
  2    wrong input; one line names file, key, value and remedy, nothing was written
  130  interrupted (Ctrl-C); the same command resumes it (mpirun answers with its own status)
  141  the reader of the output closed it, as "| head" does
  143  ended by SIGTERM; the sample in progress was stored, the same command resumes the run

"brake-fenicsx COMMAND --help" lists the options of a command.
"""

from importlib import import_module

TYPE_CHECKING = False  # as in typing, whose import would take longer than all else here
if TYPE_CHECKING:
    from .model import Model, prepare, sample, sweep
    from .pipeline import assemble, run
    from .sweeps.sweep_study import Branches

__version__ = "0.3.0"
__all__ = ["Branches", "Model", "assemble", "prepare", "run", "sample", "sweep"]

# Imported when first asked for: they bring DOLFINx and PETSc with them.


def __getattr__(name: str) -> object:
    """Functions of the package."""
    if name in __all__:
        homes = {"assemble": "pipeline", "run": "pipeline", "Branches": "sweeps.sweep_study"}
        return getattr(import_module(f"{__name__}.{homes.get(name, 'model')}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Names for completion: functions and classes, and what a module has."""
    return sorted({*globals(), *__all__} - {"TYPE_CHECKING", "import_module"})

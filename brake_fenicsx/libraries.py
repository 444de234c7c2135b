"""Libraries that solve the equations: how they are started, and the versions that a run records.

PETSc would read ~/.petscrc, .petscrc and petscrc in the working directory and PETSC_OPTIONS, and
solve with the tolerances and orderings that stand there. Options of a run are those after "--" on
its command line.

OpenBLAS identifies processors by their model number. On a processor newer than itself a release
takes its oldest kernels (Prescott, of 2004): 0.3.21 of Debian 12 multiplies matrices on Emerald
Rapids at a fifth of the speed of its best kernels. Here the instruction set chooses the kernels.
"""

import ctypes
import os
import platform
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from brake_fenicsx import __version__
from brake_fenicsx.errors import BrakeError
from brake_fenicsx.folder.log import logger

# It would answer a closed pipe and SIGTERM with its own banner and MPI_Abort.
OPTIONS = ("brake-fenicsx", "-skip_petscrc", "-no_signal_handler")

# Sections of a scene that make the mesh.
BODIES = ("parts", "mesh", "contact")
# Whose versions a run records, if it used them.
MECHANICS = "numpy", "scipy", "dolfinx", "mpi4py", "petsc4py", "slepc4py", "gmsh", "meshio"
OTHERS = "SurfaceTopography", "pyfftw", "SALib", "matplotlib", "vtkmodules", "pyuff"
LIBRARIES = *MECHANICS, "h5py", "pint", *OTHERS

CPUINFO, MAPS = Path("/proc/cpuinfo"), Path("/proc/self/maps")

# OPENBLAS_CORETYPE -> instructions that the kernels need; the best kernels first.
KERNELS = {"SkylakeX": {"avx512f", "avx512dq", "avx512bw", "avx512vl"}, "Haswell": {"avx2", "fma"}}


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


def best_kernels(cpuinfo: Path = CPUINFO) -> str | None:
    """Name of the best kernels that every OpenBLAS has and the processor can run.

    Args:
        cpuinfo: file in which Linux describes the processor.

    Returns:
        Value for OPENBLAS_CORETYPE, which OpenBLAS reads when it is loaded; None where the
        instruction set is not known or too old, and the choice is left to OpenBLAS.
    """
    with suppress(OSError), cpuinfo.open() as lines:
        flags = next((set(line.split()) for line in lines if line.startswith("flags")), set())
        return next((name for name, needed in KERNELS.items() if needed <= flags), None)
    return None


def kernels_in_use() -> str:
    """Releases and kernels of the OpenBLAS libraries that this process has loaded; "" of none."""
    files, found = set[str](), set[str]()
    with suppress(OSError):
        files |= {*re.findall(r"/\S*openblas\S*", MAPS.read_text("utf-8"))}
    for file in files:
        library = ctypes.CDLL(file)
        for name in ("openblas_get_config", "scipy_openblas_get_config64_"):
            if (function := getattr(library, name, None)) is not None:
                function.restype = ctypes.c_char_p
                words = (function() or b"").decode(errors="replace").split()
                # The release, and the kernels in front of the largest number of threads.
                found.add(" ".join([*words[:2], *words[-2:-1]]))
    return ", ".join(sorted(found))


def versions() -> dict[str, str]:
    """Of the program, the libraries that were imported, MPI, matrix kernels and the system."""
    from mpi4py import MPI

    found = {"brake_fenicsx": __version__, "python": platform.python_version()}
    found |= {name: version_of(name) for name in LIBRARIES if name in sys.modules}
    found["MPI"] = MPI.Get_library_version().split(",")[0].split("\n")[0].strip("\0 ")
    found["kernels"] = kernels_in_use()
    found["system"] = platform.platform(terse=True)
    return found


def differences(one: Mapping[str, Any], two: Mapping[str, Any]) -> list[str]:
    """What two runs were made with that differs, and meshes that do although the scenes agree.

    Numbers of such runs differ in their last digits, and in more where meshes do.

    Args:
        one: summary of a run.
        two: of another.
    """
    a, b = (summary.get("versions", {}) for summary in (one, two))
    lines = [f"{name}: {a[name]} and {b[name]}" for name in a if a[name] != b.get(name, a[name])]
    meshes = [summary.get("mesh_sha256") for summary in (one, two)]
    scenes = [[s.get("settings", {}).get(k) for k in BODIES] for s in (one, two)]
    if None not in meshes and meshes[0] != meshes[1] and scenes[0] == scenes[1]:
        lines.append("other meshes of the same parts")
    return lines


def solver_versions() -> dict[str, str]:
    """Of the program and of what solves the equations, which is imported for that."""
    start_petsc()
    from slepc4py import SLEPc

    import dolfinx

    def numbers(version: tuple[int, ...]) -> str:
        return ".".join(map(str, version))

    from petsc4py import PETSc

    return {
        "brake-fenicsx": __version__,
        "DOLFINx": str(dolfinx.__version__),
        "PETSc": numbers(PETSc.Sys.getVersion()),
        "SLEPc": numbers(SLEPc.Sys.getVersion()),
    }


def version_of(name: str) -> str:
    """Version of a library that was imported."""
    if name == "gmsh":
        from brake_fenicsx.meshing.gmsh_mesh import gmsh_session

        # Its module knows the version of its interface alone.
        with gmsh_session() as gmsh:
            return str(gmsh.option.getString("General.Version"))
    # Some packages ask git, which then answers for the checkout that holds their .venv.
    try:
        return version(name)
    except PackageNotFoundError:
        return str(getattr(sys.modules[name], "__version__", "?"))

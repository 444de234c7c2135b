"""Versions of what a run was made with."""

import platform
import sys
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from mpi4py import MPI

from brake_fenicsx import __version__
from brake_fenicsx.folder.kernels import kernels_in_use
from brake_fenicsx.petsc import start_petsc

# Sections of a scene that make the mesh.
BODIES = ("parts", "mesh", "contact")
# Whose versions a run records, if it used them.
LIBRARIES = (
    "numpy", "scipy", "dolfinx", "mpi4py", "petsc4py", "slepc4py", "gmsh", "meshio", "h5py", "pint",
    "SurfaceTopography", "pyfftw", "SALib", "matplotlib", "pyvista", "pyuff",
)  # fmt: skip


def versions() -> dict[str, str]:
    """Of the program, the libraries that were imported, MPI, matrix kernels and the system."""
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

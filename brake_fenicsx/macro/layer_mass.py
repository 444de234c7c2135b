"""Mass of each layer by itself: what the kinetic energy of a mode is shared out by."""

from __future__ import annotations

import brake_fenicsx.petsc_started  # noqa: F401

# isort: split

from collections.abc import Mapping

from petsc4py import PETSc

import scipy.sparse as sp
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc

from brake_fenicsx.meshing.brake_mesh import Mesh

from .elasticity import FreeDofs, layer_measure, lump, mass_form, on_free_dofs


def layer_masses(
    mesh: Mesh, free: FreeDofs, density: Mapping[str, float], lumped: bool = False
) -> dict[str, sp.csr_matrix]:
    """Mass matrices of single layers.

    Args:
        mesh: the tagged mesh.
        free: numbering of the free dofs.
        density: layer -> density [kg/m^3].
        lumped: whether each row is summed on the diagonal.

    Returns:
        Layer -> mass [kg] on the free dofs of all parts; they add up to the mass.
    """
    u, v = ufl.TrialFunction(free.V), ufl.TestFunction(free.V)
    masses = {}
    for layer, value in density.items():
        rho = fem.Constant(mesh.domain, PETSc.ScalarType(value))
        A = fem_petsc.assemble_matrix(fem.form(mass_form(u, v, rho, layer_measure(mesh, layer))))
        A.assemble()
        if lumped:
            lump(A)
        masses[layer] = on_free_dofs(A, free)
        # PETSc keeps places for all layers.
        masses[layer].eliminate_zeros()
    return masses

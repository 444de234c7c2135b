"""Gyroscopic term of a disc that turns about an axis, here z, seen in the fixed frame.

The pads stand still, so the problem is written at fixed places: a particle that passes x moves
with Omega e_z x x + u' + Omega ((e_z x x) . grad) u. Its acceleration beyond that of the rigid
rotation is

    u'' + 2 Omega (c . grad) u' + Omega^2 (c . grad)^2 u,     c = e_z x x,

in Cartesian components. The second term is Omega G; those in Omega^2 (and the stiffening by
centrifugal stress, of the same order) are left out: of order (Omega / omega)^2, 1e-7 at a squeal.

v'Gu = 2 int rho v . (c . grad) u. On a body of revolution c is tangential to the boundary and div c
vanishes, so that integration by parts makes G skew; the skew half of the form is assembled, which
is the same there and does without the error of a faceted boundary. A wave cos(m theta + omega t)
of the disc at rest is dragged along: the pair +-m splits by 2 m Omega.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from petsc4py import PETSc

import scipy.sparse as sp
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc

from brake_fenicsx import compat
from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.elasticity import FreeDofs, on_free_dofs
from brake_fenicsx.macro.friction import Rotation
from brake_fenicsx.macro.mesh import Mesh


def gyroscopic_form(u: Any, v: Any, rho: Any, c: Any, dx: Any) -> Any:
    """Skew half of 2 int rho v . (c . grad) u.

    Args:
        u: displacement.
        v: test function.
        rho: density [kg/m^3].
        c: velocity of the rotation over its angular velocity [m].
        dx: measure of the turning body.
    """
    return rho * (ufl.inner(ufl.grad(u) * c, v) - ufl.inner(ufl.grad(v) * c, u)) * dx


def gyroscopic(
    mesh: Mesh, free: FreeDofs, density: Mapping[str, float], rotation: Rotation
) -> sp.csr_matrix:
    """Omega G on the free dofs, to be added to the damping.

    Args:
        mesh: the tagged mesh.
        free: numbering of the free dofs.
        density: layer name -> density [kg/m^3] of the layers that turn: the disc's and no other.
        rotation: axis and angular velocity Omega [rad/s], its sign the sense.

    Returns:
        Omega G [N s/m], skew.

    Raises:
        SceneError: a layer that is not there, or none at all.
    """
    missing = [name for name in density if name not in mesh.layers]
    if missing or not density:
        there = ", ".join(sorted(mesh.layers))
        raise SceneError(f"gyroscopic term: no layer {missing or 'named'}; there are {there}")
    V = free.V
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    whole = ufl.Measure("dx", domain=mesh.domain)
    G = fem_petsc.create_matrix(fem.form(ufl.inner(u, v) * whole))
    axis, point = (fem.Constant(mesh.domain, a) for a in (rotation.frame[2], rotation.point))
    c = ufl.cross(axis, ufl.SpatialCoordinate(mesh.domain) - point)
    for layer, rho in density.items():
        cells = compat.meshtags(mesh.domain, 3, mesh.cell_tags.find(mesh.layers[layer]), 1)
        dx = ufl.Measure("dx", domain=mesh.domain, subdomain_data=cells)(1)
        factor = fem.Constant(mesh.domain, PETSc.ScalarType(rho * rotation.speed))
        fem_petsc.assemble_matrix(G, fem.form(gyroscopic_form(u, v, factor, c, dx)))
    return on_free_dofs(G, free)

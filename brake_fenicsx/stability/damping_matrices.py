"""Damping of the linearised problem, term by term.

lambda^2 M + lambda (C + C_s + C_mu + Omega G) + K: material damping C, either alpha M + beta K
(Rayleigh: 2 zeta = alpha / omega + beta omega) or the sum of eta_j K_j / omega_ref over parts: they
dissipate the share eta_j of their strain energy at omega_ref, a hysteretic part at any frequency.
C_s and C_mu are of sliding friction, G is of the turning disc.

Friction at a contact element: the disc slides past the pad at a speed V along s. With the slip of
pad minus disc, T u along s and R u across, the pad moves against the disc with the velocity
v = (T u' - V) s + R u' r, and the traction on the pad is -mu(|v|) p v / |v|. To first order in u',

    |v| = V - T u',     -v / |v| = s - (R u' / V) r,
    traction = mu p s - mu'(V) p T u' s - (mu p / V) R u' r.

The first term is the friction of the tangent; the two others, moved to the left-hand side, are
C_mu = T' W p mu'(V) T and C_s = R' W (mu p / V) R. Their signs: sliding always damps across its
direction, and friction that falls with speed (mu' < 0) feeds energy in along it.

Gyroscopic term of a disc that turns about an axis, here z, seen in the fixed frame: the pads stand
still, so the problem is written at fixed places: a particle that passes x moves
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

import brake_fenicsx.petsc_started  # noqa: F401
from brake_fenicsx.arguments import Array

# isort: split

from collections.abc import Mapping

from petsc4py import PETSc

import scipy.sparse as sp
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc

from brake_fenicsx import compat
from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.contact_forces import Rotation
from brake_fenicsx.macro.elasticity import FreeDofs, on_free_dofs
from brake_fenicsx.meshing.brake_mesh import Mesh


def friction_damping(
    T: sp.spmatrix, R: sp.spmatrix, w: Array, along: Array, across: Array
) -> sp.csr_matrix:
    """C_mu + C_s = T' W p mu'(V) T + R' W (mu p / V) R of the contact elements.

    Args:
        T: slip along the sliding direction, shape (elements, dofs).
        R: slip across it, likewise.
        w: areas [m^2], shape (elements,).
        along: p mu'(V) [Pa s/m], likewise; negative where friction falls with speed.
        across: mu p / V [Pa s/m], likewise; see ``SlidingFriction.rates``.

    Returns:
        Symmetric [N s/m].
    """
    return (T.T @ sp.diags(w * along) @ T + R.T @ sp.diags(w * across) @ R).tocsr()


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
        skew = ufl.inner(ufl.grad(u) * c, v) - ufl.inner(ufl.grad(v) * c, u)
        fem_petsc.assemble_matrix(G, fem.form(factor * skew * dx))
    return on_free_dofs(G, free)

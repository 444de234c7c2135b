"""Damping of the linearised problem, term by term.

lambda^2 M + lambda (C + C_s + C_mu + Omega G) + K: material damping C, here as Rayleigh or as loss
factors of the parts; C_s and C_mu of sliding friction; G of the turning disc.

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

from __future__ import annotations

import brake_fenicsx.petsc_started  # noqa: F401

# isort: split

from collections.abc import Mapping, Sequence
from typing import Any

from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from numpy.typing import NDArray

from brake_fenicsx import compat
from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.elasticity import FreeDofs, on_free_dofs
from brake_fenicsx.macro.sliding_friction import Rotation
from brake_fenicsx.meshing.brake_mesh import Mesh

Array = NDArray[np.float64]


def rayleigh(M: sp.csr_matrix, K: sp.csr_matrix, alpha: float, beta: float) -> sp.csr_matrix:
    """C = alpha M + beta K; a mode at omega is damped by 2 zeta = alpha/omega + beta omega.

    Args:
        M: mass [kg].
        K: elastic stiffness [N/m], symmetric, so without friction.
        alpha: mass factor [1/s], not negative.
        beta: stiffness factor [s], not negative.

    Returns:
        Damping [N s/m], CSR.

    Raises:
        SceneError: a factor is negative.
    """
    if alpha < 0 or beta < 0:
        raise SceneError(f"Rayleigh damping: alpha = {alpha:g}, beta = {beta:g}: none may be < 0")
    return (alpha * M + beta * K).tocsr()


def loss_factor(parts: Sequence[tuple[float, sp.csr_matrix]], omega_ref: float) -> sp.csr_matrix:
    """C = sum eta_j K_j / omega_ref; at omega_ref a part dissipates eta_j of its strain energy.

    The loss factor of a hysteretic part is the same at all frequencies, that of this viscous one
    grows with frequency: exact at omega_ref alone. Energy a period over 2 pi times the strain
    energy: omega u'C u / u'K u = eta at omega = omega_ref.

    Args:
        parts: loss factor [-] and stiffness [N/m] of each part, on the dofs of all parts.
        omega_ref: reference frequency [rad/s], positive.

    Returns:
        Damping [N s/m], CSR.

    Raises:
        SceneError: no part, a negative loss factor, or a reference frequency that is not positive.
    """
    if not parts:
        raise SceneError("loss factors: no part is named")
    if not omega_ref > 0:
        raise SceneError(f"loss factors: reference frequency {omega_ref:g} rad/s must be positive")
    if min(eta for eta, _ in parts) < 0:
        raise SceneError("loss factors: none may be negative")
    return sum(eta / omega_ref * K for eta, K in parts).tocsr()


def sliding_damping(R: sp.spmatrix, w: Array, p: Array, V: Array, mu: float | Array) -> Any:
    """C_s = R' W (mu p / V) R: friction turns with the direction of sliding.

    Args:
        R: slip across the sliding direction, shape (elements, dofs).
        w: areas [m^2], shape (elements,).
        p: pressures at equilibrium [Pa], shape (elements,).
        V: sliding speeds [m/s], positive where there is friction, shape (elements,).
        mu: friction coefficient, one or one per element.

    Returns:
        Symmetric, positive semi-definite [N s/m], CSR.

    Raises:
        SceneError: a sliding speed is not positive: friction without a direction.
    """
    drag, slides = mu * p, np.asarray(V) > 0
    if np.any(drag[~slides]):
        raise SceneError("sliding damping: friction needs a sliding speed V > 0 in its element")
    rates = np.divide(drag, V, out=np.zeros(drag.shape), where=slides)
    return (R.T @ sp.diags(w * rates) @ R).tocsr()


def velocity_slope(T: sp.spmatrix, w: Array, p: Array, slope: float | Array) -> Any:
    """C_mu = T' W p mu'(V) T: friction changes with the speed of sliding.

    Args:
        T: slip along the sliding direction, shape (elements, dofs).
        w: areas [m^2], shape (elements,).
        p: pressures at equilibrium [Pa], shape (elements,).
        slope: mu'(V) [s/m] at the sliding speed of each element, or one for all; negative where
            friction falls with speed.

    Returns:
        Symmetric [N s/m], CSR; negative semi-definite where friction falls.
    """
    return (T.T @ sp.diags(w * p * np.asarray(slope)) @ T).tocsr()


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

"""Gyroscopic term: exact integrals, and the whirl split of a spinning disc."""

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.errors import SceneError
from brake_fenicsx.geometry import disc
from brake_fenicsx.macro.contact_forces import Rotation
from brake_fenicsx.macro.elasticity import assemble_elastic
from brake_fenicsx.macro.material import Material, isotropic
from brake_fenicsx.meshing.brake_mesh import build_mesh
from brake_fenicsx.stability import complex_modes
from brake_fenicsx.stability.damping_matrices import gyroscopic

RHO, SPEED = 7200.0, 200.0
IRON = Material(isotropic(125e9, 0.24), RHO)


def annulus(comm, thickness, size, supports):
    shape = disc.Disc(radius=144e-3, bore=75e-3, thickness=thickness, size=size)
    mesh = build_mesh({"disc": (disc, shape)}, comm)
    solved = assemble_elastic(mesh, {"disc.body": IRON}, supports)
    return mesh, solved, gyroscopic(mesh, solved.free, {"disc.body": RHO}, Rotation(SPEED))


def field(solved, values):
    """Whole free vector of a displacement given as a function of x, shape (3, points)."""
    from dolfinx import fem

    u = fem.Function(solved.free.V)
    u.interpolate(values)
    comm = solved.free.V.mesh.comm
    return np.concatenate(comm.allgather(u.x.array[solved.free.local]))


def test_integrals_of_known_fields(comm):
    """v'Gu = int rho (v . (c.grad) u - u . (c.grad) v) of polynomials, by hand; G is skew.

    u = e_x, v = -y z e_x + x z e_z and the like: catches a factor, a sign, a transposed gradient.
    """
    _, solved, G = annulus(comm, 20e-3, 20e-3, {})
    M = solved.M
    assert abs(G + G.T).max() < 1e-12 * abs(G).max()
    zero = lambda x: 0 * x[0]  # noqa: E731

    def vector(first=zero, second=zero, third=zero):
        return field(solved, lambda x: np.stack([first(x), second(x), third(x)]))

    # (c . grad) x = -y, (c . grad) y = x: u = x e_z, v = y e_z gives rho int (-y y - x x).
    ux, uy = vector(third=lambda x: x[0]), vector(third=lambda x: x[1])
    assert uy @ G @ ux == pytest.approx(-SPEED * (ux @ M @ ux + uy @ M @ uy), rel=1e-12)
    # A translation does not change along the circles; against v its partner remains.
    one, v = vector(lambda x: 1 + zero(x)), vector(lambda x: x[0] * x[1])
    # -int rho (c . grad)(x y) = -int rho (x^2 - y^2).
    x, y = vector(lambda x: x[0]), vector(lambda x: x[1])
    assert v @ G @ one == pytest.approx(-SPEED * (x @ M @ x - y @ M @ y), abs=1e-9 * SPEED * RHO)
    # Components do not mix.
    assert vector(second=lambda x: x[0] * x[1]) @ G @ x == 0.0


def angular_order(solved, shape):
    """m and the sign of exp(i m theta) of a complex shape's u_z, by its lift over its mirror."""
    V = solved.free.V
    full = solved.free.expand(np.stack([shape.real, shape.imag], axis=1))
    uz = full[2::3, 0] + 1j * full[2::3, 1]
    x = V.tabulate_dof_coordinates()
    theta = np.arctan2(x[:, 1], x[:, 0])
    parts = {m: abs(np.sum(uz * np.exp(-1j * m * theta))) for m in range(-6, 7)}
    return max(parts, key=parts.get)


@pytest.mark.long
def test_a_wave_pair_splits_by_two_m_omega():
    """Thin disc, |m| up to 2 at least; the wave that runs along is the faster one.

    omega = m Omega + sqrt(omega_0^2 + m^2 Omega^2) without the terms in Omega^2; the in-plane
    inertia of the slab adds a Coriolis term of less than one percent of the drag.
    """
    _, solved, G = annulus(MPI.COMM_SELF, 2e-3, 14e-3, {"disc.bore": ["x", "y", "z"]})
    K, M = solved.K, solved.M
    still = complex_modes(M, None, K, (0.0, 900.0))
    modes = complex_modes(M, G, K, (0.0, 550.0), zeta_max=0.02)
    seen = set()
    for i, s in enumerate(modes.s):
        # Time runs as exp(i omega t): a wave along +theta has exp(-i m theta).
        m = -angular_order(solved, modes.right[:, i])
        drag, at_rest = m * SPEED, 2 * np.pi * still.frequency
        error = np.abs(s.imag - drag - np.hypot(at_rest, drag)).min()
        assert error < 0.01 * abs(drag) + 0.002 * SPEED, (m, s)
        seen.add(m)
    assert np.abs(modes.s.real).max() < 1e-6 * np.abs(modes.s).max()
    assert seen >= {-2, -1, 0, 1, 2}


def test_without_speed_there_is_no_term_and_other_layers_are_refused(comm):
    mesh, solved, _ = annulus(comm, 20e-3, 20e-3, {})
    assert gyroscopic(mesh, solved.free, {"disc.body": RHO}, Rotation(0.0)).count_nonzero() == 0
    with pytest.raises(SceneError, match=r"pad\.lining.*disc\.body"):
        gyroscopic(mesh, solved.free, {"pad.lining": RHO}, Rotation(1.0))

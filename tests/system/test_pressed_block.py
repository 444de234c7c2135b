"""A block pressed on a plate: converged reference, limit of a stiff penalty."""

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from brake_fenicsx.macro import displacement
from brake_fenicsx.macro.equilibrium import equilibrium
from brake_fenicsx.micro import exponential_law

LAW = exponential_law(5e5, 2e-6)
SIDES = (12e-3, 8e-3)


def pressed(two_blocks, size, mu, **changes):
    """Block guided in the plane at its top, pressed on a wider plate that slides below."""
    pad = (("length", SIDES[0]), ("width", SIDES[1]), ("height", 6e-3), ("z", 0.0), ("size", size))
    plate = (("length", 20e-3), ("width", 14e-3), ("height", 6e-3), ("z", -6e-3),
             ("size", 1.4 * size))  # fmt: skip
    scene = two_blocks("guided", pad=pad, plate=plate, direction=(1.0, 0.0, 0.0), **changes)
    return scene, equilibrium(scene, scene.enriched(LAW), mu, tolerance=1e-12)


def answers(scene, eq):
    """Tilt of the pressure over the length, and mean way of the load [m]."""
    load = scene.w @ eq.p
    tilt = scene.w @ (eq.p * scene.contact.points[:, 0]) / load / SIDES[0]
    sinks = scene.f @ displacement(scene, eq, scene.f) / load
    return tilt, sinks


@pytest.mark.parametrize("mu", [0.0, 0.5])
@pytest.mark.parametrize("cells", ["tetrahedra", "hexahedra"])
@pytest.mark.parametrize("discretisation", ["patch", "quadrature", "node"])
def test_against_the_converged_solution(two_blocks, cells, discretisation, mu):
    """How far the block sinks, against hexahedra a third as large, and the tilt by friction, which
    is mu h / L by the balance of moments: one limit for every kind of cell and of element."""
    scene, eq = pressed(two_blocks, 2e-3, mu, cells=cells, discretisation=discretisation)
    assert scene.w @ eq.p == pytest.approx(5e5 * SIDES[0] * SIDES[1], rel=1e-9)
    tilt, sinks = answers(scene, eq)
    assert tilt == pytest.approx(-mu * 6e-3 / SIDES[0], abs=1e-9)
    assert sinks == pytest.approx(SINKS[mu], abs=BOUND[discretisation])


# [m], of ``test_the_solution_is_converged``: hexahedra of 0.7 mm, 125,000 dofs.
SINKS = {0.0: 1.50636e-6, 0.5: 4.38177e-7}
# [m]; one pressure per facet cannot tilt inside it, nodes at edges carry too much.
BOUND = {"patch": 7e-8, "quadrature": 3e-9, "node": 4e-8}


@pytest.mark.slow
@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_the_solution_is_converged(two_blocks, mu):
    """The numbers above come from the finer of these meshes, and the other is near them.

    Gmsh 4.8 and 4.13 make different hexahedra of one size: with friction 7e-11 m apart at 1 mm and
    1e-11 m at 0.7 mm. What is left of the error at 0.7 mm is about 2e-10 m (it falls by 2.5 from
    size to size), a fifteenth of the smallest bound above.
    """
    for size, bound in ((1e-3, 4e-10), (0.7e-3, 2e-11)):
        _, sinks = answers(*pressed(two_blocks, size, mu, cells="hexahedra",
                                    discretisation="quadrature"))  # fmt: skip
        assert sinks == pytest.approx(SINKS[mu], abs=bound)


def test_penalty_error_falls_as_one_over_the_stiffness_until_round_off(two_blocks):
    """|u(k) - u(oo)| k is constant over six decades; then the solve loses what the penalty gains.

    u(oo) by the constraint N u = 0 itself, with pressures as multipliers.
    """
    scene = two_blocks("guided")
    limit = constrained(scene)
    stiffness = 10.0 ** np.arange(13, 25)
    error = []
    for k in stiffness:
        A = scene.tangent(np.full(scene.w.size, k), 0.0).tocsc()
        u = splu(A).solve(scene.f - scene.N.T @ (scene.w * k * scene.g0))
        error.append(np.linalg.norm(u - limit) / np.linalg.norm(limit))
    error = np.array(error)
    pairs = zip(stiffness, error, strict=True)
    print("penalty [Pa/m], error of u:", *(f"{k:.0e} {e:.1e}" for k, e in pairs))
    best = int(np.argmin(error))
    rate = -np.diff(np.log10(error[:best]))
    # The first decades are bent by the compliance of the bodies themselves.
    np.testing.assert_allclose(rate[1:5], 1.0, atol=0.02)
    assert error[best] < 1e-8
    assert np.all(error[best:] < 1e-16 * stiffness[best:] / 1e13)


def constrained(scene):
    """Displacements with closed gaps, exactly: K u - N' q = f, N u = -g0."""
    n = scene.w.size
    A = sp.bmat([[scene.K, -scene.N.T * 1e11], [-scene.N * 1e11, sp.csr_matrix((n, n))]]).tocsc()
    b = np.concatenate([scene.f, 1e11 * scene.g0])
    return splu(A).solve(b)[: scene.f.size]

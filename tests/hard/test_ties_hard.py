"""Ties at their limits: penalties far too stiff or too soft, slivers of a common part."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.geometry import block
from brake_fenicsx.macro.elasticity import assemble_elastic, unit_loads
from brake_fenicsx.macro.material import Material, isotropic
from brake_fenicsx.macro.solver import Factor
from brake_fenicsx.macro.tie import tied_faces
from brake_fenicsx.meshing.brake_mesh import raw_mesh, tagged_mesh
from brake_fenicsx.meshing.gmsh_mesh import MeshSettings

pytestmark = pytest.mark.hard

STEEL = Material(isotropic(210e9, 0.3), 7800.0)
C33 = float(STEEL.C[2, 2])
HELD = {"low.bottom": ["z"], "low.sides": ["x", "y"], "high.sides": ["x", "y"]}


def tied(kappa, supports, shift=0.0):
    """Two blocks of 10 x 8 x 6 mm^3, one upon the other, the upper one shifted along x.

    Bodies, their tie, and the loads of a pressure of 1 Pa on the upper one.
    """
    low = block.Block(length=10e-3, width=8e-3, height=6e-3, z=-6e-3, size=4e-3)
    parts = {"low": (block, low), "high": (block, replace(low, z=0.0, size=3e-3))}

    def made():
        raw = raw_mesh(parts, MeshSettings())
        upper = np.unique(raw.cells[raw.part("high")])
        points = raw.points.copy()
        points[upper, 0] += shift
        return replace(raw, points=points)

    mesh = tagged_mesh(made, MPI.COMM_SELF, MeshSettings())
    materials = dict.fromkeys(mesh.layers, STEEL)
    elastic = assemble_elastic(mesh, materials, supports)
    tie = tied_faces(mesh, elastic.free, ("low.top", "high.bottom"), materials, kappa)
    loads = unit_loads(mesh, elastic.free, "high.top")
    return replace(elastic, K=elastic.K + tie.K), tie, loads


@pytest.mark.parametrize(("times", "error"), [(1e-8, 1e-9), (1e4, 1e-7), (1e8, 1e-3)])
def test_stiffness_of_a_tie_a_hundred_million_times_off(times, error):
    """Patch test: the error is at most round-off times the factor of the stiffness."""
    usual = tied(None, HELD)[1].stiffness
    p, kappa = 1e6, times * usual
    elastic, _, unit = tied(kappa, HELD)
    factor = Factor(elastic.K)
    u = factor.solve(p * unit)
    factor.destroy()
    block_, component = np.divmod(elastic.free.local, 3)
    z = elastic.free.V.tabulate_dof_coordinates()[block_, 2]
    top = (component == 2) & (z > 5.9e-3)
    exact = -p * (12e-3 / C33 + 1 / kappa)
    np.testing.assert_allclose(u[top], exact, rtol=error)


@pytest.mark.parametrize("width", [1e-3, 1e-6, 1e-9])
def test_sliver_of_a_common_part(width):
    """The blocks share a strip: exact area, no strain from rigid motions."""
    elastic, tie, _ = tied(1e15, {}, 10e-3 - width)
    assert tie.area == pytest.approx(8e-3 * width, rel=1e-6)
    K = elastic.K
    assert abs(K - K.T).max() < 1e-12 * abs(K).max()
    block_, component = np.divmod(elastic.free.local, 3)
    x = elastic.free.V.tabulate_dof_coordinates()[block_]
    for axis in np.eye(3):
        for motion in (np.broadcast_to(axis, x.shape), np.cross(axis, x)):
            u = motion[np.arange(len(x)), component]
            assert abs(u @ (K @ u)) < 1e-12 * (abs(u) @ (abs(K) @ abs(u)))

"""Elements of first order, with consistent and lumped mass."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh

from brake_fenicsx import prepare
from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene import read_scene
from places import BLOCK

HELD = 'supports."block.bottom"="clamped"'


def lowest(size, *overrides):
    """Six lowest frequencies [Hz] of the block held at its bottom, and its matrices."""
    own = [f'parts.block.size="{size} mm"', HELD, *overrides]
    brake = assemble_brake(read_scene(BLOCK, own), MPI.COMM_SELF)
    K, M = brake.K, brake.M
    kappa = eigsh(K, 6, M, sigma=0.0, return_eigenvectors=False)
    return np.sqrt(np.sort(kappa)) / 2 / np.pi, K, M


def test_linear_elements_are_stiffer_and_converge():
    """Their space is part of the quadratic one: no frequency is lower; the error falls as h^2."""
    linear = {size: lowest(size, "mesh.degree=1")[0] for size in (10, 5)}
    quadratic = lowest(10)[0]
    assert np.all(linear[10] >= quadratic * (1 - 1e-12))
    exact = lowest(5)[0]
    gain = (linear[10] / exact - 1).mean() / (linear[5] / exact - 1).mean()
    assert 2.0 < gain < 8.0


def test_lumped_mass():
    """It is diagonal, has the mass of the bodies along each axis, and lowers the frequencies."""
    free = ['supports."plate.bottom"=["z"]', 'supports."block.top"=["z"]', "mesh.degree=1"]
    found = {}
    for mass in ("consistent", "lumped"):
        own = [*free, f'mesh.mass="{mass}"']
        brake = assemble_brake(read_scene(BLOCK, own), MPI.COMM_SELF)
        M = brake.M
        along = np.zeros(brake.elastic.free.V.dofmap.index_map.size_local * 3)
        along[0::3] = 1.0
        along = along[brake.elastic.free.local]
        volume = {"lining": 40e-3 * 20e-3 * 20e-3, "iron": 60e-3 * 30e-3 * 10e-3}
        assert along @ M @ along == pytest.approx(
            2510 * volume["lining"] + 7200 * volume["iron"], rel=1e-10
        )
        found[mass] = lowest(8, "mesh.degree=1", f'mesh.mass="{mass}"')
    M = found["lumped"][2]
    assert abs(M - np.diag(M.diagonal())).max() == 0.0
    assert M.diagonal().min() > 0
    assert np.all(found["lumped"][0] < found["consistent"][0])


def test_brake_of_linear_elements():
    """Contact, reduced model and full order take them; kinetic energy is shared out whole."""
    own = ["mesh.degree=1", 'mesh.mass="lumped"', "stability.band=['0 Hz','25 kHz']"]
    own.append('stages=["equilibrium","stability"]')
    full, reduced = (
        prepare(BLOCK, [*own, f'stability.method="{method}"']) for method in ("full", "reduced")
    )
    np.testing.assert_allclose(reduced.modes().s, full.modes().s, rtol=1e-5)
    total = sum(full.study.models.brake.masses.values())
    assert abs(total - full.study.brake.M).max() < 1e-12 * abs(total).max()


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (['mesh.mass="lumped"'], "write mesh.degree = 1"),
        (["mesh.degree=1", "mesh.order=2"], "needs mesh.degree = 2"),
        (["mesh.degree=3"], "mesh.degree"),
    ],
)
def test_what_does_not_go_together(overrides, said):
    """Lumped quadratic elements and curved linear ones are refused."""
    with pytest.raises(SceneError, match=said):
        read_scene(BLOCK, overrides)

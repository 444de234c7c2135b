"""The same contact from other programs: ContactMechanics, Tamaas (extra ``[peers]``), ASPHER."""

import numpy as np
import pytest

from brake_fenicsx.micro import solve_contact
from brake_fenicsx.surface import given_statistics, synthesise

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
SIZE = (2.825e-3, 2.825e-3)


@pytest.mark.parametrize("boundary", ["free", "periodic"])
@pytest.mark.parametrize("level", [0.01, 0.1])
def test_pressures_agree_to_1e_6(boundary, level):
    peer = pytest.importorskip("ContactMechanics")
    from SurfaceTopography import Topography

    n, periodic = 64, boundary == "periodic"
    area = SIZE[0] * SIZE[1]
    h = synthesise(PAPER.bifractal, PAPER.hdf, (n, n), SIZE, np.random.default_rng(0)).heights
    kind = peer.PeriodicFFTElasticHalfSpace if periodic else peer.FreeFFTElasticHalfSpace
    half = kind((n, n), 1.0, SIZE)
    system = peer.Systems.NonSmoothContactSystem(half, Topography(h, SIZE, periodic=periodic))
    found = system.minimize_proxy(external_force=level * area, pentol=1e-13, maxiter=2000)
    assert found.success
    theirs = np.abs(np.asarray(half.force))[:n, :n] / (area / n**2)
    ours = solve_contact(h, SIZE, 1.0, load=level * area, boundary=boundary, tol=1e-13)
    assert np.linalg.norm(theirs - ours.pressure) < 1e-6 * np.linalg.norm(ours.pressure)
    if not periodic:  # with a periodic boundary the mean displacement is a convention
        assert ours.separation == pytest.approx(-found.offset, abs=1e-6 * h.std())


@pytest.mark.parametrize("boundary", ["free", "periodic"])
@pytest.mark.parametrize("level", [0.01, 0.1])
def test_pressures_of_aspher_agree_to_1e_6(boundary, level):
    """It is given gaps, heights with the other sign, and compiled by ``pip install aspher``."""
    peer, n = pytest.importorskip("aspher"), 64
    h = synthesise(PAPER.bifractal, PAPER.hdf, (n, n), SIZE, np.random.default_rng(0)).heights
    half = peer.ContactSolver(n, SIZE[0], 1.0, backend="fft" if boundary == "free" else boundary)
    found = half.solve(-h.ravel(), level, tol=1e-12, precond="fourier-fft")
    assert found.status == "converged"
    load = level * SIZE[0] * SIZE[1]
    ours = solve_contact(h, SIZE, 1.0, load=load, boundary=boundary, tol=1e-13).pressure
    theirs = np.reshape(found.pressure, h.shape)
    assert np.linalg.norm(theirs - ours) < 1e-6 * np.linalg.norm(ours)


def tamaas_pressures(h, hardness, mean):
    """Pressures over E* of a periodic surface that yields, by the method of Stanley and Kato.

    Tamaas is given lengths over the side of the patch and pressures over E*: its tolerance is no
    relative one, and in metres and pascals the first iterate passes.
    """
    tm = pytest.importorskip("tamaas")
    tm.initialize(1)
    tm.set_log_level(tm.LogLevel.error)
    model = tm.Model(tm.model_type.basic_2d, [1.0, 1.0], list(h.shape))
    model.E, model.nu = 1.0, 0.0
    solver = tm.KatoSaturated(model, np.ascontiguousarray(h / SIZE[0]), 1e-12, hardness)
    solver.max_iter, solver.dump_freq = 200_000, 10**9
    assert solver.solve(mean) < 1e-12
    return np.array(model.traction)


@pytest.mark.parametrize("hardness", [0.02, 0.08, 0.2])
@pytest.mark.parametrize("share", [0.003, 0.03, 0.3])
@pytest.mark.parametrize("n", [24, 64])
def test_pressures_under_a_hardness_agree_to_1e_6(n, share, hardness):
    """Hardnesses over E*, of a lining 47 to 475 MPa; mean pressures are shares of them."""
    h = synthesise(PAPER.bifractal, PAPER.hdf, (n, n), SIZE, np.random.default_rng(n)).heights
    theirs = tamaas_pressures(h - h.mean(), hardness, share * hardness)
    load = share * hardness * SIZE[0] * SIZE[1]
    ours = solve_contact(
        h, SIZE, 1.0, load=load, boundary="periodic", tol=1e-13, hardness=hardness
    ).pressure
    np.testing.assert_allclose(theirs, ours, rtol=0.0, atol=1e-6 * hardness)
    for near in (1e-6 * hardness, (1.0 - 1e-6) * hardness):  # touching pixels, yielding pixels
        np.testing.assert_array_equal(theirs > near, ours > near)
    assert (ours > (1.0 - 1e-6) * hardness).any()

"""The same contact from another program: ContactMechanics (extra ``[peers]``) as an oracle."""

import numpy as np
import pytest

from brake_fenicsx.micro import solve_contact
from brake_fenicsx.surface import given_statistics, synthesise

peer = pytest.importorskip("ContactMechanics")

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
SIZE = (2.825e-3, 2.825e-3)


@pytest.mark.parametrize("boundary", ["free", "periodic"])
@pytest.mark.parametrize("level", [0.01, 0.1])
def test_pressures_agree_to_1e_6(boundary, level):
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

"""The bodies as harmonic balance reads them from the reduced model, against their full matrices."""

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.extras.limit_cycle.bodies import reduced_bodies
from reduced_samples import HIGH, damping, followed, offline

MU = 0.4


@pytest.mark.parametrize("case", ["undamped", "sliding", "falling", "loss", "all"])
def test_motions_of_forces_on_the_contact_faces(two_blocks, case):
    """Up to the end of the band, also where bodies are damped or contact forces follow rates."""
    scene, rows = two_blocks("coarse"), followed(case)
    bodies = reduced_bodies(offline(scene, case, tolerance=1e-7), np.zeros(0), MU + 0 * scene.w)
    C, _ = damping(scene, case)
    C = sp.csr_matrix(scene.K.shape) if C is None else C
    O = sp.vstack([getattr(scene, name) for name in rows])
    acting = [scene.N, scene.T] + [scene.R] * ("R" in rows)
    I = scene.N + MU * scene.T if rows == "N" else sp.vstack(acting)
    F = np.random.default_rng(1).standard_normal(I.shape[0])
    for s in HIGH * np.array([0.02 + 0.3j, -0.05 + 0.7j, 1j]):
        P = (s**2 * scene.M + s * C + scene.K).toarray()
        exact = O @ la.solve(P, I.T @ F)
        own, lead, source, D = bodies.at(s)
        found = source @ la.solve(own, lead @ F) + D @ F
        assert la.norm(found - exact) < 1e-5 * la.norm(exact)

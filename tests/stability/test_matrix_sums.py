"""Sums of matrices on one pattern, against dense sums."""

from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.macro.solver import InterfaceFactor
from brake_fenicsx.stability import reduce_bodies
from brake_fenicsx.stability.substructures.substructure import MatrixSums
from reduced_samples import BAND, box, substructures


def some(n=40):
    """Matrices of three patterns, two nearly alike, one with indices in another order."""
    rng = np.random.default_rng(0)
    A, B, C = (sp.random(n, n, 0.1, "csr", random_state=rng) for _ in range(3))
    D = sp.csr_matrix((rng.standard_normal(A.nnz), A.indices, A.indptr), A.shape)
    order = np.concatenate([np.arange(a, b)[::-1] for a, b in pairwise(B.indptr)])
    turned = sp.csr_matrix((B.data[order], B.indices[order], B.indptr), B.shape)
    zero = sp.csr_matrix((np.r_[D.data[:-1], 0.0], D.indices, D.indptr), D.shape)
    return [A, turned, C, zero], [X.toarray() for X in (A, B, C, zero)]


@pytest.mark.parametrize("which", [(0, 1, 2, 3), (0, 0, 3), (2,)])
def test_sums_are_those_of_dense_matrices_on_one_pattern(which):
    """Also where factors are zero, where entries cancel, and for complex factors."""
    sparse, dense = some()
    sums = MatrixSums([sparse[i] for i in which])
    patterns = set()
    for factors in ([1.0, -2, 3, 0.5], [0.0] * 4, [1.0, 0, 0, -1], [1j, 2, 0, 1 + 1j]):
        own = np.array(factors)[list(which)]
        found = sums(own)
        wanted = sum(f * dense[i] for f, i in zip(own, which, strict=True))
        np.testing.assert_allclose(found.toarray(), wanted, rtol=0, atol=1e-14)
        assert found.dtype == own.dtype and found.has_canonical_format
        patterns.add((found.indices.tobytes(), found.indptr.tobytes()))
    assert len(patterns) == 1


def test_a_body_is_analysed_once_for_a_whole_box(two_blocks, monkeypatch):
    """Points with a parameter at its centre, where a change has no share, have no own pattern."""
    analysed, done, init = [], [], InterfaceFactor.__init__
    monkeypatch.setattr(
        InterfaceFactor, "__init__", lambda self, *a: analysed.append(init(self, *a))
    )
    scene = two_blocks("coarse")
    bodies = substructures(scene, "undamped", True)
    given = bodies, scene.w, BAND, box(scene, "undamped")
    reduce_bodies(*given, tolerance=1e-3, progress=lambda total: done.append)
    assert sum(done) > 5 * len(bodies) and len(analysed) == len(bodies)

"""The cache of the bodies that change: taken again, or not at all."""

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.store import Store
from brake_fenicsx.uncertainty.changing import FILE, MADE_WITH, _cached, _numbering


@pytest.fixture
def store(tmp_path):
    (tmp_path / "cache").mkdir()
    return Store(tmp_path)


def save(store, numbering, made_with=MADE_WITH):
    arrays = {"0.W": np.eye(2), "0.R_0": np.ones(3)}
    marks = {"made_with": made_with, "numbering": numbering}
    store.save(FILE, bodies=np.array(2), **marks, **arrays)


def test_arrays_come_back_by_body(store):
    """The second is an image of the first, and has none."""
    save(store, np.array([1.0, 2.0]))
    first, second = _cached(store, np.array([1.0, 2.0]))
    assert set(first) == {"W", "R_0"} and second == {}
    np.testing.assert_array_equal(first["W"], np.eye(2))


def test_another_layout_or_accuracy_is_not_read(store):
    """That of earlier programs had one number less, and other arrays."""
    for other in (MADE_WITH[1:], MADE_WITH + 1):
        save(store, np.zeros(2), other)
        assert _cached(store, np.zeros(2)) is None


def test_another_numbering_is_not_read(store):
    """Rows of W would be those of other dofs."""
    rng = np.random.default_rng(0)
    M, N = (sp.random(50, 50, 0.1, format="csr", random_state=rng) for _ in range(2))
    order = rng.permutation(50)
    save(store, _numbering(M, N))
    assert _cached(store, _numbering(M, N)) is not None
    assert _cached(store, _numbering(M[order][:, order].tocsr(), N)) is None
    assert _cached(store, _numbering(M, N[:, order].tocsr())) is None

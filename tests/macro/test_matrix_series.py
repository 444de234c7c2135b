"""Series of matrices over several variables, against their closed forms."""

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.macro.stretching import matrix_series, products


def summed(found, x):
    return sum(
        products(np.array([x]), np.array([power]))[0, 0] * A for power, A in found.items()
    ).toarray()


@pytest.mark.parametrize(
    "entry",
    [
        pytest.param(lambda x, y: np.exp(x) / (3 - y), id="two variables"),
        pytest.param(lambda x, y: 1 / (4 - x - y) + x**3 * y, id="poles that move"),
        pytest.param(lambda x, y: 2.0 + 0 * x, id="constant"),
        pytest.param(lambda x, y: (1 + 0.1 * x) * (2 + 0.1 * y), id="product"),
    ],
)
def test_it_is_the_matrix_at_any_point(entry):
    def at(x):
        return sp.csr_matrix([[entry(*x), 0.5 * np.cos(x[0])], [0.0, np.exp(-x[1])]])

    found = matrix_series(at, 2)
    for x in np.random.default_rng(3).uniform(-1, 1, (20, 2)):
        np.testing.assert_allclose(summed(found, x), at(x).toarray(), atol=2e-9)


def test_variables_that_meet_in_no_entry_have_no_products():
    found = matrix_series(lambda x: sp.diags(np.exp(x)).tocsr(), 2)
    assert all(0 in power for power in found)


def test_a_pole_beside_the_range_is_beyond_the_degrees():
    assert matrix_series(lambda x: sp.csr_matrix([[1 / (1.001 - x[0])]]), 1) is None

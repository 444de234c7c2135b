"""Reference facets: nodes, derivatives, areas."""

import numpy as np
import pytest

from brake_fenicsx.macro.faces import FacetElement

KINDS = [(3, 1), (3, 2), (4, 1), (4, 2)]


@pytest.mark.parametrize("corners, degree", KINDS)
def test_shape_functions_are_those_of_the_nodes(corners, degree):
    """One at their own node, zero at others; catches middles of edges in another order."""
    e = FacetElement(corners, degree)
    np.testing.assert_allclose(e.shape(e.nodes), np.eye(len(e.nodes)), atol=1e-15)


@pytest.mark.parametrize("corners, degree", KINDS)
def test_gradients_are_derivatives(corners, degree):
    e, h = FacetElement(corners, degree), 1e-5
    x = np.random.default_rng(0).uniform(0, 1, (4, 3, 2))
    for c, d in enumerate(h * np.eye(2)):
        slope = (e.shape(x + d) - e.shape(x - d)) / (2 * h)
        np.testing.assert_allclose(e.gradient(x)[..., c], slope, atol=1e-9)


@pytest.mark.parametrize("corners, degree", KINDS)
def test_tributary_shares_and_triangles_fill_the_facet(corners, degree):
    """Shares of the nodes by halving the facet along every edge, each piece to its corners."""
    e = FacetElement(corners, degree)
    assert e.tributary.sum() == pytest.approx(1)
    area = sum(0.5 * abs(np.linalg.det(e.nodes[[b, c]] - e.nodes[a])) for a, b, c in e.triangles)
    assert area == pytest.approx(0.5 if corners == 3 else 1.0)


def test_outside_measures_the_distance_in_reference_coordinates():
    x = np.array([[0.2, 0.3], [-0.1, 0.5], [0.7, 0.5], [0.9, 1.2]])
    np.testing.assert_allclose(FacetElement(3, 2).outside(x), [0, 0.1, 0.2, 1.1])
    np.testing.assert_allclose(FacetElement(4, 2).outside(x), [0, 0.1, 0, 0.2])

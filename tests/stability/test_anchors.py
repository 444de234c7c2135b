"""Interpolation between anchors: exact for polynomials, geometric for smooth functions."""

from itertools import product
from math import comb

import numpy as np
import pytest

from brake_fenicsx.stability.changing.anchors import Anchors

pytestmark = pytest.mark.alone


@pytest.mark.parametrize(("dimension", "degree"), [(1, 5), (2, 4), (3, 3), (5, 2)])
def test_polynomials_are_exact(dimension, degree):
    """Any monomial up to the degree, from as many anchors as there are monomials."""
    anchors = Anchors(dimension, degree)
    assert len(anchors.points) == comb(dimension + degree, degree)
    assert np.all(np.abs(anchors.points) <= 1)
    x = np.random.default_rng(1).uniform(-1, 1, dimension)
    for power in product(range(degree + 1), repeat=dimension):
        if sum(power) <= degree:
            values = np.prod(anchors.points**power, axis=1)
            assert anchors.weights(x, degree) @ values == pytest.approx(np.prod(x**power), abs=1e-9)


def test_lower_degrees_use_the_first_anchors():
    """The centre alone is degree 0; each degree adds anchors and moves none."""
    anchors = Anchors(3, 4)
    assert np.all(anchors.points[0] == 0)
    for degree in range(4):
        lower = Anchors(3, degree)
        n = anchors.count(degree)
        assert n == len(lower.points)
        np.testing.assert_array_equal(anchors.points[:n], lower.points)


def test_error_falls_geometrically():
    """Of 1 / (4 + x + y), by the distance of its pole."""
    point = np.array([-0.7, -0.8])
    errors = []
    for degree in range(1, 8):
        anchors = Anchors(2, degree)
        values = 1 / (4 + anchors.points.sum(axis=1))
        errors.append(abs(anchors.weights(point, degree) @ values - 1 / (4 + point.sum())))
    slope = np.polyfit(np.arange(1, 8), np.log(errors), 1)[0]
    assert slope < np.log(0.45), errors


def test_polynomials_go_on_beyond_the_box():
    """Samples a little beyond are taken: held at the edge they would have another body's rest."""
    anchors = Anchors(2, 3)
    p = lambda x, y: 1 + 2 * x - y + x * y**2 - 3 * x**3  # noqa: E731
    at = p(*anchors.points.T)
    for x in (np.array([1.1, -1.1]), np.array([-1.05, 0.3])):
        assert anchors.weights(x, 3) @ at == pytest.approx(p(*x), rel=1e-12)


def test_powers_of_the_last_coordinate():
    """At a complex one, far from the box: what damping asks for."""
    anchors = Anchors(3, 3)
    p = lambda x, y, t: 1 - y + x * t + y * t**2 - 2 * t**3  # noqa: E731
    at, t = p(*anchors.points.T), 0.3 + 2j
    powers = anchors.series(np.array([0.4, -0.9]), 3)
    assert sum(t**n * (w @ at) for n, w in enumerate(powers)) == pytest.approx(p(0.4, -0.9, t))
    np.testing.assert_allclose(
        powers[0], anchors.weights(np.array([0.4, -0.9, 0.0]), 3), atol=1e-12
    )
    # Lower degrees, and a box of that coordinate alone.
    alone = Anchors(1, 5).series(np.zeros(0), 4)
    values = Anchors(1, 5).points[: alone.shape[1], 0] ** 3
    np.testing.assert_allclose(alone @ values, [0, 0, 0, 1, 0], atol=1e-10)

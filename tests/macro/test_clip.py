"""Common part of two triangles: exact areas, brute force, quadrature."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial import ConvexHull, QhullError

from brake_fenicsx.macro.faces import FacetElement
from brake_fenicsx.macro.overlap import (
    bilinear,
    clip_triangles,
    polygon_triangles,
    triangle_quadrature,
)


def cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def signed(t):
    return 0.5 * cross(t[1] - t[0], t[2] - t[0])


def common_area(subject, window):
    subject, window = np.asarray(subject, float), np.asarray(window, float)
    return areas(subject[None], window[None])[0]


def areas(subjects, windows):
    triangles, owner = polygon_triangles(*clip_triangles(subjects, windows))
    weights = triangle_quadrature(triangles)[1].sum(axis=1)
    return np.bincount(owner, weights, minlength=len(subjects))


def brute_force(p, q):
    """Area of the hull of all corners inside the other triangle and all edge crossings."""
    points = [x for x in p if inside(x, q)] + [x for x in q if inside(x, p)]
    for i in range(3):
        for j in range(3):
            a, d = p[i], p[(i + 1) % 3] - p[i]
            b, e = q[j], q[(j + 1) % 3] - q[j]
            det = cross(d, e)
            if abs(det) > 1e-12:
                t, s = cross(b - a, e) / det, cross(b - a, d) / det
                if 0 <= t <= 1 and 0 <= s <= 1:
                    points.append(a + t * d)
    if len(points) < 3:
        return 0.0
    try:
        return ConvexHull(np.array(points)).volume
    except QhullError:
        return 0.0


def inside(x, t):
    turn = np.sign(signed(t))
    return all(turn * cross(t[(i + 1) % 3] - t[i], x - t[i]) >= 0 for i in range(3))


UNIT = np.array([[0.0, 0], [1, 0], [0, 1]])


@pytest.mark.parametrize(
    "other, area",
    [
        (UNIT, 0.5),
        (UNIT[::-1], 0.5),
        (UNIT + np.array([0.5, 0.0]), 0.125),
        (UNIT + np.array([1.0, 0.0]), 0.0),
        (UNIT + np.array([5.0, 5.0]), 0.0),
        (10 * UNIT - [1, 1], 0.5),
        (0.1 * UNIT + [0.2, 0.2], 0.005),
        # Rotated by 180 degrees about (1/3, 1/3): a hexagon, two thirds of the triangle.
        (2 / 3 - UNIT, 1 / 3),
        (1 - UNIT, 0.0),
    ],
)
def test_known_areas(other, area):
    """Catches a window of the other orientation, a lost corner of the hexagon, touching edges."""
    assert common_area(UNIT, other) == pytest.approx(area, abs=1e-15)
    assert common_area(other, UNIT) == pytest.approx(area, abs=1e-15)


real = arrays(float, (2, 3, 2), elements=st.floats(-1, 1, width=32))
grid = arrays(float, (2, 3, 2), elements=st.integers(0, 4).map(float))


@given(pair=st.one_of(real, grid))
@settings(max_examples=400, deadline=None)
def test_agrees_with_brute_force(pair):
    """Corners on edges, shared edges, slivers; catches a polygon cut off at its sixth corner.

    All in one batch: catches pairs that mix.
    """
    p, q = pair
    if min(abs(signed(p)), abs(signed(q))) < 1e-4:
        return
    area, other, turned, _ = areas(np.array([p, q, p, UNIT]), np.array([q, p, q[::-1], UNIT + 5]))
    assert area == pytest.approx(brute_force(p, q), abs=1e-9)
    assert (other, turned) == pytest.approx((area, area), abs=1e-12)


def test_corners_that_coincide_to_rounding():
    """Matching meshes: the common part is the same from either side, whatever the last digits."""
    rng = np.random.default_rng(0)
    for _ in range(8):
        p, q = rng.integers(0, 4, (2, 20_000, 3, 2)).astype(float)
        scale = 10.0 ** -rng.integers(6, 25, (len(p), 1, 1))
        p, q = (t + scale * rng.normal(size=t.shape) for t in (p, q))
        flat = [abs(cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])) < 1e-3 for t in (p, q)]
        p, q = p[~(flat[0] | flat[1])], q[~(flat[0] | flat[1])]
        found = areas(p, q)
        for other in (areas(q, p), areas(p, q[:, ::-1]), areas(p[:, ::-1], q)):
            np.testing.assert_allclose(found, other, atol=1e-12)


@given(seed=st.integers(0, 10**6), scale=st.sampled_from([1e-4, 1.0, 1e3]))
@settings(max_examples=50, deadline=None)
def test_a_tiling_covers_a_triangle_once(seed, scale):
    """Sums of areas and of second moments over the four quarters of a window give the whole."""
    rng = np.random.default_rng(seed)
    p = rng.uniform(0.2, 0.5, (3, 2)) * scale
    if abs(signed(p)) < 1e-3 * scale**2:
        return
    a, b, c = 3 * scale * UNIT - scale
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    tiles = np.array([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]])
    triangles, _ = polygon_triangles(*clip_triangles(np.repeat(p[None], 4, axis=0), tiles))
    x, w = triangle_quadrature(triangles)
    assert w.sum() == pytest.approx(abs(signed(p)), rel=1e-12)
    # Closed form of the second moments of a triangle: A / 12 (sum of p p' + 9 c c').
    exact = abs(signed(p)) / 12 * (p.T @ p + 9 * np.outer(p.mean(0), p.mean(0)))
    np.testing.assert_allclose(np.einsum("pq,pqi,pqj->ij", w, x, x), exact, rtol=1e-11)


@given(seed=st.integers(0, 10**6))
@settings(max_examples=30, deadline=None)
def test_bilinear_coordinates_lead_back(seed):
    """Convex quadrilaterals far from parallelograms, points at corners, edges and inside."""
    rng = np.random.default_rng(seed)
    corner = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]) + rng.uniform(-0.24, 0.24, (4, 2))
    local = np.vstack([[0, 0], [1, 0], [1, 1], [0, 0.5], rng.uniform(0, 1, (5, 2))])
    x = FacetElement(4, 1).shape(local) @ corner
    np.testing.assert_allclose(bilinear(x[None], corner[None])[0], local, atol=1e-12)

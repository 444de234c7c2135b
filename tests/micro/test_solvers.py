"""Solvers against each other, against brute force, and against their own certificate."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from brake_fenicsx.errors import NotConverged, SceneError
from brake_fenicsx.micro import solve_contact
from brake_fenicsx.micro.halfspace import half_space
from brake_fenicsx.micro.qp import certify, projected_cg
from brake_fenicsx.surface import given_statistics, synthesise

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
SIZE = (2.825e-3, 2.825e-3)


def rough(n=32, seed=0):
    return synthesise(PAPER.bifractal, PAPER.hdf, (n, n), SIZE, np.random.default_rng(seed)).heights


def brute_force(h, size, d):
    """Pressures over E* of the dense program, by SciPy's Lawson-Hanson."""
    space = half_space(h.shape, tuple(np.array(size) / h.shape))
    every = np.arange(h.size)
    root = np.linalg.cholesky(space.block(every, every)).T
    u = (h - h.mean() - d).ravel()
    return nnls(root, np.linalg.solve(root.T, u), maxiter=10**5)[0].reshape(h.shape)


@pytest.mark.parametrize("solver", ["active-set", "pcg"])
@pytest.mark.parametrize("depth", [0.3, 1.0, 3.0])
def test_solvers_agree_with_brute_force(solver, depth):
    h = rough(16)
    d = h.max() - depth * h.std()
    p = brute_force(h, SIZE, d)
    found = solve_contact(h, SIZE, 2.0, separation=d, solver=solver, tol=1e-12)
    np.testing.assert_allclose(found.pressure, 2.0 * p, atol=1e-5 * 2.0 * p.max())
    assert found.residual <= 1e-12


@pytest.mark.parametrize("boundary", ["free", "periodic"])
@pytest.mark.parametrize("share", [1e-4, 1e-3, 1e-2])
def test_solvers_agree_and_load_is_dual_to_separation(boundary, share):
    """Same pressures from both solvers, at a load and at the separation that belongs to it."""
    h, E = rough(64), 2.3734e9
    load = share * E * SIZE[0] * SIZE[1]
    found = [
        solve_contact(h, SIZE, E, load=load, boundary=boundary, solver=s, tol=1e-12)
        for s in ("active-set", "pcg")
    ]
    for s in ("active-set", "pcg"):
        d = found[0].separation
        found.append(
            solve_contact(h, SIZE, E, separation=d, boundary=boundary, solver=s, tol=1e-12)
        )
    peak = found[0].pressure.max()
    for other in found[1:]:
        np.testing.assert_allclose(other.pressure, found[0].pressure, atol=1e-5 * peak)
        assert other.load == pytest.approx(load, rel=1e-6)


def test_certificate_bounds_any_pressure():
    """The bound holds for arbitrary pressures too, not only for iterates near the solution."""
    h = rough(16)
    h = h - h.mean()
    rng = np.random.default_rng(3)
    for boundary, d in (("free", 0.0), ("periodic", 0.5 * h.std())):
        space = half_space(h.shape, (SIZE[0] / 16, SIZE[1] / 16), boundary)
        best = projected_cg(space, h, d, None, np.ones_like(h), 1e-13)
        lowest = 0.5 * np.vdot(best.p, best.w + h - d) - np.vdot(best.p, h - d)
        for _ in range(50):
            p = best.p * rng.uniform(0.0, 2.0, h.shape) + rng.exponential(
                best.p.max() * 10 ** rng.uniform(-6, 0), h.shape
            )
            w = space.apply(p) - h + d
            gap = certify(space, h, p, w, d, False).gap * np.vdot(p, w + h - d)
            energy = 0.5 * np.vdot(p, w + h - d) - np.vdot(p, h - d)
            assert energy - lowest <= gap * (1 + 1e-9)


def test_reported_parts_of_the_certificate():
    h = rough(32)
    found = solve_contact(h, SIZE, 1.0, separation=0.0, solver="pcg", tol=1e-8)
    assert found.residual <= 1e-8
    assert found.penetration == pytest.approx(max(0.0, -found.gap.min()), abs=1e-20)
    assert (found.pressure >= 0.0).all()
    assert found.mean_pressure == pytest.approx(found.pressure.mean(), rel=1e-12)
    assert found.area_fraction == np.mean(found.pressure > 0.0)


def test_both_measures_of_the_same_duality_gap():
    """At a given load: p'w - F min w, over the work and over F S_q, with E* = 2."""
    h = rough(32)
    found = solve_contact(h, SIZE, 2.0, load=1e-2 * SIZE[0] ** 2, solver="pcg", tol=1e-4)
    p, w = found.pressure / 2.0, found.gap
    gap = float(np.vdot(p, w) - p.sum() * w.min())
    work = float(np.vdot(p, w + h - h.mean() - found.separation))
    assert found.residual == pytest.approx(gap / work, rel=1e-9)
    assert found.gap_residual == pytest.approx(gap / (p.sum() * h.std()), rel=1e-9)
    assert 0.0 < found.residual <= 1e-4


def test_iterations_run_out():
    """Too few iterations are an error that names the remedy, never the last iterate."""
    with pytest.raises(NotConverged, match="tolerance"):
        solve_contact(rough(32), SIZE, 1.0, separation=0.0, solver="pcg", max_iterations=3)


def test_warm_start_from_the_solution_ends_at_once():
    h = rough(64)
    cold = solve_contact(h, SIZE, 1.0, separation=0.0, solver="pcg", tol=1e-8)
    warm = solve_contact(h, SIZE, 1.0, separation=0.0, solver="pcg", tol=1e-8, start=cold.pressure)
    assert warm.iterations == 0


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 10**6),
    st.floats(-9, 0),
    st.floats(-3, 12),
    st.floats(0.05, 4.0),
    st.sampled_from([(3, 3), (8, 5), (11, 16)]),
)
def test_scaling(seed, log_height, log_modulus, depth, shape):
    """Heights, lengths and moduli only scale the answer."""
    rng = np.random.default_rng(seed)
    h = rng.standard_normal(shape)
    height, E = 10.0**log_height, 10.0**log_modulus
    d = h.max() - h.mean() - depth
    unit = solve_contact(h, (1.0, 1.5), 1.0, separation=d, tol=1e-10)
    found = solve_contact(height * h, (10.0, 15.0), E, separation=height * d, tol=1e-10)
    scale = E * height / 10.0
    np.testing.assert_allclose(
        found.pressure, scale * unit.pressure, atol=1e-4 * scale * unit.pressure.max()
    )


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"separation": 0.0, "load": 1.0}, "either"),
        ({}, "either"),
        ({"load": -1.0}, "load"),
        ({"separation": np.nan}, "separation"),
        ({"separation": 0.0, "E_star": -1.0}, "E_star"),
        ({"separation": 0.0, "tol": 0.0}, "tol"),
        ({"separation": 0.0, "boundary": "open"}, "boundary"),
        ({"separation": 0.0, "solver": "magic"}, "solver"),
        ({"separation": 0.0, "size": (1.0, -1.0)}, "size"),
        ({"separation": -1e-6, "boundary": "periodic"}, "separation"),
    ],
)
def test_mistakes_are_named(wrong, named):
    arguments = {"heights": rough(8), "size": SIZE, "E_star": 1.0, **wrong}
    with pytest.raises(SceneError, match=named):
        solve_contact(**arguments)


@pytest.mark.parametrize("boundary", ["free", "periodic"])
def test_order_of_the_arrays_does_not_matter(boundary):
    """Heights and first guess in the order of Fortran, or every other one of a larger array."""
    h = rough(32)
    settings = {"load": 1e-2 * SIZE[0] ** 2, "boundary": boundary, "solver": "pcg"}
    usual = solve_contact(h, SIZE, 1.0, **settings)
    wide = np.repeat(h, 2, axis=1)[:, ::2]
    for other in (np.asfortranarray(h), wide):
        start = np.asfortranarray(np.maximum(h, 0.0))
        found = solve_contact(other, SIZE, 1.0, start=start, **settings)
        np.testing.assert_allclose(found.pressure, usual.pressure, atol=1e-4 * usual.pressure.max())
        assert found.residual <= 1e-8

"""Braking equilibrium: condensed against sparse, balance, convergence."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from brake_fenicsx.errors import NotConverged, Separated
from brake_fenicsx.macro import EnrichedGap, displacement, draw_critical_gaps
from brake_fenicsx.macro.elasticity import assemble_elastic, unit_loads
from brake_fenicsx.macro.equilibrium import Compliance, equilibrium, solved
from brake_fenicsx.macro.newton import Newton
from brake_fenicsx.micro import (
    LawRecipe,
    LawSettings,
    OneLaw,
    exponential_law,
    law_library,
    linear_law,
)
from brake_fenicsx.surface import given_statistics


def operators(scene):
    return SimpleNamespace(N=scene.N, T=scene.T, w=scene.w, g0=scene.g0,
                           compliance=scene.compliance)  # fmt: skip


@cache
def computed_library():
    """Four laws of rough patches, on few pixels: kinks, feet and tails as real laws have them."""
    found = given_statistics(3.31e-6, -0.2410, 3.6549)
    recipe = LawRecipe(found.bifractal, found.hdf, LawSettings(2.3734e9, tolerance=1e-8), (32, 32))
    return law_library(recipe, 4, seed=5)


def enriched(kind, n, scatter=1.5e-6):
    rng = np.random.default_rng(11)
    laws = {
        "exponential": lambda: OneLaw(exponential_law(4e5, 0.8e-6)),
        "linear": lambda: OneLaw(linear_law(5e11)),
        "computed": computed_library,
    }[kind]()
    return EnrichedGap(laws, rng.integers(len(laws), size=n), rng.normal(0, scatter, n))


def sparse_newton(scene, laws, mu, start):
    """Newton on all displacements with backtracking on the residual: nothing is condensed."""
    NT = (scene.N + sp.diags(mu) @ scene.T).T.tocsr()

    def residual(u):
        return scene.K @ u - NT @ (scene.w * laws.pressure(scene.contact.gap(u))) - scene.f

    u, r = start, residual(start)
    for _ in range(80):
        k = laws.stiffness(scene.contact.gap(u))
        du = spsolve((scene.K + NT @ sp.diags(scene.w * k) @ scene.N).tocsc(), -r)
        s = 1.0
        while s > 1e-8 and np.linalg.norm(residual(u + s * du)) > (1 - 0.1 * s) * np.linalg.norm(r):
            s *= 0.5
        u = u + s * du
        r = residual(u)
        if np.linalg.norm(du) < 1e-13 * np.linalg.norm(u):
            break
    assert np.linalg.norm(r) < 1e-10 * np.linalg.norm(scene.f)
    return u


@pytest.mark.parametrize("mu", [(0.0, 0.0), (0.5, 0.5), (0.1, 0.8)])
@pytest.mark.parametrize("kind", ["exponential", "linear", "computed"])
def test_condensed_equals_sparse(two_blocks, kind, mu):
    """Gaps, pressures and displacements to 1e-10; catches a sign of friction, a term of k0 lost.

    Friction that differs from element to element, too: catches that of a neighbour.
    """
    scene = two_blocks("guided")
    mu = np.linspace(*mu, scene.w.size)
    laws, ops = enriched(kind, scene.w.size), operators(scene)
    eq = equilibrium(ops, laws, mu, tolerance=1e-13)
    assert 3 < np.count_nonzero(eq.p > 1e3) <= scene.w.size
    u = displacement(ops, eq, scene.f)
    # Start of the other one: all elements closed by soft springs.
    soft = spsolve(scene.tangent(np.full(scene.w.size, 2e11), mu.mean()).tocsc(), scene.f)
    lift = scene.field(pad=lambda x: np.array([[0.0], [0], [1]]) + 0 * x)
    level = np.median(laws.first_touch()) if kind == "computed" else 0.0
    other = sparse_newton(scene, laws, mu, soft + lift * level)
    g = scene.contact.gap(other)
    scale = np.abs(g - laws.g_cr).max()
    np.testing.assert_allclose(eq.g, g, atol=1e-10 * scale)
    np.testing.assert_allclose(
        eq.p, laws.pressure(g), atol=1e-10 * eq.p.max() + 1e-10 * scale * eq.k.max()
    )
    np.testing.assert_allclose(u, other, atol=1e-9 * np.abs(other).max())
    np.testing.assert_array_equal(eq.k, laws.stiffness(eq.g))


@pytest.mark.parametrize("kind", ["exponential", "computed"])
def test_result_does_not_depend_on_the_load_steps(two_blocks, kind):
    """One to seven steps end in one state; catches a last step that keeps an earlier load."""
    scene = two_blocks("guided")
    laws, ops = enriched(kind, scene.w.size), operators(scene)
    one = equilibrium(ops, laws, 0.4, steps=1, tolerance=1e-12)
    assert len(one.iterations) == 1
    for steps in (2, 7):
        more = equilibrium(ops, laws, 0.4, steps=steps, tolerance=1e-12)
        assert len(more.iterations) == steps
        np.testing.assert_allclose(more.p, one.p, atol=1e-9 * one.p.max())


def test_reference_stiffness_cancels(two_blocks):
    """k0 is an auxiliary: two values two decades apart, one equilibrium."""
    pressures = []
    for k0 in (3e9, 3e11):
        scene = two_blocks("guided", k0=k0)
        laws = enriched("exponential", scene.w.size)
        pressures.append(equilibrium(operators(scene), laws, 0.5, tolerance=1e-13).p)
    np.testing.assert_allclose(pressures[0], pressures[1], rtol=1e-9, atol=1e-3)


def test_newton_ends_quadratically(two_blocks):
    """The last steps square the error; a tangent without mu T'W k N would make it linear."""
    scene = two_blocks("guided")
    laws = enriched("exponential", scene.w.size)
    for mu in (0.0, 0.7):
        r = np.array(equilibrium(operators(scene), laws, mu, tolerance=1e-14).history)
        r = r[(r < 0.3) & (r > 1e-13)]
        assert r.size >= 3
        # error(n + 1) <= c error(n)^2, with one c of order one for all steps.
        assert np.all(r[1:] < 10 * r[:-1] ** 2 + 1e-13), r


def test_the_full_step_is_taken_where_the_residual_is_round_off():
    """Its work changes sign there by chance: a shorter step would never bring the full loads."""
    k, g = 1e12, -np.array([1e-6, 2e-6, 3e-6])
    laws = EnrichedGap(OneLaw(linear_law(k)), np.zeros(3, int), np.zeros(3))
    newton = Newton(SimpleNamespace(w=np.full(3, 1e-5)), laws, 60)
    for size, step in ((1e-15, 1.0), (1e-6, 0.5)):
        off, dg = size * k * g, 1e-3 * g
        p = laws.pressure(g)
        chosen, *_ = newton._line_search(g, p + off, p, dg, -k * dg - 2 * off)
        assert chosen == pytest.approx(step)


@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_loads_contact_and_supports_balance(two_blocks, mu):
    """The pad is free along z: its contact force is the load; friction is held by the guides."""
    scene = two_blocks("guided")
    laws, ops = enriched("computed", scene.w.size), operators(scene)
    eq = equilibrium(ops, laws, mu, tolerance=1e-13)
    load = 5e5 * 12e-3 * 8e-3
    assert scene.w @ eq.p == pytest.approx(load, rel=1e-10)
    # The same mesh without supports: what K u leaves over is the force of the supports.
    whole = scene.on_the_same_mesh({})
    assert whole.free.size == 3 * scene.free.V.dofmap.index_map.size_global
    u = scene.free.expand(displacement(ops, eq, scene.f))[whole.free.local]
    traction = whole.N.T @ (whole.w * eq.p) + mu * whole.T.T @ (whole.w * eq.p)
    support = whole.K @ u - whole.f - traction
    held = (scene.free.column < 0)[whole.free.local]
    assert np.abs(support[~held]).max() < 1e-9 * np.abs(support).max()
    s = scene.contact.s[0]
    for direction, wanted in ((s, -mu * load), (np.cross([0, 0, 1.0], s), 0.0)):
        push = whole.field(pad=lambda x, d=direction: d[:, None] + 0 * x)
        assert push @ support == pytest.approx(wanted, abs=1e-9 * load)
    for axis in np.eye(3):
        both = whole.field(pad=lambda x, d=axis: d[:, None] + 0 * x,
                           plate=lambda x, d=axis: d[:, None] + 0 * x)  # fmt: skip
        turning = whole.field(pad=lambda x, d=axis: np.cross(d, x.T).T,
                              plate=lambda x, d=axis: np.cross(d, x.T).T)  # fmt: skip
        for motion, lever in ((both, 1.0), (turning, 1e-2)):
            assert motion @ (support + whole.f) == pytest.approx(0, abs=1e-8 * load * lever)


def test_no_mode_of_separation_is_taken_for_contact(two_blocks):
    """Laws act up to first touch and not beyond, and the critical gap shifts them by itself."""
    laws = EnrichedGap(OneLaw(linear_law(1e12)), np.zeros(3, int), np.array([0.0, 1e-6, -1e-6]))
    g = np.zeros(3)
    np.testing.assert_allclose(laws.pressure(g), [0, 1e6, 0])
    np.testing.assert_allclose(laws.delta(g), [0, -1e-6, 1e-6])
    np.testing.assert_allclose(laws.first_touch(), [0, 1e-6, -1e-6])


def test_critical_gaps_follow_the_heights():
    """Zero mean and S_q of the scan, and its shape: quantiles of the height distribution."""
    hdf = given_statistics(33.1e-6, -0.2410, 3.6549).hdf
    g_cr = draw_critical_gaps(hdf, 40000, np.random.default_rng(2))
    assert abs(g_cr.mean()) < 4 * 33.1e-6 / 200
    assert g_cr.std() == pytest.approx(33.1e-6, rel=0.02)
    u = np.linspace(0.05, 0.95, 7)
    np.testing.assert_allclose(np.quantile(g_cr, u), hdf.ppf(u), atol=0.03 * 33.1e-6)


def test_loads_that_pull_and_iterations_that_run_out_are_named(two_blocks):
    scene = two_blocks("guided")
    laws, ops = enriched("exponential", scene.w.size), operators(scene)
    pulled = replace(ops.compliance, Nf=-ops.compliance.Nf)
    with pytest.raises(Separated):
        equilibrium(SimpleNamespace(**vars(ops) | {"compliance": pulled}), laws)
    with pytest.raises(NotConverged, match="after 1 iterations"):
        equilibrium(ops, laws, 0.5, max_iterations=1)


@pytest.mark.together
def test_one_process_and_all_give_the_same_equilibrium(two_blocks):
    """To 1e-10; catches columns of the compliance shared wrongly."""
    results = []
    for alone in (True, False):
        scene = two_blocks("guided", alone=alone)
        results.append(
            equilibrium(operators(scene), enriched("computed", scene.w.size), 0.5, tolerance=1e-13)
        )
    np.testing.assert_allclose(results[0].p, results[1].p, atol=1e-9 * results[0].p.max())


def test_loads_of_the_record(two_blocks):
    """A load on an unknown face is an error that names those there are."""
    scene = two_blocks("guided")
    with pytest.raises(ValueError, match=r"loads: no face 'pad.piston'.*pad.top"):
        unit_loads(scene.mesh, scene.free, "pad.piston")
    with pytest.raises(ValueError, match=r"supports: no face 'pad.ears'"):
        assemble_elastic(scene.mesh, scene.materials, {"pad.ears": ["x"]})
    with pytest.raises(ValueError, match="no material"):
        assemble_elastic(scene.mesh, {}, {})


@pytest.mark.parametrize("stiffness", [1e10, 1e13, 1e16])
def test_a_tolerance_below_round_off_ends_at_round_off(two_blocks, stiffness):
    """Penalty beside critical gaps of 1 mm: eps x gap x stiffness over the pressure is left.

    1e-16 of a metre times 1e16 Pa/m is 1 Pa in 0.5 MPa; the iteration ran on to its limit and
    raised.
    """
    scene = two_blocks("guided")
    n = scene.w.size
    laws = EnrichedGap(OneLaw(linear_law(stiffness)), np.zeros(n, int), np.full(n, -1e-3))
    wanted, sharp = (
        equilibrium(operators(scene), laws, 0.3, tolerance=tolerance) for tolerance in (1e-8, 1e-17)
    )
    assert sharp.residual <= 16 * np.finfo(float).eps * (1 + 1e-3 * stiffness / 5e5)
    np.testing.assert_allclose(sharp.p, wanted.p, rtol=1e-6, atol=1e-6 * wanted.p.max())


@pytest.mark.parametrize("spread", [0.0, 3.0, 9.0])
def test_refinement_solves_to_double_precision(spread):
    """Backward stable whatever the condition: single precision alone would leave 1e-7, and at a
    spread of nine decades it does not converge and double precision takes over."""
    rng = np.random.default_rng(0)
    n = 120
    A = rng.normal(size=(n, n))
    NN, NT = A @ A.T / n, rng.normal(size=(n, n)) / n
    k = 10 ** rng.uniform(-spread / 2, spread / 2, n)
    dense = np.eye(n) + NN * k + NT * (0.3 * k)
    b = rng.normal(size=n)
    x = solved(dense, b, n)
    backward = np.linalg.norm(dense @ x - b) / (
        np.linalg.norm(dense, 2) * np.linalg.norm(x) + np.linalg.norm(b)
    )
    assert backward < 1e-14
    forward = np.linalg.norm(x - np.linalg.solve(dense, b)) / np.linalg.norm(x)
    assert forward < 1e-13 * np.linalg.cond(dense)


@pytest.mark.parametrize("closed", [2, 30])
def test_elements_that_close_on_the_way_from_a_start(closed):
    """What is found among the elements near contact at the start is a start for all of them."""
    rng = np.random.default_rng(3)
    n = 60
    A = rng.normal(size=(n, n))
    NN, NT = 1e-7 * (A @ A.T / n + np.eye(n)), 2e-9 * rng.normal(size=(n, n))
    bodies = Compliance(None, np.full(n, 1e11), NN, NT, np.full(n, -3e-6), carried=1.0)
    ops = SimpleNamespace(w=np.full(n, 1e-5), g0=np.zeros(n), compliance=bodies)
    laws = EnrichedGap(OneLaw(linear_law(1e12)), np.zeros(n, int), rng.normal(0.0, 2e-6, n))
    start = laws.first_touch() + np.where(np.arange(n) < closed, -1e-7, 5e-6)
    whole = equilibrium(ops, laws, 0.4)
    found = equilibrium(ops, laws, 0.4, start=start)
    assert np.sum(whole.p > 0) > 10 and len(found.iterations) == 2
    np.testing.assert_allclose(found.p, whole.p, rtol=1e-8, atol=1e-9 * whole.p.max())

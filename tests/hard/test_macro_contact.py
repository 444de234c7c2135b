"""Hard cases of the braking equilibrium: each gives a correct result or an error message."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from brake_fenicsx.errors import InaccurateResult, NotConverged, Separated
from brake_fenicsx.macro import EnrichedGap, displacement
from brake_fenicsx.macro.braking import with_compliance
from brake_fenicsx.macro.equilibrium import compliance, equilibrium
from brake_fenicsx.macro.solver import Factor
from brake_fenicsx.micro import OneLaw, exponential_law, linear_law
from brake_fenicsx.pipeline import assemble
from coarse_block import BLOCK, ROUGH
from contact_alone import ManyLinear

pytestmark = pytest.mark.hard

AREA = 12e-3 * 8e-3
LINEAR, SOFT, WIDE = linear_law(1e12), exponential_law(1e5, 1e-6), exponential_law(1e5, 2e-6)


def full_residual(scene, laws, eq):
    """Of the whole system, relative to the load, after a check of its gaps and pressures.

    With the pressures of the result: those of gaps read off u again carry the round-off of u times
    the stiffness of the law.
    """
    u = displacement(scene, eq, scene.f)
    g = scene.contact.gap(u)
    np.testing.assert_allclose(g, eq.g, atol=1e-9 * np.abs(u).max())
    np.testing.assert_array_equal(eq.p, laws.pressure(eq.g))
    pushed = (scene.N + eq.mu * scene.T).T @ (scene.w * eq.p)
    return np.linalg.norm(scene.K @ u - pushed - scene.f) / np.linalg.norm(scene.f)


@pytest.mark.parametrize(
    ("pressure", "law", "mu"),
    [(-1e5, law, mu) for law in (LINEAR, SOFT) for mu in (0.0, 0.5)] + [(0.0, LINEAR, 0.0)],
)
def test_pulled_apart_or_not_loaded(two_blocks, pressure, law, mu):
    """A load away from the plate, or none, has no equilibrium: error message."""
    scene = two_blocks("guided", pressure=pressure)
    with pytest.raises(Separated):
        equilibrium(scene, scene.enriched(law), mu)


@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_one_closed_patch(two_blocks, mu):
    """One element protrudes by far: it carries the whole load, all others stay open."""
    scene = two_blocks("upright", pressure=1e4)
    n = scene.w.size
    one = int(np.argmin(np.linalg.norm(scene.contact.points, axis=1)))
    g_cr = np.full(n, -1e-3)
    g_cr[one] = 0.0
    laws = scene.enriched(linear_law(1e13), g_cr)
    eq = equilibrium(scene, laws, mu)
    wanted = np.zeros(n)
    wanted[one] = 1e4 * AREA / scene.w[one]
    if mu == 0.0:
        # The sides are held in the plane only: all of the load passes through the one element.
        np.testing.assert_allclose(eq.p, wanted, rtol=1e-9)
    assert np.flatnonzero(eq.p).tolist() == [one]
    assert scene.w @ eq.p == pytest.approx(1e4 * AREA, rel=1e-9)
    assert full_residual(scene, laws, eq) < 1e-8


@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_one_law_a_million_times_stiffer(two_blocks, mu):
    """Compared with a sparse solve on the closed elements; all others must be open."""
    scene = two_blocks("guided")
    n = scene.w.size
    k = np.full(n, 1e10)
    k[n // 2] = 1e16
    # Together the soft ones carry the load at the gap at which the stiff one touches.
    g_cr = np.where(k > 1e10, 0.0, 50e-6)
    laws = EnrichedGap(ManyLinear(k), np.arange(n), g_cr)
    eq = equilibrium(scene, laws, mu, tolerance=1e-9)
    is_open = eq.p == 0
    assert is_open.sum() < n / 2
    k[is_open] = 0.0
    # p = k (g_cr - g): the critical gap acts as a load.
    push = (scene.N + mu * scene.T).T @ (scene.w * k * g_cr)
    u = spsolve(scene.tangent(k, mu).tocsc(), scene.f + push)
    g = scene.contact.gap(u)
    assert np.all(g[is_open] >= g_cr[is_open])
    p = k * (g_cr - g)
    soft = np.arange(n) != n // 2
    np.testing.assert_allclose(eq.p[soft], p[soft], rtol=1e-6)
    assert scene.w @ eq.p == pytest.approx(5e5 * AREA, rel=1e-8)


@pytest.mark.parametrize("ratio", [1e-3, 1.0, 1e3, 1e6])
def test_law_from_a_thousandth_to_a_million_of_the_bulk(two_blocks, ratio):
    """Law stiffness relative to E / height, about 3e11 Pa/m: the loads balance in all cases."""
    scene = two_blocks("guided")
    laws = scene.enriched(linear_law(3e11 * ratio))
    eq = equilibrium(scene, laws, 0.3)
    assert scene.w @ eq.p == pytest.approx(5e5 * AREA, rel=1e-7)
    assert full_residual(scene, laws, eq) < 1e-6


@pytest.mark.parametrize("penalty", [1e15, 1e17, 1e19])
@pytest.mark.parametrize("steps", [1, 4])
def test_stiff_penalty_where_the_block_lifts(two_blocks, penalty, steps):
    """Penalty 1e3 to 1e7 times E / h, leading edge open: compared with a sparse solve.

    Springs that hold open elements on the way must not be stiffer than the block.
    """
    scene = two_blocks("guided", direction=(1.0, 0.0, 0.0))
    eq = equilibrium(scene, scene.enriched(linear_law(penalty)), 0.7, steps=steps)
    closed = eq.p > 0
    assert 0.3 < closed.mean() < 0.7
    g = scene.N @ spsolve(scene.tangent(penalty * closed, 0.7).tocsc(), scene.f)
    assert np.array_equal(g < 0, closed)
    np.testing.assert_allclose(eq.p[closed], -penalty * g[closed], rtol=1e-4)
    assert scene.w @ eq.p == pytest.approx(5e5 * AREA, rel=1e-8)


def test_critical_gaps_beyond_any_closure(two_blocks):
    """A third of the elements cannot touch: the other elements carry the load."""
    scene = two_blocks("guided")
    g_cr = np.zeros(scene.w.size)
    g_cr[::3] = -10e-3
    laws = scene.enriched(LINEAR, g_cr)
    eq = equilibrium(scene, laws, 0.4)
    assert np.all(eq.p[::3] == 0) and np.all(eq.k[::3] == 0)
    assert scene.w @ eq.p == pytest.approx(5e5 * AREA, rel=1e-9)
    assert full_residual(scene, laws, eq) < 1e-8


@pytest.mark.parametrize("mu", [0.0, 0.5, 0.8])
@pytest.mark.parametrize(
    ("law", "scatter", "seeds"), [(WIDE, 33e-6, 3), (WIDE, 330e-6, 3), (LINEAR, 3e-3, 25)]
)
def test_critical_gaps_far_wider_than_the_elastic_closure(two_blocks, law, scatter, seeds, mu):
    """Few patches carry the load, depending on the tilt of the free pad; one load step.

    Catches a start from which Newton's step flings the pad away (singular tangent, overflow), and
    springs of open elements that are taken away too early.
    """
    scene = two_blocks("guided")
    for seed in range(seeds):
        g_cr = np.random.default_rng(seed).normal(0, scatter, scene.w.size)
        laws = scene.enriched(law, g_cr)
        eq = equilibrium(scene, laws, mu)
        assert scene.w @ eq.p == pytest.approx(5e5 * AREA, rel=1e-8)
        assert full_residual(scene, laws, eq) < 1e-7


def test_friction_that_tips_the_block_over(two_blocks):
    """Guided 6 mm above a face 12 mm long: at mu = 1 all pressure would be at the edge.

    Moments: the centre of pressure lies mu x 6 mm behind the middle, and the block ends there.
    """
    scene = two_blocks("guided", direction=(1.0, 0.0, 0.0))
    laws = scene.enriched(WIDE)
    eq = equilibrium(scene, laws, 0.75, steps=4)
    centre = scene.w * eq.p @ scene.contact.points[:, 0] / (scene.w @ eq.p)
    assert centre == pytest.approx(-0.75 * 6e-3, rel=0.02)
    with pytest.raises(NotConverged):
        equilibrium(scene, laws, 1.1, steps=4)


def test_friction_beyond_tipping_from_an_equilibrium_nearby():
    """Block of 20 mm height: the centre of pressure lies 20 mm x mu behind the middle.

    The last column of elements ends that at mu = 0.833. Beyond it the matrix is singular, and a
    step of some 1e10 m made pressures that balanced nothing pass for a solution, at one or another
    friction with the kernels of every processor.
    """
    block = assemble(BLOCK, MPI.COMM_SELF, ROUGH)
    n = block.w.size
    laws = EnrichedGap(OneLaw(linear_law(2e13)), np.zeros(n, int), np.zeros(n))
    block = with_compliance(block, laws)
    near = equilibrium(block, laws, 0.8)
    for mu in (0.81, 0.83):
        force = block.w * equilibrium(block, laws, mu, start=near.g).p
        assert force @ block.points[:, 0] / force.sum() == pytest.approx(-20e-3 * mu, rel=1e-9)
    for mu in (0.85, 0.93, 1.0, 1.07, 1.15, 1.3):
        with pytest.raises(NotConverged):
            equilibrium(block, laws, mu, start=near.g)


def test_pad_that_rests_by_contact_alone(two_blocks):
    """K is singular; the matrix with contact springs can be factored."""
    scene = two_blocks("guided")
    with pytest.raises(InaccurateResult, match="a part can move freely"):
        Factor(scene.elastic.K)
    assert np.all(np.linalg.eigvalsh(scene.compliance.NN) > -1e-20)


def test_part_without_any_hold_is_named(two_blocks):
    """Frictionless contact does not prevent sliding: the error reports three rigid motions."""
    scene = two_blocks("loose")
    with pytest.raises(InaccurateResult, match="a part can move freely"):
        compliance(scene.elastic.K, scene.N, scene.T, scene.w, scene.f, scene.k0, scene.comm)


def test_initial_gap_is_closed_by_the_ramp(two_blocks):
    """A pad free along z starts 1 mm above the plate: the same equilibrium."""
    plate = ("length", 20e-3), ("width", 14e-3), ("height", 6e-3), ("z", -6e-3), ("size", 7e-3)
    pad = ("length", 12e-3), ("width", 8e-3), ("height", 6e-3), ("size", 4e-3)
    scene, touching = (two_blocks("guided", pad=(*pad, ("z", z)), plate=plate) for z in (1e-3, 0.0))
    eq = equilibrium(scene, scene.enriched(LINEAR), 0.3)
    closed = equilibrium(touching, touching.enriched(LINEAR), 0.3)
    np.testing.assert_allclose(scene.g0, 1e-3)
    np.testing.assert_allclose(eq.p, closed.p, rtol=1e-3)
    assert scene.w @ eq.p == pytest.approx(5e5 * AREA, rel=1e-8)

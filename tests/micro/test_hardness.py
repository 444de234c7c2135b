"""Contact with a hardness: limits, brute force, certificate, and both stiffnesses."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from brake_fenicsx.errors import SceneError
from brake_fenicsx.micro import solve_contact
from brake_fenicsx.micro.active import AllPixels, active_set
from brake_fenicsx.micro.halfspace import half_space
from brake_fenicsx.micro.qp import certify, projected_cg
from brake_fenicsx.micro.sweep import steps_per_decade, sweep
from brake_fenicsx.surface import given_statistics, synthesise
from contact_closed_forms import Hertz

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
SIZE = (2.825e-3, 2.825e-3)
UNIT = (1.0, 1.0)


def rough(n=32, seed=0):
    h = synthesise(PAPER.bifractal, PAPER.hdf, (n, n), SIZE, np.random.default_rng(seed)).heights
    return h - h.mean()


def grid(n, boundary="free"):
    return half_space((n, n), (SIZE[0] / n, SIZE[1] / n), boundary)


def brute_force(h, d, cap):
    """Pressures over E* of the dense program by SciPy's bounded least squares."""
    space = half_space(h.shape, tuple(1.0 / np.array(h.shape)))
    every = np.arange(h.size)
    root = np.linalg.cholesky(space.block(every, every)).T
    u = np.linalg.solve(root.T, (h - h.mean() - d).ravel())
    found = lsq_linear(root, u, (0.0, cap), method="bvls", tol=1e-15, max_iter=10**4)
    return found.x.reshape(h.shape)


SURFACES = {
    "random": lambda x: x,
    "steps": lambda x: np.round(1.5 * x),
    "checkerboard": lambda x: np.indices(x.shape).sum(axis=0) % 2.0,
    "plateau": lambda x: np.minimum(x, 0.3),
    "one pixel up": lambda x: np.where(x == x.max(), 1.0, 0.0),
    "one pixel down": lambda x: np.where(x == x.min(), -1.0, 0.0),
}


@pytest.mark.parametrize("kind", SURFACES)
@pytest.mark.parametrize("solver", ["auto", "pcg"])
def test_both_bounds_against_brute_force(kind, solver):
    """Random small surfaces and those on which pivoting likes to cycle."""
    rng = np.random.default_rng(7)
    for shape in [(3, 3), (5, 4), (9, 9)]:
        for _ in range(3):
            h = SURFACES[kind](rng.standard_normal(shape))
            d = (h - h.mean()).max() - rng.uniform(0.05, 3.0)
            elastic = solve_contact(h, UNIT, 1.0, separation=d).pressure.max()
            cap = elastic * 10.0 ** rng.uniform(-2.0, 0.0)
            p = brute_force(h, d, cap)
            settings = {"solver": solver, "tol": 1e-12, "hardness": cap}
            near = solve_contact(h, UNIT, 1.0, separation=d, **settings)
            np.testing.assert_allclose(near.pressure, p, atol=1e-6 * cap)
            if p.mean() < cap * (1.0 - 1e-9):
                pressed = solve_contact(h, UNIT, 1.0, load=p.mean(), **settings)
                np.testing.assert_allclose(pressed.pressure, p, atol=1e-6 * cap)


@pytest.mark.parametrize("boundary", ["free", "periodic"])
@pytest.mark.parametrize("level", [1e-4, 1e-2])
def test_solvers_agree_with_a_hardness(boundary, level):
    """Load and separation, active set and gradients: one and the same state."""
    h, E, hardness = rough(48), 2.3734e9, 2e8
    load = level * E * SIZE[0] * SIZE[1]
    settings = {"boundary": boundary, "tol": 1e-12, "hardness": hardness}
    first = solve_contact(h, SIZE, E, load=load, solver="pcg", **settings)
    assert first.plastic_fraction > 0.0 and first.plastic_depth > 0.0
    assert first.pressure.max() == pytest.approx(hardness, rel=1e-12)
    assert first.penetration < 1e-6 * first.plastic_depth
    for solver in ("active-set", "pcg"):
        d = first.separation
        other = solve_contact(h, SIZE, E, separation=d, solver=solver, **settings)
        np.testing.assert_allclose(other.pressure, first.pressure, atol=1e-5 * hardness)
        assert other.load == pytest.approx(load, rel=1e-6)
        assert other.plastic_depth == pytest.approx(first.plastic_depth, rel=1e-6)


@pytest.mark.parametrize("solver", ["active-set", "pcg"])
@pytest.mark.parametrize("boundary", ["free", "periodic"])
def test_infinite_hardness_is_the_elastic_contact(solver, boundary):
    h = rough(48)
    settings = {"load": 1e-3 * SIZE[0] ** 2, "boundary": boundary, "solver": solver, "tol": 1e-13}
    elastic = solve_contact(h, SIZE, 1.0, **settings)
    hard = solve_contact(h, SIZE, 1.0, hardness=1e6, **settings)
    np.testing.assert_allclose(hard.pressure, elastic.pressure, atol=2e-6 * elastic.pressure.max())
    assert hard.separation == pytest.approx(elastic.separation, rel=1e-9)
    assert hard.plastic_fraction == 0.0 == hard.plastic_depth
    space = grid(48, boundary)
    few = [sweep(space, h, 0.01, 1.0, steps_per_decade(40, 8), 1e-8, c) for c in (None, 1e6)]
    assert len(few[0]) == len(few[1])
    for a, b in zip(*few, strict=True):
        assert (a.d, a.total, a.stiffness) == (b.d, b.total, b.stiffness)


def test_sphere_from_hertz_to_full_plasticity():
    """Elastic below first yield; far beyond it the force is the hardness times the area."""
    n, R, E = 96, 10.0, 1.0
    x = (np.arange(n) - n // 2) / n
    h = -(x[:, None] ** 2 + x[None, :] ** 2) / (2 * R)
    hertz = Hertz(R, E, 4.0 / 3.0 * E * 0.25**3 / R)
    below = solve_contact(h, UNIT, E, load=hertz.load, tol=1e-10, hardness=1.02 * hertz.peak)
    assert below.plastic_fraction == 0.0
    assert below.pressure.max() == pytest.approx(hertz.peak, rel=1e-3)
    beyond = solve_contact(h, UNIT, E, load=hertz.load, tol=1e-10, hardness=0.9 * hertz.peak)
    assert beyond.plastic_fraction > 0.0
    soft, load = hertz.peak / 20.0, hertz.load / 8.0
    plastic = solve_contact(h, UNIT, E, load=load, tol=1e-10, hardness=soft)
    # Only the rim is elastic, a pixel wide at most: 2 / 31 of a disc of 31 pixels in radius.
    assert plastic.plastic_fraction > (1.0 - 2.0 / 31.0) * plastic.area_fraction
    assert load == pytest.approx(soft * plastic.area_fraction, rel=1.0 / 31.0)
    # The cap above the plane is gone; the rim sinks under uniform pressure by 4 H a / (pi E*)
    # (Johnson, Contact Mechanics, Eq. 3.29b).
    a = np.sqrt(load / soft / np.pi)
    approach = h.max() - h.mean() - plastic.separation
    assert approach == pytest.approx(a**2 / (2 * R) + 4.0 * soft * a / (np.pi * E), rel=0.01)


@pytest.mark.parametrize("boundary", ["free", "periodic"])
def test_load_and_contact_rise_with_the_approach(boundary):
    """Softer surfaces let the plane come nearer; area and load rise with the approach."""
    h = rough(32)
    for hardness in (0.3, 0.05):
        found = [
            solve_contact(
                h, SIZE, 1.0, load=level * SIZE[0] ** 2, boundary=boundary, hardness=hardness
            )
            for level in (1e-4, 1e-3, 1e-2, 0.04)
        ]
        assert np.all(np.diff([f.separation for f in found]) < 0.0)
        assert np.all(np.diff([f.area_fraction for f in found]) > 0.0)
        assert np.all(np.diff([f.plastic_fraction for f in found]) >= 0.0)
        assert all(f.mean_pressure <= hardness * f.area_fraction * (1 + 1e-9) for f in found)
        nearer = solve_contact(
            h, SIZE, 1.0, load=1e-2 * SIZE[0] ** 2, boundary=boundary, hardness=0.5 * hardness
        )
        assert nearer.separation < found[2].separation


def test_certificate_bounds_the_energy_under_a_hardness():
    """Arbitrary admissible pressures: the true energy error is below the reported gap."""
    h, n = rough(16), 16
    rng = np.random.default_rng(3)
    for boundary, d in (("free", 0.0), ("periodic", 0.5 * h.std())):
        space = grid(n, boundary)
        elastic = projected_cg(space, h, d, None, np.ones_like(h), 1e-13)
        for share in (0.05, 0.3, 0.9, 1.5):
            cap = share * float(elastic.p.max())
            best = projected_cg(space, h, d, None, np.ones_like(h), 1e-13, cap=cap)
            lowest = 0.5 * np.vdot(best.p, best.w + h - d) - np.vdot(best.p, h - d)
            assert lowest >= 0.5 * np.vdot(elastic.p, elastic.w + h - d) - np.vdot(
                elastic.p, h - d
            ) * (1 + 1e-9)
            for _ in range(25):
                noise = rng.exponential(cap * 10 ** rng.uniform(-6, 0), h.shape)
                p = np.minimum(best.p * rng.uniform(0.0, 2.0, h.shape) + noise, cap)
                w = space.apply(p) - h + d
                gap = certify(space, h, p, w, d, False, cap).gap * np.vdot(p, w + h - d)
                energy = 0.5 * np.vdot(p, w + h - d) - np.vdot(p, h - d)
                assert energy - lowest <= gap * (1 + 1e-9)
            # At the load of the solution its energy is the lowest of all with the same sum.
            load = float(best.p.sum())
            q = np.minimum(rng.permutation(best.p.ravel()).reshape(h.shape), cap)
            w = space.apply(q) - h
            gap = certify(space, h, q, w, 0.0, True, cap).gap * np.vdot(q, w + h)
            energy = 0.5 * np.vdot(q, w + h) - np.vdot(q, h)
            assert q.sum() == pytest.approx(load, rel=1e-12)
            assert 0.0 < energy - (lowest - d * load) <= gap * (1 + 1e-9)


def test_certificate_refuses_what_only_looks_right():
    """A yielding pixel that opens and an elastic one that is overlapped are errors."""
    h, space = rough(16), grid(16)
    cap = 0.1
    best = projected_cg(space, h, 0.0, None, np.ones_like(h), 1e-13, cap=cap)
    assert certify(space, h, best.p, best.w, 0.0, False, cap).gap <= 1e-12
    below = np.unravel_index(np.argmax(np.where(best.p >= cap, best.w, -np.inf)), h.shape)
    opened, overlapped = best.p.copy(), best.p.copy()
    opened[h < np.sort(h, axis=None)[8]] = cap
    overlapped[below] = 0.5 * cap
    for p in (opened, overlapped):
        w = space.apply(p) - h
        for load_control in (False, True):
            assert certify(space, h, p, w, 0.0, load_control, cap).gap > 1e-4


def test_steps_stop_below_the_hardness():
    """A law up to 0.97 H is monotone and its area tends to the load over the hardness."""
    h, cap = rough(32), 0.05
    steps = sweep(grid(32), h, 1e-3, 0.97 * cap * h.size, steps_per_decade(40, 8), 1e-8, cap)
    assert np.all(np.diff([s.d for s in steps]) < 0.0)
    assert np.all(np.diff([s.total for s in steps]) > 0.0)
    assert steps[-1].total == pytest.approx(0.97 * cap * h.size, rel=1e-12)
    assert 0.97 <= steps[-1].touching / h.size < 0.99
    for highest in (cap * h.size, 2.0 * cap * h.size):
        with pytest.raises(SceneError, match="hardness"):
            sweep(grid(32), h, 1e-3, highest, steps_per_decade(40, 8), 1e-8, cap)


@pytest.mark.parametrize("boundary", ["free", "periodic"])
def test_both_stiffnesses_against_finite_differences(boundary):
    """Loading goes on with the plastic pixels at the hardness; unloading is elastic.

    The plastic surface is the one whose elastic contact gives the same state: lowered by the
    plastic penetration.
    """
    h, n, cap = rough(48), 48, 0.04
    space = grid(n, boundary)
    steps = sweep(space, h, 1e-2, 20.0, steps_per_decade(40, 8), 1e-12, cap)
    assert all(s.vibration >= s.stiffness * (1.0 - 1e-3) for s in steps)
    assert steps[0].vibration == steps[0].stiffness
    at = next(s for s in steps if s.touching > 60)
    assert at.vibration > 1.5 * at.stiffness
    state = projected_cg(space, h, at.d, None, np.maximum(h, 0.0), 1e-13, cap=cap)
    step = 1e-7 * h.std()

    def load(heights, d, hardness):
        overlap = np.flatnonzero(state.p.ravel() > 0.0)
        held = np.flatnonzero(state.p.ravel() >= hardness)
        return active_set(
            AllPixels(space, heights), d, None, overlap, cap=hardness, held=held
        ).pressure.sum()

    onwards = (load(h, at.d - step, cap) - load(h, at.d, cap)) / step
    assert onwards == pytest.approx(at.stiffness, rel=1e-4)
    worn = h + np.where(state.p >= cap, state.w, 0.0)
    assert load(worn, at.d, np.inf) == pytest.approx(at.total, rel=1e-6)
    back = (load(worn, at.d, np.inf) - load(worn, at.d + step, np.inf)) / step
    assert back == pytest.approx(at.vibration, rel=1e-4)


@pytest.mark.parametrize("hardness", [0.0, -1.0, np.nan, np.inf, 1e-3])
def test_hardness_that_cannot_be(hardness):
    """Not positive, or below the mean pressure of the load."""
    with pytest.raises(SceneError, match="hardness"):
        solve_contact(rough(8), SIZE, 1.0, load=1e-3 * SIZE[0] * SIZE[1], hardness=hardness)

"""Laws: one function in three forms, monotone, smooth, and true to the contact solutions."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from brake_fenicsx.errors import SceneError, SurfaceError
from brake_fenicsx.micro import (
    LawRecipe,
    LawSettings,
    LawSteps,
    OneLaw,
    contact_law,
    exponential_law,
    join_laws,
    law_library,
    linear_law,
    load_laws,
    make_library,
    save_laws,
    scaled_laws,
    solve_contact,
)
from brake_fenicsx.surface import given_statistics, make_topography, synthesise

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
E_STAR = 2.3734e9
SIZE = (2.825e-3, 2.825e-3)


def surface(seed, n=128):
    return synthesise(PAPER.bifractal, PAPER.hdf, (n, n), SIZE, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def law():
    return contact_law(surface(0), E_STAR)


def deviations(seed):
    """Largest relative deviations of p and -p' from a 200-step law, up to p = 0.1 E*."""
    fine = contact_law(surface(seed), E_STAR, steps=200, tolerance=1e-8)
    usual = contact_law(surface(seed), E_STAR)
    d = np.linspace(fine.steps[0][-1], fine.steps[0][0], 20001)
    d = d[fine.pressure(d) <= 0.1 * E_STAR]
    p = np.abs(usual.pressure(d) / fine.pressure(d) - 1.0).max()
    return p, np.abs(usual.stiffness(d) / fine.stiffness(d) - 1.0).max()


@pytest.mark.parametrize("seed", [0, 4])
def test_law_agrees_with_200_steps(seed):
    p, k = deviations(seed)
    assert p < 0.01
    assert k < 0.03


@pytest.mark.parametrize("share", [1e-3, 0.3, 1.0, 3.0])
def test_a_library_at_one_pressure(law, share):
    """Below its first step, between steps, at the last one and beyond: p(d) is that pressure."""
    other = contact_law(surface(1), E_STAR, steps=12)
    library = make_library([law.steps, other.steps])
    first, last = library.p[:, 0].min(), library.p.max(axis=1).min()
    p = first / 2 if share == 1e-3 else share * last
    at = library.at_pressure(p)
    for i, one in enumerate((library[0], library[1])):
        assert one.pressure(at.d[i]) == pytest.approx(p, rel=1e-9)
        found = one.stiffness(at.d[i]), one.vibration(at.d[i])
        assert found == (pytest.approx(at.k[i], rel=1e-9), pytest.approx(at.v[i], rel=1e-9))
    assert at.p.tolist() == [p, p] and at.area.shape == (2,)
    np.testing.assert_array_equal(library.at_pressure(f"{float(p)!r} Pa").d, at.d)


@pytest.mark.parametrize(
    ("pressure", "said"), [("2 mm", "wrong unit"), (-1.0, "one positive"), (None, "one finite")]
)
def test_a_wrong_pressure_is_one_line(law, pressure, said):
    with pytest.raises(SceneError, match=f"pressure = .*{said}"):
        make_library([law.steps]).at_pressure(pressure)


@pytest.mark.slow
def test_laws_agree_with_200_steps_over_many_surfaces():
    found = np.array([deviations(seed) for seed in range(100, 130)])
    assert found[:, 0].max() < 0.01
    assert found[:, 1].max() < 0.03, found[:, 1]


def test_law_agrees_with_fresh_contact_solutions(law):
    """Between its steps, against solutions from cold at far-field separations."""
    h = surface(0)
    bulk = SIZE[0] / E_STAR / 1.1492083
    for p in np.geomspace(2e-5, 0.08, 9) * E_STAR:
        found = solve_contact(h.heights, h.size, E_STAR, load=p * np.prod(SIZE), tol=1e-10)
        # The law's separation is free of the sinking of the whole patch.
        d = found.separation + bulk * p
        assert law.pressure(d) == pytest.approx(p, rel=0.01)


def test_bulk_compliance_can_be_kept(law):
    raw = contact_law(surface(0), E_STAR, bulk_compliance="keep")
    (d, p, k), (d_raw, p_raw, k_raw) = law.steps[:3], raw.steps[:3]
    np.testing.assert_allclose(p, p_raw, rtol=1e-12)
    c = SIZE[0] / E_STAR / 1.1492083
    np.testing.assert_allclose(d - d_raw, c * p, rtol=1e-6)
    use = slice(0, -1)  # stiffnesses are limited where ln p would not be monotone
    np.testing.assert_allclose(1 / k_raw[use] - 1 / k[use], c, rtol=1e-4)


@pytest.mark.slow
def test_bulk_free_law_is_the_periodic_law_on_average():
    """Mean over surfaces within 0.05 S_q up to p / E* = 0.1; one surface may be 0.25 away."""
    miss = []
    for seed in range(8):
        free = contact_law(surface(seed), E_STAR)
        periodic = contact_law(surface(seed), E_STAR, boundary="periodic")
        levels = np.log(np.array([1e-4, 1e-3, 1e-2, 0.1]) * E_STAR)
        miss.append([
            np.interp(level, np.log(free.steps[1]), free.steps[0])
            - np.interp(level, np.log(periodic.steps[1]), periodic.steps[0])
            for level in levels
        ])  # fmt: skip
    miss = np.array(miss) / PAPER.S_q
    assert np.abs(miss.mean(axis=0)).max() < 0.05, miss.mean(axis=0)
    assert np.abs(miss).max() < 0.25


def test_zero_beyond_first_touch_and_a_short_foot(law):
    touch, top = law.first_touch, surface(0).heights.max()
    assert np.all(law.pressure(touch + np.array([0.0, 1e-12, 1e-6, 1.0])) == 0.0)
    assert np.all(law.stiffness(touch + np.array([0.0, 1e-6])) == 0.0)
    assert 0.0 < touch - law.steps[0][0] <= 0.04 * PAPER.S_q
    assert abs(touch - top) <= 0.02 * PAPER.S_q


def test_straight_beyond_the_last_step(law):
    d, p, k = (a[-1] for a in law.steps[:3])
    x = d - np.array([1e-6, 1e-4, 1.0])
    np.testing.assert_allclose(law.pressure(x), p + k * (d - x), rtol=1e-14)
    np.testing.assert_allclose(law.stiffness(x), k, rtol=1e-14)


def test_pressure_and_stiffness_are_continuous(law):
    """C1 at every step, at the end of the foot and at first touch."""
    d, p, k = law.steps[:3]
    step = 1e-9 * np.diff(d).min()
    for f, scale in ((law.pressure, p), (law.stiffness, k)):
        jump = f(d + step) - f(d - step)
        np.testing.assert_allclose(jump, 0.0, atol=1e-7 * scale.max())
        np.testing.assert_allclose(jump / scale, 0.0, atol=1e-5)
    assert law.stiffness(law.first_touch - 1e-15) < 1e-6 * k[0]


def random_steps(rng, n):
    """Steps of a monotone law with slopes that need not fit the chords."""
    d = np.cumsum(-rng.exponential(1e-6, n)) + 1e-4
    p = np.cumsum(rng.exponential(1.0, n)) * 10.0 ** rng.uniform(-2, 8)
    return LawSteps(d, p, rng.exponential(1.0, n) * p / 1e-6)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 40))
def test_any_law_is_monotone_and_its_derivatives_fit(seed, n):
    rng = np.random.default_rng(seed)
    law = make_library([random_steps(rng, n)])[0]
    d = law.steps[0]
    span = law.first_touch - d[-1] + 1e-6
    x = np.sort(rng.uniform(d[-1] - 0.2 * span, law.first_touch + 0.1 * span, 300))
    p, k = law.pressure(x), law.stiffness(x)
    assert np.all(np.diff(p) <= 0.0) and np.all(k >= 0.0)
    # Central differences, away from steps where the second derivative jumps.
    h = 1e-5 * span / n
    corner = np.concatenate([d, [law.first_touch]])
    far = np.abs(x[:, None] - corner).min(axis=1) > 2 * h
    # Their error, h^2 / 6 times the third derivative, is large between two steps that are close.
    order = np.sort(corner)
    far &= np.diff(np.r_[-np.inf, order, np.inf])[np.searchsorted(order, x)] > 1e3 * h
    slope = (law.pressure(x[far] - h) - law.pressure(x[far] + h)) / (2 * h)
    np.testing.assert_allclose(slope, k[far], rtol=1e-3, atol=1e-5 * k.max())


def test_library_is_its_laws():
    """Evaluation of many laws at once against one by one, rows of different length."""
    rng = np.random.default_rng(0)
    laws = make_library([random_steps(rng, n) for n in (5, 1, 30, 17)], [3, 1, 4, 1])
    index = rng.integers(0, 4, 200)
    d = rng.uniform(laws.d.min() - 1e-6, laws.first_touch(np.arange(4)).max() + 1e-6, 200)
    p, k = laws.loading(index, d)
    every = {"pressure": p, "stiffness": k}
    every["vibration"], _ = laws.vibration(index, d)
    for name, many in every.items():
        one = [getattr(laws[i], name)(x) for i, x in zip(index, d, strict=True)]
        np.testing.assert_array_equal(many, one)
    np.testing.assert_array_equal(laws.first_touch(index), [laws[i].first_touch for i in index])
    assert len(laws) == len(list(laws)) == 4
    with pytest.raises(IndexError):
        laws[4]


def test_scaled_laws_are_stiffer_everywhere(law):
    """Another modulus: p, -p', v and dv/dd grow by one factor, first touch stays."""
    x = np.linspace(law.steps.d[-1] - 1e-5, law.first_touch, 50)
    index = np.zeros(50, dtype=int)
    other = scaled_laws(law.library, 1.7)
    assert scaled_laws(law.library, 1.0) is law.library
    for name in ("loading", "vibration"):
        wanted = 1.7 * np.array(getattr(law.library, name)(index, x))
        np.testing.assert_allclose(getattr(other, name)(index, x), wanted, 1e-12)
    np.testing.assert_array_equal(other.first_touch(index), law.library.first_touch(index))
    assert other.highest(index)[0] == pytest.approx(1.7 * law.steps.p[-1], rel=1e-15)


def test_save_and_load(tmp_path, law):
    laws = make_library(
        [law.steps, contact_law(surface(3, 32), E_STAR).steps], [11, 12], {"E_star": E_STAR}
    )
    save_laws(tmp_path / "laws.npz", laws)
    back = load_laws(tmp_path / "laws.npz")
    assert back.settings == {"E_star": E_STAR}
    np.testing.assert_array_equal(back.seed, [11, 12])
    x = np.linspace(-1e-4, 2e-4, 100)
    for i in range(2):
        np.testing.assert_array_equal(back[i].pressure(x), laws[i].pressure(x))
        np.testing.assert_array_equal(back[i].vibration(x), laws[i].vibration(x))


def test_loading_something_else_is_named(tmp_path):
    with pytest.raises(SceneError, match="missing"):
        load_laws(tmp_path / "missing.npz")
    np.savez(tmp_path / "other.npz", a=1)
    with pytest.raises(SceneError, match=r"other\.npz"):
        load_laws(tmp_path / "other.npz")


def test_laws_of_an_earlier_version_are_refused(tmp_path):
    """They stored the ratio of both stiffnesses, whose product was wrong between the steps."""
    table = np.ones((1, 2))
    np.savez(tmp_path / "laws.npz", d=table, p=table, k=table, ratio=table, settings="{}")
    with pytest.raises(SceneError, match="earlier version"):
        load_laws(tmp_path / "laws.npz")


def test_a_law_of_a_library_can_be_made_again_alone():
    """Law i draws from its own child of the seed, so that any process may make it."""
    recipe = LawRecipe(PAPER.bifractal, PAPER.hdf, LawSettings(E_STAR), shape=(32, 32))
    laws = law_library(recipe, 3, seed=7)
    np.testing.assert_array_equal(laws[2].steps.d, recipe.law(7, 2).d)
    assert laws[0].first_touch != laws[1].first_touch


@pytest.mark.long
@pytest.mark.parametrize("hardness", [None, 200e6])
@pytest.mark.parametrize("boundary", ["free", "periodic"])
def test_a_law_to_a_low_pressure_is_the_whole_law_up_to_it(hardness, boundary):
    """Digit for digit, smoothed slopes included; beyond its end it goes on as a straight line."""
    recipe = LawRecipe(
        PAPER.bifractal, PAPER.hdf, LawSettings(E_STAR, hardness=hardness, boundary=boundary),
        (96, 96),
    )  # fmt: skip
    whole, short = recipe.law(1, 0), recipe.law(1, 0, 0.5e6)
    reach = recipe.reach(short, 0.5e6)
    assert 0.5e6 <= reach < short.p[-1] < 0.1 * whole.p[-1]
    known = np.count_nonzero(short.p <= reach)
    for ours, theirs in zip(short, whole, strict=True):
        if ours is not None:
            assert np.array_equal(ours[:known], theirs[:known])
    for pressure in (whole.p[-1], np.inf):
        assert recipe.reach(recipe.law(1, 0, pressure), pressure) == np.inf


def test_laws_that_end_too_low_are_made_longer():
    """Those that a pressure passes and no others; then the library is that of whole laws there."""
    recipe = LawRecipe(PAPER.bifractal, PAPER.hdf, LawSettings(E_STAR, hardness=200e6), (96, 96))
    rows = [recipe.law(1, i, 0.25e6) for i in range(3)]
    reach = [recipe.reach(steps, 0.25e6) for steps in rows]
    base = replace(make_library(rows, [0, 1, 2], reach=reach), longer=recipe.longer(1))
    index, p = np.array([0, 1, 2, 1]), np.array([0.2e6, 0.2e6, 1e3, 3e6])
    assert base.up_to(index[:3], p[:3]) is base
    longer = base.up_to(index, p)
    assert longer.reach[1] >= 3e6 and (longer.reach[[0, 2]] == base.reach[[0, 2]]).all()
    assert longer.up_to(index, p) is longer and longer.up_to(index, [0, 0, 0, 1e9]).reach[1] > 1e9
    whole = law_library(recipe, 3, 1)
    for library, most in ((base, base.reach), (longer, longer.reach)):
        for i in range(3):
            d = whole.d[i][whole.p[i] <= most[i]]
            d = np.concatenate([d, 0.5 * (d[1:] + d[:-1])])
            for name in ("loading", "vibration"):
                ours, theirs = (getattr(x, name)(np.full(d.size, i), d) for x in (library, whole))
                assert np.array_equal(ours[0], theirs[0]) and np.array_equal(ours[1], theirs[1])
    scaled = scaled_laws(base, 2.0)
    assert scaled.up_to(index[:3], 2 * p[:3]) is scaled
    joined = join_laws([OneLaw(linear_law(1e12)), scaled])
    found = joined.up_to(index + 1, 2 * p)
    assert (
        np.array_equal(found.parts[1].laws.reach, longer.reach)
        and found.parts[0] is joined.parts[0]
    )


def test_analytic_laws():
    d = np.array([-2e-6, 0.0, 1e-6])
    spring = linear_law(2e13)
    np.testing.assert_allclose(spring.pressure(d), [4e7, 0.0, 0.0])
    np.testing.assert_allclose(spring.stiffness(d), [2e13, 0.0, 0.0])
    soft = exponential_law(1e6, 1e-6)
    np.testing.assert_allclose(soft.pressure(d), 1e6 * np.exp([2.0, 0.0, -1.0]))
    np.testing.assert_allclose(soft.stiffness(d), 1e12 * np.exp([2.0, 0.0, -1.0]))
    many = OneLaw(spring)
    index = np.array([0, 5, 9])
    np.testing.assert_array_equal(many.loading(index, d), [spring.pressure(d), spring.stiffness(d)])
    v, slope = OneLaw(soft).vibration(index, d)
    np.testing.assert_array_equal(v, soft.stiffness(d))
    np.testing.assert_allclose(slope, -soft.stiffness(d) / 1e-6, rtol=1e-6)
    assert len(many) == 1 and many.first_touch(np.zeros(3, dtype=int)).shape == (3,)


@pytest.mark.parametrize(
    "make",
    [
        lambda: linear_law(-1.0),
        lambda: exponential_law(1.0, 0.0),
        lambda: make_library([]),
        lambda: make_library([LawSteps(np.array([1.0, 2.0]), np.array([1.0, 2.0]), np.ones(2))]),
        lambda: make_library([LawSteps(np.array([2.0, 1.0]), np.array([1.0, 1.0]), np.ones(2))]),
        lambda: make_library([LawSteps(np.array([2.0, 1.0]), np.array([1.0, 2.0]), np.zeros(2))]),
        lambda: make_library([LawSteps(np.array([2.0, 1.0]), np.array([0.0, 2.0]), np.ones(2))]),
        lambda: contact_law(surface(0, 8), -1.0),
        lambda: contact_law(surface(0, 8), 1.0, max_pressure=1e-9, min_pressure=1e-6),
        lambda: contact_law(surface(0, 8), 1.0, max_pressure=0.1, hardness=0.05),
        lambda: contact_law(surface(0, 8), 1.0, grids="two"),
        lambda: contact_law(surface(0, 8), 1.0, tolerance=10.0),
        lambda: contact_law(surface(0, 8), 1.0, hardness=[0.1, 0.2]),
        lambda: contact_law(surface(0, 8), 1.0, steps=10**6),
        lambda: contact_law(surface(0, 8), 1.0, bulk_compliance="half"),
        lambda: law_library(LawRecipe(PAPER.bifractal, PAPER.hdf, LawSettings(1.0)), 0, 1),
    ],
)
def test_laws_that_cannot_be(make):
    with pytest.raises(SceneError):
        make()


def test_missing_points_are_an_error():
    h = np.zeros((4, 4))
    h[1, 1] = np.nan
    with pytest.raises(SurfaceError, match="missing"):
        contact_law(make_topography(h, (1.0, 1.0)), 1.0)

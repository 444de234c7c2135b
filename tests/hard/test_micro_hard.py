"""Hard cases of the micro-contact: each gives a correct result or an error message."""

import logging

import numpy as np
import pytest

from brake_fenicsx.errors import SceneError, SurfaceError
from brake_fenicsx.micro import contact_law, solve_contact
from brake_fenicsx.micro.halfspace import half_space
from brake_fenicsx.micro.qp import certify
from brake_fenicsx.surface import given_statistics, make_topography, synthesise

pytestmark = pytest.mark.hard

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
SIZE = (2.825e-3, 2.825e-3)


def rough(shape=(48, 48), size=SIZE, seed=0):
    return synthesise(PAPER.bifractal, PAPER.hdf, shape, size, np.random.default_rng(seed))


@pytest.mark.parametrize("solver", ["auto", "active-set", "pcg"])
def test_one_touching_pixel(solver):
    """The law of one pixel follows from its compliance: p = overlap / K(0)."""
    topo = rough()
    h = topo.heights - topo.heights.mean()
    second = np.sort(h, axis=None)[-2]
    d = 0.5 * (h.max() + second)
    found = solve_contact(topo.heights, SIZE, 3.0, separation=d, solver=solver, tol=1e-12)
    pixel = SIZE[0] / 48
    # Centre of a uniformly loaded square sinks by 4 asinh(1) / pi times its side and p / E*.
    compliance = pixel * 4.0 * np.arcsinh(1.0) / np.pi
    assert np.count_nonzero(found.pressure) == 1
    assert found.pressure.max() == pytest.approx(3.0 * (h.max() - d) / compliance, rel=1e-9)


@pytest.mark.parametrize("boundary", ["free", "periodic"])
def test_plane_at_first_touch_or_above(boundary):
    """First touch exactly at a grid point: no pressure, no failure."""
    h = np.zeros((8, 8))
    h[3, 3] = 1.0
    top = 1.0 - h.mean()
    for d in (top, np.nextafter(top, 2.0), top + 1.0):
        found = solve_contact(h, (1.0, 1.0), 1.0, separation=d, boundary=boundary)
        assert found.load == 0.0 and found.solver == "none" and found.area_fraction == 0.0
    none = solve_contact(h, (1.0, 1.0), 1.0, load=0.0, boundary=boundary)
    assert none.separation == top


@pytest.mark.parametrize("boundary", ["free", "periodic"])
def test_flat_surface_under_load(boundary):
    """Free: the square punch. Periodic: a uniform pressure and no gap."""
    found = solve_contact(np.full((64, 64), 0.3), (1.0, 1.0), 2.0, load=0.1, boundary=boundary)
    assert found.area_fraction == 1.0
    assert found.load == pytest.approx(0.1, rel=1e-9)
    if boundary == "free":
        # Far-field separation: the plane has sunk by F / (1.1461 E* L) on 64 x 64 pixels.
        assert found.separation == pytest.approx(-0.1 / (2.0 * 1.1461), rel=1e-3)
    else:
        np.testing.assert_allclose(found.pressure, 0.1, rtol=1e-12)


def test_law_of_a_flat_surface_is_refused():
    """A flat surface has no pressure-gap law: named error."""
    flat = make_topography(np.zeros((16, 16)), (1.0, 1.0))
    with pytest.raises(SurfaceError, match="flat"):
        contact_law(flat, 1.0)


def test_single_spike():
    """One pixel touches until the plane reaches the flat; the law then is stiff and monotone."""
    h = np.zeros((32, 32))
    h[10, 20] = 1e-3
    law = contact_law(make_topography(h, (1.0, 1.0)), 1.0)
    d, _, k = law.steps[:3]
    space = half_space((32, 32), (1 / 32, 1 / 32))
    alone = 1.0 / (space.diagonal * 32**2)
    # The sinking of the patch as a whole is taken out of the law: 1/k_law = 1/k - c.
    early = d > 0.5e-3
    assert np.all(k[early] >= alone) and np.all(k[early] < 1.1 * alone)
    assert k[-1] > 50 * alone
    x = np.linspace(d[-1] - 1e-4, law.first_touch, 2000)
    assert np.all(np.diff(law.pressure(x)) <= 0.0)


def test_two_equal_maxima():
    """Symmetric twins carry the same pressure, from either solver and in the law."""
    h = np.full((33, 33), -1.0)
    h[8, 16] = h[24, 16] = 0.0
    for solver in ("active-set", "pcg"):
        found = solve_contact(
            h, (1.0, 1.0), 1.0, separation=-h.mean() - 1e-3, solver=solver, tol=1e-12
        )
        assert found.pressure[8, 16] == pytest.approx(found.pressure[24, 16], rel=1e-9)
        assert np.count_nonzero(found.pressure) == 2
    law = contact_law(make_topography(h, (1.0, 1.0)), 1.0, max_pressure=1e-3)
    assert np.all(law.steps[2] > 0.0)


@pytest.mark.parametrize("start", ["one", "wrong", "all", "nan"])
@pytest.mark.parametrize("solver", ["auto", "active-set", "pcg"])
def test_warm_start_from_a_bad_contact_set(start, solver):
    """A wrong, full or undefined first guess ends in the solution of a cold start."""
    topo = rough()
    h = topo.heights
    cold = solve_contact(h, SIZE, 1.0, separation=40e-6, solver="pcg", tol=1e-12)
    guess = {
        "one": np.where(h == h.min(), 1.0, 0.0),
        "wrong": np.where(cold.pressure > 0.0, 0.0, 1.0),
        "all": np.ones_like(h),
        "nan": np.full_like(h, np.nan),
    }[start]
    warm = solve_contact(h, SIZE, 1.0, separation=40e-6, solver=solver, start=guess, tol=1e-12)
    np.testing.assert_allclose(warm.pressure, cold.pressure, atol=1e-5 * cold.pressure.max())


def test_full_contact_free():
    """Full contact: every pixel touches, and the displacement equals the overlap."""
    h = 1e-6 * np.random.default_rng(0).standard_normal((16, 16))
    found = solve_contact(h, (1.0, 1.0), 1.0, separation=-1.0, tol=1e-14)
    assert found.area_fraction == 1.0
    u = half_space((16, 16), (1 / 16, 1 / 16)).apply(found.pressure)
    np.testing.assert_allclose(u, h - h.mean() + 1.0, rtol=1e-7)


@pytest.mark.parametrize("boundary", ["free", "periodic"])
def test_law_of_a_surface_that_closes(boundary):
    """A smooth surface closes far below 0.1 E*: the law is extrapolated linearly."""
    h = 1e-7 * np.random.default_rng(1).standard_normal((24, 24))
    law = contact_law(make_topography(h, (1.0, 1.0)), 1.0, boundary=boundary)
    d, p, k = law.steps[:3]
    assert p[-1] < 0.1
    assert np.all(np.diff(d) < 0.0) and np.all(np.diff(p) > 0.0) and np.all(k > 0.0)
    x = d[-1] - np.array([0.0, 1e-9])
    assert np.diff(law.pressure(x))[0] == pytest.approx(k[-1] * 1e-9, rel=1e-6)


@pytest.mark.parametrize("height", [1e-9, 1.0])
def test_tiny_and_huge_heights(height):
    """The law scales with the heights: d with h, p with h over L."""
    topo = rough((32, 32))
    scale = height / topo.heights.std()
    scaled = make_topography(topo.heights * scale, tuple(topo.size * scale))
    usual, other = contact_law(topo, 1.0), contact_law(scaled, 1.0)
    for a, b, factor in zip(
        usual.steps[:3], other.steps[:3], (scale, 1.0, 1.0 / scale), strict=True
    ):
        np.testing.assert_allclose(b, a * factor, rtol=1e-5)


@pytest.mark.parametrize("shape", [(3, 3), (2, 5), (127, 129)])
@pytest.mark.parametrize("boundary", ["free", "periodic"])
def test_odd_grids(shape, boundary):
    """Grids of few or odd numbers of pixels: the load is met, and the law is monotone."""
    h = np.random.default_rng(4).standard_normal(shape) * 1e-3
    size = (shape[0] * 1e-2, shape[1] * 1e-2)
    load = 1e-3 * size[0] * size[1]
    found = solve_contact(h, size, 1.0, load=load, boundary=boundary, tol=1e-10)
    assert found.load == pytest.approx(load, rel=1e-9)
    assert found.residual <= 1e-10
    law = contact_law(make_topography(h, size), 1.0, boundary=boundary)
    assert np.all(np.diff(law.pressure(np.linspace(-1e-2, 1e-2, 200))) <= 0.0)


def test_anisotropic_pixels():
    """A sphere on pixels with an aspect ratio of 1 : 3 has Hertz's radius and approach."""
    nx, ny, R = 192, 64, 10.0
    x, y = (np.arange(nx) - nx // 2) / nx, (np.arange(ny) - ny // 2) / ny
    h = -(x[:, None] ** 2 + y[None, :] ** 2) / (2 * R)
    a = 0.25
    found = solve_contact(h, (1.0, 1.0), 1.0, load=4 / 3 * a**3 / R, tol=1e-10)
    assert np.sqrt(found.area_fraction / np.pi) == pytest.approx(a, rel=1e-2)
    assert h.max() - h.mean() - found.separation == pytest.approx(a**2 / R, rel=1e-3)


def test_steep_surface_is_said_to_be_beyond_small_strain(caplog):
    """Slopes above one: a solution, and a warning that small strain is not valid."""
    steep = np.random.default_rng(0).standard_normal((16, 16)) * 5.0
    topo = make_topography(steep, (16.0, 16.0), source="steep")
    with caplog.at_level(logging.WARNING, logger="brake_fenicsx"):
        contact_law(topo, 1.0)
    assert "slope" in caplog.text and "steep" in caplog.text
    assert solve_contact(steep, (16.0, 16.0), 1.0, load=1e-3).rms_slope > 1.0


def wrong_heights():
    h = rough().heights
    yield from ((np.where(h == h.max(), bad, h), "1 points") for bad in (np.nan, np.inf, -np.inf))
    yield np.ma.masked_greater(h, 2.0 * h.std()), "missing"
    yield from ((wrong, "real numbers") for wrong in (h + 1j * h, h.astype(str)))
    # A patch needs two pixels each way.
    for shape in (5, (1, 8), (8, 1), (0, 0), (0, 5), (1, 1)):
        yield np.ones(shape), "two dimensions"


@pytest.mark.parametrize(("heights", "said"), wrong_heights())
def test_heights_without_meaning_are_named(heights, said):
    """Missing, infinite or masked points, profiles, empty maps, complex numbers and texts."""
    with pytest.raises(SurfaceError, match=said):
        solve_contact(heights, SIZE, 1.0, load=1e-9)


def worn(kind, n=48):
    """Surfaces whose first touch is not one pixel, or nearly all of which is one height."""
    rng = np.random.default_rng(11)
    h = rough((n, n)).heights
    if kind.startswith("plateau"):
        return np.minimum(h, np.quantile(h, 1.0 - float(kind[7:])))
    if kind == "holes":  # missing points filled with one value, deep valleys elsewhere
        top = np.minimum(h, np.quantile(h, 0.7))
        top[rng.random(h.shape) < 0.31] = top.max()
        return np.where(top < -2.0 * h.std(), 8.0 * top, top)
    if kind == "checkerboard":
        return checkerboard(n, 5e-7)[0]
    if kind == "one down":
        return np.where(h == h.max(), -1e-6, 0.0)
    return -1e-6 * np.exp(2.0 * rng.standard_normal(h.shape))  # skewness about -10


WORN = [
    "plateau0.06",
    "plateau0.3",
    "plateau0.6",
    "holes",
    "checkerboard",
    "one down",
    "skew",
]


@pytest.mark.parametrize("kind", WORN)
@pytest.mark.parametrize("boundary", ["free", "periodic"])
def test_law_of_a_worn_surface(kind, boundary):
    """Plateaus touch at once: the law is monotone and agrees with single contacts."""
    topo = make_topography(worn(kind), SIZE)
    settings = {"boundary": boundary, "bulk_compliance": "keep"}
    law = contact_law(topo, 1.0, max_pressure=3e-2, **settings)
    d, p = law.steps[:2]
    x = np.linspace(d[-1], law.first_touch, 500)
    assert np.all(np.diff(law.pressure(x)) <= 0.0)
    if boundary == "periodic" and kind == "one down":
        return  # closed from the first touch on
    for mean in np.geomspace(p[0], min(p[-1], 0.03), 4):
        found = solve_contact(topo.heights, SIZE, 1.0, load=mean * SIZE[0] ** 2, boundary=boundary)
        assert law.pressure(found.separation) == pytest.approx(mean, rel=0.02)


def checkerboard(n, amplitude):
    """Heights of n x n pixels, one up and one down, and their wave number."""
    up = np.indices((n, n)).sum(axis=0) % 2
    return amplitude * (2.0 * up - 1.0), np.sqrt(2.0) * np.pi * n / SIZE[0]


def test_checkerboard_against_its_closed_form():
    """Crests carry 2 P and sink by 2 P / (E* |q|) at the shortest wave: a linear law.

    It ends where the valleys close, at P = |q| times the amplitude over two.
    """
    amplitude = 1e-6
    h, q = checkerboard(48, amplitude)
    law = contact_law(make_topography(h, SIZE), 1.0, boundary="periodic", max_pressure=1.0)
    d, p, k = law.steps[:3]
    np.testing.assert_allclose(p, 0.5 * q * (amplitude - d), rtol=1e-6, atol=1e-6 * p.max())
    assert 0.5 * q == pytest.approx(k[-1], rel=1e-3)
    assert p.max() <= 0.5 * q * amplitude * (1 + 1e-9)


@pytest.mark.parametrize("solver", ["auto", "pcg"])
def test_checkerboard_that_yields(solver):
    """Crests at the hardness H, valleys at 0.2 H: plastic depth 2 A - 1.6 H / (E* |q|)."""
    amplitude = 1e-6
    h, q = checkerboard(16, amplitude)
    hardness = 0.5 * q * amplitude
    found = solve_contact(
        h, SIZE, 1.0, load=0.6 * hardness * SIZE[0] ** 2, boundary="periodic", solver=solver,
        hardness=hardness, tol=1e-12,
    )  # fmt: skip
    np.testing.assert_allclose(found.pressure[h < 0.0], 0.2 * hardness, rtol=1e-6)
    assert found.plastic_fraction == 0.5 and found.area_fraction == 1.0
    assert found.plastic_depth == pytest.approx(1.2 * amplitude, rel=1e-6)
    assert found.separation == pytest.approx(-0.6 * amplitude, rel=1e-6)


@pytest.mark.parametrize("tolerance", [0.0, -1e-6, np.nan, np.inf])
def test_tolerance_of_a_law_without_meaning(tolerance):
    """Zero, negative, undefined or infinite: wrong input, not a failure to converge."""
    with pytest.raises(SceneError, match="tolerance"):
        contact_law(rough(), 1.0, tolerance=tolerance)
    with pytest.raises(SceneError, match="tol"):
        solve_contact(rough().heights, SIZE, 1.0, load=1e-9, tol=tolerance)


@pytest.mark.parametrize("solver", ["auto", "pcg"])
def test_start_of_another_shape_is_named(solver):
    """Initial pressures must have the shape of the patch."""
    for start in (np.ones((4, 4)), np.ones(48), 1.0):
        with pytest.raises(SceneError, match="start of shape"):
            solve_contact(rough().heights, SIZE, 1.0, load=1e-9, start=start, solver=solver)


NUMBERS = ("E_star", "separation", "load", "tol", "hardness", "size", "max_iterations")
VALUES = ("a", [1.0, 2.0], 1.0 + 1.0j, np.nan, np.inf, 1e300, -1e300, None)
WORDS = ("none", 3, ["free"], None)


@pytest.mark.parametrize(
    ("name", "value"),
    [(n, v) for n in NUMBERS for v in VALUES if n != "hardness" or v is not None]
    + [(n, v) for n in ("boundary", "solver") for v in WORDS],
)
def test_arguments_without_meaning_are_named(name, value):
    """Words, lists, complex and overflowing numbers, words that are no choice: one line."""
    given = {"size": SIZE, "E_star": 1.0, "load": 1e-9}
    if name == "separation":
        given.pop("load")
    given[name] = (value, SIZE[1]) if name == "size" else value
    with pytest.raises(SceneError, match=f"{name}.* = |'{name}'"):
        solve_contact(rough().heights, **given)


@pytest.mark.parametrize("boundary", ["free", "periodic"])
def test_a_negative_gap_is_no_certificate(boundary):
    """Suction on open pixels lowers the gap below zero; its magnitude may be any."""
    h = rough().heights - rough().heights.mean()
    found = solve_contact(h, SIZE, 1.0, load=1e-3 * SIZE[0] ** 2, boundary=boundary, tol=1e-12)
    space = half_space(h.shape, (SIZE[0] / 48, SIZE[1] / 48), boundary)
    w = np.maximum(found.gap, 0.0)
    assert certify(space, h, found.pressure, w, found.separation, False).gap < 1e-11
    suction = np.where(w > 0.0, -1e-8, 0.0)
    assert certify(space, h, found.pressure + suction, w, found.separation, False).gap == np.inf

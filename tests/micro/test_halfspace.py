"""Operator of the half-space against its analytic symbol and against direct integration."""

import gc
import weakref

import numpy as np
import pytest
from scipy.integrate import dblquad

from brake_fenicsx.micro.halfspace import HalfSpace, half_space, love


@pytest.mark.parametrize("shape", [(16, 16), (15, 18), (9, 7)])
@pytest.mark.parametrize("wave", [(1, 0), (0, 2), (2, 3)])
def test_periodic_operator_has_its_symbol(shape, wave):
    """A pressure wave sinks by 2 / |q| times itself: a factor 2 or pi would show here."""
    size = np.array([1.3e-3, 0.8e-3])
    x, y = (np.arange(n) / n for n in shape)
    p = np.cos(2 * np.pi * (wave[0] * x[:, None] + wave[1] * y[None, :]))
    q = 2 * np.pi * np.hypot(*(np.array(wave) / size))
    space = HalfSpace(shape, size / shape, "periodic")
    np.testing.assert_allclose(space.apply(p), 2.0 / q * p, atol=2e-14 / q)


def test_love_kernel_is_the_integral_of_boussinesq():
    """Displacement beside a loaded 2:1 rectangle by quadrature of 1 / (pi r)."""
    a, b, x, y = 2e-3, 1e-3, 3.1e-3, -1.7e-3
    found, _ = dblquad(
        lambda t, s: 1.0 / (np.pi * np.hypot(x - s, y - t)), -a / 2, a / 2, -b / 2, b / 2,
        epsabs=1e-15,
    )  # fmt: skip
    assert love(np.array(x), np.array(y), a, b) == pytest.approx(found, rel=1e-10)


def test_free_operator_is_the_direct_sum():
    """FFT convolution against the sum over all pairs: no wrap-around in the padding."""
    shape, pixel = (7, 10), np.array([1e-3, 1.6e-3])
    rng = np.random.default_rng(0)
    p = rng.random(shape)
    x, y = (np.arange(n) * d for n, d in zip(shape, pixel, strict=True))
    u = np.zeros(shape)
    for i, j in np.ndindex(shape):
        u += p[i, j] * love(x[:, None] - x[i], y[None, :] - y[j], *pixel)
    space = HalfSpace(shape, pixel, "free")
    np.testing.assert_allclose(space.apply(p), u, rtol=1e-12)
    every = np.arange(p.size)
    np.testing.assert_allclose(space.block(every, every) @ p.ravel(), u.ravel(), rtol=1e-11)


@pytest.mark.parametrize("boundary", ["free", "periodic"])
def test_operator_is_symmetric_and_positive(boundary):
    """Energy of any pressure is positive (on pressures without mean, if periodic)."""
    space = HalfSpace((12, 9), np.array([1.0, 1.4]), boundary)
    every = np.arange(108)
    matrix = space.block(every, every)
    np.testing.assert_allclose(matrix, matrix.T, rtol=1e-12, atol=1e-14)
    lowest = np.linalg.eigvalsh(matrix)[:2]
    assert lowest[1] > 0.01 * space.diagonal
    assert lowest[0] > (0.01 if boundary == "free" else -1e-12) * space.diagonal
    assert np.linalg.eigvalsh(matrix)[-1] <= space.largest * (1 + 1e-12)


def test_square_punch_tends_to_its_limit():
    """1.149208 on 128 x 128 pixels; the error falls like 1 / N: extrapolated the known 1.1523."""
    found = []
    for n in (32, 64, 128):
        space = half_space((n, n), (1.0 / n, 1.0 / n))
        found.append(1.0 / (space.punch * n**2))
    assert found[-1] == pytest.approx(1.149208, abs=5e-7)
    first, second = 2 * found[1] - found[0], 2 * found[2] - found[1]
    assert second == pytest.approx(1.1523, abs=2e-4)
    assert abs(second - first) < 3e-4


def test_kernels_of_past_grids_are_let_go():
    """A study over many grids keeps the last few kernels, not all of them."""
    past = weakref.ref(half_space((11, 13), (1.0, 1.0)))
    assert past().punch > 0.0
    for n in range(4, 12):
        assert half_space((n, n), (1.0, 1.0)).punch > 0.0
    gc.collect()
    assert past() is None

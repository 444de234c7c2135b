"""Contact solutions against closed forms: each number is known without this program."""

import numpy as np
import pytest

from brake_fenicsx.micro import solve_contact
from contact_closed_forms import (
    BUSH_GIBSON_THOMAS_AREA,
    PERSSON_AREA,
    SQUARE_PUNCH,
    Hertz,
    Westergaard,
    wave_2d_full,
)


def sphere(n, R=10.0):
    """Paraboloid of unit side, its top on a grid point."""
    x = (np.arange(n) - n // 2) / n
    return -(x[:, None] ** 2 + x[None, :] ** 2) / (2 * R)


def hertz_errors(n):
    """Errors of radius, peak, pressure (L2), approach at a contact radius of a quarter."""
    h, R, E = sphere(n), 10.0, 3.0e9
    hertz = Hertz(R, E, 4.0 / 3.0 * E * 0.25**3 / R)
    found = solve_contact(h, (1.0, 1.0), E, load=hertz.load, tol=1e-10)
    x = (np.arange(n) - n // 2) / n
    p = hertz.pressure(np.hypot(x[:, None], x[None, :]))
    approach = h.max() - h.mean() - found.separation
    return np.array([
        np.sqrt(found.area_fraction / np.pi) / hertz.radius - 1,
        found.pressure.max() / hertz.peak - 1,
        np.linalg.norm(found.pressure - p) / np.linalg.norm(p),
        approach / hertz.indentation - 1,
    ])  # fmt: skip


def test_hertz_sphere_at_128():
    """As good as the best public solvers: 5.4e-3, 2.1e-4, 4.5e-3 (radius, peak, L2)."""
    radius, peak, l2, approach = np.abs(hertz_errors(128))
    assert radius < 5.4e-3
    assert peak < 2.1e-4
    assert l2 < 7e-3
    assert approach < 1e-4


def test_hertz_pressure_converges():
    """L2 error of a pressure with a vertical edge falls like 1 / N."""
    errors = [hertz_errors(n)[2] for n in (32, 64, 128, 256)]
    rate = np.log2(errors[0] / errors[-1]) / 3
    assert 0.8 < rate < 1.6, errors


def test_hertz_stiffness():
    """Load over approach has the slope 2 E* a."""
    h = sphere(128)
    E = 1.0
    hertz = Hertz(10.0, E, 4.0 / 3.0 * 0.25**3 / 10.0)
    mid = solve_contact(h, (1.0, 1.0), E, load=hertz.load, tol=1e-10).separation
    step = 2e-2 * hertz.indentation
    loads = [
        solve_contact(h, (1.0, 1.0), E, separation=mid + s, tol=1e-11).load for s in (step, -step)
    ]
    assert (loads[1] - loads[0]) / (2 * step) == pytest.approx(hertz.stiffness, rel=6e-3)


@pytest.mark.parametrize("f", [0.1, 0.5, 0.9])
def test_westergaard_wave(f):
    """Mean gap Delta (1 - f + f ln f) and pressure of a one-dimensional wave."""
    n, E = 256, 2.0e9
    wave = Westergaard(0.01, 1.0, E)
    x = np.arange(n) / n
    h = np.repeat(wave.Delta * np.cos(2 * np.pi * x)[:, None], 4, axis=1)
    load = f * wave.full * 4 / n
    found = solve_contact(h, (1.0, 4 / n), E, load=load, boundary="periodic", tol=1e-12)
    mean = f * wave.full
    assert found.separation == pytest.approx(wave.separation(mean), abs=1e-4 * wave.Delta)
    p = wave.pressure((x + 0.5) % 1.0 - 0.5, mean)
    assert np.linalg.norm(found.pressure[:, 0] - p) < 8e-3 * np.linalg.norm(p)
    assert found.area_fraction == pytest.approx(2 * wave.half_width(mean), abs=2.0 / n)


@pytest.mark.parametrize(("f", "gap", "peak"), [(0.2, 0.20463, 1.0955), (0.5, 0.045078, 1.4793)])
def test_johnson_greenwood_higginson_wave(f, gap, peak):
    """Two-dimensional wave: mean gap over Delta and peak over p*."""
    n, Delta = 256, 0.01
    x = 2 * np.pi * np.arange(n) / n
    h = Delta * np.outer(np.cos(x), np.cos(x))
    full = wave_2d_full(Delta, 1.0, 1.0)
    found = solve_contact(h, (1.0, 1.0), 1.0, load=f * full, boundary="periodic", tol=1e-12)
    assert found.separation / Delta == pytest.approx(gap, abs=3e-5)
    assert found.pressure.max() / full == pytest.approx(peak, abs=1e-4)


def test_wave_flattens_at_p_star():
    """At p* the periodic contact is closed: gap zero, pressure p* (1 + cos cos)."""
    n, Delta = 32, 0.01
    x = 2 * np.pi * np.arange(n) / n
    wave = np.outer(np.cos(x), np.cos(x))
    full = wave_2d_full(Delta, 1.0, 5.0)
    found = solve_contact(
        Delta * wave, (1.0, 1.0), 5.0, load=1.2 * full, boundary="periodic", tol=1e-10
    )
    np.testing.assert_allclose(found.pressure, full * (1.2 + wave), atol=1e-12 * full)
    assert found.separation == 0.0


def test_flat_punch_on_a_pedestal():
    """A square pedestal of half the patch length is a flat punch of that length."""
    n = 128
    h = np.full((n, n), -1.0)
    h[n // 4 : 3 * n // 4, n // 4 : 3 * n // 4] = 0.0
    delta = 1e-3
    found = solve_contact(h, (1.0, 1.0), 7.0, separation=h.max() - h.mean() - delta, tol=1e-10)
    assert found.area_fraction == 0.25
    # On 64 x 64 pixels the punch is 0.5 % softer than in the limit.
    assert found.load / (7.0 * 0.5 * delta) == pytest.approx(SQUARE_PUNCH, rel=6e-3)


def self_affine(n, rng, H=0.8, longest=4, shortest=8):
    """Periodic Gaussian surface of unit length, q^-2(1+H) between n/longest and shortest pixels."""
    k = np.hypot(np.fft.fftfreq(n, 1 / n)[:, None], np.fft.rfftfreq(n, 1 / n))
    inside = (k >= longest) & (k <= n / shortest)
    amplitude = np.where(inside, np.where(k > 0, k, 1.0) ** -(1 + H), 0.0)
    return np.fft.irfft2(amplitude * np.fft.rfft2(rng.standard_normal((n, n))), s=(n, n))


def test_area_of_self_affine_surface_lies_between_the_theories():
    """A / A0 over P / (E* h') at light load: above Persson's 1.60, below Bush's 2.51."""
    n, area = 256, []
    for seed in range(3):
        h = self_affine(n, np.random.default_rng(seed))
        slope = np.sqrt(sum(np.mean((np.roll(h, 1, a) - h) ** 2) for a in (0, 1))) * n
        h *= 0.01 / slope
        reduced = 0.04
        found = solve_contact(
            h, (1.0, 1.0), 1.0, load=reduced * 0.01, boundary="periodic", tol=1e-8
        )
        touching = found.pressure > 0.0
        # Pixels cover too much along the outline: (pi - 1 + ln 2) / 24 of a pixel for each edge
        # (Yastrebov, Anciaux, Molinari, J. Mech. Phys. Solids 107 (2017) 469).
        edges = sum(np.count_nonzero(touching != np.roll(touching, 1, a)) for a in (0, 1))
        area.append((touching.sum() - (np.pi - 1 + np.log(2)) / 24 * edges) / n**2 / reduced)
    assert PERSSON_AREA < np.mean(area) < BUSH_GIBSON_THOMAS_AREA, area


def test_stiffness_of_self_affine_surface_is_proportional_to_pressure():
    """Persson: p ~ exp(-d / u0) with u0 about 0.4 to 0.6 S_q over a decade of light loads."""
    h = self_affine(128, np.random.default_rng(5), longest=2)
    h *= 1e-3 / h.std()
    loads = np.array([3e-4, 1e-3, 3e-3]) * 1.0
    slope = np.sqrt(sum(np.mean((np.roll(h, 1, a) - h) ** 2) for a in (0, 1))) * 128
    d = [
        solve_contact(h, (1.0, 1.0), 1.0, load=p * slope / 0.05, boundary="periodic").separation
        for p in loads
    ]
    lengths = -np.diff(d) / np.diff(np.log(loads)) / h.std()
    assert np.all(lengths > 0.3) and np.all(lengths < 0.7), lengths

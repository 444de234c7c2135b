"""Waviness of a face: variance shared with the laws, correlation, and independence of the patch."""

import numpy as np
import pytest
from scipy import integrate

from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.macro import draw_waviness
from brake_fenicsx.micro import contact_law
from brake_fenicsx.surface import given_statistics, synthesise
from brake_fenicsx.surface.spectrum import BiFractal, Waviness

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
L = 2.825e-3


def within_a_patch(psd, patch, low, pixels):
    """Variance of the surfaces behind the laws [m^2]."""
    rng = np.random.default_rng(0)
    topo = synthesise(psd, PAPER.hdf, (pixels, pixels), (patch, patch), rng, low)
    return topo.record.S_q**2


@pytest.mark.parametrize(("low", "tolerance"), [("flat", 0.01), ("extend", 0.02)])
def test_laws_and_waviness_share_the_variance(low, tolerance):
    """The sum of both is the same for patches of 2.8, 5.6 and 11 mm."""
    psd, sums = PAPER.bifractal, []
    for factor, pixels in ((1, 150), (2, 300), (4, 600)):
        patch = factor * L
        own = within_a_patch(psd, patch, low, pixels)
        sums.append(own + Waviness(psd, patch, low).variance(0.14))
    assert np.ptp(sums) < tolerance * np.mean(sums)


def test_variance_of_patch_means_of_a_flat_spectrum():
    """A flat spectrum is uncorrelated noise: the mean over a patch has variance C (2 pi / L)^2."""
    flat = BiFractal(0.0, -4.5, 1e5, 1e-18, (1e3, 1e6))
    expected = 1e-18 * (2 * np.pi / L) ** 2
    assert Waviness(flat, L).variance(0.05) == pytest.approx(expected, rel=0.06)


def test_neighbours_are_correlated_as_the_spectrum_says():
    """Correlation at 0, 1, 2 and 4 patches: the cosine transform of the averaged spectrum."""
    psd = BiFractal(-3.0, -4.5, 3e3, 1e-16, (600.0, 1e5))
    wavy = Waviness(psd, L, "flat")
    x = np.arange(0, 30) * L
    points = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    rng = np.random.default_rng(3)
    fields = np.array([wavy.sample(points, rng).reshape(30, 30) for _ in range(120)])

    def covariance(r):
        def along(qx):
            def across(qy):
                filter_ = np.sinc(qx * L / (2 * np.pi)) * np.sinc(qy * L / (2 * np.pi))
                return float(psd(np.array(np.hypot(qx, qy)), "flat")) * filter_**2

            return integrate.quad(across, 0, 4e3, limit=100)[0] * np.cos(qx * r)

        return 4 * integrate.quad(along, 0, 4e3, limit=200)[0]

    for lag in (0, 1, 2, 4):
        found = np.mean(fields[:, : 30 - lag] * fields[:, lag:])
        assert found == pytest.approx(covariance(lag * L), abs=0.08 * covariance(0))


def test_pads_have_fields_of_their_own():
    """Two pads, one on each side of the disc, and a face that does not lie along the axes."""
    rng = np.random.default_rng(0)
    flat = np.stack([*rng.uniform(0, 0.04, (2, 300)), np.zeros(300)], axis=1)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    points = np.concatenate([flat, flat + np.array([0, 0, 0.02])]) @ turn.T
    normal = np.repeat([[0, 0, -1.0], [0, 0, 1.0]], 300, axis=0) @ turn.T
    wavy = Waviness(BiFractal(-2.0, -4.5, 1e4, 1e-16, (500.0, 1e5)), L)
    draws = np.array([draw_waviness(wavy, points, normal, rng) for _ in range(60)])
    one, other = draws[:, :300], draws[:, 300:]
    assert abs(np.mean(one * other)) < 0.15 * np.mean(one**2)
    assert one.std() == pytest.approx(other.std(), rel=0.15)
    near = np.argsort(np.linalg.norm(flat - flat[0], axis=1))[1]
    assert np.corrcoef(one[:, 0], one[:, near])[0, 1] > 0.5


@pytest.mark.slow
def test_two_patch_sizes_close_a_rigid_pad_alike():
    """Mean pressure over the closure of a rigid pad: patches of 2.8 and of 5.6 mm, within 0.15 S_q.

    The laws of the small patches lack the waves between both lengths; their waviness has them.
    """
    psd = BiFractal(-2.0, -4.5, 1.2e4, 1e-18, (600.0, 1e5))
    closure = {}
    pressures = np.array([1e6, 5e6])
    for patch, pixels in ((L, 48), (2 * L, 96)):
        laws = [
            contact_law(
                synthesise(psd, PAPER.hdf, (pixels, pixels), (patch, patch),
                           np.random.default_rng(seed)), 2.4e9, max_pressure=5e7, steps=20,
            )
            for seed in range(24)
        ]  # fmt: skip
        x = np.arange(0, 0.2, patch)
        points = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
        gaps = Waviness(psd, patch).sample(points, np.random.default_rng(1))
        index = np.random.default_rng(2).integers(0, len(laws), gaps.size)
        S_q = np.sqrt(psd.variance(600.0, 1e5))
        d = np.linspace(0.5, 8, 120) * S_q
        mean = np.zeros_like(d)
        for number, law in enumerate(laws):
            own = gaps[index == number]
            mean += law.pressure(d[:, None] - own).sum(axis=1)
        mean /= gaps.size
        some = mean > 0
        closure[pixels] = np.interp(
            np.log(pressures), np.log(mean[some][::-1]), d[some][::-1] / S_q
        )
    np.testing.assert_allclose(closure[48], closure[96], atol=0.15)


def test_faces_too_long_for_their_patches_are_refused():
    with pytest.raises(SurfaceError, match="patches larger"):
        Waviness(PAPER.bifractal, 1e-5).variance(0.14)

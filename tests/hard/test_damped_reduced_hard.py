"""Reduced model with damping, stretched: open and stiff contact, contrasts, merging modes."""

from functools import cache

import numpy as np
import pytest

from brake_fenicsx.macro.condensation import gathered
from brake_fenicsx.macro.elasticity import affine_parts
from brake_fenicsx.macro.solver import local_rows
from brake_fenicsx.stability import DampedReduced, Reduced
from dense_reference import all_damped

BAND, K0, ZETA = (0.0, 90e3), 3e11, 0.3
OMEGA = 2 * np.pi * BAND[1]


@cache
def real_modes(scene, band=BAND):
    return Reduced(scene.elastic.K, scene.elastic.M, scene.N, scene.T, scene.w, K0, band, order=0)


@cache
def losses(scene, pad, plate):
    """Loss factors of both bodies at 30 kHz, C [N s/m]."""
    K = [
        local_rows(gathered(affine_parts(scene.mesh, scene.free, [{n: scene.materials[n].C}])[0]))
        for n in ("pad.body", "plate.body")
    ]
    return ((pad * K[0] + plate * K[1]) / (2 * np.pi * 30e3)).tocsr()


def solve(scene, C, k, mu, tolerance=1e-6, band=BAND):
    none = 0.0 * scene.w
    model = DampedReduced(real_modes(scene, band), C, scene.R, along=False, across=False)
    return model.modes(k, mu, none, none, ZETA, tolerance)


def dense(scene, C, k, mu):
    """Eigenvalues of the linearised problem [1/s]; to some 1e-8."""
    s = all_damped(scene.M.toarray(), C.toarray(), scene.tangent(k, mu).toarray(), OMEGA)
    return s[s.imag >= 0]


def in_band(s):
    return s[(s.imag > 1e-4 * OMEGA) & (s.imag <= OMEGA) & (s.real >= -ZETA * np.abs(s))]


def agree(modes, exact, digits=1e-7):
    """None missed, errors covered; the largest relative error."""
    elastic = np.abs(modes.s) > 1e-4 * OMEGA
    s = modes.s[elastic]
    assert elastic.sum() == in_band(exact).size > 0
    distance = np.abs(s[:, None] - exact).min(axis=1)
    assert np.all(distance <= modes.error[elastic] + digits * modes.condition[elastic] * np.abs(s))
    return float((distance / np.abs(s)).max())


def test_all_contacts_open(two_blocks):
    """The pad moves along z and tilts about its top, and Rayleigh's alpha acts on that.

    Each of the three is a zero, once, and a decay at -alpha.
    """
    scene = two_blocks("coarse")
    C, k = (500.0 * scene.M + 1e-8 * scene.K).tocsr(), 0.0 * scene.w
    found = solve(scene, C, k, 0.5)
    assert np.sum(found.s == 0) == 3
    assert set(np.array(found.verdict)[found.s == 0]) == {"neutral"}
    assert agree(found, dense(scene, C, k, 0.5)) < 1e-6


def test_contrast_of_a_thousand_between_bodies(two_blocks):
    """A lossy lining on steel that loses next to nothing."""
    scene = two_blocks("coarse")
    C, k = losses(scene, 0.1, 1e-4), K0 * np.ones_like(scene.w)
    found = solve(scene, C, k, 0.4)
    assert agree(found, dense(scene, C, k, 0.4)) < 1e-6
    zeta = -found.s.real / np.abs(found.s)
    assert zeta.max() > 0.05 and set(found.verdict) <= {"stable", "unstable"}


@pytest.mark.parametrize("k", [1e3 * K0, 1e12 * K0])
def test_contact_far_stiffer_than_the_reference(two_blocks, k):
    """All but a constraint; the backward error of the full matrices would be a weak test.

    At 1e12 the dense spectrum has no digits left: the answer is that of 1e6.
    """
    scene = two_blocks("coarse")
    C, one = losses(scene, 0.05, 0.002), np.ones_like(scene.w)
    found = solve(scene, C, k * one, 0.3)
    if k < 1e6 * K0:
        agree(found, dense(scene, C, k * one, 0.3))
        return
    before = solve(scene, C, 1e6 * K0 * one, 0.3)
    assert len(found) == len(before)
    assert np.all(np.abs(found.s - before.s) <= found.error + before.error + 1e-5 * np.abs(found.s))


def test_two_modes_about_to_merge(two_blocks):
    """The mu at which two modes are most alike; little damping keeps them apart."""
    scene = two_blocks("coarse")
    C, k = losses(scene, 2e-4, 2e-4), K0 * np.ones_like(scene.w)
    mu = max(
        np.linspace(0.6, 1.2, 31), key=lambda mu: solve(scene, C, k, mu, np.inf).condition.max()
    )
    found = solve(scene, C, k, mu)
    assert found.condition.max() > 15
    assert agree(found, dense(scene, C, k, mu)) < 1e-6


def test_band_without_a_mode(two_blocks):
    """Nothing below 1 kHz but the pad's support on its contact: no row, and no error."""
    scene = two_blocks("coarse")
    C = losses(scene, 0.05, 0.002)
    stiff = 10 * K0 * np.ones_like(scene.w)
    model = DampedReduced(real_modes(scene), C, scene.R, along=False, across=False)
    model.reduced.band, whole = (0.0, 1e3), model.reduced.band
    try:
        assert len(model.modes(stiff, 0.2, 0 * stiff, 0 * stiff, ZETA)) == 0
    finally:
        model.reduced.band = whole

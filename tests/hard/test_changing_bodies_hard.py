"""Reduced model of bodies that change, stretched: wide boxes, stiff and open contact."""

import numpy as np
import pytest

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.stability.changing.own_bodies import Whole
from brake_fenicsx.stability.ensemble_basis import EnsembleBasis
from dense_reference import agrees, all_lambda

BAND = (0.0, 60e3)
MU = 0.5


def coefficients(spread):
    """Of C33 and of C44 = C55 of the lining, linear in the compliances."""
    return lambda x: np.array([2.27e9, 1.18e9]) * (1 / (1 + spread * x) - 1)


def basis(scene, parts, change, degree=3):
    return EnsembleBasis(
        scene.K, scene.M, scene.N, scene.T, scene.w, scene.f[:, None], parts, change, 2, BAND,
        degree, scene.comm,
    )  # fmt: skip


def exact(scene, parts, c, k):
    """All lambda, dense."""
    K = scene.tangent(k, MU) + sum(a * A for a, A in zip(c, parts, strict=True))
    return all_lambda(K, scene.M)


def agree(modes, reference):
    """None missed, errors covered, no wrong verdict; the largest relative error."""
    return agrees(modes, reference, BAND)[0]


def test_constants_within_a_half(two_bodies):
    """Compliances by a factor of three: less accurate, and the estimates say so."""
    scene, parts = two_bodies
    change = coefficients(0.5)
    made, rng = basis(scene, parts, change), np.random.default_rng(9)
    for x in (np.array([-1.0, -1.0]), *rng.uniform(-1, 1, (3, 2))):
        k = 3e11 * 10 ** rng.uniform(-1, 1, scene.w.size)
        assert agree(made.modes(x, k, MU), exact(scene, parts, change(x), k)) < 1e-4


def test_penalty_of_perfect_contact(two_bodies):
    """1e16 Pa/m: the interface is all but a constraint."""
    scene, parts = two_bodies
    change = coefficients(0.2)
    made = basis(scene, parts, change)
    for x in np.random.default_rng(9).uniform(-1, 1, (3, 2)):
        k = np.full(scene.w.size, 1e16)
        assert agree(made.modes(x, k, MU), exact(scene, parts, change(x), k)) < 1e-5


def test_all_contacts_open(two_bodies):
    """The bodies alone: nothing couples them, and the free block keeps its rigid modes."""
    scene, parts = two_bodies
    change = coefficients(0.2)
    made, x, k = basis(scene, parts, change), np.array([0.4, -0.8]), np.zeros(scene.w.size)
    modes = made.modes(x, k, MU)
    assert agree(modes, exact(scene, parts, change(x), k)) < 1e-5
    assert "unstable" not in modes.verdict


def test_stiffness_that_is_not_positive(two_bodies):
    """A corner of the box where the lining would give energy away."""
    scene, parts = two_bodies
    with pytest.raises(InaccurateResult, match="not positive definite"):
        basis(scene, parts, lambda x: np.array([0.0, -2.4e9 * (x[1] > 0.5)]))


@pytest.mark.parametrize("contact", ["scattered", "rigid", "open", "one element"])
def test_refined_from_a_poor_basis(two_bodies, contact):
    """Degree one in a box of a factor of three, at its worst corner: 1e-8 where it is asked for.

    Contact over two decades, all but a constraint, open (rigid modes), and in one element alone.
    """
    scene, parts = two_bodies
    change, x = coefficients(0.5), np.array([-1.0, -1.0])
    if not hasattr(scene, "poor"):
        scene.poor = basis(scene, parts, change, 1)
    n = scene.w.size
    k = {
        "scattered": 3e11 * 10 ** np.random.default_rng(2).uniform(-1, 1, n),
        "rigid": np.full(n, 1e15),
        "open": np.zeros(n),
        "one element": np.where(np.arange(n) == 4, 3e11, 0.0),
    }[contact]
    K = (scene.K + sum(a * A for a, A in zip(change(x), parts, strict=True))).tocsr()
    whole = Whole(K, scene.M, scene.N, scene.T, scene.N[:0])
    reference = exact(scene, parts, change(x), k)
    assert agree(scene.poor.modes(x, k, MU), reference) > 1e-6
    modes = scene.poor.modes(x, k, MU, 1e-8, lambda: whole)
    # A penalty takes digits from the dense spectrum.
    assert agree(modes, reference) < (1e-6 if contact == "rigid" else 1e-8)
    elastic = np.abs(modes.s) > 10.0
    assert np.all(modes.error[elastic] <= 1e-8 * np.abs(modes.s[elastic]))


def test_sample_whose_own_bodies_have_no_factor(two_bodies):
    """A sample whose own stiffness is not positive: refused by name, never a mode of another."""
    scene, parts = two_bodies
    made, k = basis(scene, parts, coefficients(0.2), 1), np.full(scene.w.size, 3e11)
    K = (scene.K - 2.4e9 * parts[1]).tocsr()
    wrong = Whole(K, scene.M, scene.N, scene.T, scene.N[:0])
    with pytest.raises(InaccurateResult, match="not positive definite"):
        made.modes(np.array([0.3, 0.3]), k, MU, 1e-9, lambda: wrong)

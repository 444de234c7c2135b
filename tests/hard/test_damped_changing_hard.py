"""Damped samples of changing materials, stretched: contrasts, free bodies, beyond the box."""

from functools import cache

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.macro.condensation import gathered
from brake_fenicsx.macro.elasticity import affine_parts
from brake_fenicsx.macro.solver import local_rows
from brake_fenicsx.stability.changing.own_bodies import Whole
from brake_fenicsx.stability.changing.proportion import Damping
from brake_fenicsx.stability.ensemble_basis import EnsembleBasis

BAND, K0, ZETA = (0.0, 60e3), 3e11, 0.3
HIGH = 2 * np.pi * BAND[1]
MODULI = np.array([2.27e9, 1.18e9])


@cache
def stiffnesses(scene):
    """Unit changes of C33 and C44 = C55 of the pad, stiffness of the pad, that of the plate."""
    C = {name: scene.materials[name].C for name in ("pad.body", "plate.body")}
    changes = [{"pad.body": np.diag(np.isin(np.arange(6), p) + 0.0)} for p in (2, [3, 4])]
    changes += [{name: values} for name, values in C.items()]
    return [local_rows(gathered(A)) for A in affine_parts(scene.mesh, scene.free, changes)]


def coefficients(spread):
    return lambda x: MODULI * (1 / (1 + spread * x) - 1)


@cache
def offline(scene, pad, plate, shear=0.0, spread=0.2):
    """Loss factors at 30 kHz of pad and plate, and what the pad's C44 = C55 adds to them."""
    *parts, lining, steel = stiffnesses(scene)
    pad, plate, shear = (eta / (2 * np.pi * 30e3) for eta in (pad, plate, shear))
    C = (pad * lining + plate * steel + shear * MODULI[1] * parts[1]).tocsr()
    given = Damping(C, 0.0, np.array([pad, pad + shear]), scene.R, False, False)
    basis = EnsembleBasis(
        scene.K, scene.M, scene.N, scene.T, scene.w, scene.f[:, None], parts,
        coefficients(spread), 2, BAND, 3, scene.comm, damping=given,
    )  # fmt: skip
    return basis, given, coefficients(spread)


def both(scene, dense, made, x, k, mu, tolerance=np.inf):
    """Modes of a sample, refined beyond a tolerance, and its dense problem."""
    (basis, d, change), none = made, np.zeros_like(k)
    c, parts = change(np.array(x)), stiffnesses(scene)[:2]
    moved = sum(a * A for a, A in zip(c, parts, strict=True))
    C = d.C + sum(f * a * A for f, a, A in zip(d.follows, c, parts, strict=True))
    whole = Whole((scene.K + moved).tocsr(), scene.M, scene.N, scene.T, scene.R, C.tocsr())
    found = basis.damped_modes(np.array(x), k, mu, none, none, ZETA, tolerance, lambda: whole)
    return found, dense(scene.M, C, scene.tangent(k, mu) + moved, HIGH, ZETA)


def scattered(scene, seed):
    return K0 * 10 ** np.random.default_rng(seed).uniform(-1, 1, scene.w.size)


@pytest.mark.parametrize("losses", [(0.1, 1e-4), pytest.param((1e-4, 0.1), marks=pytest.mark.slow)])
def test_contrast_of_a_thousand_between_changing_bodies(two_blocks, dense, losses):
    """The body that changes loses a thousand times as much as the other, or as little."""
    scene = two_blocks("coarse")
    found, exact = both(
        scene, dense, offline(scene, *losses), (-1.0, -1.0), scattered(scene, 1), 0.4
    )
    assert exact.agrees(found) < 1e-6


def test_contrast_of_a_thousand_within_a_changing_body(two_blocks, dense):
    """Shear loses a thousand times what the rest of the pad does: far from any proportion."""
    scene = two_blocks("coarse")
    made = offline(scene, 1e-4, 1e-4, 0.1)
    assert made[0].damping[0].difference is not None
    for x, mu in (((-1.0, -1.0), 1.0), ((0.6, -0.3), 0.0)):
        found, exact = both(scene, dense, made, x, scattered(scene, 2), mu)
        assert exact.agrees(found) < 3e-6


def test_places_beyond_the_box(two_blocks, dense):
    """Hardly beyond it: a tenth of its half width; less accurate, and the estimates say so."""
    scene = two_blocks("coarse")
    for x in ((1.1, -1.1), (-1.1, -1.1)):
        found, exact = both(
            scene, dense, offline(scene, 0.05, 0.002, 0.05), x, scattered(scene, 3), 0.5
        )
        assert exact.agrees(found) < 1e-5


@pytest.mark.slow
def test_constants_within_a_half_and_damped(two_blocks, dense):
    """Compliances by a factor of three."""
    scene = two_blocks("coarse")
    made = offline(scene, 0.05, 0.002, 0.05, 0.5)
    for x in ((-1.0, -1.0), (0.7, 0.9)):
        found, exact = both(scene, dense, made, x, scattered(scene, 4), 0.5)
        assert exact.agrees(found) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("shear", [0.0, 0.05])
def test_nothing_held_but_by_contact(two_blocks, dense, shear):
    """Both bodies free, damped in proportion or not: nine zeros, each once.

    Six of the whole, and three of the pad sliding and turning on the plate.
    """
    scene = two_blocks("loose")
    made = offline(scene, 0.05, 0.002, shear)
    found, exact = both(scene, dense, made, (0.5, -0.8), scattered(scene, 5), 0.3)
    assert exact.agrees(found) < 1e-5
    assert np.sum(found.s == 0) == 9
    assert set(np.array(found.verdict)[found.s == 0]) == {"neutral"}


@pytest.mark.slow
def test_free_body_that_only_its_damping_changes(two_blocks, dense):
    """The plate: nothing clamps it, its stiffness is constant, and its shear alone loses energy."""
    scene = two_blocks("loose")
    parts, change = stiffnesses(scene)[:2], coefficients(0.2)
    shear = np.diag([0.0, 0, 0, 1, 1, 1]) * scene.materials["plate.body"].C[3, 3]
    (A,) = affine_parts(scene.mesh, scene.free, [{"plate.body": shear}])
    C = (0.02 / (2 * np.pi * 30e3) * local_rows(gathered(A))).tocsr()
    given = Damping(C, 0.0, np.zeros(2), scene.R, False, False)
    basis = EnsembleBasis(
        scene.K, scene.M, scene.N, scene.T, scene.w, scene.f[:, None], parts, change, 2, BAND, 3,
        scene.comm, damping=given,
    )  # fmt: skip
    anchored = [body.anchors.points.shape[1] for body in basis.bodies if body.varies]
    assert sorted(anchored) == [1, 2]
    k = scattered(scene, 7)
    found, exact = both(scene, dense, (basis, given, change), (-0.7, 0.4), k, 0.3)
    assert exact.agrees(found) < 1e-5


def test_all_contacts_open_and_damped(two_blocks, dense):
    """The bodies alone; the pad's way along z is a zero, once."""
    scene = two_blocks("coarse")
    found, exact = both(
        scene, dense, offline(scene, 0.05, 0.002, 0.05), (0.4, -0.8), 0.0 * scene.w, 0.5
    )
    assert exact.agrees(found) < 1e-6
    assert "unstable" not in found.verdict


@pytest.mark.parametrize("stiff", [pytest.param(1e3, marks=pytest.mark.slow), 1e6])
def test_contact_all_but_rigid_and_damped(two_blocks, dense, stiff):
    """A penalty; at 1e6 the dense spectrum has few digits left: the answer is that of 1e5."""
    scene = two_blocks("coarse")
    made, k = offline(scene, 0.05, 0.002), np.full(scene.w.size, K0)
    found, exact = both(scene, dense, made, (0.2, 0.6), stiff * k, 0.3)
    if stiff < 1e6:
        assert exact.agrees(found) < 1e-5
        return
    before, _ = both(scene, dense, made, (0.2, 0.6), 1e5 * k, 0.3)
    assert len(found) == len(before)
    assert np.all(np.abs(found.s - before.s) <= found.error + before.error + 1e-4 * np.abs(found.s))


def test_two_modes_about_to_merge_in_changed_bodies(two_blocks, dense):
    """The mu at which two modes of a sample are most alike."""
    scene = two_blocks("coarse")
    made, k, x = offline(scene, 2e-4, 2e-4), np.full(scene.w.size, 3 * K0), np.array([-0.5, 0.7])
    none = 0.0 * k
    mu = max(
        np.linspace(1.5, 1.7, 11),
        key=lambda mu: made[0].damped_modes(x, k, mu, none, none, ZETA).condition.max(),
    )
    found, exact = both(scene, dense, made, x, k, mu)
    # How near the grid of mu comes to it depends on the mesh: 42 with that of gmsh 4.13.
    assert found.condition.max() > 20
    exact.agrees(found)


@pytest.mark.parametrize(
    "scene, losses",
    [
        ("coarse", (1e-4, 1e-4, 0.1)),
        pytest.param("loose", (0.05, 0.002, 0.05), marks=pytest.mark.slow),
        pytest.param("coarse", (0.1, 1e-4), marks=pytest.mark.slow),
    ],
)
def test_refined_from_a_poor_basis(two_blocks, dense, scene, losses):
    """Beyond the corner of the box, damping far from any proportion, bodies that nothing holds."""
    scene = two_blocks(scene)
    made, k = offline(scene, *losses), scattered(scene, 8)
    found, exact = both(scene, dense, made, (-1.1, -1.1), k, 0.4)
    before = exact.agrees(found)
    found, _ = both(scene, dense, made, (-1.1, -1.1), k, 0.4, 1e-8)
    assert exact.agrees(found) < min(1e-8, 0.3 * before)
    elastic = np.abs(found.s) > 1e-6 * HIGH
    assert np.median(found.error[elastic] / np.abs(found.s[elastic])) < 1e-8


def test_damping_beyond_the_series(two_blocks):
    """One layer all but a dashpot: refused by name, no sample is solved."""
    scene = two_blocks("coarse")
    with pytest.raises(InaccurateResult, match=r"damping too strong|not positive definite"):
        offline(scene, 0.01, 0.002, 4.0)


def test_no_damping_matrix_at_all(two_blocks, dense):
    """Only rates at contact, and they vanish: the undamped problem, on the imaginary axis."""
    scene = two_blocks("coarse")
    parts, change = stiffnesses(scene)[:2], coefficients(0.2)
    given = Damping(None, 0.0, np.zeros(2), scene.R, True, True)
    basis = EnsembleBasis(
        scene.K, scene.M, scene.N, scene.T, scene.w, scene.f[:, None], parts, change, 2, BAND, 3,
        scene.comm, damping=given,
    )  # fmt: skip
    made = basis, Damping(sp.csr_matrix(scene.K.shape), *(0.0, np.zeros(2)), scene.R, True, True)
    found, exact = both(scene, dense, (*made, change), (0.3, 0.3), scattered(scene, 6), 0.0)
    assert exact.agrees(found) < 1e-6
    assert "unstable" not in found.verdict

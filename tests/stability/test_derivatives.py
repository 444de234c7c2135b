"""Derivatives of eigenvalues against finite differences of dense full problems and closed forms."""

from functools import cache

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.macro.elasticity import affine_parts, layer_masses
from brake_fenicsx.stability import ContactLinearisation, complex_modes
from brake_fenicsx.stability.derivatives import (
    bilinear,
    contact_derivatives,
    friction_work,
    motions_of_vectors,
    trusted,
)
from brake_fenicsx.stability.eigensolvers.eigenpairs import QuadraticPencil, inner
from reduced_samples import BAND, HIGH, ZETA, Sample, followed, offline

MU, STIFFNESS, TOLERANCE = 1.5, 1e12, 1e-7
CASES = ("undamped", "sliding", "all")
LAYERS = ("pad.body", "plate.body")


@cache
def sample(scene, case):
    return Sample(scene, case, mu=MU, k=np.full(scene.w.size, STIFFNESS))


@cache
def found(scene, case):
    """Modes by the reduced model, and two of them: the lowest elastic one, and one that grows."""
    modes = sample(scene, case).modes(offline(scene, case, tolerance=TOLERANCE))
    first = np.flatnonzero(modes.s.imag > 1e-2 * HIGH)[0]
    growing = np.flatnonzero(modes.s.real > 1e-3 * modes.s.imag)
    return modes, np.unique(np.r_[first, growing[:1]])


@cache
def layer_matrices(scene):
    """Stiffness and mass of each layer."""
    K = {n: affine_parts(scene.mesh, scene.free, [{n: scene.materials[n].C}])[0] for n in LAYERS}
    density = {n: scene.materials[n].rho for n in LAYERS}
    return K, layer_masses(scene.mesh, scene.free, density)


def differences(s, M, C, K, changed, h):
    """Central differences of dense eigenvalues: ``changed(h)`` is what is added to M, C and K."""
    ends = []
    for x in (h, -h):
        added = (A.toarray() for A in changed(x))
        ends.append(moved(s, *(A + B for A, B in zip((M, C, K), added, strict=True))))
    return (ends[0] - ends[1]) / (2 * h)


def moved(s, M, C, K):
    """The eigenvalues next to some values, by two-sided Rayleigh quotients from random vectors."""
    out = s.copy()
    for j in range(s.size):
        x = y = np.random.default_rng(0).standard_normal(len(M)) + 0j
        lu = la.lu_factor(s[j] ** 2 * M + s[j] * C + K)
        for _ in range(4):
            slope = 2 * out[j] * M + C
            x, y = la.lu_solve(lu, slope @ x), la.lu_solve(lu, slope.conj().T @ y, trans=2)
            x, y = x / la.norm(x), y / la.norm(y)
            P = out[j] ** 2 * M + out[j] * C + K
            out[j] -= (y.conj() @ P @ x) / (y.conj() @ slope @ x)
    return out


def directions(scene, case):
    """Parameter -> its step, and what it adds to M, C and K at full order."""
    smp, w = sample(scene, case), scene.w
    none = 0 * scene.M
    K, M = layer_matrices(scene)

    def contact(dk, dmu):
        """Stiffness of the contact at other k and mu."""
        k, mu = smp.k * (1 + dk), MU + dmu
        new = (scene.N + sp.diags(mu + 0 * w) @ scene.T).T @ sp.diags(w * k) @ scene.N
        old = (scene.N + MU * scene.T).T @ sp.diags(w * smp.k) @ scene.N
        return none, none, new - old

    def sliding(x):
        R = scene.R
        return none, x * (R.T @ sp.diags(w * smp.across) @ R), none

    one = (np.arange(w.size) == 3).astype(float)
    out = {
        "k": (1e-4, lambda x: contact(x, 0.0)),
        "k3": (1e-3, lambda x: contact(x * one, 0.0)),
        "friction": (1e-4, lambda x: contact(0.0, x)),
        "across": (1e-3, sliding),
    }
    pad, plate = LAYERS
    out["stiffness"] = (1e-4, lambda x: (none, none, x * K[pad]))
    out["mass"] = (1e-4, lambda x: (x * M[plate], none, none))
    out["loss"] = (1e-4, lambda x: (none, x * K[pad] / 1e5, none))
    return out


def derivatives(scene, case, motions, right, left):
    """The same derivatives by formula."""
    smp, w = sample(scene, case), scene.w
    K, M = layer_matrices(scene)
    s, zero = motions.s, np.zeros(w.size)
    d = contact_derivatives(motions, smp.contact, np.full(w.size, MU), w)
    out = {
        "k": d.chain(smp.k, zero, zero, zero),
        "k3": smp.k[3] * d.k[3],
        "friction": d.chain(zero, zero + 1, zero, zero),
        "across": d.chain(zero, zero, zero, smp.across),
    }
    given, (pad, plate) = (right, left, motions.slope), LAYERS
    out["stiffness"] = bilinear(K[pad], *given)
    out["mass"] = s**2 * bilinear(M[plate], *given)
    out["loss"] = s / 1e5 * bilinear(K[pad], *given)
    return out


@cache
def exact(scene, case):
    """Parameter -> derivatives of the two modes by differences of the full problem."""
    modes, chosen = found(scene, case)
    smp = sample(scene, case)
    given = modes.s[chosen], *(A.toarray() for A in (smp.M, smp.C, smp.K))
    named = directions(scene, case).items()
    return {n: differences(*given, change, h) for n, (h, change) in named}


def compared(scene, case, by_formula, most=1e-5):
    """Errors of each parameter, relative to its largest derivative."""
    for name, values in exact(scene, case).items():
        if name == "across" and case == "undamped":
            continue
        error = np.abs(by_formula[name] - values).max() / np.abs(values).max()
        assert error < most, f"{name}: {error:.1e}"


@pytest.mark.long
@pytest.mark.parametrize("case", CASES)
def test_reduced_model_agrees_with_differences_of_the_full_problem(two_blocks, case):
    """Contact from the interface alone, layers from left and right displacements.

    Catches vectors of the truncated series (1e-3), left rows of the wrong blocks, a lost friction
    term, a left displacement that is not that of the transposed bodies (the plate turns).
    """
    scene = two_blocks("guided")
    (modes, chosen), smp, model = (
        found(scene, case),
        sample(scene, case),
        offline(scene, case, tolerance=TOLERANCE),
    )
    given = modes.s[chosen], modes.right[:, chosen], modes.left[:, chosen]
    motions, a, b = model.motions([], smp.contact, *given)
    right, _ = model.displacements([], smp.contact, motions.s, a)
    left, _ = model.displacements([], smp.contact, motions.s, b, left=True)
    compared(scene, case, derivatives(scene, case, motions, right, left))


@pytest.mark.parametrize("case", CASES)
def test_full_order_agrees_with_differences(two_blocks, case):
    """From the vectors of the full problem."""
    scene = two_blocks("guided")
    (reduced, chosen), smp = found(scene, case), sample(scene, case)
    C = None if case == "undamped" else smp.C
    modes = complex_modes(smp.M, C, smp.K, BAND, zeta_max=ZETA)
    chosen = np.abs(modes.s[:, None] - reduced.s[chosen]).argmin(axis=0)
    s, right, left = modes.s[chosen], modes.right[:, chosen], modes.left[:, chosen]
    rows = {name: getattr(scene, name) for name in followed(case)} | {"T": scene.T}
    pencil = QuadraticPencil(smp.M, C, smp.K)
    motions = motions_of_vectors(rows, pencil, s, right, left)
    compared(scene, case, derivatives(scene, case, motions, right, left))


def test_friction_work_is_the_growth(two_blocks):
    """Without damping the elements' works over a period add up to 4 pi alpha / omega energies.

    Catches a lost factor, and the left vector in the place of the right one.
    """
    scene, case = two_blocks("guided"), "undamped"
    (modes, chosen), smp, model = found(scene, case), sample(scene, case), offline(scene, case)
    given = modes.s[chosen], modes.right[:, chosen], modes.left[:, chosen]
    motions, a, _ = model.motions([], smp.contact, *given)
    right, _ = model.displacements([], smp.contact, motions.s, a)
    rows = {name: getattr(scene, name) for name in "NTR"}
    pencil = QuadraticPencil(smp.M, None, smp.K)
    whole = motions_of_vectors(rows, pencil, motions.s, right, right)
    inertia = inner(right, smp.M @ right).real
    work = friction_work(whole, smp.contact, scene.w, inertia)
    growth = 4 * np.pi * motions.s.real / motions.s.imag
    assert growth.max() > 0.1
    np.testing.assert_allclose(work.sum(axis=0), growth, rtol=1e-5, atol=1e-7)


class Flutter:
    """Hoffmann's minimal model: two coordinates, one contact spring with friction.

    N. Hoffmann et al., ASME J. Vib. Acoust. 124 (2002) 475; unit mass, kappa = -lambda^2 =
    m +- root, root^2 = ((k11 - k22 - k)/2)^2 + k12 (k12 + mu k): the two merge where root = 0.
    """

    N, T, w = sp.csr_matrix([[0.0, 1.0]]), sp.csr_matrix([[1.0, 0.0]]), np.ones(1)
    K, M = np.array([[1.1e8, -0.2e8], [-0.2e8, 0.5e8]]), sp.identity(2, format="csr")
    k = 0.5e8
    merging = (0.25 * 0.1e8**2 / 0.2e8 - (-0.2e8)) / 0.5e8

    def __init__(self, mu, C=None, across=0.0):
        self.mu = np.array([mu])
        self.contact = ContactLinearisation.of([self.k], mu, 0.0, across)
        friction = (self.N + mu * self.T).T @ sp.diags(self.w * self.k) @ self.N
        K = sp.csr_matrix(self.K + friction.toarray())
        self.C = None if C is None else sp.csr_matrix(C)
        modes = complex_modes(self.M, self.C, K, (0.0, 3e3), zeta_max=0.5)
        self.s, self.right, self.left = modes.s, modes.right, modes.left
        given = QuadraticPencil(self.M, self.C, K), self.s, self.right, self.left
        self.motions = motions_of_vectors({"N": self.N, "T": self.T}, *given)

    @property
    def by_friction(self):
        d = contact_derivatives(self.motions, self.contact, self.mu, self.w)
        return d.friction[0]


@pytest.mark.parametrize("share", [0.5, 0.99, 1.05, 2.0])
def test_derivative_of_the_flutter_model(share):
    """To friction, before and after the two modes merge: closed form."""
    mu = share * Flutter.merging
    model = Flutter(mu)
    kappa = -(model.s**2)
    root = np.sqrt(0.25 * 0.1e8**2 - 0.2e8 * (-0.2e8 + mu * model.k) + 0j)
    middle = 1.05e8
    # Which of the two each mode is.
    sign = np.where(np.abs(kappa - middle - root) < np.abs(kappa - middle + root), 1, -1)
    exact = -(sign * -0.2e8 * model.k / (2 * root)) / (2 * model.s)
    np.testing.assert_allclose(kappa, middle + sign * root, rtol=1e-9)
    np.testing.assert_allclose(model.by_friction, exact, rtol=1e-6)


@pytest.mark.parametrize(("share", "expected"), [(1.015, False), (1.03, True), (0.985, False)])
def test_not_trusted_next_to_merging(share, expected):
    """A change of 1 % leads half way to the merging point from 2 % beyond it."""
    model = Flutter(share * Flutter.merging)
    kept = trusted(model.s, model.by_friction[None], 0.01 * model.mu, {0: [1], 1: [0]})
    assert np.all(kept == expected)


def test_friction_work_feeds_growth_and_damping():
    """With a dashpot: the work of friction is the growth and what the dashpot takes."""
    C = np.diag([150.0, 50.0])
    model = Flutter(2 * Flutter.merging, C)
    inertia = inner(model.right, model.right).real
    work = friction_work(model.motions, model.contact, model.w, inertia).sum(axis=0)
    taken = 2 * np.pi * inner(model.right, C @ model.right).real / (model.s.imag * inertia)
    growth = 4 * np.pi * model.s.real / model.s.imag
    np.testing.assert_allclose(work, growth + taken, rtol=1e-9)

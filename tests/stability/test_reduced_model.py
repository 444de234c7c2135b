"""The reduced model against dense full order: every kind of brake, every mode of the band."""

from itertools import pairwise
from mmap import mmap
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

import reduced_samples
from brake_fenicsx.errors import InaccurateResult, NotConverged, SceneError
from brake_fenicsx.folder.store import Store
from brake_fenicsx.macro.contact_forces import Rotation
from brake_fenicsx.macro.equilibrium import compliance
from brake_fenicsx.stability import (
    ContactLinearisation,
    Reduced,
    ReducedModel,
    complex_modes,
    reduce_bodies,
    split_substructures,
)
from brake_fenicsx.stability.damping_matrices import gyroscopic
from brake_fenicsx.stability.eigensolvers import symmetric
from brake_fenicsx.stability.substructures import CONSTANT
from brake_fenicsx.stability.substructures.component import Complement
from brake_fenicsx.stability.substructures.contact_rows import SIGMA
from brake_fenicsx.stability.substructures.parameters import InterpolatedCoefficients, Interpolation
from brake_fenicsx.stability.substructures.polynomials import (
    Blocks,
    lowest_coefficients,
    whole,
    zeros,
)
from brake_fenicsx.stability.substructures.reduction import AMID, Reduction, kept_modes
from brake_fenicsx.stability.substructures.sample import assembled
from brake_fenicsx.stability.substructures.substructure import mirror_image
from brake_fenicsx.stability.substructures.vectors import SETTLED
from reduced_samples import (
    BAND,
    CASES,
    HIGH,
    K0,
    Sample,
    box,
    coefficients,
    offline,
    scattered,
    substructures,
    unit_changes,
)
from tables import turns

KINDS = [case for case in CASES if case not in ("dashpot", "little", "contrast")]
# Round-off of coefficients in single precision, which eigenvalues feel in part.
SINGLE = 6e-8
POINTS = (0.0, (0.3, -0.5)), (0.5, (-1.0, -1.0)), (1.0, (0.7, 0.9))


@pytest.mark.long
@pytest.mark.parametrize("case, mu, seed", turns(zip(KINDS), [(0.0, 1), (0.4, 2), (1.0, 3)]))
def test_every_mode_of_constant_materials(two_blocks, case, mu, seed):
    """Two decades of contact stiffness, 30 % open: none missed, errors covered, verdicts right.

    Catches a term with a wrong sign or at the wrong place, a left vector of the wrong problem
    ("turning"), a pair of +-alpha of which one is lost.
    """
    scene = two_blocks("coarse")
    sample = Sample(scene, case, mu=mu, seed=seed)
    assert sample.agrees(sample.modes(offline(scene, case))) < 2e-6


@pytest.mark.long
@pytest.mark.parametrize("case, mu, x", turns(zip(KINDS), POINTS), ids=str)
def test_every_mode_of_changing_materials(two_blocks, case, mu, x):
    """Two points inside, and the corner without an anchor; damping follows the stiffness."""
    scene = two_blocks("coarse")
    sample = Sample(scene, case, x, mu, seed=int(10 * mu))
    assert sample.agrees(sample.modes(offline(scene, case, changing=True))) < 1e-5


@pytest.mark.parametrize("case", ["undamped", "all"])
def test_free_bodies(two_blocks, case):
    """Nothing is held, one of the two bodies turns: rigid modes are there and never unstable."""
    scene = two_blocks("free")
    sample = Sample(scene, case, mu=0.3, seed=5)
    found = sample.modes(offline(scene, case))
    assert sample.agrees(found) < 1e-5
    rigid = np.abs(found.s) <= 10.0
    assert np.sum(rigid) >= 6
    assert "unstable" not in np.array(found.verdict)[rigid]
    assert found.residual.max() <= 2.0


@pytest.mark.parametrize("case", KINDS)
def test_growing_modes_are_found_without_the_others(two_blocks, case):
    """With the few that move them: their squares to round-off of the band's end squared.

    There are some, and without damping they come as +-alpha: the verdicts above say something.
    """
    scene, number = two_blocks("coarse"), 0
    model = offline(scene, case)
    for seed in range(6):
        sample = Sample(scene, case, mu=1.0, seed=seed)
        every, some = sample.modes(model), sample.modes(model, growing=True)
        both = [x.s[np.array(x.verdict, str) == "unstable"] for x in (every, some)]
        assert len(some) <= len(every)
        number += both[0].size
        if case == "undamped":
            assert all(np.abs(every.s + s.conj()).min() <= 1e-9 * abs(s) for s in both[0])
        np.testing.assert_allclose(both[1] ** 2, both[0] ** 2, rtol=0, atol=2e-9 * HIGH**2)
        assert np.all(np.abs(both[1] - both[0]) <= some.error[np.isin(some.s, both[1])])
    assert number or case != "undamped"


@pytest.mark.long
def test_tolerance_buys_accuracy(two_blocks):
    """More points and higher degrees: errors fall down to single precision, and so do estimates."""
    scene = two_blocks("coarse")
    sample = Sample(scene, x=(-1.0, -1.0), mu=0.5, seed=1)
    found = [sample.modes(offline(scene, changing=True, tolerance=t)) for t in (1e-2, 1e-5, 1e-7)]
    true = [sample.agrees(modes) for modes in found]
    stated = [float((m.error / np.abs(m.s)).max()) for m in found]
    for errors, least in ((true, SINGLE), (stated, 10 * SINGLE)):
        assert all(b < max(a / 4, least) for a, b in pairwise(errors))
    assert stated[1] < 1e-4


def test_static_compliance(two_blocks):
    """For braking equilibrium, here put on springs; a free pad and the loads too."""
    scene = two_blocks("guided")
    for model, x in ((offline(scene), ()), (offline(scene, "loss", changing=True), (0.6, -0.7))):
        found = model.static(x, scene.k0)
        K = scene.K
        if x:
            c = coefficients()(x)
            K = K + sum(a * A for a, A in zip(c, unit_changes(scene), strict=True))
        ref = compliance(K.tocsr(), scene.N, scene.T, scene.w, scene.f, scene.k0, scene.comm)
        n, free = scene.w.size, len(found[0]) - scene.w.size
        assert free == 3
        J = np.eye(n + free) + found[0] * np.r_[scene.w * scene.k0, np.ones(free)]
        for ours, theirs in zip(found, (ref.NN, ref.NT, ref.Nf[:, None]), strict=True):
            ours = np.linalg.solve(J, ours)[:n, : theirs.shape[1]]
            assert np.abs(ours - theirs).max() < 1e-6 * np.abs(theirs).max()


@pytest.mark.parametrize("case, x", [("undamped", ()), ("all", (0.4, -0.6))])
def test_displacements_solve_the_full_problem(two_blocks, case, x):
    """(lambda^2 M + lambda C + K) phi is what the error of lambda leaves, in the K0^-1 norm."""
    scene = two_blocks("coarse")
    sample = Sample(scene, case, x, 0.4, seed=3)
    model = offline(scene, case, changing=bool(x))
    found = sample.modes(model)
    elastic = np.flatnonzero(np.abs(found.s) > 1e3)
    s = found.s[elastic]
    phi, _ = model.displacements(x, sample.contact, s, found.right[:, elastic])
    K0_ = (scene.tangent(np.full(scene.w.size, K0), 0.0)).toarray()
    r = sample.M @ phi * s**2 + sample.C @ phi * s + sample.K @ phi
    norm = np.sqrt(np.einsum("im,im->m", r.conj(), la.solve(K0_, r)).real)
    size = np.sqrt(np.einsum("im,im->m", phi.conj(), K0_ @ phi).real)
    assert np.all(norm < 1e-4 * size)
    full = complex_modes(sample.M, sample.C if case == "all" else None, sample.K, BAND)
    gram = model.coordinates(scene.M, phi)
    np.testing.assert_allclose(gram, found.right[:, elastic], atol=1e-6)
    assert len(full) == len(found)


@pytest.mark.together
@pytest.mark.parametrize("left", [False, True])
@pytest.mark.parametrize("changing, factors", [(False, 2), (True, 3)])
def test_samples_share_the_factors_of_their_displacements(
    two_blocks, changing, factors, left, monkeypatch
):
    """Two samples: two matrices of the block whose material changes, one of the other; same shapes.

    The processes take the factors in turns. Modes of both samples are iterated together.
    """
    scene = two_blocks("coarse")
    model, count = offline(scene, "loss", changing=changing), [0]
    modes = []
    for seed, x in enumerate([(0.4, -0.6), (-0.3, 0.2)]):
        sample = Sample(scene, "loss", x if changing else (), 0.4, seed=seed)
        a = sample.modes(model)
        vectors = a.left if left else a.right
        modes.append((sample.x, sample.contact, a.s[-2:], vectors[:, -2:]))
    alone = [model.displacements(*mode, left) for mode in modes]

    class Counted(Complement):
        def __init__(self, *given):
            super().__init__(*given)
            count[0] += 1

    monkeypatch.setattr("brake_fenicsx.stability.substructures.vectors.Complement", Counted)
    shared = model.displacements_of_samples(modes, left, MPI.COMM_WORLD)
    assert MPI.COMM_WORLD.allreduce(count[0]) == factors
    for (one, _), (other, left_over) in zip(alone, shared, strict=True):
        assert np.all(left_over <= SETTLED)
        error = np.linalg.norm(other - one, axis=0) / np.linalg.norm(one, axis=0)
        assert error.max() < 2 * SETTLED


def test_left_vectors_and_conditions_are_those_of_full_order(two_blocks):
    """The condition of each mode against full order, to the share of energy that is left out."""
    scene = two_blocks("coarse")
    sample = Sample(scene, mu=0.8, seed=2)
    found = sample.modes(offline(scene))
    full = complex_modes(sample.M, None, sample.K, BAND)
    np.testing.assert_allclose(found.condition, full.condition, rtol=0.05)


@pytest.mark.parametrize("changing", [False, True])
def test_what_was_made_earlier_gives_the_same_bytes(two_blocks, changing, tmp_path, monkeypatch):
    """The arrays of the bodies, mapped from the file that a first run left."""
    scene, store = two_blocks("coarse"), Store(tmp_path)
    parameters = box(scene, "loss") if changing else CONSTANT
    first = reduce_bodies(
        substructures(scene, "loss", changing), scene.w, BAND, parameters,
        keep=lambda arrays: store.save("model.npz", **arrays) or arrays,
    )  # fmt: skip
    monkeypatch.setattr("brake_fenicsx.folder.arrays.MAPPED", 1000)
    mapped = store.load("model.npz", mapped=True)
    assert isinstance(mapped["1.W"].base, mmap)
    again = ReducedModel(mapped, scene.w, BAND, parameters)
    sample = Sample(scene, "loss", (0.1, -0.2) if changing else (), seed=2)
    a, b = sample.modes(first), sample.modes(again)
    np.testing.assert_array_equal(a.s, b.s)
    np.testing.assert_array_equal(a.error, b.error)
    phi = [model.displacements(sample.x, sample.contact, a.s[-2:], a.right[:, -2:])[0]
           for model in (first, again)]  # fmt: skip
    np.testing.assert_array_equal(*phi)


@pytest.mark.together
def test_one_process_and_all_give_the_same_modes(two_blocks):
    """Eigenvalues and stated errors to round-off, however many processes share the solves."""
    found = []
    for alone in (True, False):
        scene = two_blocks("coarse", alone=alone)
        model = offline(scene, "loss", changing=True)
        found.append(Sample(two_blocks("coarse", alone=True), "loss", (0.2, 0.1)).modes(model))
    a, b = found
    assert len(a) == len(b)
    assert np.all(np.abs(a.s - b.s) <= 1e-8 * np.abs(a.s))


@pytest.mark.together
def test_what_fails_on_the_first_process_alone_is_raised_on_all(two_blocks, monkeypatch):
    """It takes the values of all others, which wait for more of them: at its next factor."""
    done = []

    def fails(*_):
        raise InaccurateResult("said by the test")

    monkeypatch.setattr(Reduction, "_check_convergence", fails)
    scene = two_blocks("coarse", alone=False)
    with pytest.raises(InaccurateResult, match="said by the test"):
        reduce_bodies(
            substructures(scene, "undamped", changing=True), scene.w, BAND,
            box(scene, "undamped"), comm=scene.comm, progress=lambda total: done.append,
        )  # fmt: skip
    assert len(done) <= 8  # of 70 and more


def hidden(real):
    """A solver that withholds a mode."""

    def solve(*args, **kwargs):
        found = real(*args, **kwargs)
        return type(found)(found.Phi[:, 1:], found.kappa[1:])

    return solve


def failing(real):
    """A solver that fails."""

    def solve(*args, **kwargs):
        raise NotConverged("block Lanczos: said by the test")

    return solve


@pytest.mark.together
@pytest.mark.parametrize(
    "changed, error, said",
    [(hidden, InaccurateResult, "inertia"), (failing, NotConverged, "said by the test")],
)
def test_a_failure_of_one_process_is_raised_on_all(two_blocks, monkeypatch, changed, error, said):
    """Each body's modes are found by one process: catches the others waiting for ever.

    A real mode withheld is a failure: inertia knows.
    """
    scene = two_blocks("guided")
    monkeypatch.setattr(symmetric, "lowest_modes", changed(symmetric.lowest_modes))
    with pytest.raises(error, match=said):
        Reduced(scene.K, scene.M, scene.N, scene.T, scene.w, 1e11, BAND, comm=scene.comm)


@pytest.mark.parametrize("lowest", [-0.5, -500.0])
def test_an_indefinite_body_is_refused(lowest):
    """A negative spring: its eigenvalue next to the band or far below, counted but not found."""
    n, end = 40, (2 * np.pi * BAND[1]) ** 2
    K = sp.diags(end * np.r_[lowest, np.linspace(0.1, 9.0, n - 1)]).tocsr()
    N = sp.identity(n, format="csr")[:1]
    with pytest.raises(InaccurateResult, match="not positive definite"):
        Reduced(K, sp.identity(n, format="csr"), N, N, np.ones(1), 1e11, BAND)


def chain_and_its_modes():
    """What ``kept_modes`` takes of a chain of unit masses, and its eigenvalues."""
    n = 600
    line = sp.diags([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1])
    K, M = (line + sp.diags(np.linspace(0.0, 1.0, n))).tocsr(), sp.identity(n, format="csr")
    body = SimpleNamespace(stiffness=lambda low: K - low * M, mass=lambda _: M, changes={})
    constant = SimpleNamespace(centre=0.0, softening=1.0, shapes=[], acting_on=lambda _: [])
    return body, constant, la.eigvalsh(K.toarray())


@pytest.mark.parametrize("off", [0.0, 1e-13, 1e-10])
def test_an_eigenvalue_at_the_shift_of_the_kept_modes(off):
    """It hides all others by its round-off: they are found about another shift."""
    body, constant, exact = chain_and_its_modes()
    omega = np.sqrt(exact[12] * (1 + off) / AMID / (1 - SIGMA))
    kept = kept_modes(body, constant, omega, 1.0)
    np.testing.assert_allclose(np.sort(kept.kappa), exact[exact < omega**2], rtol=1e-9)


@pytest.mark.parametrize("share", [0.02, 0.98])
def test_a_little_below_zero_modes_are_kept(share):
    """As far as the shift of the reduced model makes a body definite."""
    body, constant, exact = chain_and_its_modes()
    omega = np.sqrt(exact[40])
    constant.centre = exact[0] + share * SIGMA * omega**2
    kept, exact = kept_modes(body, constant, omega, 1.0), exact - constant.centre
    np.testing.assert_allclose(np.sort(kept.kappa), exact[exact < omega**2], atol=1e-9 * omega**2)


def test_bodies_are_taken_apart(two_blocks):
    """Their matrices and operators put together are those of the whole."""
    scene = two_blocks("guided")
    bodies = substructures(scene, "loss", changing=True)
    assert [sorted(b.changes) for b in bodies] in ([[0, 1], []], [[], [0, 1]])
    places = np.concatenate([b.dofs for b in bodies])
    np.testing.assert_array_equal(np.sort(places), np.arange(scene.K.shape[0]))
    u = np.random.default_rng(0).standard_normal(places.size)
    gap, energy = np.zeros(scene.w.size), 0.0
    for b in bodies:
        gap[b.elements] += b.interface["N"] @ u[b.dofs]
        energy += u[b.dofs] @ (b.K @ u[b.dofs])
    np.testing.assert_allclose(gap, scene.N @ u, rtol=1e-12, atol=1e-12)
    assert energy == pytest.approx(u @ (scene.K @ u), rel=1e-12)


def mirrored(scene):
    """Two brakes, the second the first one's mirror image in z, its dofs in another order.

    The slip across the sliding direction has the other sign there, as on both sides of a disc.
    """
    rng = np.random.default_rng(5)
    n, m = scene.K.shape[0], scene.w.size
    order = rng.permutation(n)
    free = scene.free
    block, direction = np.divmod(free.local, 3)
    x = np.column_stack([free.V.tabulate_dof_coordinates()[block], direction])
    other = x[order] * [1, 1, -1, 1] + [0, 0, 0.1, 0]
    P = sp.csr_matrix((np.where(x[:, 3] == 2, -1.0, 1.0)[order], (np.arange(n), order)), (n, n))
    both = SimpleNamespace(w=np.r_[scene.w, scene.w], points=np.vstack([x, other]), P=P)
    both.K, both.M = (sp.block_diag([A, P @ A @ P.T]).tocsr() for A in (scene.K, scene.M))
    both.interface = {
        name: sp.block_diag([A, sign * A @ P.T]).tocsr()
        for name, A, sign in (("N", scene.N, 1), ("T", scene.T, 1), ("R", scene.R, -1))
    }
    assert both.K.shape == (2 * n, 2 * n) and both.interface["N"].shape == (2 * m, 2 * n)
    return both


@pytest.mark.parametrize("rows", ["N", "NR"])
def test_mirror_images_share_the_work(two_blocks, rows):
    """Half of the bodies are reduced, and the modes are those of all four reduced."""
    scene = two_blocks("coarse", alone=True)
    twin = mirrored(scene)
    made = [
        reduce_bodies(
            split_substructures(twin.K, twin.M, twin.interface, points=points),
            twin.w, BAND, followed=rows,
        )
        for points in (twin.points, None)
    ]  # fmt: skip
    assert [len({id(b.component) for b in model.bodies}) for model in made] == [2, 4]
    k = np.r_[scattered(scene, 4), scattered(scene, 6)]
    contact = ContactLinearisation.of(k, 0.4, 0.0, 2e5 * (k > 0) * ("R" in rows))
    a, b = (model.modes([], contact) for model in made)
    np.testing.assert_allclose(a.s, b.s, rtol=1e-9)
    one, both = made
    phi = [one.displacements([], contact, a.s[-1:], a.right[:, -1:])[0]]
    phi.append(both.displacements([], contact, b.s[-1:], b.right[:, -1:])[0])
    # One vector, up to its phase.
    likeness = np.abs(np.vdot(*phi)) / np.linalg.norm(phi[0]) / np.linalg.norm(phi[1])
    assert likeness == pytest.approx(1.0, abs=1e-6)


def images(bodies):
    """Pairs of bodies of which the second is the mirror image of the first."""
    return [(j, i) for i in range(4) for j in range(i) if mirror_image(bodies[j], bodies[i])]


def test_what_differs_by_little_is_no_image(two_blocks):
    """One entry by a millionth of the largest; unlike blocks neither."""
    twin = mirrored(two_blocks("coarse", alone=True))
    bodies = split_substructures(twin.K, twin.M, twin.interface, points=twin.points)
    (_, i), _ = images(bodies)
    bodies[i].K[0, 0] += 1e-6 * abs(bodies[i].K).max()
    assert len(images(bodies)) == 1


@pytest.mark.parametrize("sense, number", [(1.0, 2), (-1.0, 1)])
def test_a_body_that_turns_the_other_way_is_no_image(two_blocks, sense, number):
    """A change of the damping decides too: the gyroscopic matrix has a sense, the mass has none."""
    scene = two_blocks("coarse", alone=True)
    twin = mirrored(scene)
    G = gyroscopic(scene.mesh, scene.free, {"plate.body": 7200.0}, Rotation(1.0))
    changes = [sp.block_diag([G, sense * twin.P @ G @ twin.P.T]).tocsr(), twin.M]
    given = twin.K, twin.M, twin.interface, None, changes, twin.M, twin.points
    assert len(images(split_substructures(*given))) == number


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (dict(w=np.zeros(1)), r"N: a sparse matrix of shape \(1, \d+\) is needed"),
        (dict(w="zero"), r"w = 0: positive finite"),
        (dict(K="dense"), None),
        (dict(N="short"), r"N: a sparse matrix of shape \(\d+, \d+\) is needed"),
        (dict(w="list"), None),
        (dict(k=[1.0]), r"k: 1 values for \d+ contact elements"),
        (dict(k="negative"), r"k = -1 Pa/m: contact stiffness must not be negative"),
        (dict(k="nan"), r"k: a value is not finite"),
        (dict(mu=[0.1, 0.2]), r"mu: shape \(2,\), one value for each contact element"),
        (dict(band=(5e3, 1e3)), r"band 5000 to 1000 Hz"),
        (dict(tolerance=0.0), r"tolerance = 0: a relative error between 0 and 1"),
    ],
)
def test_arguments_that_do_not_fit_are_one_line(two_blocks, change, said):
    """Of the scripted interface: no NumPy error, no answer."""
    scene = two_blocks("coarse", alone=True)
    n = scene.w.size
    given = {"K": scene.K, "N": scene.N, "w": scene.w, "band": BAND, "tolerance": 1e-5}
    k, mu = np.full(n, K0), 0.5
    named = {
        "dense": scene.K.toarray(), "short": scene.N[:-1], "list": list(scene.w),
        "zero": 0 * scene.w, "negative": np.r_[-1.0, k[1:]], "nan": np.r_[np.nan, k[1:]],
    }  # fmt: skip
    change = {key: named.get(v, v) if isinstance(v, str) else v for key, v in change.items()}
    k, mu = change.pop("k", k), change.pop("mu", mu)
    given |= change

    def run():
        made = Reduced(
            given["K"], scene.M, given["N"], scene.T, given["w"], 1e11, given["band"],
            given["tolerance"],
        )  # fmt: skip
        return made.modes(k, mu)

    if said is None:
        assert len(run())
        return
    with pytest.raises(SceneError, match=said):
        run()


@pytest.mark.parametrize(
    "degrees", [(), (5,), (4, 4), (3, 3, 3), (2, 2, 2, 2, 2), (7, 3), (9, 2, 4)], ids=str
)
def test_interpolation_is_exact_for_polynomials(degrees):
    """Products up to i / n_1 + j / n_2 + ... = 1, an anchor for each; lower degrees by the first.

    Also a little beyond the box.
    """
    rng, box = np.random.default_rng(len(degrees)), Interpolation(degrees)
    powers = np.array([*np.ndindex(*(n + 1 for n in degrees))])
    share = np.sum(powers / np.maximum(degrees, 1), axis=1)
    assert len(box.points) == np.sum(share < 1 + 1e-9) == box.count(box.degree)
    for lower in range(box.degree + 1):
        x = 1.1 * rng.uniform(-1, 1, len(degrees))
        weights = box.weights(x, lower)
        assert not np.any(weights[box.count(lower) :])
        for of in powers[box.degree * share < lower + 1e-9]:
            value = weights @ np.prod(box.points**of, axis=1)
            assert value == pytest.approx(np.prod(x**of), abs=1e-10)


@pytest.mark.parametrize("degree", [1, 2])
def test_zeros_of_a_matrix_polynomial(degree):
    """By division and without it: the small zeros of the full linearisation, and both vectors."""
    rng = np.random.default_rng(0)
    n, top = 12, 2 * degree
    T = np.array([rng.standard_normal((n, n)) * 0.05**j for j in range(top + 1)])
    T[0] += 4 * np.eye(n)
    T[degree] += np.eye(n)
    T[degree + 1 :] *= 1e-2

    def near(z):
        return np.flatnonzero(np.abs(z) < 3.0)

    A = np.eye(n * top, k=n)
    A[-n:] = -la.solve(T[-1], np.hstack([*T[:-1]]))
    exact = la.eigvals(A)
    wanted = exact[np.abs(exact) < 3.0]
    for reach in (3.0, 1e9):
        found = zeros(T, degree, reach, near)
        assert found.z.size == wanted.size > 0
        assert np.abs(found.z[:, None] - wanted).min(axis=1).max() < 1e-8
        for z, a, b in zip(found.z, found.right.T, found.left.T, strict=True):
            value = sum(z**j * C for j, C in enumerate(T))
            assert la.norm(value @ a) < 1e-7 and la.norm(b @ value) < 1e-6


def test_blocks_are_a_matrix():
    """Products, transposed, and the whole: blocks that meet add up, elsewhere are zeros."""
    rng = np.random.default_rng(4)
    places = [(slice(0, 3), np.array([1, 4])), (np.array([2, 5, 0]), np.array([4, 0]))]
    places.append((np.array([6]), slice(2, 5)))
    entries = [rng.standard_normal(shape) for shape in ((3, 2), (3, 2), (1, 3))]
    A = Blocks((7, 6), [(*place, B) for place, B in zip(places, entries, strict=True)])
    dense = np.zeros((7, 6))
    for (rows, columns), B in zip(places, entries, strict=True):
        for n, i in enumerate(np.arange(7)[rows]):
            for m, j in enumerate(np.arange(6)[columns]):
                dense[i, j] += B[n, m]
    x, y = rng.standard_normal((6, 3)), rng.standard_normal((7, 2))
    np.testing.assert_allclose(A @ x, dense @ x, atol=1e-15)
    np.testing.assert_allclose(A.T @ y, dense.T @ y, atol=1e-15)
    np.testing.assert_array_equal(A.whole, dense)
    np.testing.assert_array_equal(whole([A, dense]), [dense, dense])
    single = A.astype(np.float32)
    assert single.dtype == np.float32 and (single @ x.astype(np.float32)).dtype == np.float32
    np.testing.assert_array_equal(Blocks((2, 3), []) @ np.ones((3, 1)), np.zeros((2, 1)))


@pytest.mark.parametrize("case, changing", [("undamped", True), ("all", True), ("sliding", False)])
def test_forces_act_on_each_body_by_itself(two_blocks, case, changing):
    """The bodies one by one under the forces of their own elements are lead J of all together."""
    scene = two_blocks("coarse")
    model, x = offline(scene, case, changing), (0.3, -0.5) if changing else ()
    sample = model.sample(x, Sample(scene, case, x, 0.4, seed=2).contact)
    b = assembled(model.bodies, model.at(x), model.rows, sample.closed)
    wanted = [sample.contact.after(A, model.rows) for A in whole(b.lead)]
    assert 0 < sample.closed.count < scene.w.size and np.abs(wanted[0]).max() > 0
    np.testing.assert_allclose(whole(sample.forced), wanted, rtol=1e-14)


@pytest.mark.parametrize("degrees, digits", [((4, 3, 1), 2e-7), ((6, 4, 2), 1e-13)])
def test_moments_between_the_anchors(degrees, digits):
    """Exact for polynomials of each degree; a term of one degree more is within the estimates.

    "Exact" is round-off: of single precision up to the fifth degree and for the moments beyond the
    first, else of double precision.
    """
    rng = np.random.default_rng(3)
    moments = InterpolatedCoefficients((degrees[0],) * 2, degrees)
    assert sorted(moments.order) == [*range(len(moments.points))] and moments.order[0] == 0
    assert np.all(np.diff([moments.counts[i] for i in moments.order]) <= 0)
    powers = [[(i, j) for i in range(n + 1) for j in range(n + 1 - i)] for n in degrees]
    factors = [rng.standard_normal((len(of), 5, 7)) for of in powers]
    largest = max(np.abs(factor).sum(axis=0).max() for factor in factors)

    def exact(x, more=0.0):
        """Moments at x, and ``more`` times a term of one degree more."""
        out = []
        for n, of, factor in zip(degrees, powers, factors, strict=True):
            terms = np.array([x[0] ** i * x[1] ** j for i, j in of])
            out.append(np.tensordot(terms, factor, 1) + more * x[0] ** (n + 1))
        return np.array(out)

    for more in (0.0, 1e-3):
        made = InterpolatedCoefficients((degrees[0],) * 2, degrees)
        for i in made.order:
            made.add(i, exact(made.points[i], more)[: made.counts[i]])
        arrays = made.arrays()
        known = InterpolatedCoefficients((degrees[0],) * 2, degrees, arrays)
        for x in rng.uniform(-1, 1, (5, 2)):
            D, errors, growth = known.at(x)
            assert growth == 1.0 and all(A.dtype == np.float32 for A in D[1:])
            off = np.array([np.abs(A - B) for A, B in zip(D, exact(x, more), strict=True)])
            for one, limit in zip(off, (digits, 2e-7, 2e-7), strict=True):
                assert one.max() <= (2e-3 if more else limit * largest)
            assert len(errors) == 3 and all(e.dtype == np.float32 for e in errors)
            if more:
                assert off.max() <= 8 * max(np.abs(e).max() for e in errors)


def test_first_coefficients_where_the_others_are_interpolated():
    """As many values as coefficients are enough: an anchor knows those it is not there for."""
    degrees, rng = (6, 4, 2), np.random.default_rng(5)
    moments = InterpolatedCoefficients((6, 6), degrees)
    powers = [[(i, j) for i in range(n + 1) for j in range(n + 1 - i)] for n in degrees]
    factors = [rng.standard_normal((len(of), 4, 3)) for of in powers]

    def exact(x):
        terms = [np.array([x[0] ** i * x[1] ** j for i, j in of]) for of in powers]
        return np.array([np.tensordot(t, f, 1) for t, f in zip(terms, factors, strict=True)])

    for i in moments.order:
        w = np.linspace(0.05, 1.0, moments.counts[i])
        values = [np.tensordot(x ** np.arange(3), exact(moments.points[i]), 1) for x in w]
        found = lowest_coefficients(w, values, moments.beyond(i))
        # What is known is held in single precision.
        np.testing.assert_allclose(found, exact(moments.points[i])[: len(w)], atol=2e-5)
        moments.add(i, found)
    assert {moments.counts[i] for i in moments.order} == {1, 2, 3}


def test_anchors_have_as_many_points_as_coefficients(two_blocks, monkeypatch):
    """All of them where checks are made, at the centre and where the body is softest."""
    plans, totals, done, plan = [], [], [], Reduction.plan
    monkeypatch.setattr(Reduction, "plan", lambda *given: plans.append(plan(*given)) or plans[-1])
    scene = two_blocks("coarse")
    given = substructures(scene, "undamped", True), scene.w, BAND, box(scene, "undamped")
    reduce_bodies(*given, progress=lambda total: totals.append(total) or done.append)
    assert sum(done) == sum(totals) == sum(one.factors for one in plans)
    pad = max(plans, key=lambda one: one.factors)
    counts, every = pad.coefficients.counts, len(pad.points[0])
    softest = int(np.argmax([np.sum(x) for x in pad.coefficients.points]))
    whole = {i for i, points in pad.points.items() if len(points) == every}
    assert whole == {softest} | {i for i, count in enumerate(counts) if count == max(counts)}
    lowest = {i: pad.points[softest][: counts[i]] for i in pad.points.keys() - whole}
    assert all(np.array_equal(pad.points[i], points) for i, points in lowest.items())
    assert pad.factors < 0.75 * every * len(pad.points)


def test_damping_in_proportion_at_the_centre_alone(two_blocks, monkeypatch):
    """Elsewhere in the box the damping follows a modulus threefold: complex factors there."""
    scene = two_blocks("coarse")
    C, shares = reduced_samples.damping(scene, "rayleigh")
    monkeypatch.setattr(reduced_samples, "damping", lambda *_: (C, 3 * shares))
    plans, plan = [], Reduction.plan
    monkeypatch.setattr(Reduction, "plan", lambda *given: plans.append(plan(*given)) or plans[-1])
    given = substructures(scene, "rayleigh", True), scene.w, BAND, box(scene, "rayleigh")
    model = reduce_bodies(*given)
    centre, *others = max(plans, key=lambda one: one.factors).shares
    assert centre is not None and others == [None] * len(others)
    for x in ((0.8, -0.9), (-1.0, -1.0)):
        sample = Sample(scene, "rayleigh", x, 0.4, seed=2)
        assert sample.agrees(sample.modes(model)) < 1e-5

"""Hard cases of the full order: each gives a correct result or an error message."""

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from scipy.optimize import linear_sum_assignment
from scipy.stats import ortho_group

import sliding_layer as layer
from brake_fenicsx import prepare
from brake_fenicsx.errors import SceneError
from brake_fenicsx.stability import complex_modes, contact_interface
from brake_fenicsx.stability.full import general
from dense_reference import all_damped
from places import SQUEALING

pytestmark = pytest.mark.hard

TWO_PI = 2 * np.pi
BAND = (0.0, 90e3)


def grid(n, m, stiff=1.0, coupling=1.0):
    """Springs on a box n x m between walls, and its eigenvalues; square ones have true doublets."""
    lines = [sp.diags([np.full(k, 2.0), -np.ones(k - 1), -np.ones(k - 1)], [0, 1, -1])
             for k in (n, m)]  # fmt: skip
    K = sp.kron(lines[0], sp.identity(m)) + sp.kron(sp.identity(n), lines[1])
    values = [4 * np.sin(np.arange(1, k + 1) * np.pi / (2 * (k + 1))) ** 2 for k in (n, m)]
    return K.tocsr(), np.sort((values[0][:, None] + values[1]).ravel())


def one(n):
    return sp.identity(n, format="csr")


def below(K, omega, number, C=None, M=None, **more):
    """Modes of a band that ends between the number-th frequency and the next, and that end."""
    edge = 0.5 * (omega[number - 1] + omega[number])
    M = one(K.shape[0]) if M is None else M
    return complex_modes(M, C, K.tocsr(), (0.0, edge / TWO_PI), **more), edge


def chain(n, *stiffness):
    """Stiffness of n masses in a chain that is held at one end, for each row of link springs."""
    links = sp.diags([np.ones(n), -np.ones(n - 1)], [0, -1], shape=(n, n)).tocsr()
    return [(links.T @ sp.diags(k) @ links).tocsr() for k in stiffness]


def near(modes, exact, tolerance=1e-7):
    """As many as there are, each next to one of them."""
    assert len(modes) == exact.size > 0
    assert np.all(np.abs(modes.s[:, None] - exact).min(axis=1) < tolerance * np.abs(modes.s))


def dense(K, M):
    """All lambda with omega >= 0, by a shifted inverse: exact to round-off for low modes."""
    K, M = (A.toarray() for A in (K, M))
    s = 1e-3 * (TWO_PI * BAND[1]) ** 2
    theta = la.eigvals(la.solve(K + s * M, M))
    theta = theta[np.abs(theta) > 1e-14 * np.abs(theta).max()]
    lam = np.sqrt(s - 1 / theta + 0j)
    return np.where(lam.imag < 0, -lam, lam)


def compared(modes, exact, highest=BAND[1], tolerance=1e-7):
    """None missed, none invented, each within a tolerance."""
    exact = exact[(exact.imag > 0) & (exact.imag <= TWO_PI * highest)]
    assert len(modes) == exact.size == modes.count.expected
    distance = np.abs(modes.s[:, None] - exact).min(axis=1)
    assert np.all(distance <= tolerance * np.abs(modes.s) + modes.error)


@pytest.mark.parametrize("mu", [0.6, 1.0])
def test_thin_layer_that_slides_on_stiff_contact_is_counted(mu):
    """Stiffness of 1e15 Pa/m, where the bound of what the count leaves out is large."""
    law = f"law={{ linear='1e15 Pa/m' }}, friction={mu}"
    changes = [
        "countermeasures=[]", "samples.n=1", "stability.method=full",
        f"contact.block_plate={{ faces=['block.bottom', 'plate.top'], {law} }}",
        "parts.block.height='6 mm'", "parts.block.size='6 mm'",
        "stability.band=['0 Hz', '30 kHz']",
    ]  # fmt: skip
    modes = prepare(SQUEALING, changes).modes()
    assert "winding number" in modes.count.how and modes.count.kind == "proven"


def test_exact_doublets():
    """A square grid: both modes of every doublet are found."""
    K, kappa = grid(22, 22)
    assert kappa[100] > kappa[99] * 1.0001
    m, _ = below(K, np.sqrt(kappa), 100)
    np.testing.assert_allclose(m.s.imag, np.sqrt(kappa[:100]), rtol=1e-9)
    # Vectors of a doublet are independent.
    gram = m.right.conj().T @ m.right
    assert np.linalg.cond(gram) < 1.0 + 1e-6


def test_close_pairs_are_kept():
    """150 pairs of modes 1e-9 apart: none merged, none doubled."""
    base = np.linspace(1.0, 4.0, 160)
    kappa = np.sort(np.r_[base, base * (1 + 1e-9)])
    m, _ = below(sp.diags(kappa), np.sqrt(kappa), 300)
    assert len(m) == 300
    np.testing.assert_allclose(m.s.imag, np.sqrt(kappa[:300]), rtol=1e-8)


@pytest.mark.parametrize("n", [25, 400])
def test_band_edge_inside_a_cluster_and_on_an_eigenvalue(n):
    """Ten modes within 1e-6 of the band edge: exactly the modes below the edge are listed."""
    cluster = 2.0 * (1 + 1e-6 * np.linspace(-0.45, 0.55, 10))
    kappa = np.sort(np.r_[cluster, np.linspace(0.5, 1.8, 8), np.linspace(2.5, 90.0, n - 18)])
    m = complex_modes(one(n), None, sp.diags(kappa).tocsr(), (0.0, np.sqrt(2.0) / TWO_PI))
    assert len(m) == np.sum(kappa <= 2.0)
    # The edge is an eigenvalue itself: in or out, but never an error of another kind.
    m = complex_modes(one(n), None, sp.diags(kappa).tocsr(), (0.0, np.sqrt(cluster[4]) / TWO_PI))
    assert len(m) in (np.sum(kappa < cluster[4]), np.sum(kappa <= cluster[4]))


@pytest.mark.parametrize("n", [40, 400])
def test_shift_exactly_on_an_eigenvalue(n):
    """kappa = sigma in both methods: no division by zero."""
    high = (TWO_PI * 0.5) ** 2
    for at in (high, 0.49 * high * (1 + 1.234e-7)):
        kappa = np.sort(np.r_[at, high * np.linspace(0.1, 0.95, 7), high * np.linspace(2, 90, n)])
        m = complex_modes(one(n + 8), None, sp.diags(kappa).tocsr(), (0.0, 0.5))
        assert len(m) in (np.sum(kappa < high * (1 - 1e-9)), np.sum(kappa <= high * (1 + 1e-9)))


@pytest.mark.parametrize("mu", [0.0, 0.4, 1.0])
def test_band_without_a_mode_and_a_third_of_the_patches_open(two_blocks, mu):
    """The other patches span two decades; the count proves that the band has no mode."""
    scene = two_blocks("guided")
    rng = np.random.default_rng(5)
    k = 3e11 * 10 ** rng.uniform(-1, 1, scene.w.size)
    k[rng.random(k.size) < 1 / 3] = 0.0
    K, smooth = scene.tangent(k, mu), scene.tangent(k, 0.0)
    exact = dense(K, scene.M)
    m = complex_modes(scene.M, None, K, BAND, frictionless=smooth)
    compared(m, exact)
    if mu == 0:
        assert np.all(m.s.real == 0) and m.count.how == "inertia of K - kappa M"
        assert set(m.verdict) == {"stable"}
    else:
        assert "winding" in m.count.how and m.count.kind == "proven"
    first = np.min(exact[exact.imag > 0].imag) / TWO_PI
    none = complex_modes(scene.M, None, K, (0.0, 0.6 * first), frictionless=smooth)
    assert len(none) == 0 == none.count.expected


def test_all_contacts_open_with_friction_is_symmetric(two_blocks):
    """No closed element, no friction: only the pad's rigid motion, at zero."""
    scene = two_blocks("guided")
    k = np.zeros(scene.w.size)
    face = contact_interface(scene.N, scene.T, scene.w * k, 0.5)
    assert face.rank == 0
    m = complex_modes(scene.M, None, scene.tangent(k, 0.5), BAND, friction=face)
    assert m.count.how == "inertia of K - kappa M" and "unstable" not in m.verdict


@pytest.mark.parametrize("n", [60, 420])
def test_springs_of_a_trillion_times_the_mean(n):
    """At 1e12 the backward error is no criterion; the reference is a constraint.

    Catches low modes drowned in the round-off of the stiff ones.
    """
    K, _ = grid(n // 20, 20)
    stiff = K + sp.diags(np.where(np.arange(n) % 7 == 0, 4e12, 0.0))
    free = np.flatnonzero(np.arange(n) % 7)
    exact = np.sqrt(la.eigvalsh(K[free][:, free].toarray()))
    m, _ = below(stiff, exact, 20)
    np.testing.assert_allclose(m.s.imag, exact[:20], rtol=1e-7)


@pytest.mark.parametrize("n", [9, 401])
@pytest.mark.parametrize("alpha", [0.0, 0.01])
def test_massless_contact_dofs(n, alpha):
    """Springs in series through nodes without mass: k / 2 each; a finite mode for each mass."""
    K = sp.diags([np.full(2 * n + 1, 2.0), -np.ones(2 * n), -np.ones(2 * n)], [0, 1, -1]).tocsr()
    M = sp.diags(np.arange(2 * n + 1) % 2 * 1.0).tocsr()
    exact = np.sqrt(2.0) * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1)))
    wanted = min(n, 30)
    m, _ = below(K, np.r_[exact, 2.5], wanted, alpha * exact[0] * M if alpha else None, M)
    a = 0.5 * alpha * exact[0]
    expected = -a + 1j * np.sqrt(exact[:wanted] ** 2 - a**2)
    assert len(m) == wanted
    np.testing.assert_allclose(m.s, expected, rtol=1e-9)


@pytest.mark.parametrize("nu", [0.49, 0.499])
def test_nearly_incompressible_layer(nu):
    """Exact dispersion relation of a sliding layer with a nearly incompressible lining."""
    exact = layer.in_band(layer.lambdas(layer.exact_modes(1.5 / layer.H, nu, 0.4)))
    m = layer.solved(*layer.constrained(layer.Layer(1.5 / layer.H, nu, 0.4), 16))
    assert len(m) == exact.size
    frequency, growth = layer.match(m.s, exact)
    assert frequency.max() < 1e-4 and growth.max() < 1e-3


@pytest.mark.parametrize("mu", [0.3, 0.8, 1.5])
def test_fine_sliding_layer_of_strong_friction(mu):
    """A fine layer, friction up to 1.5: all modes of its dispersion relation, a proven count."""
    k, nu = 1.5 / layer.H, 0.3
    exact = layer.in_band(layer.lambdas(layer.exact_modes(k, nu, mu)))
    smooth, _ = layer.constrained(layer.Layer(k, nu, 0.0), 150)
    m = layer.solved(*layer.constrained(layer.Layer(k, nu, mu), 150), smooth)
    assert len(m) == exact.size and m.count.kind == "proven"
    frequency, growth = layer.match(m.s, exact)
    assert frequency.max() < 1e-6 and growth.max() < 1e-4


@pytest.mark.parametrize("n", [30, 400])
def test_spring_ten_thousand_times_softer(n):
    """Two stiff chains on one soft spring: the lowest mode is that of two masses on it."""
    k = np.full(n + 1, 1e4)
    k[n // 2], k[0], k[-1] = 1.0, 0.0, 0.0
    K = sp.diags([k[:-1] + k[1:], -k[1:-1], -k[1:-1]], [0, 1, -1]).tocsr()
    exact = np.sqrt(np.maximum(la.eigvalsh(K.toarray())[:3], 0))
    m, _ = below(K, exact, 2)
    elastic = m.s[m.s.imag > 1e-3 * exact[1]]
    np.testing.assert_allclose(elastic.imag, exact[1], rtol=1e-8)
    # The free chain's rigid mode is there, or on the other side of zero: never a divergence.
    assert "unstable" not in m.verdict and len(m) in (1, 2)


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("zeta", [0.45, 2.0])
def test_overdamped_modes_within_the_band(zeta, whole):
    """Stiffness damping of a whole chain or of half of it, zeta at the band's end: real lambda.

    Of 400 modes nearly all have a real eigenvalue that is smaller than the band's end, or close
    above it; those of the band with a damping ratio up to 0.1 are found all the same.
    """
    n = 400
    K, damped = chain(n, np.full(n, 1e8), np.where((np.arange(n) > n // 2) | whole, 1e8, 0.0))
    omega = np.sqrt(la.eigvalsh(K.toarray()))
    edge = 0.5 * (omega[29] + omega[30])
    C = (2 * zeta / edge * damped).tocsr()
    m = complex_modes(one(n), C, K, (0.0, edge / TWO_PI))
    exact = all_damped(np.eye(n), C.toarray(), K.toarray(), edge)
    assert np.sum((exact.imag == 0) & (np.abs(exact) < 1.2 * edge)) > 100
    exact = exact[(exact.imag > 1e-3) & (exact.imag <= edge) & (exact.real >= -0.1 * np.abs(exact))]
    near(m, exact)
    assert m.count.how.startswith(
        "zeros of T(z)" if m.count.kind == "proven" else "damping too large"
    )


@pytest.mark.parametrize("above", [1.032, 1.036, 1.049])
def test_damped_mode_just_beyond_the_band(above):
    """A mode just above the band, at the limit of the search: the count is still correct.

    With that one unseen, the counted region reached over it: one mode more than found.
    """
    n, edge, zeta = 400, 1e3, 0.01
    beyond = np.r_[1.007, 1.014, 1.021, 1.028, above] * edge
    omega = np.r_[np.linspace(50.0, 0.97 * edge, 20), beyond,
                  np.linspace(1.4 * edge, 9 * edge, n - 25)]  # fmt: skip
    K = sp.diags(omega**2).tocsr()
    m = complex_modes(one(n), 2 * zeta / edge * K, K, (0.0, edge / TWO_PI))
    damping = zeta * omega[:20] / edge
    exact = omega[:20] * (-damping + 1j * np.sqrt(1 - damping**2))
    assert "zeros of T(z)" in m.count.how and len(m) == 20
    np.testing.assert_allclose(m.s, exact, rtol=1e-9)


def mixed(n, rng):
    """Rotation of n coordinates, each with its neighbours."""
    turns = [sp.block_diag([np.eye(first), *ortho_group.rvs(4, n // 4 - 1, rng), np.eye(4 - first)])
             for first in (1, 3)]  # fmt: skip
    return (turns[0] @ turns[1]).tocsr()


@pytest.mark.parametrize("n", [16, 400])
@pytest.mark.parametrize("damping", [(0.0, 0.0), (0.02, 0.01), (-0.02, 0.01)])
@pytest.mark.parametrize("excess", [-1e-9, 0.0, 1e-12, 1e-6])
def test_exceptional_points_of_two_and_of_three_modes(n, damping, excess):
    """A pair beside a bystander, and a triple: errors within their estimates, no wrong verdict."""
    d, (a, b) = 1e-2, damping
    pair = [[1 + d, d * (1 + excess)], [-d * (1 + excess), 1 - d]]
    triple = 1.5 * np.eye(3) + d * np.array([[0, 1, 0], [0, 0, 1], [excess, 0, 0]])
    rest = np.linspace(3.0, 80.0, n - 6)
    K = sp.block_diag([pair, [[1.0]], triple, sp.diags(rest)])
    Q = mixed(n, np.random.default_rng(1))
    K, smooth = (Q.T @ A @ Q for A in (K, sp.diags(K.diagonal())))
    C = (a * one(n) + b * K).tocsr() if b else None
    m = complex_modes(one(n), C, K.tocsr(), (0.0, 1.5 / TWO_PI), frictionless=smooth.tocsr())
    root = d * np.sqrt(-excess * (2 + excess) + 0j)
    cubic = d * np.cbrt(excess) * np.exp(TWO_PI / 3 * 1j * np.arange(3))
    kappa = np.r_[1 + root, 1 - root, 1, 1.5 + cubic]
    c = 0.5 * (a + b * kappa)
    exact = -c + 1j * np.sqrt(kappa - c**2)
    rows, columns = linear_sum_assignment(np.abs(m.s[:, None] - exact))
    assert len(m) == 6 == m.count.expected and m.count.kind == "proven"
    off, exact = np.abs(m.s[rows] - exact[columns]), exact[columns]
    assert np.all(off <= m.error) and np.sum(m.condition > 600) >= 5
    for mode, verdict in zip(exact, m.verdict, strict=True):
        assert verdict != ("stable" if mode.real > 1e-6 * abs(mode) else "unstable")


@pytest.mark.parametrize("band", [(2.0, 1.0), (1.0, 1.0), (-1.0, 1.0), (np.nan, 1.0)])
def test_a_band_that_is_none(band):
    """A reversed, empty or negative band: named error."""
    with pytest.raises(SceneError, match="band"):
        complex_modes(one(3), None, sp.diags([1.0, 2.0, 3.0]).tocsr(), band)
    assert general.DENSE > 3

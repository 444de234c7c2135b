"""Elastic layer sliding on a rigid base: the exact dispersion relation against finite elements.

A layer 0 < y < h in plane strain is clamped at y = h. At y = 0 it slides on a rigid flat base that
moves along +x and drags it by Coulomb's traction mu p. Waves u(y) exp(i k x + lambda t):

    u = grad phi + rot(psi e_z),   phi'' = p^2 phi,   psi'' = q^2 psi,
    p^2 = k^2 + lambda^2 / c_1^2,  q^2 = k^2 + lambda^2 / c_2^2,
    u_x = i k phi + psi',          u_y = phi' - i k psi,
    sigma_yy = G [(q^2 + k^2) phi - 2 i k psi'],
    sigma_xy = G [2 i k phi' + (q^2 + k^2) psi].

With phi = A cosh py + B sinh(py)/p and psi = C cosh qy + D sinh(qy)/q the base asks u_y = 0, that
is B = i k C, and sigma_xy = mu sigma_yy, since the traction on the layer's lower face is
-sigma e_y = (mu p, p). With u = 0 at y = h three equations for (A, C, D) remain; the dispersion
relation

    | -mu (q^2 + k^2)   q^2 - k^2              2 i k mu      |
    | i k cosh ph       q sinh qh - k^2 S_p    cosh qh       |  =  0,      S_p = sinh(ph)/p,
    | p sinh ph         i k (cosh ph-cosh qh)  -i k S_q      |

is entire in kappa = -lambda^2 (and has a root kappa = 0 that is none: p = q there). Its roots come
as +-lambda: a wave that runs with the base and one that runs against it, one growing as the other
decays.

The finite elements are one-dimensional: u_x = i U(y), u_y = V(y) makes stiffness and mass real and
the friction imaginary, and a matrix A + i B is doubled to [[A, -B], [B, A]]. Gauss-Lobatto
nodes give a diagonal mass, so that the reaction to u_y = 0 is a row of the stiffness alone.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy.sparse as sp
from numpy.polynomial import legendre

from brake_fenicsx.stability import complex_modes

H, RHO, E = 10e-3, 2500.0, 6e9
HIGHEST = 250e3


@dataclass(frozen=True)
class Layer:
    """A wave number k [1/m] along a layer of Poisson's ratio nu on a base of friction mu."""

    k: float
    nu: float
    mu: float

    @property
    def G(self):
        return E / (2 * (1 + self.nu))

    @property
    def lame(self):
        return 2 * self.G * self.nu / (1 - 2 * self.nu)

    def determinant(self, kappa):
        """The dispersion relation, lengths in h, columns scaled against overflow."""
        k, mu = self.k * H, self.mu
        p2 = k**2 - kappa * RHO * H**2 / (self.lame + 2 * self.G)
        q2 = k**2 - kappa * RHO * H**2 / self.G
        p, q = np.sqrt(p2 + 0j), np.sqrt(q2 + 0j)
        Cp, Cq = np.cosh(p), np.cosh(q)
        Sp, Sq = np.sinh(p) / p, np.sinh(q) / q
        a = (-mu * (q2 + k**2), q2 - k**2, 2j * k * mu)
        b = (1j * k * Cp, q2 * Sq - k**2 * Sp, Cq)
        c = (p2 * Sp, 1j * k * (Cp - Cq), -1j * k * Sq)
        return a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (
            b[0] * c[1] - b[1] * c[0]
        )  # fmt: skip


def polished(layer, kappa):
    """A root near a start, by Newton's method, to 1e-12; its last step is the proof."""
    for _ in range(50):
        d = 1e-6 * abs(kappa)
        # Fourth-order difference: the slope is good to 1e-10 and costs no digit of the root.
        f = [layer.determinant(kappa + j * d) for j in (-2, -1, 1, 2)]
        slope = (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * d)
        step = layer.determinant(kappa) / slope
        kappa = kappa - step
        if abs(step) < 1e-13 * abs(kappa):
            return kappa
    raise AssertionError(f"no root: last step {abs(step / kappa):.1e}")


@cache
def exact_modes(k, nu, mu):
    """All kappa with |Im kappa| < Re kappa up to the highest frequency: followed from mu = 0.

    At mu = 0 the relation is real up to a factor: its signs on a fine grid bracket the roots.
    """
    top = (2 * np.pi * 1.3 * HIGHEST) ** 2
    grid = np.linspace(1e-3, 1, 4001) ** 2 * top
    value = Layer(k, nu, 0.0).determinant(grid)
    turn = value[np.argmax(np.abs(value))]
    sign = np.sign((value / turn).real)
    starts = 0.5 * (grid[1:] + grid[:-1])[np.flatnonzero(np.diff(sign))].astype(complex)
    roots = [polished(Layer(k, nu, 0.0), z) for z in starts]
    for m in np.linspace(0, mu, 41)[1:]:
        roots = [polished(Layer(k, nu, m), z) for z in roots]
    return np.array(roots)


def winding(layer, low, high, rise):
    """Roots with low < Re kappa < high, |Im kappa| < rise, by the argument principle."""
    corners = [low - 1j * rise, high - 1j * rise, high + 1j * rise, low + 1j * rise]
    path = np.concatenate(
        [np.linspace(a, b, 20000) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]
    )
    value = layer.determinant(path)
    turns = np.angle(value[1:] / value[:-1])
    assert np.abs(turns).max() < 0.3
    return int(np.rint(turns.sum() / (2 * np.pi)))


def lobatto(degree):
    """Gauss-Lobatto nodes and weights on [-1, 1], and their derivative matrix."""
    P = np.eye(degree + 1)[degree]
    x = np.r_[-1.0, np.sort(legendre.legroots(legendre.legder(P)).real), 1.0]
    weight = 2 / (degree * (degree + 1) * legendre.legval(x, P) ** 2)
    V = legendre.legvander(x, degree)
    slopes = [legendre.legval(x, legendre.legder(row)) for row in np.eye(degree + 1)]
    return x, weight, np.linalg.solve(V.T, np.stack(slopes)).T


def finite_elements(layer, cells, degree=4):
    """Real K and diagonal M of (U, V), node 0 at the base, the clamped node left out."""
    _, weight, D = lobatto(degree)
    n, half = cells * degree + 1, H / cells / 2
    K, M = np.zeros((2 * n, 2 * n)), np.zeros(2 * n)
    C = np.array([[layer.lame + 2 * layer.G, layer.lame, 0],
                  [layer.lame, layer.lame + 2 * layer.G, 0], [0, 0, layer.G]])  # fmt: skip
    for c in range(cells):
        nodes = c * degree + np.arange(degree + 1)
        dofs = np.r_[nodes, n + nodes]
        M[dofs] += RHO * np.tile(weight, 2) * half
        for i in range(degree + 1):
            value, slope = np.eye(degree + 1)[i], D[i] / half
            zero = np.zeros_like(value)
            # e_xx = -k U, e_yy = V', 2 e_xy = i (U' + k V): the i cancels in the energy.
            B = np.stack([np.r_[-layer.k * value, zero], np.r_[zero, slope],
                          np.r_[slope, layer.k * value]])  # fmt: skip
            K[np.ix_(dofs, dofs)] += weight[i] * half * (B.T @ C @ B)
    keep = np.r_[0 : n - 1, n : 2 * n - 1]
    return K[np.ix_(keep, keep)], M[keep]


def doubled(A, B):
    """The real form of A + i B."""
    return sp.csr_matrix(np.block([[A, -B], [B, A]]))


def constrained(layer, cells, degree=4):
    """u_y = 0 at the base eliminated; its reaction drives the friction."""
    K, M = finite_elements(layer, cells, degree)
    base_u, base_v = 0, K.shape[0] // 2
    keep = np.delete(np.arange(K.shape[0]), base_v)
    # p = K[base_v] x. The work of t_x = mu p on i W is conj(i W) mu p = -i mu W p; on the left +i.
    friction = np.zeros_like(K)
    friction[base_u] = layer.mu * K[base_v]
    A, B = K[np.ix_(keep, keep)], friction[np.ix_(keep, keep)]
    return doubled(A, B), sp.diags(np.tile(M[keep], 2)).tocsr()


def penalised(layer, cells, spring, degree=4):
    """A spring [Pa/m] in place of the constraint: p = -spring V. Also the matrix at mu = 0."""
    K, M = finite_elements(layer, cells, degree)
    base_u, base_v = 0, K.shape[0] // 2
    K[base_v, base_v] += spring
    friction = np.zeros_like(K)
    friction[base_u, base_v] = -layer.mu * spring
    mass = sp.diags(np.tile(M, 2)).tocsr()
    return doubled(K, friction), mass, doubled(K, 0 * friction)


def lambdas(kappa):
    """lambda with omega > 0 of kappa and of its conjugate."""
    lam = np.sqrt(-np.r_[kappa, kappa.conj()])
    return np.where(lam.imag < 0, -lam, lam)


def in_band(lam):
    return lam[(lam.imag > 0) & (lam.imag < 2 * np.pi * HIGHEST)]


def solved(K, M, frictionless=None):
    return complex_modes(M, None, K, (0.0, HIGHEST), zeta_max=0.25, frictionless=frictionless)


def match(found, exact):
    """Relative errors of frequency and of growth rate of each exact mode."""
    nearest = found[np.abs(found - exact[:, None]).argmin(axis=1)]
    return (np.abs(nearest.imag - exact.imag) / exact.imag,
            np.abs(nearest.real - exact.real) / np.abs(exact.real))  # fmt: skip

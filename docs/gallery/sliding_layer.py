# # A sliding layer against its dispersion relation
#
# An elastic layer of thickness h, clamped on its upper face, slides on a rigid base with
# Coulomb's friction. Waves along the layer, u(y) exp(i k x + lambda t), have an exact dispersion
# relation. Friction makes the stiffness non-symmetric: one wave of each pair grows. The program's
# eigenvalue solver gets the matrices of a finite-element layer, and both answers are compared.
#
# ![Growth rates of the waves over the friction coefficient](sliding_layer.png)
#
# With p^2 = k^2 + lambda^2 / c_1^2 and q^2 = k^2 + lambda^2 / c_2^2 (pressure and shear waves)
# the relation is a determinant of order three, derived in `tests/sliding_layer.py`.
# Its roots kappa = -lambda^2 are followed from mu = 0, where they are real, by Newton's method.

# +
import matplotlib.pyplot as plt
import numpy as np
import scipy.sparse as sp
from numpy.polynomial import legendre

from brake_fenicsx.stability import complex_modes

H, RHO, E, NU = 10e-3, 2500.0, 6e9, 0.3
G = E / (2 * (1 + NU))
LAME = 2 * G * NU / (1 - 2 * NU)
K = 1.5 / H  # wave number along the layer [1/m]
TOP = 200e3  # highest frequency [Hz]


def determinant(kappa, mu):
    """The dispersion relation, lengths in h."""
    k = K * H
    p2, q2 = (k**2 - kappa * RHO * H**2 / c for c in (LAME + 2 * G, G))
    p, q = np.sqrt(p2 + 0j), np.sqrt(q2 + 0j)
    Cp, Cq, Sp, Sq = np.cosh(p), np.cosh(q), np.sinh(p) / p, np.sinh(q) / q
    rows = [
        [-mu * (q2 + k**2), q2 - k**2, 2j * k * mu],
        [1j * k * Cp, q2 * Sq - k**2 * Sp, Cq],
        [p2 * Sp, 1j * k * (Cp - Cq), -1j * k * Sq],
    ]
    return np.linalg.det(np.array(rows))


def root(kappa, mu):
    """A root near a start."""
    for _ in range(40):
        d = 1e-5 * kappa
        slope = (determinant(kappa + d, mu) - determinant(kappa - d, mu)) / (2 * d)
        step = determinant(kappa, mu) / slope
        kappa = kappa - step
        if abs(step) < 1e-12 * abs(kappa):
            break
    return kappa


grid = np.linspace(1e-3, 1, 1500) ** 2 * (2 * np.pi * 1.2 * TOP) ** 2
value = np.array([determinant(x, 0.0) for x in grid])
sign = np.sign((value / value[np.abs(value).argmax()]).real)
starts = grid[np.flatnonzero(np.diff(sign))].astype(complex)
friction = np.linspace(0.0, 0.8, 17)
exact = [np.array([root(x, 0.0) for x in starts])]
for mu in friction[1:]:
    exact.append(np.array([root(x, mu) for x in exact[-1]]))
# -

# The finite elements: u_x = i U(y) and u_y = V(y) make stiffness and mass real and the friction
# imaginary; a matrix A + i B becomes [[A, -B], [B, A]]. The nodes are those of Gauss and Lobatto,
# so that the mass is diagonal.

# +
CELLS, DEGREE = 12, 4
P = np.eye(DEGREE + 1)[DEGREE]
nodes = np.r_[-1.0, np.sort(legendre.legroots(legendre.legder(P)).real), 1.0]
weights = 2 / (DEGREE * (DEGREE + 1) * legendre.legval(nodes, P) ** 2)
slopes = np.stack([legendre.legval(nodes, legendre.legder(row)) for row in np.eye(DEGREE + 1)])
slopes = np.linalg.solve(legendre.legvander(nodes, DEGREE).T, slopes).T
n, half = CELLS * DEGREE + 1, H / CELLS / 2
C = np.array([[LAME + 2 * G, LAME, 0], [LAME, LAME + 2 * G, 0], [0, 0, G]])
stiffness, mass = np.zeros((2 * n, 2 * n)), np.zeros(2 * n)
for cell in range(CELLS):
    at = cell * DEGREE + np.arange(DEGREE + 1)
    dofs = np.r_[at, n + at]
    mass[dofs] += RHO * np.tile(weights, 2) * half
    for i in range(DEGREE + 1):
        one, slope, zero = np.eye(DEGREE + 1)[i], slopes[i] / half, np.zeros(DEGREE + 1)
        B = np.stack([np.r_[-K * one, zero], np.r_[zero, slope], np.r_[slope, K * one]])
        stiffness[np.ix_(dofs, dofs)] += weights[i] * half * (B.T @ C @ B)

clamped, base = [n - 1, 2 * n - 1], n  # the base holds V of its node
keep = np.delete(np.arange(2 * n), [*clamped, base])


def modes(mu):
    """All modes up to TOP; the reaction of the base drives the friction on its node."""
    drag = np.zeros_like(stiffness)
    drag[0] = mu * stiffness[base]
    A, B = (matrix[np.ix_(keep, keep)] for matrix in (stiffness, drag))
    whole = sp.csr_matrix(np.block([[A, -B], [B, A]]))
    return complex_modes(sp.diags(np.tile(mass[keep], 2)).tocsr(), None, whole, (0.0, TOP)).s


found = [modes(mu) for mu in friction]
# -

# Growth rates of both:

# +
figure, axis = plt.subplots(figsize=(6.4, 4.2), layout="constrained")
error = 0.0
for mu, kappa, s in zip(friction, exact, found, strict=True):
    wave = np.sqrt(-np.r_[kappa, kappa.conj()])
    wave = np.where(wave.imag < 0, -wave, wave)
    wave = wave[wave.imag < 2 * np.pi * TOP]
    error = max(error, max(np.abs(s - one).min() / abs(one) for one in wave))
    axis.plot(np.full(wave.size, mu), wave.real / 1e3, "o", mfc="none", ms=7, color="0.6")
    axis.plot(np.full(s.size, mu), s.real / 1e3, "k.", ms=3)
axis.plot([], [], "o", mfc="none", color="0.6", label="dispersion relation")
axis.plot([], [], "k.", label="finite elements")
axis.set(xlabel="friction coefficient [-]", ylabel="growth rate [1/ms]")
axis.legend()
figure.savefig("sliding_layer.png", dpi=120)
# -

# The largest error of an eigenvalue lambda, relative to |lambda|:

print(f"{len(friction)} friction coefficients, {len(found[-1])} modes each: error {error:.1e}")
assert error < 1e-6

"""Spectral Ritz solutions of single bodies, without meshes and without the package.

Boxes: products of Legendre polynomials in x, y, z, after W. M. Visscher et al., J. Acoust. Soc. Am.
90 (1991) 2154. Rings and sectors: displacements (u_r, u_theta, u_z) are such products in r, theta
and, layer by layer and continuous, in z; materials isotropic about z keep their stiffness in these
axes.
"""

from itertools import pairwise

import numpy as np
import scipy.linalg as la
from numpy.polynomial import legendre

VOIGT = ((0, 5, 4), (5, 1, 3), (4, 3, 2))
# Strains rr, tt, zz, tz, rz, rt as sums of (component, function of r, derivative in theta, in z,
# sign): "f", "d" for the derivative, "q" for the quotient by r.
STRAINS = [
    [(0, "d", 0, 0, 1)],
    [(0, "q", 0, 0, 1), (1, "q", 1, 0, 1)],
    [(2, "f", 0, 1, 1)],
    [(1, "f", 0, 1, 1), (2, "q", 1, 0, 1)],
    [(0, "f", 0, 1, 1), (2, "d", 0, 0, 1)],
    [(0, "q", 1, 0, 1), (1, "d", 0, 0, 1), (1, "q", 0, 0, -1)],
]


def line(degree, low, high, points):
    """Legendre polynomials over an interval: quadrature points, weights, values, derivatives."""
    x, w = legendre.leggauss(points)
    half = 0.5 * (high - low)
    slopes = legendre.legval(x, legendre.legder(np.eye(degree + 1))).T
    return low + half * (x + 1), half * w, legendre.legvander(x, degree), slopes / half


def box_frequencies(lengths, C, rho, degree):
    """Frequencies [Hz] of all modes of a free box, the six rigid ones left out.

    Args:
        lengths: of the three edges [m].
        C: stiffness [Pa], shape (6, 6).
        rho: density [kg/m^3].
        degree: largest total degree of the polynomials.
    """
    place = np.array([p for p in np.ndindex(*[degree + 1] * 3) if sum(p) <= degree]).T
    _, w, values, slopes = line(degree, -1.0, 1.0, degree + 1)
    size = np.sqrt(np.arange(degree + 1) + 0.5)
    values, slopes = (size * values).T, (size * slopes).T
    mixed = (slopes * w) @ values.T
    pick = {0: np.eye(degree + 1), 1: mixed, 2: mixed.T, 3: (slopes * w) @ slopes.T}
    n, found = place.shape[1], []
    gradient = np.empty((3, 3, n, n))
    for a, b in np.ndindex(3, 3):
        kinds = [pick[(axis == a) + 2 * (axis == b)] for axis in range(3)]
        product = np.prod([k[np.ix_(p, p)] for k, p in zip(kinds, place, strict=True)], axis=0)
        gradient[a, b] = 4 / lengths[a] / lengths[b] * product
    K = np.zeros((3, n, 3, n))
    for i, k, a, b in np.ndindex(3, 3, 3, 3):
        K[i, :, k] += C[VOIGT[i][a], VOIGT[k][b]] * gradient[a, b]
    K = K.reshape(3 * n, 3 * n) / rho
    # With the symmetries of the box, displacement i of a mode is even or odd along each axis.
    for parity in np.ndindex(2, 2, 2):
        even = [(place.T + parity + axis) % 2 == 0 for axis in np.eye(3, dtype=int)]
        rows = np.concatenate([i * n + np.flatnonzero(e.all(1)) for i, e in enumerate(even)])
        found.append(rows)
    if np.any(C[:3, 3:]) or np.any(C[3:, 3:] != np.diag(np.diag(C[3:, 3:]))):
        found = [np.concatenate(found)]
    kappa = np.concatenate([la.eigvalsh(K[np.ix_(rows, rows)]) for rows in found])
    return np.sqrt(np.sort(kappa)[6:]) / (2 * np.pi)


def layers_in_z(heights, degree):
    """Continuous functions over layers: hats at the borders and bubbles inside each layer."""
    out, borders = [], len(heights)
    total = borders + (borders - 1) * (degree - 1)
    for i, (low, high) in enumerate(pairwise(heights)):
        _, w, P, dP = line(degree, low, high, degree + 2)
        Z, dZ = np.zeros((w.size, total)), np.zeros((w.size, total))
        for to, a in ((Z, P), (dZ, dP)):
            to[:, i], to[:, i + 1] = 0.5 * (a[:, 0] - a[:, 1]), 0.5 * (a[:, 0] + a[:, 1])
            for k in range(2, degree + 1):
                to[:, borders + i * (degree - 1) + k - 2] = a[:, k] - a[:, k - 2]
        out.append((w, (Z, dZ)))
    return out


def sector_frequencies(radii, around, heights, materials, degrees, clamped=False):
    """Lowest frequencies [Hz] of a ring or sector.

    Args:
        radii: inner and outer one [m].
        around: weights in theta, and values and derivatives there of u_r, u_theta and u_z.
        heights: z of the borders of the layers [m].
        materials: of each layer.
        degrees: in r and in z.
        clamped: at the inner radius; free if False.
    """
    r, wr, F, dF = line(degrees[0], *radii, degrees[0] + 8)
    if clamped:
        s = (r - radii[0])[:, None] / (radii[1] - radii[0])
        F, dF = s * F, s * dF + F / (radii[1] - radii[0])
    radial = {"f": F, "d": dF, "q": F / r[:, None]}
    wt, functions = around
    slabs = layers_in_z(heights, degrees[1])
    size = F.shape[1] * functions[0][0].shape[1] * slabs[0][1][0].shape[1]
    K, M = np.zeros((3, size, 3, size)), np.zeros((3, size, 3, size))

    def term(one, two, w, Z):
        (c, f, t, z, s), (d, g, q, y, o) = one, two
        R = (radial[f].T * (wr * r)) @ radial[g]
        T = (functions[c][t].T * wt) @ functions[d][q]
        return s * o * np.kron(np.kron(R, T), (Z[z].T * w) @ Z[y])

    for (w, Z), material in zip(slabs, materials, strict=True):
        for a, b in zip(*np.nonzero(material.C), strict=True):
            for x in STRAINS[a]:
                for y in STRAINS[b]:
                    K[x[0], :, y[0]] += material.C[a, b] * term(x, y, w, Z)
        for c in range(3):
            M[c, :, c] += material.rho * term(*2 * [(c, "f", 0, 0, 1)], w, Z)
    # Legendre functions are far from dependent: M is well conditioned.
    K, M = (A.reshape(3 * size, 3 * size) for A in (K, M))
    values = la.eigh(K, M, eigvals_only=True, subset_by_index=[0, min(40, 3 * size - 1)])
    return np.sqrt(np.maximum(values, 0)) / 2 / np.pi


def ring_frequencies(radii, heights, material, highest, degrees, clamped=False):
    """All frequencies [Hz] below ``highest`` of a ring; each wave around it is there twice."""
    t, found = np.linspace(0, 2 * np.pi, 64, endpoint=False), []
    for n in range(12):
        c, s = np.cos(n * t)[:, None], np.sin(n * t)[:, None]
        # With n = 0 the middle component uncouples and stands for torsion: it has its own constant.
        along = (c, -n * s), (s, n * c) if n else (c, 0 * c), (c, -n * s)
        around = np.full(t.size, 2 * np.pi / t.size), along
        f = sector_frequencies(radii, around, heights, (material,), degrees, clamped)
        found += list(np.repeat(f[f < highest], 2 if n else 1))
        if n > 1 and f[0] > highest:
            break
    return np.sort(found)

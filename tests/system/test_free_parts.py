"""Free disc and free pad against spectral Ritz solutions in cylindrical coordinates.

Displacements (u_r, u_theta, u_z) are products of Legendre polynomials in r, theta and, layer by
layer and continuous, in z. Materials isotropic about z keep their stiffness in these axes. Nothing
is shared with the code under test.
"""

from itertools import pairwise

import numpy as np
import pytest
import scipy.linalg as la
from numpy.polynomial import legendre

from brake_fenicsx.macro.elasticity import assemble_elastic
from brake_fenicsx.macro.material import Material, isotropic, transversely_isotropic
from brake_fenicsx.meshing.brake_mesh import build_mesh
from brake_fenicsx.meshing.gmsh_mesh import MeshSettings
from brake_fenicsx.stability import complex_modes

IRON = Material(isotropic(125e9, 0.24), 7200.0)
STEEL = Material(isotropic(207e9, 0.28), 7820.0)
LINING = Material(transversely_isotropic(5.94e9, 0.76e9, 0.98e9, 2.27e9, 1.18e9), 2510.0)

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
    d = np.stack(
        [legendre.legval(x, legendre.legder(np.eye(degree + 1)[i])) for i in range(degree + 1)],
        axis=1,
    )
    half = 0.5 * (high - low)
    return low + half * (x + 1), half * w, legendre.legvander(x, degree), d / half


def layers_in_z(heights, degree):
    """Continuous functions over layers: hats at the borders and bubbles inside each layer."""
    out, borders = [], len(heights)
    total = borders + (borders - 1) * (degree - 1)
    for i, (low, high) in enumerate(pairwise(heights)):
        _, w, P, dP = line(degree, low, high, degree + 2)
        Z, dZ = np.zeros((w.size, total)), np.zeros((w.size, total))
        for to, a, da in ((Z, P, P), (dZ, dP, dP)):
            to[:, i], to[:, i + 1] = 0.5 * (a[:, 0] - a[:, 1]), 0.5 * (a[:, 0] + a[:, 1])
            for k in range(2, degree + 1):
                to[:, borders + i * (degree - 1) + k - 2] = da[:, k] - da[:, k - 2]
        out.append((w, (Z, dZ)))
    return out


def spectrum(radii, around, heights, materials, degrees):
    """Frequencies [Hz] of a free ring or sector.

    ``around``: (weights, values, derivatives) in theta of u_r and u_z, and of u_theta.
    """
    r, wr, F, dF = line(degrees[0], *radii, degrees[0] + 8)
    radial = {"f": F, "d": dF, "q": F / r[:, None]}
    wt, functions = around
    slabs = layers_in_z(heights, degrees[1])
    size = F.shape[1] * functions[0][0].shape[1] * slabs[0][1][0].shape[1]
    K, M = np.zeros((3 * size, 3 * size)), np.zeros((3 * size, 3 * size))

    def term(one, two, w, Z):
        (c, f, t, z, s), (d, g, q, y, o) = one, two
        R = (radial[f].T * (wr * r)) @ radial[g]
        T = (functions[c][t].T * wt) @ functions[d][q]
        return s * o * np.kron(np.kron(R, T), (Z[z].T * w) @ Z[y])

    for (w, Z), material in zip(slabs, materials, strict=True):
        for a, one in enumerate(STRAINS):
            for b, two in enumerate(STRAINS):
                if material.C[a, b]:
                    for x in one:
                        for y in two:
                            block = np.s_[x[0] * size : (x[0] + 1) * size,
                                          y[0] * size : (y[0] + 1) * size]  # fmt: skip
                            K[block] += material.C[a, b] * term(x, y, w, Z)
        for c in range(3):
            block = np.s_[c * size : (c + 1) * size, c * size : (c + 1) * size]
            M[block] += material.rho * term((c, "f", 0, 0, 1), (c, "f", 0, 0, 1), w, Z)
    # Legendre functions are far from dependent: M is well conditioned.
    top = min(40, 3 * size - 1)
    values = la.eigh(K, M, eigvals_only=True, subset_by_index=[0, top])
    return np.sqrt(np.maximum(values, 0)) / 2 / np.pi


def ring_spectrum(n, degrees=(8, 6)):
    """Waves of n periods around the free disc 75-144 mm, 20 mm thick: cos for r, z, sin for
    theta."""
    t = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    w = np.full(t.size, 2 * np.pi / t.size)
    c, s = np.cos(n * t)[:, None], np.sin(n * t)[:, None]
    if n == 0:
        # In-plane torsion lives in the sine: give theta its own constant.
        s, ds = np.ones_like(c), np.zeros_like(c)
    else:
        ds = n * c
    functions = ((c, -n * np.sin(n * t)[:, None]), (s, ds), (c, -n * np.sin(n * t)[:, None]))
    return spectrum((75e-3, 144e-3), (w, functions), (-10e-3, 10e-3), (IRON,), degrees)


def disc_reference(highest, degrees=(8, 6)):
    found = []
    for n in range(12):
        f = ring_spectrum(n, degrees)
        found += list(np.repeat(f[f < highest], 1 if n == 0 else 2))
        if n > 1 and f[0] > highest:
            break
    return np.sort(found)


def pad_reference(degrees=(7, 11, 3)):
    """Lining and plate of the reference pad without ears."""
    half = np.pi / 6
    _, w, P, dP = line(degrees[1], -half, half, degrees[1] + 2)
    functions = ((P, dP),) * 3
    heights = (10e-3, 20e-3, 26e-3)
    return spectrum(
        (96e-3, 140e-3), (w, functions), heights, (LINING, STEEL), (degrees[0], degrees[2])
    )


def frequencies(comm, parts, materials, highest, table=None):
    mesh = build_mesh(parts, comm, table)
    solved = assemble_elastic(mesh, materials, {})
    return complex_modes(solved.M, None, solved.K, (0.0, highest))


@pytest.mark.parametrize(
    "cells, bound",
    [("tetrahedra", 7e-3), pytest.param("hexahedra", 1.5e-3, marks=pytest.mark.slow)],
)
def test_free_disc(comm, cells, bound):
    """Six rigid modes and all others below 5 kHz, doublets twice, on a mesh of 12 mm, from above.

    Second-order geometry: a polygon in place of the circles would be too soft or too light.
    Within 0.6 % on 19,000 dofs of tetrahedra, 0.11 % on 26,000 of hexahedra.
    """
    from brake_fenicsx.geometry import disc

    wanted = disc_reference(5000.0)
    assert np.count_nonzero(wanted < 1.0) == 6
    parts = {"disc": (disc, disc.Disc(size=12e-3))}
    table = MeshSettings(cells=cells, order=2)
    modes = frequencies(comm, parts, {"disc.body": IRON}, 5000.0, table)
    found = modes.frequency
    assert found.size == wanted.size == modes.count.expected
    assert np.count_nonzero(found < 1.0) == 6
    error = found[6:] / wanted[6:] - 1
    assert np.all((error > -1e-5) & (error < bound)), error


@pytest.mark.parametrize(
    "cells, bound",
    [pytest.param("tetrahedra", 1e-2, marks=pytest.mark.slow), ("hexahedra", 5.5e-3)],
)
def test_free_pad(comm, cells, bound):
    """Lining and plate as one body: the first eight modes on a mesh of 6 mm, from above.

    Within 1 % on 15,600 dofs of tetrahedra, 0.5 % on 24,900 of hexahedra.
    Catches the axes of the lining turned, a layer with the other's material, a gap between them.
    """
    from brake_fenicsx.geometry import pad

    wanted = pad_reference()
    highest = 0.5 * (wanted[13] + wanted[14])
    given = pad.Pad(side="top", ear_length=0.0, size=6e-3, plate_size=6e-3)
    materials = {"pad.lining": LINING, "pad.plate": STEEL}
    table = MeshSettings(cells=cells, order=2)
    modes = frequencies(comm, {"pad": (pad, given)}, materials, highest, table)
    assert modes.count.expected == 14
    error = modes.frequency[6:] / wanted[6:14] - 1
    assert np.all((error > -1e-4) & (error < bound)), error


@pytest.mark.slow
def test_references_are_converged():
    """Higher degrees lower the frequencies by far less than the bounds above."""
    a, b = disc_reference(5000.0), disc_reference(5000.0, (10, 8))
    assert a.size == b.size
    assert np.all((a[6:] / b[6:] > 1 - 1e-9) & (a[6:] / b[6:] < 1 + 3e-5)), a[6:] / b[6:] - 1
    a, b = pad_reference()[6:14], pad_reference((9, 13, 3))[6:14]
    assert np.all((a / b > 1 - 1e-9) & (a / b < 1 + 1e-3)), a / b - 1

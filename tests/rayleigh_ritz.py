"""Free modes of an anisotropic box by Rayleigh-Ritz with Legendre polynomials, without meshes.

Reference: W. M. Visscher et al., J. Acoust. Soc. Am. 90 (1991) 2154.
"""

import numpy as np
import scipy.linalg as la
from numpy.polynomial import legendre

VOIGT = ((0, 5, 4), (5, 1, 3), (4, 3, 2))


def box_frequencies(lengths, C, rho, degree):
    """Frequencies [Hz] of all modes, the six rigid ones left out.

    Args:
        lengths: of the three edges [m].
        C: stiffness [Pa], shape (6, 6).
        rho: density [kg/m^3].
        degree: largest total degree of the polynomials.
    """
    powers = [(i, j, k) for i in range(degree + 1) for j in range(degree + 1 - i)
              for k in range(degree + 1 - i - j)]  # fmt: skip
    x, w = legendre.leggauss(degree + 1)
    eye = np.eye(degree + 1)
    values = legendre.legval(x, eye) * np.sqrt(np.arange(degree + 1)[:, None] + 0.5)
    slopes = legendre.legval(x, legendre.legder(eye))
    slopes = slopes * np.sqrt(np.arange(degree + 1)[:, None] + 0.5)
    one, mixed, both = eye, (slopes * w) @ values.T, (slopes * w) @ slopes.T
    place = np.array(powers).T
    pick = {0: one, 1: mixed, 2: mixed.T, 3: both}
    n, found = len(powers), []
    gradient = np.empty((3, 3, n, n))
    for a in range(3):
        for b in range(3):
            kinds = [pick[(axis == a) + 2 * (axis == b)] for axis in range(3)]
            product = np.prod([k[np.ix_(p, p)] for k, p in zip(kinds, place, strict=True)], axis=0)
            gradient[a, b] = 4 / lengths[a] / lengths[b] * product
    K = np.zeros((3, n, 3, n))
    for i in range(3):
        for k in range(3):
            for a in range(3):
                for b in range(3):
                    K[i, :, k] += C[VOIGT[i][a], VOIGT[k][b]] * gradient[a, b]
    # Displacement i of a mode that is even or odd along each axis: eight problems.
    for parity in np.ndindex(2, 2, 2):
        even = [(place.T + parity + axis) % 2 == 0 for axis in np.eye(3, dtype=int)]
        rows = np.concatenate([i * n + np.flatnonzero(e.all(1)) for i, e in enumerate(even)])
        found.append(la.eigvalsh(K.reshape(3 * n, 3 * n)[np.ix_(rows, rows)] / rho))
    return np.sqrt(np.sort(np.concatenate(found))[6:]) / (2 * np.pi)

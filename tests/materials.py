"""Stiffnesses that several tests take: of the lining, and of a material with three axes."""

import numpy as np

from brake_fenicsx.macro.material import orthotropic, transversely_isotropic

VOIGT = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]
LINING = transversely_isotropic(5.94e9, 0.76e9, 0.98e9, 2.27e9, 1.18e9)
ORTHOTROPIC = orthotropic(
    np.array([9e9, 5e9, 2e9]), np.array([0.2, 0.35, 0.3]), np.array([0.9e9, 1.3e9, 2.1e9])
)


def tensor(C):
    """Stiffness with four indices."""
    c = np.empty((3, 3, 3, 3))
    for a, (i, j) in enumerate(VOIGT):
        for b, (k, l) in enumerate(VOIGT):
            c[i, j, k, l] = c[j, i, k, l] = c[i, j, l, k] = c[j, i, l, k] = C[a, b]
    return c

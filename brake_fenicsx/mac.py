"""How alike two shapes are: the modal assurance criterion (MAC).

It is 1 for the same shape, whatever its complex scale, and 0 for an orthogonal one (R. J. Allemang,
Sound and Vibration 37(8) (2003) 14).
"""

import numpy as np

from brake_fenicsx.arguments import AnyArray, Complex


def mac(
    x: Complex, y: Complex, x_left: Complex | None = None, y_left: Complex | None = None
) -> AnyArray:
    """Modal assurance criterion of every column of x with every column of y.

    With a mass M the left vectors are M x and M y.

    Args:
        x: vectors in coordinates in which the mass is about the identity, shape (m, modes).
        y: likewise, shape (m, others).
        x_left: left vectors of modes that are not orthogonal; x itself if None.
        y_left: likewise.

    Returns:
        Shape (modes, others): real, 0 of a zero vector; with left vectors complex traces of the
        products of the modes' spectral projectors, infinite of a defective mode.
    """
    L, N = (x if x_left is None else x_left), (y if y_left is None else y_left)
    own, theirs = (np.einsum("im,im->m", a.conj(), b) for a, b in ((L, x), (N, y)))
    scale = np.outer(own, theirs)
    tiny = np.abs(scale) < 1e-300
    product = (L.conj().T @ y) * (N.conj().T @ x).T
    if x_left is None and y_left is None:
        return np.where(tiny, 0.0, product / np.where(tiny, 1.0, scale)).real
    return np.where(tiny, np.inf, product / np.where(tiny, 1.0, scale))

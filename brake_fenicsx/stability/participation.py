"""Which part of the brake moves in a mode, and which mode a flutter pair is made of.

The share of a part in the kinetic energy of a mode phi is phi^H M_p phi / sum_q phi^H M_q phi, with
the mass M_p of the part on the dofs of all parts. Shared nodes belong to each part by its own mass,
so that nothing is counted twice. Strain energy is shared likewise, with stiffnesses.

Without damping the two modes of a flutter pair are lambda and -conj(lambda), with vectors phi and
conj(phi). Damping moves the two eigenvalues apart and turns the vectors a little: there the partner
is the mode whose shape is nearest to conj(phi), and it is a matter of degree.

How alike two shapes are: the modal assurance criterion (MAC).

It is 1 for the same shape, whatever its complex scale, and 0 for an orthogonal one (R. J. Allemang,
Sound and Vibration 37(8) (2003) 14).
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index, Mask
from brake_fenicsx.errors import SceneError

# Two rows +-alpha of one pair agree to this share of |lambda|.
SAME = 1e-6

# Least MAC of the partner's shape with the conjugate one, by which at most one of two orthogonal
# shapes is the partner, and largest distance of the two frequencies relative to |lambda|: damping
# moves a pair apart by its damping ratios, 0.1 at most by default.
ALIKE, NEAR = 0.5, 0.1


def energy_shares(parts: Mapping[str, Any], phi: Complex) -> dict[str, Array]:
    """Share of each part in the energy of each mode.

    Args:
        parts: name -> mass [kg] or stiffness [N/m] of the part on all dofs, symmetric and positive
            semi-definite, sparse or dense, shape (dofs, dofs).
        phi: displacements of the modes, shape (dofs, modes), or coordinates with matrices of these.

    Returns:
        For each part the shares [-], shape (modes,); they sum to one.

    Raises:
        SceneError: a mode has no energy in any part.
    """
    energy = {
        name: np.maximum(np.einsum("im,im->m", phi.conj(), A @ phi).real, 0.0)
        for name, A in parts.items()
    }
    total = np.sum(list(energy.values()), axis=0)
    if not np.all(total > 0):
        raise SceneError(f"participation: mode {int(np.argmin(total))} has no energy in any part")
    return {name: e / total for name, e in energy.items()}


def flutter_partners(s: Complex) -> Index:
    """The other row of each flutter pair of an undamped problem.

    Args:
        s: eigenvalues lambda [1/s], one of each conjugate pair, shape (modes,).

    Returns:
        For each mode the row with -conj(lambda), which coalesced with it; -1 for a mode on the
        imaginary axis, a divergence, or where that row is not in the list.
    """
    partner = np.full(s.size, -1)
    for i in np.flatnonzero((s.real != 0) & (s.imag != 0)):
        distance = np.abs(s + s[i].conj())
        # A mode closer to the axis than the tolerance would be its own partner.
        distance[i] = np.inf
        j = int(np.argmin(distance))
        if distance[j] <= SAME * abs(s[i]):
            partner[i] = j
    return partner


def damped_partners(s: Complex, phi: Complex, M: Any, unstable: Mask) -> Index:
    """The mode that each growing mode of a damped problem coalesced with, by its shape.

    Args:
        s: eigenvalues lambda [1/s], one of each conjugate pair, shape (modes,).
        phi: right vectors, shape (dofs, modes).
        M: mass [kg], SciPy sparse.
        unstable: which modes grow, shape (modes,).

    Returns:
        For each mode its partner's row; -1 for one that has none: it does not grow and no growing
        mode names it, or no other mode is alike (one that falling friction alone drives).
    """
    partner = np.full(s.size, -1)
    image = M @ phi
    for i in np.flatnonzero(unstable & (s.imag != 0)):
        near = np.abs(s.imag - s[i].imag) <= NEAR * abs(s[i])
        near[i] = False
        mirrored, its_image = phi[:, [i]].conj(), image[:, [i]].conj()
        likeness = np.where(near, mac(mirrored, phi, its_image, image)[0].real, 0.0)
        j = int(np.argmax(likeness))
        if likeness[j] >= ALIKE:
            partner[i] = j
            partner[j] = i if partner[j] < 0 else partner[j]
    return partner


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

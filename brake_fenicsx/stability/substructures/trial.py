"""Trial vectors of a line: right and left vectors of some values, one space for both.

The bodies stay along a line of constant materials: what the contact elements see of them serves all
values and all samples (``UnitContact``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg as la
from numpy.typing import ArrayLike, NDArray

from ..modes import Complex

if TYPE_CHECKING:
    from .reduced_model import ReducedModel

Array = NDArray[np.float64]

# Trial coordinates and motions have at least these shares of the largest singular value of all,
# times the root of the tolerance: the error is of second order in what is left out. Measured at the
# demo brake, where two values then suffice for friction from 0 to 0.8.
KEPT, MOVING = 0.1, 0.1

# Elements below this share of the largest stiffness teach no motions.
LITTLE = 1e-12

# Bodies are symmetric up to this share of their matrices.
SYMMETRIC = 1e-10


@dataclass(frozen=True, slots=True)
class UnitContact:
    """The bodies as their contact elements see them, at a point of the box.

    Attributes:
        normal: D of normal forces, shape (elements, elements) for each coefficient; those beyond
            the first in single precision: they are less than a thousandth of it.
        friction: D of friction forces, likewise.
        lead: of both, shape (coefficients, kept modes, elements).
        source: see ``block_matrix``.
        own: likewise.
        symmetric: whether the bodies are, as without rotation.
        stiffness: k for which w k is 1 in units of the band's end [Pa/m], shape (elements,).
    """

    normal: list[NDArray[Any]]
    friction: list[NDArray[Any]]
    lead: tuple[Array, Array]
    source: Array
    own: Array
    symmetric: bool
    stiffness: Array

    @classmethod
    def of(cls, model: ReducedModel, p: ArrayLike) -> UnitContact:
        """Assemble them."""
        b = model.blocks(p)
        own = b.own
        unit = model.unit_stiffness(p)
        c = unit.size
        normal, friction = (
            [np.ascontiguousarray(A[:, part]) for A in b.D] for part in (slice(c), slice(c, 2 * c))
        )
        symmetric = bool(la.norm(own - own.transpose(0, 2, 1)) <= SYMMETRIC * la.norm(own))
        lead = b.lead[..., :c], b.lead[..., c : 2 * c]
        return cls(normal, friction, lead, b.source, own, symmetric, unit)


@dataclass(frozen=True, slots=True)
class Held:
    """What one value computed in full adds to the trial vectors.

    Attributes:
        a: right and left coordinates, real, shape (kept modes, columns).
        y: motions at all contact elements, zero in open ones, likewise.
        stiffness: w k in units of the band, shape (elements,).
        T: symmetric part of T(0).
        polynomials: what the errors of the polynomials may add to b' T a.
    """

    a: Array
    y: Array
    stiffness: Array
    T: Array
    polynomials: float


@dataclass(frozen=True, slots=True)
class TrialSpace:
    """The trial space.

    Attributes:
        V: of the coordinates, orthonormal, shape (kept modes, r).
        Y: of the motions, shape (elements, q).
        beyond: least kappa + sigma of what V leaves out.
        own: own(z) V.
        source: source(z) V.
        polynomials: what the errors of the polynomials may add to b' T a.
    """

    V: Array
    Y: Array
    beyond: float
    own: Array
    source: Array
    polynomials: float

    @classmethod
    def of(cls, held: list[Held], unit: UnitContact, tolerance: float) -> TrialSpace:
        """Of the vectors of some values."""
        value, U = la.eigh(sum(h.a @ h.a.T for h in held))
        kept = value > KEPT**2 * tolerance * value[-1]
        V, rest = U[:, kept], U[:, ~kept]
        stiffness = np.mean([h.stiffness for h in held], axis=0)
        weight = np.sqrt(np.maximum(stiffness, LITTLE * (stiffness.max(initial=0.0) or 1.0)))
        Y = np.hstack([h.y for h in held]) * weight[:, None]
        size, X = la.eigh(Y.T @ Y)
        chosen = size > MOVING**2 * tolerance * size[-1]
        Y = Y @ (X[:, chosen] / np.sqrt(size[chosen])) / weight[:, None]
        beyond = la.eigvalsh(rest.T @ held[-1].T @ rest)[0] if rest.shape[1] else np.inf
        polynomials = max(h.polynomials for h in held)
        return cls(V, Y, float(beyond), unit.own @ V, unit.source @ V, polynomials)


def real_columns(X: Complex) -> Array:
    """Real and imaginary parts of columns, without those that are zero."""
    return np.hstack([X.real, X.imag[:, np.any(X.imag, axis=0)]])

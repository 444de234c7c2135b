"""Shifts of a sample's modes under small changes of what acts at its contact.

To first order a change dk shifts lambda by psi' (N + mu T)' W dk N phi over psi' P'(lambda) phi,
changes of what slip rates are multiplied by likewise. Of what the kept modes leave out of psi the
static answer is enough: it is an error's size.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..complex_columns import times
from ..modes import Complex, Modes
from ..reduced.damped_sample import DampedSample
from ..reduced.sample import Sample

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Changes:
    """Changes at contact, of each element; those of a row happen together.

    Attributes:
        k: of the stiffness [Pa/m], shape (changes, elements).
        along: of p mu'(V) [Pa s/m], likewise; None for none.
        across: of mu p / V [Pa s/m].
    """

    k: Array
    along: Array | None = None
    across: Array | None = None


def undamped_shifts(sample: Sample, modes: Modes, changes: Changes, rows: Index) -> Array:
    """Sum of the sizes of the shifts of each lambda [1/s] under some changes.

    Args:
        sample: the sample.
        modes: its modes, vectors in the kept modes.
        changes: at all elements.
        rows: the elements that the sample sees.
    """
    b, kappa = sample.basis, sample.sigma - modes.s**2
    g = sample.gaps(modes.right, kappa)
    y = sample.answer(kappa.conj(), times(sample.B.T, modes.left), 1)
    normal = times(b.Phi_N, modes.left) - times(b.NN[0].T, y)
    along = times(b.Phi_T, modes.left) - times(b.NT[0].T, y)
    left = normal + _column(sample.mu, len(along)) * along
    return _sizes(modes, times(changes.k[:, rows], b.w[:, None] * left.conj() * g))


def damped_shifts(sample: DampedSample, modes: Modes, changes: Changes, rows: Index) -> Array:
    """The same for a damped sample."""
    b, J, n = sample.basis, sample.forces, sample.forces.n
    y = sample.left_gaps(modes.s, modes.left)
    left = times(b.forced, modes.left) - times(b.G[0][: J.rows, : J.columns].T, y)
    left = left.conj() * np.tile(b.w, J.columns // n)[:, None]
    z = sample.gaps(modes.s, modes.right)
    normal = left[:n] + _column(sample.mu, n) * left[n : 2 * n]
    total = times(changes.k[:, rows], normal * z[:n])
    rates = {"T": changes.along, "R": changes.across}
    for i, name in enumerate(b.names[1:], 1):
        rate, first = rates[name], n * "NTR".index(name)
        if rate is not None:
            moving = modes.s * z[n * i : n * (i + 1)]
            total += times(rate[:, rows], left[first : first + n] * moving)
    return _sizes(modes, total)


def _column(mu: float | Array, n: int) -> Array:
    return np.broadcast_to(mu, n)[:, None]


def _sizes(modes: Modes, forces: Complex) -> Array:
    """Sums of |shifts| by what each change does between the left and the right vectors."""
    # Rigid modes have no relative error.
    size = np.where(modes.s == 0, np.inf, 2 * np.abs(modes.s))
    return np.asarray(modes.condition * np.abs(forces).sum(axis=0) / size)

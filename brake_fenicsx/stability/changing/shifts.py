"""Shifts of a sample's modes under small changes of its contact stiffness.

To first order a change dk shifts lambda by psi' (N' + mu T') W dk N phi over psi' P'(lambda) phi.
Of what the kept modes leave out of psi the static answer is enough: it is an error's size.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..complex_columns import times
from ..modes import Complex, Modes
from ..reduced.damped_sample import DampedSample
from ..reduced.sample import Sample

Array = NDArray[np.float64]


def undamped_shifts(sample: Sample, modes: Modes, changes: Array) -> Array:
    """Sum of the sizes of the shifts of each lambda [1/s] under some changes.

    Args:
        sample: the sample.
        modes: its modes, vectors in the kept modes.
        changes: changes of k [Pa/m], shape (changes, elements).
    """
    b, kappa = sample.basis, sample.sigma - modes.s**2
    g = sample.gaps(modes.right, kappa)
    y = sample.answer(kappa.conj(), times(sample.B.T, modes.left), 1)
    normal = times(b.Phi_N, modes.left) - times(b.NN[0].T, y)
    along = times(b.Phi_T, modes.left) - times(b.NT[0].T, y)
    return _sizes(modes, (normal, along, g), sample.mu, b.w * changes)


def damped_shifts(sample: DampedSample, modes: Modes, changes: Array) -> Array:
    """The same for a damped sample; the rates at contact stay as they are."""
    b, J, n = sample.basis, sample.forces, sample.forces.n
    y = sample.left_gaps(modes.s, modes.left)
    left = times(b.forced, modes.left) - times(b.G[0][: J.rows, : J.columns].T, y)
    g = sample.gaps(modes.s, modes.right)[:n]
    return _sizes(modes, (left[:n], left[n : 2 * n], g), sample.mu, b.w * changes)


def _sizes(
    modes: Modes, seen: tuple[Complex, Complex, Complex], mu: float | Array, changes: Array
) -> Array:
    """Sums of |shifts|, of left vectors the gaps and slips given, of right ones the gaps."""
    normal, along, right = seen
    left = normal + np.broadcast_to(mu, len(along))[:, None] * along
    first = np.abs(changes @ (left.conj() * right)).sum(axis=0)
    # Rigid modes have no relative error.
    size = np.where(modes.s == 0, np.inf, 2 * np.abs(modes.s))
    return np.asarray(modes.condition * first / size)

"""Pairs of measured and computed modes by the modal assurance criterion (MAC).

Computed modes of nearly equal frequencies, as the doublets of a disc, span a plane in which any
combination is a mode: a measured shape is compared with its best approximation in it.

Reference: R. J. Allemang, Sound and Vibration 37(8) (2003) 14.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from brake_fenicsx.results.families import mac

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Least MAC of a pair; largest ratio of its frequencies; frequencies of a doublet differ by less.
LEAST, FARTHEST, DOUBLET = 0.5, 2.0, 5e-3
# A combination of a doublet counts if the measured directions see this share of the one seen best.
SEEN = 0.1


@dataclass(frozen=True, slots=True)
class Pairs:
    """Measured modes and the computed ones that they are.

    Attributes:
        mac: of every measured and computed mode, those of doublets combined, shape (tests, modes).
        mode: number of the computed mode of each measured one, -1 for none, shape (tests,).
        combined: modes of the computed doublet (or larger group), 1 for a mode by itself, (modes,).
    """

    mac: Array
    mode: NDArray[np.intp]
    combined: NDArray[np.intp]


def paired(measured: Complex, tested: Array, shapes: Array, frequency: Array) -> Pairs:
    """Pair measured with computed modes so that the sum of their MAC is largest.

    Args:
        measured: shapes in the measured directions, shape (tests, directions).
        tested: their frequencies [Hz], ascending.
        shapes: computed shapes in the same directions, shape (modes, directions).
        frequency: their frequencies [Hz], ascending.

    Returns:
        The pairs of at least the least MAC.
    """
    group = np.concatenate([[0], np.cumsum(np.diff(frequency) > DOUBLET * frequency[1:])])
    members = [np.flatnonzero(group == g) for g in range(group[-1] + 1)]
    span = np.column_stack([_in_span(measured, shapes[own]) for own in members])[:, group]
    apart = np.abs(np.log(tested[:, None] / frequency))
    span[apart > np.log(FARTHEST)] = 0.0
    mode = np.full(len(measured), -1)
    # All of a group have the same MAC here: the one that has most of the measured shape.
    alone = mac(measured.T, shapes.astype(complex).T)
    for i, j in zip(*linear_sum_assignment(-span - 1e-3 * alone), strict=True):
        if span[i, j] >= LEAST:
            mode[i] = j
    combined = shapes.astype(complex)
    for own in members:
        if len(own) > 1:
            combined[own] = _combined(shapes[own], own, measured, mode)
    size = np.array([len(members[g]) for g in group])
    return Pairs(mac(measured.T, combined.T), mode, size)


def _in_span(measured: Complex, shapes: Array) -> Array:
    """MAC of measured shapes with their projections on the span of some shapes, shape (tests,)."""
    u, s, _ = np.linalg.svd(shapes.T, full_matrices=False)
    inside = measured @ u[:, s > SEEN * s[0]]
    return np.asarray(np.sum(np.abs(inside) ** 2, axis=1) / np.sum(np.abs(measured) ** 2, axis=1))


def _combined(
    shapes: Array, own: NDArray[np.intp], measured: Complex, mode: NDArray[np.intp]
) -> Complex:
    """Combinations of a group: the best ones for its measured partners, then what is left."""
    test = [int(np.flatnonzero(mode == j)[0]) if j in mode else -1 for j in own]
    used = np.array([i >= 0 for i in test])
    if not used.any():
        return shapes.astype(complex)
    C = np.linalg.lstsq(shapes.T.astype(complex), measured[[i for i in test if i >= 0]].T, SEEN)[0]
    turn = np.zeros((len(own), len(own)), complex)
    turn[:, used] = C
    turn[:, ~used] = np.linalg.svd(C)[0][:, C.shape[1] :]
    return np.asarray(turn.T @ shapes)

"""Families: modes of different samples that have the same shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


class ModeFamilies:
    """Families of modes over samples, by the modal assurance criterion (MAC) in a common basis.

    Reference: R. J. Allemang, Sound and Vibration 37(8) (2003) 14.

    Each sample's modes are matched to the families' first members, best match first; a mode that
    matches none founds a family.

    Attributes:
        vectors: the first member of each family, of length 1.
        frequencies: its frequency [Hz], at least 1.
    """

    def __init__(self, least: float = 0.5):
        """Begin without families.

        Args:
            least: smallest MAC of a match.
        """
        self.vectors: list[Complex] = []
        self.frequencies: list[float] = []
        self._least = least

    def add(self, shapes: Complex, frequencies: Array) -> NDArray[np.intp]:
        """Family of each mode of one more sample, shape (modes,).

        Args:
            shapes: the mode vectors in M-orthonormal coordinates, shape (m, modes).
            frequencies: their frequencies [Hz], shape (modes,).
        """
        X = shapes / np.linalg.norm(shapes, axis=0)
        f = np.maximum(frequencies, 1.0)
        family = np.full(X.shape[1], -1)
        if self.vectors:
            mac = np.abs(np.stack(self.vectors).conj() @ X) ** 2
            near = np.abs(np.log(f[None, :] / np.array(self.frequencies)[:, None])) < 0.3
            mac = np.where(near, mac, 0.0)
            for _ in range(min(mac.shape)):
                i, j = np.unravel_index(np.argmax(mac), mac.shape)
                if mac[i, j] < self._least:
                    break
                family[j] = i
                mac[i, :], mac[:, j] = -1.0, -1.0
        for j in np.flatnonzero(family < 0):
            family[j] = len(self.vectors)
            self.vectors.append(X[:, j].copy())
            self.frequencies.append(float(f[j]))
        return family

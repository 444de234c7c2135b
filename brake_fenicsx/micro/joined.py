"""Laws of several libraries under one numbering: interfaces that follow laws of different kinds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from brake_fenicsx.micro.law import Array, Index, Laws


@dataclass(frozen=True, slots=True)
class JoinedLaws:
    """Libraries one after the other.

    Attributes:
        parts: the libraries; law i of part j has number ``start[j] + i``.
        start: number of the first law of each part, shape (parts,).
    """

    parts: tuple[Laws, ...]
    start: Index

    def __len__(self) -> int:
        return sum(len(part) for part in self.parts)

    def first_touch(self, index: Index) -> Array:
        """See ``Laws``."""
        return self._each("first_touch", index)

    def pressure(self, index: Index, d: Array) -> Array:
        """See ``Laws``."""
        return self._each("pressure", index, d)

    def stiffness(self, index: Index, d: Array) -> Array:
        """See ``Laws``."""
        return self._each("stiffness", index, d)

    def vibration(self, index: Index, d: Array) -> Array:
        """See ``Laws``."""
        return self._each("vibration", index, d)

    def energy(self, index: Index, d: Array) -> Array:
        """See ``Laws``."""
        return self._each("energy", index, d)

    def _each(self, name: str, index: Index, *d: Array) -> Array:
        index = np.asarray(index)
        owner = np.searchsorted(self.start, index, side="right") - 1
        out = np.empty(index.shape)
        for j, part in enumerate(self.parts):
            own = owner == j
            if own.any():
                values = (np.asarray(v)[own] for v in d)
                out[own] = getattr(part, name)(index[own] - self.start[j], *values)
        return out


def join_laws(parts: Sequence[Laws]) -> Laws:
    """One library of several; a single one is returned as it is."""
    if len(parts) == 1:
        return parts[0]
    sizes = [len(part) for part in parts]
    return JoinedLaws(tuple(parts), np.cumsum([0, *sizes[:-1]]).astype(np.intp))

"""Laws of another modulus: all pressures of a library multiplied by one factor, without a copy."""

from __future__ import annotations

from dataclasses import dataclass

from brake_fenicsx.micro.law import Array, Index, Laws


@dataclass(frozen=True, slots=True)
class ScaledLaws:
    """A library whose pressures are multiplied by a factor.

    Attributes:
        laws: the library.
        factor: the factor, positive.
    """

    laws: Laws
    factor: float

    def __len__(self) -> int:
        return len(self.laws)

    def first_touch(self, index: Index) -> Array:
        """See ``Laws``: no pressure is moved."""
        return self.laws.first_touch(index)

    def pressure(self, index: Index, d: Array) -> Array:
        """See ``Laws``."""
        return self.factor * self.laws.pressure(index, d)

    def stiffness(self, index: Index, d: Array) -> Array:
        """See ``Laws``."""
        return self.factor * self.laws.stiffness(index, d)

    def vibration(self, index: Index, d: Array) -> Array:
        """See ``Laws``."""
        return self.factor * self.laws.vibration(index, d)

    def energy(self, index: Index, d: Array) -> Array:
        """See ``Laws``."""
        return self.factor * self.laws.energy(index, d)


def scaled_laws(laws: Laws, factor: float) -> Laws:
    """The library for a modulus ``factor`` times its own; itself where nothing changes."""
    return laws if factor == 1.0 else ScaledLaws(laws, factor)

"""Laws without a surface: a penalty, an exponential, and one law in the place of many."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from brake_fenicsx.micro.law import Array, Index, Law, positive, same_shape


@dataclass(frozen=True, slots=True)
class LinearLaw:
    """Penalty p = k <-d>, also as a library of one law.

    Attributes:
        k: stiffness [Pa/m].
    """

    k: float
    first_touch: float = 0.0

    def pressure(self, d: ArrayLike) -> Array:
        """Pressure p [Pa] at the separation d [m]."""
        return self.k * np.maximum(-np.asarray(d, dtype=float), 0.0)

    def stiffness(self, d: ArrayLike) -> Array:
        """Stiffness -dp/dd [Pa/m]."""
        return np.where(np.asarray(d, dtype=float) < 0.0, self.k, 0.0)

    def vibration(self, d: ArrayLike) -> Array:
        """Stiffness of small vibrations [Pa/m]: that of loading."""
        return self.stiffness(d)

    def energy(self, d: ArrayLike) -> Array:
        """Energy per area, the integral of p from d to infinity [J/m^2]."""
        return 0.5 * self.k * np.maximum(-np.asarray(d, dtype=float), 0.0) ** 2

    def scaled(self, factor: float) -> LinearLaw:
        """The same law with all pressures multiplied by ``factor``."""
        positive(factor=factor)
        return LinearLaw(self.k * factor)


@dataclass(frozen=True, slots=True)
class ExponentialLaw:
    """p = p0 exp(-d / u0): many contacts of a random surface.

    Attributes:
        p0: pressure at d = 0 [Pa].
        u0: length over which the pressure falls by e [m].
    """

    p0: float
    u0: float

    @property
    def first_touch(self) -> float:
        """Separation [m] where p has fallen to p0 / 1e6, since it never becomes zero."""
        return float(self.u0 * np.log(1e6))

    def pressure(self, d: ArrayLike) -> Array:
        """Pressure p [Pa] at the separation d [m]."""
        return np.asarray(self.p0 * np.exp(-np.asarray(d, dtype=float) / self.u0), float)

    def stiffness(self, d: ArrayLike) -> Array:
        """Stiffness -dp/dd [Pa/m]."""
        return np.asarray(self.pressure(d) / self.u0, float)

    def vibration(self, d: ArrayLike) -> Array:
        """Stiffness of small vibrations [Pa/m]: that of loading."""
        return self.stiffness(d)

    def energy(self, d: ArrayLike) -> Array:
        """Energy per area, the integral of p from d to infinity [J/m^2]."""
        return self.pressure(d) * self.u0

    def scaled(self, factor: float) -> ExponentialLaw:
        """The same law with all pressures multiplied by ``factor``."""
        positive(factor=factor)
        return ExponentialLaw(self.p0 * factor, self.u0)


@dataclass(frozen=True, slots=True)
class OneLaw:
    """A single law seen as ``Laws``: every index means the same law.

    Attributes:
        law: the law.
    """

    law: Law

    def __len__(self) -> int:
        """One."""
        return 1

    def __iter__(self) -> Iterator[Law]:
        """The law itself."""
        return iter((self.law,))

    def first_touch(self, index: Index) -> Array:
        """Separations [m] at which the pressures become zero, shape of ``index``."""
        return np.full(np.shape(index), self.law.first_touch)

    def pressure(self, index: Index, d: Array) -> Array:
        """Pressures [Pa] at the separations d [m], same shapes."""
        return self.law.pressure(same_shape(index, d)[1])

    def stiffness(self, index: Index, d: Array) -> Array:
        """Stiffnesses -dp/dd [Pa/m]."""
        return self.law.stiffness(same_shape(index, d)[1])

    def vibration(self, index: Index, d: Array) -> Array:
        """Stiffnesses of small vibrations [Pa/m]."""
        return self.law.vibration(same_shape(index, d)[1])

    def energy(self, index: Index, d: Array) -> Array:
        """Energies per area [J/m^2]."""
        return self.law.energy(same_shape(index, d)[1])


def linear_law(k: float) -> LinearLaw:
    """Linear penalty p = k <-d> with k [Pa/m]."""
    positive(k=k)
    return LinearLaw(float(k))


def exponential_law(p0: float, u0: float) -> ExponentialLaw:
    """Exponential law p = p0 exp(-d / u0) with p0 [Pa] and u0 [m]."""
    positive(p0=p0, u0=u0)
    return ExponentialLaw(float(p0), float(u0))

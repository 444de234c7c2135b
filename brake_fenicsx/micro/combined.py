"""Laws that no surface is pressed for: by a formula, and libraries made of other laws.

One law for all elements, laws of another modulus, several libraries.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from brake_fenicsx.arguments import Array, Index, positive
from brake_fenicsx.micro.law import Law, Laws, same_shape, smooth_vibration


@dataclass(frozen=True, slots=True)
class LinearLaw:
    """Penalty p = k <-d>.

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

    vibration = stiffness


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

    vibration = stiffness


def linear_law(k: float) -> LinearLaw:
    """Linear penalty p = k <-d> with k [Pa/m].

    Example:
        >>> float(linear_law(1e12).pressure(-2e-6))  # 2 um of overlap
        2000000.0
    """
    positive(k=k)
    return LinearLaw(float(k))


def exponential_law(p0: float, u0: float) -> ExponentialLaw:
    """Exponential law p = p0 exp(-d / u0) with p0 [Pa] and u0 [m].

    Example:
        >>> law = exponential_law(1e6, 1e-6)
        >>> round(float(law.pressure(1e-6)))  # p0 / e
        367879
    """
    positive(p0=p0, u0=u0)
    return ExponentialLaw(float(p0), float(u0))


@dataclass(frozen=True, slots=True)
class OneLaw:
    """A single smooth law seen as ``Laws``: every index means the same law.

    Attributes:
        law: the law.
    """

    law: Law

    def __len__(self) -> int:
        """One."""
        return 1

    def first_touch(self, index: Index) -> Array:
        """See ``Laws``."""
        return np.full(np.shape(index), self.law.first_touch)

    def loading(self, index: Index, d: Array) -> tuple[Array, Array]:
        """See ``Laws``."""
        x = same_shape(index, d)[1]
        return self.law.pressure(x), self.law.stiffness(x)

    def vibration(self, index: Index, d: Array) -> tuple[Array, Array]:
        """See ``Laws``."""
        return smooth_vibration(self.law.vibration, same_shape(index, d)[1])

    def up_to(self, index: Index, p: ArrayLike) -> "OneLaw":
        """See ``Laws``: a formula is known everywhere."""
        return self

    def highest(self, index: Index) -> Array:
        """See ``Laws``."""
        return np.full(np.shape(index), getattr(self.law, "highest", np.inf))


@dataclass(frozen=True, slots=True)
class ScaledLaws:
    """Laws of another modulus: all pressures multiplied by one factor, without a copy.

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

    def loading(self, index: Index, d: Array) -> tuple[Array, Array]:
        """See ``Laws``."""
        p, k = self.laws.loading(index, d)
        return self.factor * p, self.factor * k

    def vibration(self, index: Index, d: Array) -> tuple[Array, Array]:
        """See ``Laws``."""
        v, slope = self.laws.vibration(index, d)
        return self.factor * v, self.factor * slope

    def up_to(self, index: Index, p: ArrayLike) -> "ScaledLaws":
        """See ``Laws``."""
        laws = self.laws.up_to(index, np.asarray(p) / self.factor)
        return self if laws is self.laws else replace(self, laws=laws)

    def highest(self, index: Index) -> Array:
        """See ``Laws``."""
        return self.factor * self.laws.highest(index)


@dataclass(frozen=True, slots=True)
class JoinedLaws:
    """Libraries one after the other, for interfaces that follow laws of different kinds.

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
        return self._each("first_touch", index)[0]

    def loading(self, index: Index, d: Array) -> tuple[Array, Array]:
        """See ``Laws``."""
        p, k = self._each("loading", index, d)
        return p, k

    def vibration(self, index: Index, d: Array) -> tuple[Array, Array]:
        """See ``Laws``."""
        v, slope = self._each("vibration", index, d)
        return v, slope

    def up_to(self, index: Index, p: ArrayLike) -> "JoinedLaws":
        """See ``Laws``."""
        owner = np.searchsorted(self.start, index, side="right") - 1
        parts = tuple(
            part.up_to(index[owner == j] - self.start[j], np.asarray(p)[owner == j])
            for j, part in enumerate(self.parts)
        )
        same = all(a is b for a, b in zip(parts, self.parts, strict=True))
        return self if same else replace(self, parts=parts)

    def highest(self, index: Index) -> Array:
        """See ``Laws``."""
        return self._each("highest", index)[0]

    def _each(self, name: str, index: Index, *d: Array) -> Array:
        """What the part of each element answers, shape (answers, *shape of index)."""
        index = np.asarray(index)
        owner = np.searchsorted(self.start, index, side="right") - 1
        out = np.empty((2 if d else 1, *index.shape))
        for j, part in enumerate(self.parts):
            if (here := owner == j).any():
                values = (np.asarray(v)[here] for v in d)
                out[:, here] = getattr(part, name)(index[here] - self.start[j], *values)
        return out


def scaled_laws(laws: Laws, factor: float) -> Laws:
    """The library for a modulus ``factor`` times its own; itself where nothing changes.

    Example:
        >>> steps = LawSteps(np.array([1e-6, 0.0]), np.array([1e5, 4e5]), np.array([2e11, 6e11]))
        >>> stiffer = scaled_laws(make_library([steps]), 2.0)
        >>> stiffer.loading(np.array([0]), np.array([0.0]))[0].round()
        array([800000.])
    """
    return laws if factor == 1.0 else ScaledLaws(laws, factor)


def join_laws(parts: Sequence[Laws]) -> Laws:
    """One library of several; a single one is returned as it is.

    Example:
        >>> both = join_laws([OneLaw(linear_law(1e12)), OneLaw(linear_law(3e12))])
        >>> both.loading(np.array([0, 1]), np.array([-1e-6, -1e-6]))[0].round()
        array([1000000., 3000000.])
    """
    if len(parts) == 1:
        return parts[0]
    sizes = [len(part) for part in parts]
    return JoinedLaws(tuple(parts), np.cumsum([0, *sizes[:-1]]).astype(np.intp))

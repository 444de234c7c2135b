"""The undamped problem taken apart, what a method returns, and what cannot be counted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult

from ..modes import Count
from .interface import Interface

Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class SplitProblem:
    """K x = kappa M x, taken apart.

    Attributes:
        K: stiffness [N/m].
        M: mass [kg].
        frictionless: symmetric part without friction, K itself if that is symmetric.
        friction: K - frictionless as an interface; None if K is symmetric or that has no low rank.
        halved: whether the symmetric half of K stands for the frictionless part.
    """

    K: sp.csr_matrix
    M: sp.csr_matrix
    frictionless: sp.csr_matrix
    friction: Interface | None
    halved: bool

    @property
    def symmetric(self) -> bool:
        """Whether there is no friction."""
        return self.frictionless is self.K

    @property
    def remedy(self) -> str:
        """What helps where nothing can be counted or proven."""
        return "; give frictionless=, the stiffness at mu = 0" if self.halved else ""

    @property
    def not_low_rank(self) -> Count:
        """Record of modes that are not counted because of the rank of friction."""
        reason = "K less its frictionless part is not of low rank"
        return Count("not counted", reason + self.remedy)

    @property
    def indefinite(self) -> Count:
        """Record of modes that are not counted because of the frictionless part."""
        part = "symmetric half of K" if self.halved else "frictionless stiffness"
        reason = f"the {part} is not positive semi-definite{self.remedy}"
        return Count("not counted", reason)


@dataclass(frozen=True, slots=True)
class Found:
    """What a method found.

    Attributes:
        kappa: eigenvalues [1/s^2], conjugates included.
        right: right vectors, shape (dofs, modes).
        left: left vectors, psi^H K = kappa psi^H M.
        counting: how their number was counted.
    """

    kappa: Complex
    right: Complex
    left: Complex
    counting: Count


def agree(found: int, expected: int, high: float, by: str) -> None:
    """Compare the modes found with those counted.

    Raises:
        InaccurateResult: they differ.
    """
    if found != expected:
        raise InaccurateResult(
            f"{found} modes found up to {np.sqrt(high) / 2 / np.pi:g} Hz, {by} counts {expected}"
        )

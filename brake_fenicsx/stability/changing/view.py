"""A body as its contact elements see it: kept modes, and moments of what they leave out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .bodies import Body
from .congruent import Image
from .expansion import Expansion

Array = NDArray[np.float64]
Arrays = dict[str, Array]


@dataclass(frozen=True, slots=True)
class View:
    """A body as its interface sees it, at one stiffness.

    Attributes:
        Lambda: kappa' of the kept modes [1/s^2].
        Phi_N: their gaps, shape (elements, modes).
        Phi_T: their slips, and what the loads do on them, shape (elements + loads, modes).
        shapes: the modes in the coordinates of W, shape (W, modes).
        moments: N R_j [N' T'] for j = 0, 1, ..., shape (elements, 2 elements + loads).
        TT: T R_0 T', shape (elements + loads, elements + loads).
    """

    Lambda: Array
    Phi_N: Array
    Phi_T: Array
    shapes: Array
    moments: Sequence[Array]
    TT: Array


class Seen(Protocol):
    """A body that can be looked at."""

    @property
    def body(self) -> Body:
        """The body; its dofs are the rows of W, its elements those of a view."""

    @property
    def varies(self) -> bool:
        """Whether it looks different at another point."""

    @property
    def W(self) -> Array:
        """Displacements of its coordinates, M-orthonormal, shape (dofs, directions)."""

    @property
    def directions(self) -> int:
        """Number of its coordinates."""

    @property
    def doubt(self) -> Array:
        """Errors of R_0, R_1, ... where they were checked, as ``View.moments``; may be none."""

    @property
    def every_doubt(self) -> Array:
        """The same of all rows and columns."""

    def pole_doubt(self, Lambda: Array) -> Array:
        """Typical errors of its eigenvalues in W [1/s^2], where they were checked."""

    def view(self, x: Array) -> View:
        """The body at a point of the box."""

    def expansion(self, x: Array) -> Expansion:
        """The same, as damped samples take it."""

    def arrays(self) -> Arrays:
        """All that was computed."""


@dataclass(frozen=True, slots=True)
class ImageBody:
    """A body that is the image of another one, and looks the same from its elements.

    Attributes:
        image: how it is one.
        of: the other one.
    """

    image: Image
    of: Seen

    @property
    def body(self) -> Body:
        """The body, in the order of the other one."""
        return self.image.body

    @property
    def varies(self) -> bool:
        """Like the other one."""
        return self.of.varies

    @property
    def W(self) -> Array:
        """Those of the other one, turned."""
        return self.image.signs[:, None] * self.of.W

    @property
    def directions(self) -> int:
        """Like the other one."""
        return self.of.directions

    @property
    def doubt(self) -> Array:
        """Like the other one."""
        return self.of.doubt

    @property
    def every_doubt(self) -> Array:
        """Like the other one."""
        return self.of.every_doubt

    def pole_doubt(self, Lambda: Array) -> Array:
        """Like the other one."""
        return self.of.pole_doubt(Lambda)

    def view(self, x: Array) -> View:
        """Like the other one."""
        return self.of.view(x)

    def expansion(self, x: Array) -> Expansion:
        """Like the other one."""
        return self.of.expansion(x)

    def arrays(self) -> Arrays:
        """Nothing of its own."""
        return {}

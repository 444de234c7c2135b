"""How a body is damped: in proportion to its mass and stiffness, and what differs from that.

With C = alpha M + beta K + DeltaC,

    K + lambda C + lambda^2 M = (1 + beta lambda) [K - kappa M + delta DeltaC],
    kappa = -(lambda^2 + alpha lambda) / (1 + beta lambda),   delta = lambda / (1 + beta lambda):

what is known of the undamped body at every kappa is that of the damped one too. A real delta is no
more than another stiffness; as one more coordinate of its box, polynomials in it hold for complex
ones. beta is taken where contact is: DeltaC then stands in what contact sees little of.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult

from ..full.symmetric import count_below
from .anchors import Anchors
from .at_anchors import work_at
from .bodies import Body

Array = NDArray[np.float64]

# Share of a matrix that is round-off.
ROUND_OFF = 1e-11

# Half width of the box in delta as a share of the highest omega: polynomials are asked for up to
# twice that, at right angles to it.
REACH = 0.5

# Degrees more for a body that only its damping changes.
DEEPER = 3

# Modes below this share of the highest kappa are those of a body that nothing clamps.
RIGID = 1e-6


@dataclass(frozen=True, slots=True)
class Damping:
    """Damping of an ensemble.

    Attributes:
        C: of the scene's bodies [N s/m], shape (dofs, dofs); None where they have none.
        alpha: share of the mass in it [1/s].
        follows: share [s] of each unit change of the stiffness that C takes.
        R: slip across the sliding direction, shape (elements, dofs).
        along: whether forces along the slip follow its rate.
        across: whether forces across it do.
    """

    C: sp.csr_matrix | None
    alpha: float
    follows: Array
    R: sp.csr_matrix
    along: bool
    across: bool

    @property
    def names(self) -> str:
        """Blocks of rows that forces follow."""
        return "N" + "T" * self.along + "R" * self.across


@dataclass(frozen=True, slots=True)
class Proportion:
    """Damping of one body.

    Attributes:
        alpha: share of its mass [1/s].
        beta: share of its stiffness [s].
        difference: DeltaC in the scene [N s/m]; None where it is nought, always.
        follows: what the shares of its unit changes differ by, over all unit changes [s].
        skew: whether DeltaC is not symmetric.
        reach: delta at t = 1 [1/s].
    """

    alpha: float = 0.0
    beta: float = 0.0
    difference: sp.csr_matrix | None = None
    follows: Array | None = None
    skew: bool = False
    reach: float = 1.0

    def beside(self, coefficients: Callable[[Array], Array]) -> Callable[[Array], Array]:
        """Coefficients of all unit changes and of DeltaC, at points with t as last coordinate."""
        follows = self.follows

        def both(x: Array) -> Array:
            delta, c = self.reach * x[-1], coefficients(x[:-1])
            return np.r_[c * (1.0 if follows is None else 1.0 + delta * follows), delta]

        return both


def proportion(body: Body, damping: Damping | None, high: float) -> Proportion:
    """Take the damping of a body apart.

    Args:
        body: the body.
        damping: of the ensemble; None without.
        high: highest omega of the band [rad/s].

    Raises:
        InaccurateResult: so much damping that the series in lambda do not reach the band's end.
    """
    if damping is None or not body.C.nnz:
        return Proportion()
    elastic = (body.C - damping.alpha * body.M).tocsr()
    # Where contact is; anywhere for a body without.
    touched = np.unique(body.N.indices) if body.N.nnz else np.arange(body.K.shape[0])
    beta = float(elastic.diagonal()[touched].sum() / body.K.diagonal()[touched].sum())
    if abs(beta) * body.K.diagonal().max() <= ROUND_OFF * np.abs(body.C.diagonal()).max():
        beta = 0.0
    if not beta * high < 1:
        raise InaccurateResult("damping too strong for the reduced model of changing materials")
    difference = (elastic - beta * body.K).tocsr()
    follows = damping.follows - beta
    own = [number for number, _ in body.parts]
    if _largest(difference) <= ROUND_OFF * _largest(body.C):
        if np.all(np.abs(follows[own]) <= ROUND_OFF * abs(beta)):
            return Proportion(damping.alpha, beta)
        difference = sp.csr_matrix(body.K.shape)
    skew = _largest(difference - difference.T) > ROUND_OFF * _largest(body.C)
    return Proportion(damping.alpha, beta, difference, follows, skew, REACH * high)


class Box:
    """Where a body's stiffness is looked at.

    Attributes:
        body: the body; DeltaC is one of its unit changes where it is looked at as stiffness.
        anchors: points of its own box; None for a body that looks the same everywhere.
        coefficients: of its unit changes at a point of that box.
        stretched: whether the last coordinate is the share t of DeltaC.
        series: whether its damping is taken by ``damped_body`` instead.
    """

    def __init__(
        self,
        plain: tuple[Anchors, Callable[[Array], Array]],
        body: Body,
        how: Proportion,
        number: int,
        high: float,
    ):
        """Choose the box.

        Args:
            plain: anchors and coefficients of the box of the materials.
            body: the body.
            how: its damping.
            number: of all unit changes of the materials.
            high: highest kappa of the band [1/s^2].

        Raises:
            InaccurateResult: a body turns that is of variable stiffness or not clamped.
        """
        differs, varies = how.difference is not None, bool(body.parts)
        self.series = differs and not varies and not count_below(body.K, body.M, RIGID * high)[0]
        self.body, self.stretched = body, differs and not self.series
        self.anchors: Anchors | None = plain[0] if varies else None
        self.coefficients = plain[1]
        if not self.stretched:
            return
        if how.skew:
            raise InaccurateResult(
                "a part that turns must be clamped and of constant stiffness"
                " for the reduced model of changing materials"
            )
        degree, dimension = plain[0].degree, plain[0].points.shape[1]
        self.anchors = Anchors(dimension + 1, degree) if varies else Anchors(1, degree + DEEPER)
        self.coefficients = how.beside(plain[1] if varies else lambda x: np.zeros(number))
        self.body = replace(body, parts=(*body.parts, (number, how.difference)))

    @property
    def work(self) -> int:
        """Points at which the body is solved."""
        return 0 if self.anchors is None else work_at(self.anchors)


def _largest(A: sp.spmatrix) -> float:
    return float(np.abs(A.tocsr().data).max(initial=0.0))

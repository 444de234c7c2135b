"""Bodies together: sums of what each shows, over all contact elements.

Elements stand in an order of their own, those of a changing body side by side. What the bodies that
never change show is added once; for a sample only the blocks of the others are written again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..reduced.basis import Basis
from .bodies import compact
from .springs import Resting
from .view import Seen, View

Array = NDArray[np.float64]
Index = NDArray[np.intp]

# Terms of the series in kappa' of a body at rest.
AT_REST = 3

# Modes up to this multiple of sigma are kept apart there: rigid ones have sigma itself.
SOFT = 2.0


class Together:
    """Bodies and where their elements stand.

    Attributes:
        order: the contact elements in the order of all matrices here.
        place: where each contact element stands in it.
    """

    def __init__(self, bodies: Sequence[Seen], w: Array, sigma: float, limit: float):
        """Add up what never changes.

        Args:
            bodies: the bodies.
            w: areas of the contact elements [m^2].
            sigma: kappa' of the bodies at rest [1/s^2].
            limit: no mode of a body below it is missing [1/s^2], as kappa'.
        """
        varied = [body.body.elements for body in bodies if body.varies]
        every = np.concatenate([*varied, np.arange(w.size)])
        self.order: Index = every[np.sort(np.unique(every, return_index=True)[1])]
        self.place: Index = np.argsort(self.order)
        self.bodies, self.sigma, self.limit = bodies, sigma, limit
        self.w: Array = w[self.order]
        self._own = [compact(self.place[body.body.elements]) for body in bodies]
        self._moving = _Sums(bodies, self._own, w.size, _moving)
        self._resting = _Sums(bodies, self._own, w.size, partial(_resting, sigma=sigma))

    def basis(self, views: list[View], closed: Index) -> Basis:
        """Basis of a sample, seen from some of the elements; valid until the next sample's.

        Args:
            views: the bodies of the sample.
            closed: places of the elements.
        """
        all_of_them = self._moving.of(views)
        if closed.size < self.w.size:
            all_of_them = [A[closed][:, closed] for A in all_of_them]
        *moments, TT, NN_0, NT_0, TT_0 = all_of_them
        Phi_N, Phi_T, _ = self._modal(views, 0)
        Lambda = np.concatenate([s.Lambda for s in views])
        w = self.w[closed]
        return Basis(
            Lambda, Phi_N[closed], Phi_T[closed], tuple(moments[0::2]), tuple(moments[1::2]), TT,
            (NN_0, NT_0, TT_0), w, np.zeros_like(w), self.limit,
        )  # fmt: skip

    def resting(self, views: list[View]) -> Resting:
        """The bodies of a sample at rest, kappa' = sigma."""
        NN, NT = self._resting.of(views)
        most = SOFT * self.sigma
        Phi_N, Phi_T, Phi_f = self._modal(views, most)
        Nf = np.zeros((self.w.size, Phi_f.shape[0]))
        for own, s in zip(self._own, views, strict=True):
            Nf[own] += _at_rest(s, self.sigma, slice(2 * len(s.Phi_N), None))
        kappa = np.concatenate([s.Lambda[s.Lambda <= most] for s in views]) - self.sigma
        return Resting(NN, NT, Nf, kappa, Phi_N, Phi_T, Phi_f)

    def doubt(self, closed: Index) -> list[list[tuple[Any, Any]]]:
        """Errors of the interpolation where it was checked: what ``Sample`` multiplies by."""
        out = []
        at = np.full(self.w.size, -1)
        at[closed] = np.arange(closed.size)
        for body, own in zip(self.bodies, self._own, strict=True):
            there = at[own]
            here = np.flatnonzero(there >= 0)
            there = there[here]
            for errors in body.doubt:
                n = errors.shape[1]
                # A whole block needs no copy.
                inner = (slice(None), slice(None)) if here.size == n else np.ix_(here, here)
                halves = [(e[:, :n][inner], e[:, n : 2 * n][inner]) for e in errors]
                turn = (there, closed.size)
                out.append([(_Within(NN, *turn), _Within(NT, *turn)) for NN, NT in halves])
        return out

    def _modal(self, views: list[View], most: float) -> tuple[Array, Array, Array]:
        """Gaps, slips and loads of all modes, of those up to some kappa' if it is given."""
        counts = [int((s.Lambda <= (most or np.inf)).sum()) for s in views]
        loads = views[0].Phi_T.shape[0] - views[0].Phi_N.shape[0]
        Phi_N, Phi_T, Phi_f = (np.zeros((m, sum(counts))) for m in (*self.w.shape * 2, loads))
        first = 0
        for own, s, count in zip(self._own, views, counts, strict=True):
            n, columns = s.Phi_N.shape[0], slice(first, first + count)
            Phi_N[own, columns], Phi_T[own, columns] = s.Phi_N[:, :count], s.Phi_T[:n, :count]
            Phi_f[:, columns] = s.Phi_T[n:, :count]
            first += count
        return Phi_N, Phi_T, Phi_f


class _Sums:
    """Some matrices over all elements, each a sum over the bodies."""

    def __init__(
        self,
        bodies: Sequence[Seen],
        own: Sequence[slice | Index],
        n: int,
        shown: Callable[[View], list[Array]],
    ):
        """Say what is added.

        Args:
            bodies: the bodies.
            own: places of their elements.
            n: number of elements.
            shown: the matrices that a body shows.
        """
        self._n, self._shown = n, shown
        self._block = [_block(places) for places in own]
        self._changing = [i for i, body in enumerate(bodies) if body.varies]
        self._sums: list[Array] = []
        self._below: list[list[Array]] = []

    def of(self, views: list[View]) -> list[Array]:
        """The sums; they are written again by the next call."""
        if not self._sums:
            self._start(views)
        blocks = [self._block[i] for i in self._changing]
        # Images share their view.
        found = {id(views[i]): self._shown(views[i]) for i in self._changing}
        shown = [found[id(views[i])] for i in self._changing]
        for j, total in enumerate(self._sums):
            for block, below in zip(blocks, self._below, strict=True):
                total[block] = below[j]
            for block, matrices in zip(blocks, shown, strict=True):
                total[block] += matrices[j]
        return self._sums

    def _start(self, views: list[View]) -> None:
        """Add up what never changes."""
        n = self._n
        self._sums = [np.zeros((n, n)) for _ in self._shown(views[0])]
        for i in set(range(len(views))) - set(self._changing):
            for total, matrix in zip(self._sums, self._shown(views[i]), strict=True):
                total[self._block[i]] += matrix
        self._below = [
            [np.array(total[self._block[i]]) for total in self._sums] for i in self._changing
        ]


@dataclass(frozen=True, slots=True)
class _Within:
    """Products with a matrix over some of the closed elements; over all others it is zero."""

    A: Array
    own: Index
    n: int

    def __matmul__(self, x: Array) -> Array:
        out = np.zeros((self.n, x.shape[1]))
        out[self.own] = self.A @ x[self.own]
        return out


def _moving(s: View) -> list[Array]:
    """N R_j N' and N R_j T' in turn, T R_0 T', and the three of R_0 with the modes."""
    n = len(s.Phi_N)
    out = [half for R in s.moments for half in (R[:, :n], R[:, n : 2 * n])]
    P_N, P_T, TT = s.Phi_N / s.Lambda, s.Phi_T[:n] / s.Lambda, s.TT[:n, :n]
    with_modes = (
        out[0] + P_N @ s.Phi_N.T, out[1] + P_N @ s.Phi_T[:n].T, TT + P_T @ s.Phi_T[:n].T,
    )  # fmt: skip
    return [*out, TT, *with_modes]


def _resting(s: View, sigma: float) -> list[Array]:
    """N R N' and N R T' at rest."""
    n = len(s.Phi_N)
    both = _at_rest(s, sigma, slice(0, 2 * n))
    return [both[:, :n], both[:, n:]]


def _at_rest(s: View, sigma: float, columns: slice) -> Array:
    """Some columns of N R [N' T'] at rest, all modes but the soft ones in it."""
    R = s.moments[0][:, columns].copy()
    for j in range(1, AT_REST):
        R += sigma**j * s.moments[j][:, columns]
    firm = s.Lambda > SOFT * sigma
    Phi = np.vstack([s.Phi_N, s.Phi_T])[columns, firm]
    R += (s.Phi_N[:, firm] / (s.Lambda[firm] - sigma)) @ Phi.T
    return R


def _block(places: slice | Index) -> tuple[Any, ...]:
    """Rows and columns of a block on the diagonal."""
    return (places, places) if isinstance(places, slice) else np.ix_(places, places)

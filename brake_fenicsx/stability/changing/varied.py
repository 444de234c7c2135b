"""A body of variable stiffness as its contact elements see it, for any stiffness in a box.

A(theta) = K + sum c_j(theta) K_j + sigma M is positive definite. With a space W, the modes of the
body at some anchors theta_a, the resolvent on the interface B = [N; T] is

    B (A - kappa' M)^-1 B' = B W (W'A W - kappa')^-1 W'B' + R_0(theta) + kappa' R_1(theta) + ...,

kappa' = kappa + sigma. The first term is exact for every theta (A is linear in the coefficients);
the rest is small and smooth in theta, because W is the same for all: R_j is computed at anchors,
see ``rest``, and interpolated with a degree that falls from j to j + 1; the last ones are those of
the centre. ``at_anchors`` does that work once; here its results are looked up. Rows that forces
follow alone are kept, N R_j [N' T'] without damping.

Where damping is not in proportion, its share t of the stiffness is one more coordinate of the box,
see ``proportion``; at t = 0 the body is the undamped one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from .at_anchors import Varied
from .bodies import places_of
from .expansion import Expansion, Moment
from .interpolated import Rests, degrees
from .view import Arrays, View

Array = NDArray[np.float64]

# From this j on, directions of W beyond so many times the kept kappa add less than 1e-7.
FAR_ORDER, FAR = 3, 16.0

# An eigenvalue's error is looked up at so many times its size, since eigenvalues move.
NEARBY = 1.2


class VariedBody:
    """A body whose stiffness changes from sample to sample.

    Attributes:
        body: the body; its matrices have served and are gone.
        W: M-orthonormal, shape (dofs, directions).
        anchors: where it was solved.
        every_doubt: errors of R_0, R_1, ... at each point that checks the interpolation, shape
            (checks, orders, rows that are looked at, all columns).
        doubt: of the rows and columns that undamped samples look at.
    """

    varies = True

    def __init__(self, varied: Varied, names: str, elements: int, loads: int, arrays: Arrays):
        """Take what was solved at the anchors.

        Args:
            varied: the body.
            names: blocks of rows that forces follow, see ``looked_at``.
            elements: number of its contact elements.
            loads: number of its unit loads.
            arrays: from ``solve_at_anchors``.
        """
        # Some hundred megabytes in every process.
        none = sp.csr_matrix((0, 0))
        self._arrays, self._kept, self._stretched = arrays, varied.kept, varied.stretched
        self.anchors, self._n = varied.anchors, elements
        self._columns = places_of(names, "NT", elements, loads)
        self._stiffness = varied.stiffness(arrays["projected"])
        number = len(degrees(varied.anchors))
        self._rests = Rests(varied.anchors, tuple(arrays[f"R_{j}"] for j in range(number)))
        self._last: tuple[Array, View] | None = None
        self.body = replace(varied.body, K=none, M=none, parts=(), C=none, R=none)
        self.W, self.every_doubt = arrays["W"], arrays["doubt"]
        self.doubt = self.every_doubt[:, :, :elements, self._columns]

    @property
    def directions(self) -> int:
        """Number of its coordinates."""
        return int(self.W.shape[1])

    def arrays(self) -> Arrays:
        """All that was computed."""
        return self._arrays

    def pole_doubt(self, Lambda: Array) -> Array:
        """Typical errors of its eigenvalues in W [1/s^2], where they were checked."""
        return np.asarray(Lambda * np.interp(NEARBY * Lambda, *self._arrays["poles"]))

    def view(self, x: Array) -> View:
        """The body at a point of [-1, 1]^d; the last one is kept, others may ask for the same."""
        if self._last is None or not np.array_equal(self._last[0], x):
            self._last = x.copy(), self._view(self._place(x))
        return self._last[1]

    def expansion(self, x: Array) -> Expansion:
        """The body at a point of [-1, 1]^d, as damped samples take it."""
        x = self._place(x)
        Lambda, Q = self._directions(x)
        kept, top = int(np.searchsorted(Lambda, self._kept, side="right")), len(self._rests.values)
        moments = [self._rests.moment(x, j, self._stretched) for j in range(top)]
        one = np.ones((1, 1))
        moments += [Moment(top + j, one, R[None]) for j, R in enumerate(self._arrays["higher"])]
        difference = Q.T @ self._stiffness.difference(x) @ Q if self._stretched else None
        Phi = Q.T @ self._arrays["W_B"]
        return Expansion(self._n, Lambda, Phi, Q, kept, difference, moments, self._arrays["TT"])

    def _place(self, x: Array) -> Array:
        """The undamped body's place among the anchors."""
        size = self.anchors.points.shape[1]
        return np.r_[x[: size - 1], 0.0] if self._stretched else x

    def _directions(self, x: Array) -> tuple[Array, Array]:
        """Eigenvalues and eigenvectors of W'A W."""
        # Divide and conquer: the default driver takes four times as long for some of these.
        Lambda, Q = la.eigh(self._stiffness.at(x), driver="evd", check_finite=False)
        return Lambda, Q

    def _view(self, x: Array) -> View:
        Lambda, Q = self._directions(x)
        Phi, n = (Q.T @ self._arrays["W_B"])[:, self._columns], self._n
        kept, far = np.searchsorted(Lambda, [self._kept, FAR * self._kept], side="right")
        higher, moments, top = self._arrays["higher"], [], len(self._rests.values)
        for j in range(top + len(higher)):
            beyond = slice(kept, None if j < FAR_ORDER else far)
            scaled = Phi[beyond, :n] / Lambda[beyond, None] ** (j + 1)
            total = scaled.T @ Phi[beyond]
            rest = self._rests.at(x, j, n) if j < top else higher[j - top][:n]
            total += rest[:, self._columns]
            moments.append(total)
        Phi, TT = Phi[:kept], self._arrays["TT"]
        return View(Lambda[:kept], Phi[:, :n].T, Phi[:, n:].T, Q[:, :kept], moments, TT)

"""Reduced model of an ensemble whose bodies differ too: a basis for every sample.

The bodies are taken apart. Each is seen from its contact elements alone, those of variable
stiffness through ``varied``; a sample's basis is the sum of what its bodies show, with k0 = 0 and
shifted by sigma, so that pads held by nothing but contact are no exception. Contact and friction
then enter exactly, as in ``sample``.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

from mpi4py import MPI

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from .anchors import Anchors
from .basis import Basis
from .bodies import split_bodies
from .modes import Complex, Modes
from .reduction import CUTOFF, ORDER
from .sample import Sample
from .varied import VariedBody, work_at
from .view import FixedBody, View, fixed_body

Array = NDArray[np.float64]
Index = NDArray[np.intp]

# Modes of bodies of variable stiffness are kept up to the first multiple of the band, since nothing
# of a sample is corrected later, and known up to the second.
VARIED_CUTOFF = (2.0, 2.2)

# sigma as a share of the highest kappa of the band: moments about -sigma lose the digits that the
# lowest modes, which have none of their own on free bodies, would cost them about zero.
SHIFT = 0.05

# Total degree of the interpolation between the anchors.
DEGREE = 3


class EnsembleBasis:
    """Modes and compliance of any sample of stiffnesses, contact and friction.

    Attributes:
        bodies: the bodies and how they are seen.
        sigma: shift [1/s^2].
        seconds: time of the offline stage [s].
    """

    def __init__(
        self,
        K: sp.csr_matrix,
        M: sp.csr_matrix,
        N: sp.csr_matrix,
        T: sp.csr_matrix,
        w: Array,
        loads: Array,
        parts: Sequence[sp.csr_matrix],
        coefficients: Callable[[Array], Array],
        dimension: int,
        band: tuple[float, float],
        degree: int = DEGREE,
        comm: MPI.Comm | None = None,
        progress: Callable[[int], Callable[[int], None]] = lambda total: lambda done: None,
        known: Sequence[dict[str, Array]] | None = None,
    ):
        """Offline stage.

        Args:
            K: elastic stiffness of the scene [N/m].
            M: mass [kg].
            N: gap operator, shape (elements, dofs).
            T: slip operator.
            w: areas of the elements [m^2].
            loads: unit loads, shape (dofs, loads).
            parts: unit changes of the stiffness.
            coefficients: of the unit changes at a point of the box [-1, 1]^d, added to K.
            dimension: number of parameters d.
            band: lowest and highest frequency [Hz].
            degree: total degree of the interpolation.
            comm: processes that share the work; this process alone if None.
            progress: called with this process's number of anchors; what it returns is called with
                the number done.
            known: ``arrays`` of all bodies of the same problem, made earlier.

        Raises:
            InaccurateResult: a body has no positive definite stiffness somewhere in the box, or an
                inertia count finds a missing mode.
        """
        start = time.perf_counter()
        comm = MPI.COMM_SELF if comm is None else comm
        high = (2 * np.pi * band[1]) ** 2
        self.band, self.w, self.sigma = band, w, SHIFT * high
        self.limit = CUTOFF**2 * high
        anchors = Anchors(dimension, degree)
        self.bodies: list[FixedBody | VariedBody] = []
        self._last: tuple[Array, list[View]] | None = None
        kept, known_up_to = (factor**2 * high for factor in VARIED_CUTOFF)
        bodies = split_bodies(K, M, N, T, loads, list(parts))
        varied = sum(bool(body.parts) for body in bodies)
        advance = progress(-(-varied * work_at(anchors) // comm.size))
        for i, body in enumerate(bodies):
            made = None if known is None else known[i]
            if body.parts:
                box = (coefficients, anchors)
                self.bodies.append(
                    VariedBody(
                        body, *box, self.sigma, (kept, known_up_to), ORDER, comm, advance, made
                    )
                )
            else:
                self.bodies.append(fixed_body(body, self.sigma, self.limit, ORDER, comm, made))
        self.seconds = time.perf_counter() - start

    def modes(self, x: Array, k: Array, mu: float | Array) -> Modes:
        """Complex modes of one sample in the band; nothing is corrected.

        Args:
            x: its stiffness, a point of the box.
            k: contact stiffness of each element [Pa/m], shape (elements,).
            mu: friction coefficient, one or one per element.

        Returns:
            The modes; ``right`` and ``left`` in coordinates that ``displacements`` understands.
        """
        start = time.perf_counter()
        views = self._look(x)
        # Open elements show nothing; of a brake whose every element is open one is looked at.
        closed = np.flatnonzero(k > 0) if np.any(k > 0) else np.zeros(1, dtype=np.intp)
        basis = self._basis(views, closed)
        mu = np.broadcast_to(np.asarray(mu, float), k.shape)[closed]
        doubt = self._doubt(closed)
        found = Sample(basis, k[closed], mu, self.sigma, doubt).modes(self.band, start)
        turn = la.block_diag(*(s.shapes for s in views))
        how = "winding number of det T, on bases complete by inertia at the anchors"
        return replace(
            found, right=turn @ found.right, left=turn @ found.left,
            count=replace(found.count, how=how),
        )  # fmt: skip

    def compliance(self, x: Array, k0: Array) -> tuple[Array, Array, Array]:
        """N K0^-1 N', N K0^-1 T' and N K0^-1 f of the bodies on springs k0, K0 = K + N'W k0 N.

        Args:
            x: a point of the box.
            k0: reference stiffness [Pa/m], shape (elements,).

        Returns:
            Shapes (elements, elements) twice, (elements, loads).
        """
        views = self._look(x)
        n, D0 = self.w.size, self.w * k0
        R = [np.zeros((n, n)) for _ in range(2)]
        R.append(np.zeros((n, views[0].NT[0].shape[1] - views[0].NN[0].shape[1])))
        for body, s in zip(self.bodies, views, strict=True):
            e = body.body.elements
            # kappa' = sigma is the body at rest.
            powers = self.sigma ** np.arange(3)
            NN, NT = (np.tensordot(powers, moments[:3], 1) for moments in (s.NN, s.NT))
            R[0][np.ix_(e, e)] += NN
            R[1][np.ix_(e, e)] += NT[:, : e.size]
            R[2][e] += NT[:, e.size :]
        Phi_N, Phi_T, Phi_f, Lambda = self._modal(views)
        # g = R (q - N'D0 g) + Phi_N a,   (Lambda' - sigma) a = Phi' (q - N'D0 g).
        E = R[0] * D0
        E[np.diag_indices_from(E)] += 1.0
        lu = la.lu_factor(E, overwrite_a=True, check_finite=False)
        S = la.lu_solve(lu, Phi_N, check_finite=False)
        small = (Phi_N.T * D0) @ S
        small[np.diag_indices_from(small)] += Lambda - self.sigma
        small = la.lu_factor(small, check_finite=False)
        out = []
        for right, modal in zip(R, (Phi_N, Phi_T, Phi_f), strict=True):
            g = la.lu_solve(lu, right, check_finite=False)
            a = la.lu_solve(small, modal.T - (Phi_N.T * D0) @ g, check_finite=False)
            out.append(g + S @ a)
        return 0.5 * (out[0] + out[0].T), out[1], out[2]

    def displacements(self, coordinates: Complex) -> Complex:
        """Displacements of some coordinates, shape (dofs, columns); static answers left out."""
        out = np.zeros((sum(b.body.dofs.size for b in self.bodies), coordinates.shape[1]), complex)
        for body, own in zip(self.bodies, self._places(), strict=True):
            out[body.body.dofs] = body.W @ coordinates[own]
        return out

    def projected(self, A: sp.csr_matrix, shapes: Array | None = None) -> Array:
        """Shapes' A U of the displacements U of all coordinates; U'A U without other shapes.

        Args:
            A: a matrix that does not couple the bodies, such as the mass, shape (dofs, dofs).
            shapes: other displacements, shape (dofs, columns).
        """
        places = self._places()
        size = places[-1].stop
        out = np.zeros((size if shapes is None else shapes.shape[1], size))
        for body, own in zip(self.bodies, places, strict=True):
            dofs = body.body.dofs
            AW = A[dofs][:, dofs] @ body.W
            if shapes is None:
                out[own, own] = body.W.T @ AW
            else:
                out[:, own] = shapes[dofs].T @ AW
        return out

    def _look(self, x: Array) -> list[View]:
        """The bodies at a point; kept: equilibrium and modes of a sample ask for the same."""
        if self._last is None or not np.array_equal(self._last[0], x):
            self._last = x.copy(), [body.view(x) for body in self.bodies]
        return self._last[1]

    def _places(self) -> list[slice]:
        """Places of each body's coordinates."""
        ends = np.cumsum([0, *(body.W.shape[1] for body in self.bodies)])
        return [slice(int(a), int(b)) for a, b in pairwise(ends)]

    def _modal(self, views: list[View]) -> tuple[Array, Array, Array, Array]:
        """Gaps, slips and loads of all modes, and their eigenvalues."""
        n, modes = self.w.size, sum(s.Lambda.size for s in views)
        loads = views[0].Phi_T.shape[0] - views[0].Phi_N.shape[0]
        Phi_N, Phi_T, Phi_f = (np.zeros((m, modes)) for m in (n, n, loads))
        first = 0
        for body, s in zip(self.bodies, views, strict=True):
            e, own = body.body.elements, slice(first, first + s.Lambda.size)
            Phi_N[e, own], Phi_T[e, own] = s.Phi_N, s.Phi_T[: e.size]
            Phi_f[:, own] = s.Phi_T[e.size :]
            first = own.stop
        return Phi_N, Phi_T, Phi_f, np.concatenate([s.Lambda for s in views])

    def _basis(self, views: list[View], closed: Index) -> Basis:
        """The bodies together, seen from some of the elements."""
        Phi_N, Phi_T, _, Lambda = self._modal(views)
        Phi_N, Phi_T = Phi_N[closed], Phi_T[closed]
        NN = [np.zeros((closed.size, closed.size)) for _ in range(ORDER + 1)]
        NT = [np.zeros((closed.size, closed.size)) for _ in range(ORDER + 1)]
        TT = np.zeros((closed.size, closed.size))
        for body, s in zip(self.bodies, views, strict=True):
            there, here = _common(closed, body.body.elements)
            for total, part in zip(NN, s.NN, strict=True):
                total[there] += part[here]
            for total, part in zip(NT, s.NT, strict=True):
                total[there] += part[here]
            TT[there] += s.TT[here]
        P_N, P_T = Phi_N / Lambda, Phi_T / Lambda
        whole = (NN[0] + P_N @ Phi_N.T, NT[0] + P_N @ Phi_T.T, TT + P_T @ Phi_T.T)
        w = self.w[closed]
        return Basis(
            Lambda, Phi_N, Phi_T, tuple(NN), tuple(NT), TT, whole, w, np.zeros_like(w),
            self.limit + self.sigma,
        )  # fmt: skip

    def _doubt(self, closed: Index) -> list[list[tuple[Array, Array]]]:
        """Errors of the interpolation where it was checked."""
        out = []
        for body in self.bodies:
            if isinstance(body, FixedBody):
                continue
            there, here = _common(closed, body.body.elements)
            for errors in body.doubt:
                spread = []
                for pair in errors:
                    whole = np.zeros((2, closed.size, closed.size))
                    for total, part in zip(whole, pair, strict=True):
                        total[there] = part[here]
                    spread.append((whole[0], whole[1]))
                out.append(spread)
        return out


def _common(closed: Index, elements: Index) -> tuple[tuple[Index, ...], tuple[Index, ...]]:
    """Where the elements that both name stand in matrices over the first, and over the second."""
    places = np.intersect1d(closed, elements, assume_unique=True, return_indices=True)[1:]
    there, here = (np.ix_(own, own) for own in places)
    return there, here

r"""What the interface and the kept modes of a body see of the rest of it, at one frequency.

With W the kept modes, I the rows that contact forces act along, F loads, and

    R = [I', M W, F],     G = R' P^-1 R,

write u = W a + v with v M-orthogonal to W, and let S be the inverse of P on these v. Eliminating
from G the forces M W that hold W'M u (a partial inverse) gives

    H = G_WW^-1                     = W'P W - W'P S P W,
    L = G_WW^-1 [G_WI, G_WF]        = W'[I', F] - W'P S [I', F],
    D = G_II - G_IW G_WW^-1 G_WI    = I S I',

exact for any P. What they lack of their first terms is [I; W'P] S [I', P W, F]: residual
flexibility (MacNeal 1971, Rubin 1975), and the coupling of the kept modes by damping and changes.
It is smooth up to the eigenvalues of the body that is held at W'M u = 0, beyond the cutoff. At the
shift of the reduced model S itself serves as an operator (``Complement``).
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import AnyArray, Array
from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.macro.solver import Factor, InterfaceFactor

from ..eigensolvers.eigenpairs import plus
from ..eigensolvers.symmetric import is_symmetric
from .contact_rows import SIGMA, Rows

# Distance of an eigenvalue in kappa below which its kept mode is solved for.
NEAR = 0.02

INDEFINITE = (
    "the stiffness of a body is not positive definite somewhere in the box of the random"
    " materials: narrow their distributions"
)


@dataclass(frozen=True, slots=True)
class SeenBody:
    """A body and what sees it, at a point of the box, in units of the band's end.

    Attributes:
        K: stiffness, shape (n, n).
        C: damping; None where there is none.
        M: mass.
        W: kept modes, shape (n, modes).
        MW: mass at the centre of the box times W.
        interface: rows of the contact elements.
        loads: unit loads, shape (n, loads).
        rows: blocks of contact rows.
        coupled: whether the kept modes couple with what they leave out.
    """

    K: sp.csr_matrix
    C: sp.csr_matrix | None
    M: sp.csr_matrix
    W: Array
    MW: Array
    interface: dict[str, sp.csr_matrix]
    loads: Array
    rows: Rows
    coupled: bool

    def at(self, s: complex) -> AnyArray:
        """[O; W'P] S [I', P W, F] at lambda = s, O the rows that contact forces follow.

        Returns:
            Shape (followed rows + kept modes, acting rows + kept modes + loads); without rows and
            columns of the kept modes where these are not coupled.

        Raises:
            InaccurateResult: P has no factor, or is definite neither at kappa = -s^2 < 0 nor at
                the shift: an eigenvalue in between belongs to a kept mode.
        """
        # P is real for a real s, and an undamped one on the imaginary axis.
        s = s if np.imag(s) else np.real(s)
        square = np.real(s**2) if self.C is None else s**2
        P = (self.K + square * self.M).tocsr()
        P = P if self.C is None else (P + s * self.C).tocsr()
        acting = sp.vstack([self.interface[name] for name in self.rows.acting]).tocsr()
        if not (acting.shape[0] or self.coupled):
            return np.zeros((0, self.loads.shape[1]))
        factor = _Factor(P, acting)
        try:
            if not np.imag(s) and factor.negative_pivots and not self._definite():
                raise InaccurateResult(INDEFINITE)
            return self._seen(P, factor, acting)
        finally:
            factor.destroy()

    def _definite(self) -> bool:
        """Whether the stiffness and mass are definite at the shift of the reduced model."""
        factor = Factor((self.K + SIGMA * self.M).tocsr(), "brake_residual_")
        negative = factor.negative_pivots
        factor.destroy()
        return not negative

    def _seen(self, P: sp.csr_matrix, factor: "_Factor", acting: sp.csr_matrix) -> AnyArray:
        """The same from a factor of P."""
        m, c = self.W.shape[1], self.interface["N"].shape[0]
        starts = c * np.array([self.rows.acting.index(name) for name in self.rows.followed])
        followed = (starts[:, None] + np.arange(c)).ravel()
        if self.coupled:
            X = factor.solve(np.hstack([self.MW, self.loads]))
        else:
            # P W = M W diag(d). Next to an eigenvalue the factor has its own d, which cancels.
            d = np.einsum("ij,ij->j", self.W, P @ self.W)
            near = np.flatnonzero(np.abs(d) < NEAR)
            solved = factor.solve(np.hstack([self.MW[:, near], self.loads]))
            X = np.hstack([self.W / d, solved[:, near.size :]])
            X[:, near] = solved[:, : near.size]
        seen, held = acting @ X, self.MW.T @ X
        met = seen[:, :m].T if factor.symmetric else factor.solve(self.MW, True).T @ acting.T
        H = np.linalg.inv(held[:, :m])
        L = H @ np.hstack([met, held[:, m:]])
        D = np.hstack([factor.flexibility[followed], seen[followed, m:]]) - seen[followed, :m] @ L
        if not self.coupled:
            return D
        PW, r = P @ self.W, len(acting.indptr) - 1
        source = acting[followed] @ self.W - seen[followed, :m] @ H
        lead = np.hstack([(acting @ self.W).T, self.W.T @ self.loads]) - L
        kept = self.W.T @ PW - H
        return np.block([[D[:, :r], source, D[:, r:]], [lead[:, :r], kept, lead[:, r:]]])


class _Factor:
    """Factor of a real or complex P; a complex one by the real form of twice the size.

    (A + i B)(x + i y) = f is [A, -B; -B, -A] [x; y] = [f; 0], symmetric where A and B are, or else
    [A, -B; B, A] [x; y] = [f; 0].

    Attributes:
        flexibility: B P^-1 B' of rows B of an interface, shape (rows, rows).
        symmetric: whether P is symmetric.
    """

    def __init__(self, P: sp.csr_matrix, rows: sp.csr_matrix):
        """Factor P.

        Raises:
            InaccurateResult: P has no factor.
        """
        self._n, self.symmetric = P.shape[0], is_symmetric(P)
        self._real = not np.iscomplexobj(P)
        if self._real:
            self._factor = InterfaceFactor(P, rows, self.symmetric)
            self.flexibility: AnyArray = self._factor.flexibility
            return
        A, B, sign = P.real, P.imag, -1.0 if self.symmetric else 1.0
        whole = sp.bmat([[A, -B], [sign * B, sign * A]], format="csr")
        self._factor = InterfaceFactor(whole, sp.block_diag([rows, rows]).tocsr(), self.symmetric)
        G, r = self._factor.flexibility, rows.shape[0]
        self.flexibility = G[:r, :r] + 1j * G[r:, :r]

    def solve(self, b: Array, transpose: bool = False) -> AnyArray:
        """P^-1 b of a real block, or P^-T b."""
        if self._real:
            return self._factor.solve(b, transpose)
        x = self._factor.solve(np.vstack([b, np.zeros_like(b)]), transpose)
        # The transpose of the real form is that of the conjugate transpose.
        turned = -1j if transpose and not self.symmetric else 1j
        return np.asarray(x[: self._n] + turned * x[self._n :])

    @property
    def negative_pivots(self) -> int:
        """Negative eigenvalues of a real symmetric P."""
        return self._factor.negative_pivots * (self._real and self.symmetric)

    def destroy(self) -> None:
        """Free the factor."""
        self._factor.destroy()


class Complement:
    """Inverse of P_0 on the displacements that are M-orthogonal to the kept modes."""

    def __init__(self, P0: sp.csr_matrix, M: sp.csr_matrix, W: Array):
        """Factor P_0.

        Args:
            P0: P_0 or its transpose, shape (n, n).
            M: mass [kg].
            W: M-orthonormal kept modes, shape (n, m).

        Raises:
            InaccurateResult: a symmetric P_0 is not positive definite.
        """
        symmetric = is_symmetric(P0)
        self.factor = Factor(P0, "brake_residual_", symmetric=symmetric)
        if symmetric and self.factor.negative_pivots:
            self.factor.destroy()
            raise InaccurateResult(INDEFINITE)
        self._W, self._MW = W, np.asfortranarray(M @ W)
        self._Y = self.factor.solve(self._MW)
        self._small = np.linalg.inv(self._MW.T @ self._Y) if W.shape[1] else np.zeros((0, 0))

    def solve(self, b: Array) -> Array:
        """S_0 b of a block of right-hand sides, shape (n, columns)."""
        x = self.factor.solve(plus(np.array(b, order="F"), self._MW, self._W.T @ b, -1.0))
        return plus(x, self._Y, self._small @ (self._MW.T @ x), -1.0)

"""One substructure of the reduced model: kept modes, what they see of the rest, polynomials of it.

The kept modes W are those of the centre of the parameter box alone, below a cutoff. With I the rows
that contact forces act along, F loads, and

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

If K(p) >= r K(0), the theorem of Courant and Fischer places every pole of the complement S(w; p)
beyond r cutoff^2, for every p: the coefficients D_n(p) of what is left out in powers of w fall
geometrically and are smooth functions of p, and no mode below that limit can be missed anywhere in
the box, by one inertia count at the centre. Where the shape of a body changes, its rigid motions
do, and there is no such r: the lowest pole is computed at the corners of the box of the shapes
(``reduction``). W'P(w; p)W is affine and exact; D_n(p) is interpolated, with a degree that falls
with n. v stays orthogonal to W in the mass of the centre. In the brake each reduced body is itself,
or a mirror image of another one.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index
from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.macro.solver import Factor, InterfaceFactor, interface_factor

from ..eigensolvers.eigenpairs import plus
from ..eigensolvers.symmetric import is_symmetric
from .contact_rows import SIGMA, Rows, shifted_polynomial
from .parameters import CONSTANT, InterpolatedCoefficients, Parameters, Powers
from .polynomials import Polynomial
from .substructure import (
    SAME_ENTRY,
    MatrixSums,
    MirrorImage,
    Substructure,
    mirror_image,
    turned_across,
)

# What the names of a body's arrays begin with.
BODY = "body"

# What the names of the arrays begin with by which its kept modes couple, see ``coupling``.
COUPLING = "coupling."

# Distance of an eigenvalue in kappa below which its kept mode is solved for.
NEAR = 5e-3

INDEFINITE = (
    "the stiffness of a body is not positive definite somewhere in the box of the random"
    " materials: narrow their distributions"
)


@dataclass(frozen=True, slots=True)
class AtPoint:
    """A substructure at a point of the box.

    Attributes:
        modal: W'P_n W, in units of the band's end, shape (2 or 3, modes, modes).
        D: coefficients, each of shape (rows, columns).
        errors: estimates of the errors of D, see ``InterpolatedCoefficients.at``.
        growth: how much larger they may be at this point.
        followed: motions of the kept modes that forces follow, shape (followed rows, modes).
        acting: motions along which forces act, shape (acting rows, modes).
    """

    modal: Array
    D: Powers
    errors: list[NDArray[np.float32]]
    growth: float
    followed: Array
    acting: Array


class Component:
    """A substructure, reduced.

    Attributes:
        body: its matrices.
        W: M-orthonormal kept modes, shape (n, modes).
        kappa: their eigenvalues at the centre of the box [1/s^2].
        loads: loads on the kept modes [N], shape (loads, modes).
        coupled: whether D has rows and columns of the kept modes.
        missing: what the polynomials lack of D at the end of the band, real and imaginary parts,
            shape (1 or 2, rows, columns).
        reach: no pole of what is left out lies below it anywhere in the box, over the band's end.
    """

    def __init__(
        self, arrays: dict[str, AnyArray], rows: Rows, parameters: Parameters, omega: float
    ):
        """Take what the offline stage made.

        Args:
            arrays: see ``Reduction.arrays``; large ones may be mapped from a file.
            rows: blocks of its contact rows.
            parameters: of all bodies.
            omega: end of the band [rad/s].
        """
        self.body = body = Substructure.from_arrays(arrays)
        self.W, self.kappa, self.reach = arrays["W"], arrays["kappa"], float(arrays["reach"])
        self._beyond = arrays["beyond"]
        self.missing, self._polynomial = arrays["missing"], Polynomial(arrays["points"], rows)
        self.loads, self.coupled = body.loads.T @ self.W, bool(arrays["coupled"])
        self._rows, self._omega, self._parameters = rows, omega, parameters
        (self._K, self._M, *self._changes), self._C = arrays["modal"], arrays["modal_C"]
        self._own = parameters.acting_on(list(body.changes), body.elements.size)
        degrees = [int(degree) for degree in arrays["degrees"]]
        orders = [int(order) for order in arrays["orders"]]
        own = {n.removeprefix(COUPLING): a for n, a in arrays.items() if n.startswith(COUPLING)}
        self._coefficients = InterpolatedCoefficients(orders, degrees, arrays, bool(own))
        self._coupling = InterpolatedCoefficients(orders, degrees, own) if own else None
        self._still = self._motions(body.interface)

    def at(self, x: Array) -> AtPoint:
        """The substructure at a point of the box, shape (d,)."""
        rows = self.interface(x)
        motions = self._still if rows is self.body.interface else self._motions(rows)
        D, errors, growth = self._coefficients.at(own := self.own(x))
        if self._coupling is not None:
            # The errors at the checked points have those of the coupling already.
            kept, (step, *_), _ = self._coupling.at(own)
            places = coupling_places(self.body.elements.size, self._rows, self.W.shape[1])
            for n, A in enumerate(kept):
                D[n][places], errors[0][n][places] = A, step[n]
        return AtPoint(self._modal(x), D, errors, growth, *motions)

    def own(self, x: Array) -> Array:
        """Those of the coordinates of a point of the box that the body depends on."""
        return np.asarray(x[self._own])

    def growth(self, w: Complex) -> Array:
        """Error of the polynomials at some w over that at the end of the band."""
        return self._polynomial.growth(w, self.reach)

    @property
    def mass(self) -> sp.csr_matrix:
        """Mass at the centre of the box [kg], shape (n, n), in which W is orthonormal."""
        return self.body.mass(self._parameters.centre)

    def interface(self, x: Array) -> dict[str, sp.csr_matrix]:
        """Rows of its contact elements at a point of the box."""
        return interface_at(self.body, self._parameters, x)

    def _motions(self, rows: dict[str, sp.csr_matrix]) -> tuple[Array, Array]:
        """Motions of the kept modes that forces follow, and along which they act."""
        followed, acting = (
            np.vstack([rows[name] @ self.W for name in names])
            for names in (self._rows.followed, self._rows.acting)
        )
        return followed, acting

    def polynomial(self, x: Array) -> list[sp.csr_matrix]:
        """P_0, P_1, ... at a point of the box, at full order."""
        K, C, M = matrices(self.body, self._parameters, x, self._beyond, self.body.added)
        C = None if C is None else C / self._omega
        # SciPy copies a sparse matrix twice where it is divided.
        return shifted_polynomial(K * (1 / self._omega**2), C, M, self._rows)

    def _modal(self, x: Array) -> Array:
        """W'P_n W in units of the band's end."""
        c = self._parameters.coefficients(x)

        def changed(A: Array, row: int) -> Array:
            parts = zip(self.body.changes, self._changes, strict=True)
            return np.asarray(A + sum(c[row, j] * part for j, part in parts))

        K, M = changed(self._K, 0) / self._omega**2, changed(self._M, 2)
        C = changed(self._C[0], 1) / self._omega if len(self._C) else None
        return np.array(shifted_polynomial(K, C, M, self._rows))


def coupling_places(elements: int, rows: Rows, modes: int) -> tuple[slice, slice]:
    """Rows and columns of the kept modes in D of a body with so many contact elements."""
    first = elements * len(rows.followed), elements * len(rows.acting)
    return slice(first[0], first[0] + modes), slice(first[1], first[1] + modes)


def interface_at(
    body: Substructure, parameters: Parameters, x: Array, signs: Array | None = None
) -> dict[str, sp.csr_matrix]:
    """Rows of the contact elements of a body at a point of the box; its own where these stay.

    Args:
        body: the body.
        parameters: of all bodies.
        x: the point, shape (d,).
        signs: of a mirror image, displacement over that of the body, shape (dofs,).
    """
    if parameters.contact is None or not body.elements.size:
        return body.interface
    turn, out = sp.diags(np.ones(body.dofs.size) if signs is None else signs), {}
    for name, A in parameters.contact(x)[0].items():
        out[name] = (A[body.elements][:, body.dofs] @ turn).tocsr()
    # The direction across may be either of the two, see ``turned_across``.
    same = np.asarray(out["R"].multiply(body.interface["R"]).sum(axis=1)).ravel()
    out["R"] = (sp.diags(np.where(same < 0, -1.0, 1.0)) @ out["R"]).tocsr()
    return out


def matrices(
    body: Substructure,
    parameters: Parameters,
    x: Array,
    beyond: Array,
    added: Callable[[Array], sp.csr_matrix],
) -> tuple[sp.csr_matrix, sp.csr_matrix | None, sp.csr_matrix]:
    """K [N/m], C [N s/m] and M [kg] of a body at full order at a point of the box.

    Args:
        body: the body.
        parameters: of all bodies.
        x: the point, shape (d,).
        beyond: damping of what the kept modes leave out, see ``Substructure.damping_beyond``. It
            couples nothing with the kept modes, of the same M and the K of the centre of the box.
        added: the sum of ``Substructure.matrices`` times some factors, of ``Substructure`` or
            ``MatrixSums``.
    """
    c, own = parameters.coefficients(x), [*body.changes]
    K, M, C, *_ = np.eye(3 + len(own))
    K[3:], M[3:] = c[0, own], c[2, own]
    C[3:] = c[1, own]
    if body.C is None:
        if not beyond.any():
            return added(K), None, added(M)
        C[:] = 0.0
    C[:2] += beyond[[1, 0]]
    C[3:] += beyond[1] * parameters.centre[0, own]
    return added(K), added(C), added(M)


@dataclass(frozen=True, slots=True)
class Placed:
    """A reduced body in the brake: itself, or a mirror image of it.

    Attributes:
        component: the reduced body.
        elements: its contact elements among all.
        dofs: its free dofs among all.
        signs: displacement over that of the reduced body, shape (dofs,).
        modes: places of its kept modes among all.
    """

    component: Component
    elements: Index
    dofs: Index
    signs: Array
    modes: slice


def originals_and_images(
    substructures: Sequence[Substructure], parameters: Parameters = CONSTANT
) -> tuple[list[Substructure], dict[str, AnyArray]]:
    """Bodies that are reduced, and how all bodies follow from them.

    Args:
        substructures: the bodies of the brake.
        parameters: of all bodies: an image stays one wherever contact elements slide to.

    Returns:
        The originals; for ``placed`` the number of the original, the contact elements, dofs and
        signs of each body.
    """
    originals: list[Substructure] = []
    turned: list[Index] = []
    arrays: dict[str, AnyArray] = {}
    corners = parameters.corners(parameters.sliding)
    for number, body in enumerate(substructures):
        original, image = len(originals), MirrorImage(body, np.ones(body.dofs.size), False)
        for i, first in enumerate(originals):
            found = mirror_image(first, body)
            if found and all(_slide_alike(first, found, parameters, x) for x in corners):
                original, image = i, found
                turned += [found.body.elements] * found.across
                break
        else:
            originals.append(body)
        own = {"original": np.array(original), "signs": image.signs}
        own |= {"elements": image.body.elements, "dofs": image.body.dofs}
        arrays |= {f"{BODY}{number}.{name}": a for name, a in own.items()}
    if turned:
        originals = [turned_across(body, np.concatenate(turned)) for body in originals]
    return originals, arrays


def _slide_alike(body: Substructure, image: MirrorImage, parameters: Parameters, x: Array) -> bool:
    """Whether the rows of a mirror image at a point of the box are those of the body."""
    own = interface_at(body, parameters, x)
    other = interface_at(image.body, parameters, x, image.signs)
    return all(abs(A - other[n]).max() <= SAME_ENTRY * abs(A).max() for n, A in own.items())


def placed(
    groups: Mapping[str, dict[str, AnyArray]], rows: Rows, parameters: Parameters, omega: float
) -> list[Placed]:
    """The bodies of the brake, their kept modes one after the other.

    Args:
        groups: arrays of each original, by its number, and of ``originals_and_images``.
        rows: blocks of contact rows.
        parameters: of all bodies.
        omega: end of the band [rad/s].
    """
    components: dict[str, Component] = {}
    out, first = [], 0
    for number in range(sum(name.startswith(BODY) for name in groups)):
        own = groups[f"{BODY}{number}"]
        i = str(int(own["original"]))
        if i not in components:
            components[i] = Component(groups[i], rows, parameters, omega)
        modes = slice(first, first + components[i].W.shape[1])
        first = modes.stop
        out.append(Placed(components[i], own["elements"], own["dofs"], own["signs"], modes))
    return out


@dataclass(frozen=True, slots=True)
class Products:
    """What the kept modes W of a body make.

    Attributes:
        MW: mass at the centre of the box times them, shape (n, modes).
        K: W'K W of the stiffness, shape (modes, modes).
        M: W'M W of the mass, likewise.
    """

    MW: Array
    K: Array
    M: Array


@dataclass(frozen=True, slots=True)
class SeenBody:
    """A body and what sees it, at a point of the box.

    Attributes:
        K: stiffness, shape (n, n).
        C: damping; None where there is none.
        M: mass.
        W: kept modes, shape (n, modes).
        centre: mass at the centre of the box, in which they are orthonormal.
        interface: rows of the contact elements.
        loads: unit loads, shape (n, loads).
        rows: blocks of contact rows.
        kept: eigenvalues of the kept modes in units of the band's end, or what they make where
            they couple with what they leave out.
        omega: end of the band, in whose units lambda is.
        near: kept modes, the closest to each point, that its factor solves for at least. With the
            largest number wanted at any point all patterns are the same.
        factors: the last one, for others of the same pattern.
    """

    K: sp.csr_matrix
    C: sp.csr_matrix | None
    M: sp.csr_matrix
    W: Array
    centre: sp.csr_matrix
    interface: dict[str, sp.csr_matrix]
    loads: Array
    rows: Rows
    kept: Array | Products
    omega: float = 1.0
    near: int = 0
    factors: list[InterfaceFactor] = field(default_factory=list)

    @property
    def coupled(self) -> bool:
        """Whether the kept modes couple with what they leave out."""
        return isinstance(self.kept, Products)

    def at(self, s: complex, take: Callable[[Array], None] | None = None) -> AnyArray:
        """[O; W'P] S [I', P W, F] at lambda = s, O the rows that contact forces follow.

        Args:
            s: lambda in units of the band's end.
            take: called with S P W, shape (n, modes), where the kept modes are coupled.

        Returns:
            Shape (followed rows + kept modes, acting rows + kept modes + loads); without rows and
            columns of the kept modes where these are not coupled.

        Raises:
            InaccurateResult: P has no factor, or is definite neither at kappa = -s^2 < 0 nor at
                the shift: an eigenvalue in between belongs to a kept mode.
        """
        # P is real for a real s, and an undamped one on the imaginary axis.
        s = s if np.imag(s) else np.real(s)
        acting = sp.vstack([self.interface[name] for name in self.rows.acting]).tocsr()
        if not (acting.shape[0] or self.coupled):
            return np.zeros((0, self.loads.shape[1]))
        if not isinstance(self.kept, Products):
            return self._seen(s, acting, *self._on_modes(s, acting, self.kept + np.real(s**2)))
        symmetric, real = self.C is None or is_symmetric(self.C), self.C is None or not np.imag(s)
        factor = _Factor(partial(self.P, s), acting, symmetric, real, self.factors)
        self._check(s, factor.negative_pivots)
        MW = self.kept.MW
        X = factor.solve(np.hstack([MW, self.loads]))
        met = None if factor.symmetric else factor.solve(MW, True).T @ acting.T
        if take is not None:
            by_modes = X[:, : MW.shape[1]]
            take(self.W - by_modes @ np.linalg.inv(MW.T @ by_modes))
        return self._seen(s, acting, factor.flexibility, acting @ X, MW.T @ X, met)

    def destroy(self) -> None:
        """Free the last factor."""
        while self.factors:
            self.factors.pop().destroy()

    def P(self, s: complex) -> sp.csr_matrix:
        """P in units of the band's end. It is made again when it is wanted: it is large."""
        given = [self.K, self.M, *([] if self.C is None else [self.C])]
        factors = np.array([self.omega**-2, s**2, s / self.omega][: len(given)])
        return MatrixSums(given)(factors.real if self.C is None else factors)

    def _check(self, s: complex, negative: int) -> None:
        """Whether the stiffness and mass are definite at the shift of the reduced model.

        Raises:
            InaccurateResult: they are not; negative eigenvalues of a P below it are looked at.
        """
        if np.imag(s) or not negative:
            return
        shifted = self.K / self.omega**2 + SIGMA * self.M
        factor = Factor(shifted, "brake_residual_", solves=False)
        factor.destroy()
        if factor.negative_pivots:
            raise InaccurateResult(INDEFINITE)

    def _on_modes(self, s: complex, acting: sp.csr_matrix, d: Array) -> tuple[Array, Array, Array]:
        """Arguments of ``_seen`` where P W = M W diag(d), without a solve."""
        # Next to an eigenvalue the factor has its own d, which cancels.
        near = np.argsort(np.abs(d))[: max(self.near, near_modes(d))]
        r, m = acting.shape[0], d.size
        rest = sp.csr_matrix(np.vstack([(self.centre @ self.W[:, near]).T, self.loads.T]))
        wide = sp.vstack([acting, rest]).tocsr()
        factor = interface_factor(self.factors, partial(self.P, s), wide, solves=False)
        self._check(s, factor.negative_pivots)
        G, pushed = factor.flexibility, self.W.T @ self.loads
        places = np.r_[near, m : m + pushed.shape[1]]
        seen = np.hstack([acting @ self.W / d, np.zeros((r, pushed.shape[1]))])
        held = np.hstack([np.diag(1 / d), pushed / d[:, None]])
        seen[:, places] = G[:r, r:]
        held[np.ix_(near, places)] = G[r : r + near.size, r:]
        return G[:r, :r], seen, held

    def _seen(
        self, s: complex, acting: sp.csr_matrix, flexibility: AnyArray, seen: AnyArray,
        held: AnyArray, met: AnyArray | None = None,
    ) -> AnyArray:  # fmt: skip
        """All of it from I P^-1 I', I P^-1 [M W, F], W'M P^-1 [M W, F] and W'M P^-1 I'."""
        c, r, m = self.interface["N"].shape[0], acting.shape[0], self.W.shape[1]
        starts = c * np.array([self.rows.acting.index(name) for name in self.rows.followed])
        some = (starts[:, None] + np.arange(c)).ravel()
        H = np.linalg.inv(held[:, :m])
        L = H @ np.hstack([seen[:, :m].T if met is None else met, held[:, m:]])
        D = np.hstack([flexibility[some], seen[some, m:]]) - seen[some, :m] @ L
        if not isinstance(self.kept, Products):
            return np.asarray(D)
        source = acting[some] @ self.W - seen[some, :m] @ H
        lead = np.hstack([(acting @ self.W).T, self.W.T @ self.loads]) - L
        if self.C is None:
            kept = self.kept.K / self.omega**2 + np.real(s**2) * self.kept.M - H
        else:
            kept = self.W.T @ (self.P(s) @ self.W) - H
        return np.block([[D[:, :r], source, D[:, r:]], [lead[:, :r], kept, lead[:, r:]]])


def near_modes(d: Array) -> int:
    """Number of kept modes that are solved for at a point, by the distances of their kappa."""
    return int(np.sum(np.abs(d) < NEAR))


class _Factor:
    """Factor of a real or complex P; a complex one by the real form of twice the size.

    (A + i B)(x + i y) = f is [A, -B; -B, -A] [x; y] = [f; 0], symmetric where A and B are, or else
    [A, -B; B, A] [x; y] = [f; 0].

    Attributes:
        flexibility: B P^-1 B' of rows B of an interface, shape (rows, rows).
        symmetric: whether P is symmetric.
    """

    def __init__(
        self, P: Callable[[], sp.csr_matrix], rows: sp.csr_matrix, symmetric: bool, real: bool,
        factors: list[InterfaceFactor],
    ):  # fmt: skip
        """Factor P, which the function makes; see ``interface_factor``.

        Raises:
            InaccurateResult: P has no factor.
        """
        self._n, self.symmetric, self._real = rows.shape[1], symmetric, real
        if real:
            self._factor = interface_factor(factors, P, rows, symmetric)
            self.flexibility: AnyArray = self._factor.flexibility
            return

        def real_form() -> sp.csr_matrix:
            whole, sign = P(), -1.0 if symmetric else 1.0
            A, B = whole.real, whole.imag
            return sp.bmat([[A, -B], [sign * B, sign * A]], format="csr")

        both = sp.block_diag([rows, rows]).tocsr()
        self._factor = interface_factor(factors, real_form, both, symmetric)
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


class Complement:
    """Inverse of P_0 on the displacements that are M-orthogonal to the kept modes."""

    def __init__(self, P0: sp.csr_matrix, M: sp.csr_matrix, W: Array, coupled: bool = True):
        """Factor P_0.

        Args:
            P0: P_0 or its transpose, shape (n, n).
            M: mass [kg].
            W: M-orthonormal kept modes, shape (n, m).
            coupled: False says that they are modes of P_0.

        Raises:
            InaccurateResult: a symmetric P_0 is not positive definite.
        """
        symmetric = not coupled or is_symmetric(P0)
        self.factor = Factor(P0, "brake_residual_", symmetric=symmetric)
        if symmetric and self.factor.negative_pivots:
            self.factor.destroy()
            raise InaccurateResult(INDEFINITE)
        self._W, self._MW = W, np.asfortranarray(M @ W)
        self._Y = self.factor.solve(self._MW) if coupled else np.asfortranarray(W)
        self._small = np.linalg.inv(self._MW.T @ self._Y) if W.shape[1] else np.zeros((0, 0))

    def solve(self, b: Array) -> Array:
        """S_0 b of a block of right-hand sides, shape (n, columns)."""
        x = self.factor.solve(plus(np.array(b, order="F"), self._MW, self._W.T @ b, -1.0))
        return plus(x, self._Y, self._small @ (self._MW.T @ x), -1.0)

"""One substructure of the reduced model: kept modes, projected matrices, polynomials of the rest.

The kept modes W are those of the centre of the parameter box alone, below a cutoff. If
K(p) >= r K(0), the theorem of Courant and Fischer places every pole of the complement S(w; p)
beyond r cutoff^2, for every p: the coefficients D_n(p) of what is left out in powers of w fall
geometrically and are smooth functions of p, and no mode below that limit can be missed anywhere in
the box, by one inertia count at the centre. Where the shape of a body changes, its rigid motions
do, and there is no such r: the lowest pole is computed at the corners of the box of the shapes
(``reduction``). W'P(w; p)W is affine and exact; D_n(p) is interpolated, with a degree that falls
with n. v stays orthogonal to W in the mass of the centre.

The reduced bodies in the brake: each one itself, or a mirror image of another one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index

from .contact_rows import Rows, shifted_polynomial
from .parameters import CONSTANT, InterpolatedCoefficients, Parameters, Powers
from .polynomials import Polynomial
from .substructure import SAME_ENTRY, MirrorImage, Substructure, mirror_image, turned_across

# What the names of a body's arrays begin with.
BODY = "body"


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
        self._coefficients = InterpolatedCoefficients(orders, degrees, arrays)
        self._still = self._motions(body.interface)

    def at(self, x: Array) -> AtPoint:
        """The substructure at a point of the box, shape (d,)."""
        rows = self.interface(x)
        motions = self._still if rows is self.body.interface else self._motions(rows)
        return AtPoint(self._modal(x), *self._coefficients.at(x[self._own]), *motions)

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
        given = self.body, self._parameters, x, self._omega, self._beyond
        return shifted_polynomial(*matrices(*given), self._rows)

    def _modal(self, x: Array) -> Array:
        """W'P_n W in units of the band's end."""
        c = self._parameters.coefficients(x)

        def changed(A: Array, row: int) -> Array:
            parts = zip(self.body.changes, self._changes, strict=True)
            return np.asarray(A + sum(c[row, j] * part for j, part in parts))

        K, M = changed(self._K, 0) / self._omega**2, changed(self._M, 2)
        C = changed(self._C[0], 1) / self._omega if len(self._C) else None
        return np.array(shifted_polynomial(K, C, M, self._rows))


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
    body: Substructure, parameters: Parameters, x: Array, omega: float, beyond: Array
) -> tuple[sp.csr_matrix, sp.csr_matrix | None, sp.csr_matrix]:
    """K, C and M of a body at full order at a point of the box, in units of the band's end.

    Args:
        body: the body.
        parameters: of all bodies.
        x: the point, shape (d,).
        omega: end of the band [rad/s].
        beyond: damping of what the kept modes leave out, see ``Substructure.damping_beyond``. It
            couples nothing with the kept modes, of the same M and the K of the centre of the box.
    """
    c = parameters.coefficients(x)
    C = body.damping(c)
    if beyond.any():
        K = body.stiffness(parameters.centre)
        left_out = beyond[0] * body.M + beyond[1] * K
        C = left_out if C is None else C + left_out
    K = (body.stiffness(c) / omega**2).tocsr()
    return K, None if C is None else (C / omega).tocsr(), body.mass(c)


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

"""Eigenvalues of one sample, from the matrices that its contact and its bodies make.

With the kept coordinates a of all bodies, the gaps and slips y that contact forces follow, and
u = Lambda y, Lambda = 1 on gaps and lambda on slips, eliminating what the kept modes leave out
gives, exactly,

    own(w) a + forced(w) u = 0,            own = W'P W - D_XX,      forced = (W'I' - D_XI) J,
    y + (E(w) - 1) u = source(w) a,        E = 1 + D_OI J,          source = O W - D_OX,

w = kappa + sigma where bodies are not damped, also where contact forces follow rates: D has half as
many coefficients then. Without y and u it is T(z) a = 0. T is expanded in powers of z; its zeros
come from a companion matrix, and the two-sided Rayleigh quotient with all coefficients corrects
them (``sample``): b'T(z)a is evaluated with y and the left motions eta solved for, which makes its
error of second order (Schwetlick and Schreiber, Linear Algebra Appl. 436, 2012; Guettel and
Tisseur, Acta Numerica 26, 2017, doi:10.1017/S0962492917000034).

y + (E(w) - 1) u = source(w) a is solved power by power. With Lambda = Lambda_0 + z Lambda' the
coefficients of u are u_m = Lambda_0 y_m + Lambda' y_m-1, and

    (1 + (E_0 - 1) Lambda_0) y_m = source_m - (E_0 - 1) Lambda' y_m-1 - sum_n>0 E_n (w^n u)_m.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np
import scipy.linalg as la

from brake_fenicsx.arguments import AnyArray, Array, Complex
from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.iteration import remaining

from ..eigensolvers.eigenpairs import on_parts, times
from .contact_rows import SIGMA, Rows
from .polynomials import Coefficients, Zeros, applied, whole

# Steps at most of the motions y and eta.
STEPS = 8

# Groups of zeros, each with a point beside it, at this distance in z, where T is inverted.
GROUPS, BESIDE = 4, 0.1
# Stated of a group of zeros beside which T is singular: an error beyond the band.
UNKNOWN = 10.0

# Coefficients for the first step of eta.
FIRST = 3

# Round-off of matrices and eigenvalues in double precision, of the reduced model and of full order,
# in units of the band's end squared: a difference of 5.1e-10 was measured on the reference brake
# with hardness, 1.2e-10 on the demo with coarse cells, the same without single precision anywhere,
# which makes 4.5e-12 of it there. Stated is SAFETY times this number, with what estimates see.
ROUND_OFF = 5e-10

# Least power of z in T (two of lambda for each of kappa), the most, and the share of T_0 that the
# last one (two of lambda) may have at the end of the band. Measured against full order on a block,
# mu p / V from 0.03 to 0.9 times the impedance of the lining: the stated errors hold where this is
# settled, and are up to 16 times too small where it is not.
LEAST, MOST, SETTLED = {False: 2, True: 4}, 16, 1e-3


@dataclass(frozen=True, slots=True)
class Quotient:
    """What the two-sided quotient finds of some zeros of T, in z.

    Attributes:
        products: b_i' T(z_j) a_j of left vectors i and zeros j, shape (zeros, zeros); and those of
            the left vectors' conjugates.
        rest: T(z) a, shape (kept modes, zeros).
        slope: b' T'(z) a.
        unsolved: what y and eta, the vectors and the stored digits leave, over the slope.
        y: motions that contact forces follow, shape (followed rows, zeros).
        right: a of each zero.
        left: [eta; b], the motions of what is left out that are seen.
    """

    products: tuple[Complex, Complex]
    rest: Complex
    slope: Complex
    unsolved: Array
    y: Complex
    right: Complex
    left: Complex


class SampleProblem:
    """The problem of one sample.

    Attributes:
        E: coefficients of E(w).
        source: coefficients of source(w).
        forced: coefficients of forced(w).
        own: coefficients of own(w).
        rows: blocks of contact rows.
        gaps: gaps among the motions that contact forces follow; slips come after them.
        y: coefficients of y as a function of a, in powers of z.
        T: those of T(z), as many as it takes.
    """

    # Precision of the LU factor of 1 + (E_0 - 1) Lambda_0, and of T and its zeros.
    _precision: type = float

    def __init__(
        self, E: Sequence[Array], source: Coefficients, forced: Coefficients, own: Coefficients,
        rows: Rows,
    ):  # fmt: skip
        """Take the coefficients, and expand T.

        Args:
            E: see above.
            source: likewise.
            forced: likewise.
            own: likewise.
            rows: blocks of contact rows.

        Raises:
            InaccurateResult: the series of T does not settle.
        """
        self.E, self.source, self.forced, self.own = E, source, forced, own
        self.rows: Rows = rows
        self.gaps: int = rows.gaps(len(E[0]))
        self._lu: tuple[AnyArray, AnyArray] | None = None
        if len(E[0]):
            A: AnyArray = E[0].astype(self._precision)
            A[:, self.gaps :] *= rows.shift
            A[np.diag_indices(len(A))] += np.where(np.arange(len(A)) < self.gaps, 0, 1 - rows.shift)
            self._lu = la.lu_factor(A, overwrite_a=True, check_finite=False)
        self.y, self.T = self._expanded()

    def _expanded(self) -> tuple[Array, Array]:
        """Coefficients of y as a function of a, and of T."""
        E, rows = self.E, self.rows
        y: list[Array] = []
        u: list[Array] = []
        T: list[Array] = []
        sizes: list[float] = []
        gaps, rates = self.gaps, rows.rates
        end = float(np.hypot(1.0, rows.shift) if rates else 1.0 + SIGMA)
        # In powers of z; zeros of a truncated series need no more digits than its factor has.
        kind = self._precision
        source, own = _in_powers(self.source, rows, kind), _in_powers(self.own, rows, kind)
        forced: Coefficients = [A.astype(self._precision) for A in self.forced]
        powers = rows.powers(len(E))

        def times_u(A: Coefficients, m: int, first: int) -> Iterator[Array]:
            """A_n (w^n u)_m of n = first and those after it."""
            for n in range(first, min(m, len(A) - 1) + 1):
                terms = [k for k in range(n, m + 1) if k < len(powers) and powers[k, n]]
                x = sum(powers[k, n] * u[m - k] for k in terms)
                yield A[n] @ np.asarray(x, A[n].dtype)

        for m in range(MOST + 1):
            rhs = source[m] if m < len(source) else np.zeros_like(source[0])
            slips = y[-1][gaps:] if y else 0 * rhs[gaps:]
            rhs[gaps:] += slips
            rhs -= E[0][:, gaps:] @ slips
            for product in times_u(E, m, 1):
                rhs -= product
            y.append(self.solve(rhs))
            u.append(np.vstack([y[m][:gaps], rows.shift * y[m][gaps:] + slips]))
            T.append(own[m] if m < len(own) else np.zeros_like(own[0]))
            T[m] += sum(times_u(forced, m, 0))
            sizes.append(float(la.norm(T[m])) * end**m)
            if m >= LEAST[rates] and max(sizes[-2 if rates else -1 :]) <= SETTLED * sizes[0]:
                return np.array(y), np.array(T)
        raise InaccurateResult("""the motions of the contact are no short series in lambda: its
            forces that follow rates (damping of sliding mu p / V, or falling friction) are too
            strong for the reduced model; use stability.method = "full", or stability.on_tolerance =
            "full order" """)

    def quotient(self, found: Zeros) -> Quotient:
        """The two-sided quotient with all coefficients, for some zeros."""
        z, a, b = found.z, found.right, found.left
        w = self.rows.variable(z)
        source = [times(A, a) for A in self.source]
        y, last = applied(self.y, z, a), np.full(z.size, np.inf)
        forced = applied(self.forced, w, b, transpose=True)
        eta: Complex = self.solve(self.gaps_and_rates(z, forced), 1)
        # A step with few coefficients spares a whole one.
        seen = forced + self.left_response(z, eta, FIRST, self._precision)
        change: Complex = self.solve(self.gaps_and_rates(z, seen) - eta, 1)
        eta = eta + change
        step = la.norm(change, axis=0)
        for _ in range(STEPS):
            u = self.gaps_and_rates(z, y)
            moved = [-times(A, u) for A in self.E]
            for n, product in enumerate(source):
                moved[n] = moved[n] + product
            unsolved = u - y + np.sum([w**n * x for n, x in enumerate(moved)], axis=0)
            seen = forced + self.left_response(z, eta)
            change = self.solve(self.gaps_and_rates(z, seen) - eta, 1)
            eta = eta + change
            better = y + self.solve(unsolved)
            # eta gains by both steps what it gained by this one, y what it did.
            gained = np.abs(column_products(change, unsolved))
            before, step = np.maximum(step, 1e-300), la.norm(change, axis=0)
            left = remaining(gained, np.maximum(step / before, np.sqrt(gained / last)))
            if np.all(left <= ROUND_OFF):
                break
            y, last = better, np.maximum(gained, 1e-300)
        terms = rest_terms(self.own, self.forced, a, u)
        slope = self.slope(z, y, (b, eta, seen), moved, terms)
        slope = np.where(np.abs(slope) > 1e-300, slope, 1e-300)
        rest = np.sum([w**n * x for n, x in enumerate(terms)], axis=0)
        ends, missed = np.vstack([eta, b]), np.vstack([unsolved, rest])
        real, imag = (times(side.T.copy(), missed) for side in (ends.real, ends.imag))
        change = self.gaps_and_rates(z, better - y)
        rest, y = rest + applied(self.forced, w, change, kind=self._precision), better
        back = applied(self.own, w, b, True) + applied(self.source, w, eta, True)
        beside = BESIDE * (1.0 if self.rows.rates else 1j)
        left = left + _second_order(self.T, z, beside, rest, back) + _round_off(self.E, w, eta, u)
        products = real + 1j * imag, real - 1j * imag
        return Quotient(products, rest, slope, left / np.abs(slope), y, a, ends)

    def residual(self, found: Zeros) -> Complex:
        """T(z) a of some zeros, with y after one step from its series: all but its last digits."""
        z, a, w = found.z, found.right, self.rows.variable(found.z)
        y = applied(self.y, z, a)
        u = self.gaps_and_rates(z, y)
        y = y + self.solve(u - y + applied(self.source, w, a) - applied(self.E, w, u))
        return applied(self.own, w, a) + applied(self.forced, w, self.gaps_and_rates(z, y))

    def slope(
        self,
        z: Complex,
        y: Complex,
        left: tuple[Complex, Complex, Complex],
        moved: Sequence[Complex],
        rest: Sequence[Complex],
    ) -> Complex:
        """The slope b' T'(z) a of some vectors.

        Args:
            z: eigenvalues.
            y: motions that contact forces follow.
            left: b, eta and forced(w)'b + (1 - E(w))'eta.
            moved: coefficients of source(w) a - E(w) u.
            rest: those of own(w) a + forced(w) u.
        """
        (b, eta, seen), w = left, self.rows.variable(z)
        total = np.zeros(z.size, complex)
        for side, terms in ((eta, moved), (b, rest)):
            for n, term in enumerate(terms[1:], 1):
                total += n * w ** (n - 1) * column_products(side, term)
        # Lambda depends on z, too.
        rates = column_products(seen[self.gaps :], y[self.gaps :])
        return np.asarray(self.rows.slope(z) * total + rates)

    def gaps_and_rates(self, z: Complex, y: Complex) -> Complex:
        """Gaps, and rates of slips: u = Lambda y."""
        if self.gaps == len(y):
            return y
        return np.concatenate([y[: self.gaps], (z + self.rows.shift) * y[self.gaps :]])

    def left_response(
        self, z: Complex, eta: Complex, first: int | None = None, kind: type | None = None
    ) -> Complex:
        """(1 - E)' eta, shape (followed rows, zeros); with the first coefficients, all if None."""
        return eta - applied(self.E[:first], self.rows.variable(z), eta, True, kind)

    def solve(self, x: AnyArray, trans: int = 0) -> AnyArray:
        """Solve with 1 + (E_0 - 1) Lambda_0, the matrix of y at z = 0, or with its transpose."""
        if (lu := self._lu) is None:
            return x

        def real(x: Array) -> Array:
            x = x.astype(self._precision, copy=False)
            return np.asarray(la.lu_solve(lu, x, trans=trans, check_finite=False))

        return on_parts(real, x) if np.iscomplexobj(x) else real(x)


def _in_powers(A: Coefficients, rows: Rows, kind: type) -> Array:
    """Coefficients in powers of z of some in powers of w, in some precision."""
    return np.asarray(np.tensordot(rows.powers(len(A)), whole(A), 1), kind)


def rest_terms(own: Coefficients, forced: Coefficients, a: Complex, u: Complex) -> list[Complex]:
    """Coefficients of own(w) a + forced(w) u."""
    products = (times(A, a) for A in own), (times(A, u) for A in forced)
    return [np.asarray(x + y) for x, y in zip_longest(*products, fillvalue=0.0)]


def column_products(left: Complex, right: Complex) -> Complex:
    """Products of columns, not conjugated."""
    return np.asarray(np.einsum("im,im->m", left, right))


def _second_order(T: Array, z: Complex, beside: complex, rest: Complex, back: Complex) -> Array:
    """Size of l' T^-1 r of the residuals r = T(z) a and l = T(z)' b of each zero.

    The quotient is of second order in the errors of its vectors. T is taken next to the zeros,
    where it is regular in their directions as well: what zeros within ``BESIDE`` of each other add
    is too small here, and their products have it (``sample.corrected``, ``moved_by_others``), which
    miss what lies far off. Neither covers the other: errors of random samples were 1.14 times the
    stated ones without this estimate, and 31 times without those of the products.

    Args:
        T: coefficients of T(z), expanded.
        z: zeros.
        beside: from a group of zeros to where T is inverted.
        rest: r, shape (kept modes, zeros).
        back: l, likewise.
    """
    out = np.zeros(z.size)
    for group in np.array_split(np.argsort(np.abs(z), kind="stable"), GROUPS):
        if group.size:
            # An estimate: single precision will do.
            near = np.empty(T.shape[1:], np.complex64)
            powers = (z[group].mean() + beside) ** np.arange(len(T))
            for part, x in ((near.real, powers.real), (near.imag, powers.imag)):
                part[:] = np.tensordot(x.astype(T.dtype), T, 1)
            *_, x, singular = la.lapack.cgesv(near, rest[:, group].astype(np.complex64))
            found = np.abs(column_products(back[:, group], x.astype(complex)))
            out[group] = UNKNOWN if singular else found  # another zero lies just there
    return out


def _round_off(E: Sequence[AnyArray], w: Complex, eta: Complex, u: Complex) -> Array:
    """Size of eta' E u of the digits that the coefficients of E lack, independent ones."""
    total = np.zeros(w.size)
    for n, A in enumerate(E):
        if A.size:
            usual = float(np.linalg.norm(A)) / np.sqrt(A.size)
            total += np.finfo(A.dtype).eps * usual * np.abs(w) ** n
    return np.asarray(total * la.norm(eta, axis=0) * la.norm(u, axis=0))

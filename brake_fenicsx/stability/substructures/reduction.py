"""Offline stage of one substructure: kept modes, projected matrices, values at the anchors."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, eigsh

from brake_fenicsx.arguments import AnyArray, Array, Index
from brake_fenicsx.errors import InaccurateResult, NotConverged
from brake_fenicsx.folder.processes import in_turns, on_first
from brake_fenicsx.macro.solver import InterfaceFactor, blocks

from ..eigensolvers.symmetric import (
    RealModes,
    complete,
    count_below,
    factor_near,
    modes_not_counted,
)
from .component import (
    COUPLING,
    Complement,
    Products,
    SeenBody,
    coupling_places,
    interface_at,
    matrices,
    near_modes,
)
from .contact_rows import SIGMA, Rows
from .coupling import Coupling, wanted_coefficients
from .parameters import InterpolatedCoefficients, Parameters, coefficient_counts
from .polynomials import Polynomial, imaginary_points, real_points
from .sample_problem import ROUND_OFF
from .substructure import MatrixSums, Substructure

# The poles of what the kept modes leave out lie beyond this multiple of the square of the band's
# end, wherever in the box; with shapes beyond almost that, after some attempts, and never below
# the last multiple of the end itself.
POLES, ALMOST, NEAREST, ATTEMPTS = 3.3, 0.95, 1.3, 4

# The shift of Lanczos over the sum of the limits of the kept modes, -SIGMA and the square of the
# cutoff: amid them fewer vectors are needed than at an end. At an eigenvalue the round-off of that
# one hides all others, and the second is taken. Blocks are small: a body has at most six modes at
# zero.
AMID, BESIDE, BLOCK = 0.5, 0.499, 12

# With one level less, errors at the corners of a box exceed those that the checked points foresee:
# up to twice on two blocks with two moduli.
CAUTION = 3.0

# Least degree with fewer levels, and most responses that are held then, 4 bytes for each dof and
# kept mode: 99 of three parameters at the fifth degree.
LEAST, HELD = 4, 120

# Damping is a combination of mass and stiffness up to this share of it.
PROPORTIONAL = 1e-10

# Relative accuracy of the lowest pole.
POLE_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True)
class KeptModes:
    """Modes that a body keeps.

    Attributes:
        W: M-orthonormal modes of the centre of the box, shape (n, modes).
        kappa: their eigenvalues [1/s^2].
        cutoff: all modes below this multiple of the band's end.
        reach: no pole of what is left out lies below this multiple of the band's end anywhere in
            the box.
    """

    W: Array
    kappa: Array
    cutoff: float
    reach: float


@dataclass(frozen=True, slots=True)
class FactorPlan:
    """Where a body is factored.

    Attributes:
        coefficients: interpolated over the box.
        points: of the frequency, lambda in units of the band's end, at each point of the box:
            number -> shape (factors,), in the order of the work.
        shares: alpha and beta of its damping there, see ``proportional``.
        coupling: of the kept modes, where it takes more levels than all else.
        degrees: level of the interpolation of each coefficient, see ``Interpolation``.
        orders: degree of the first coefficient in each parameter of the body.
    """

    coefficients: InterpolatedCoefficients
    points: dict[int, AnyArray]
    shares: list[tuple[float, float] | None]
    coupling: Coupling | None
    degrees: Sequence[int]
    orders: Index

    @property
    def factors(self) -> int:
        """Number of factorisations."""
        return sum(len(points) for points in self.points.values())


class Reduction:
    """The offline stage of one body."""

    def __init__(
        self,
        body: Substructure,
        modes: KeptModes,
        rows: Rows,
        parameters: Parameters,
        terms: int,
        omega: float,
        comm: MPI.Comm,
        coarse: bool = False,
    ):
        """Plan it.

        Args:
            body: the body.
            modes: what it keeps.
            rows: blocks of its contact rows.
            parameters: of all bodies.
            terms: number of coefficients in powers of w.
            omega: end of the band [rad/s].
            comm: processes that share the work.
            coarse: whether fewer factors are enough for all but the coupling of the kept modes, as
                they are in rough contact without rates; of an undamped body of a constant shape.
        """
        self._body, self._W, self._kappa = body, modes.W, modes.kappa
        self._grams = [self._W.T @ (A @ self._W) for A in (body.K, body.M, *body.changes.values())]
        self._rows, self._parameters = rows, parameters
        self._reach = modes.reach
        self._omega, self._comm = omega, comm
        self._beyond = body.damping_beyond(modes.cutoff * omega)
        # One pattern at all points of the box: it is analysed once.
        self._sums = MatrixSums(body.matrices)
        self._own = parameters.acting_on(list(body.changes), body.elements.size)
        self._centre_shares = self._shares(np.zeros(self._own.size))
        self._coupled = bool(body.changes) or self._centre_shares is None
        same = not np.isin(self._own, [*parameters.shapes, *parameters.sliding]).any()
        able = same and self._coupled and not (rows.damped or rows.rates) and self._own.size > 0
        self._coarse = coarse and bool(able)
        self._X = coupling_places(body.elements.size, rows, modes.W.shape[1])
        self._centre = body.mass(parameters.centre)
        self._MW = self._centre @ modes.W if self._coupled else None
        # Of an undamped body the coefficients in powers of lambda are those in powers of kappa.
        count = terms // 2 if rows.damped else terms
        self._scaled: Array = np.asarray(modes.kappa / omega**2, dtype=float)
        self._real = real_points(count, self._scaled)
        self._near = max(near_modes(self._scaled - point) for point in self._real)
        points = imaginary_points(count, self._scaled) if rows.damped else self._real
        self._points = points
        self._polynomial = Polynomial(points, rows)

    def cost(self, degrees: Sequence[int], orders: Index) -> tuple[int, int]:
        """Points of the box where the body is factored, and about its factors; as ``plan``."""
        own = [int(n) for n in orders[self._own]]
        counts = coefficient_counts(own, degrees, self._is_coarse(own, degrees))
        factors = [len(self._frequencies(n, self._centre_shares)) for n in counts if n]
        return len(factors), sum(factors)

    def _is_coarse(self, orders: Sequence[int], degrees: Sequence[int]) -> bool:
        """Whether fewer factors are taken: not at low degrees, nor where memory would not do."""
        responses = sum(coefficient_counts(orders, degrees, True))
        return self._coarse and max(degrees) >= LEAST and responses <= HELD

    def plan(self, degrees: Sequence[int], orders: Index) -> FactorPlan:
        """Where the body is factored; collective.

        The softest anchor, where the poles of what is left out are the nearest, has all points of
        the frequency, so that it tells what the polynomials lack.

        Args:
            degrees: level of the interpolation of each coefficient, see ``Interpolation``.
            orders: degree of the first coefficient in each parameter, shape (d,).
        """
        own = [int(n) for n in orders[self._own]]
        coarse = self._is_coarse(own, degrees)
        placed = InterpolatedCoefficients(own, degrees, coarse=coarse)
        softness = [self._softness(placed.points[i]) for i in placed.order]
        softest = self._comm.bcast(placed.order[int(np.argmin(softness))])
        shares = [
            *in_turns(len(placed.points), lambda i: self._shares(placed.points[i]), self._comm)
        ]
        counts = {i: placed.counts[i] if i != softest else len(degrees) for i in placed.order}
        points = {i: self._frequencies(n, shares[i]) for i, n in counts.items()}
        coupling = self._coupling(degrees, own, points) if coarse else None
        return FactorPlan(placed, points, shares, coupling, degrees, orders[self._own])

    def _coupling(
        self, degrees: Sequence[int], orders: Sequence[int], points: Mapping[int, AnyArray]
    ) -> Coupling:
        """How the kept modes couple, by the factors of a plan."""
        fine = InterpolatedCoefficients(orders, degrees)
        # The weights in x~ are sums of coefficients that are much larger.
        coarse = InterpolatedCoefficients(orders, degrees, coarse=True, kind=np.float64)

        def through(s: AnyArray) -> Array:
            # The end of the band measures what polynomials lack.
            return self._w(s)[: self._polynomial.count]

        wanted = {i: through(self._frequencies(fine.counts[i], (0.0, 0.0))) for i in fine.order}
        factored = {i: through(s) for i, s in points.items()}
        return Coupling(fine, coarse, wanted, factored, self._polynomial, self._comm)

    def _w(self, s: AnyArray) -> Array:
        """Frequencies w of an undamped body at lambda, in units of the band's end."""
        return np.asarray(SIGMA - np.real(s**2))

    def _shares(self, own: Array) -> tuple[float, float] | None:
        """Alpha and beta of the damping at a point of the box, see ``proportional``."""
        if not self._rows.damped:
            return 0.0, 0.0
        return proportional(*self._matrices(self._at(own)))

    def _frequencies(self, count: int, shares: tuple[float, float] | None) -> AnyArray:
        """Lambda, in units of the band's end, of the factors that give so many coefficients.

        The first ones alone of an undamped body take as many: the others are interpolated. They are
        the lowest of those that are taken elsewhere: through these, all polynomials lack the same,
        and coefficients follow the materials. One parameter has few such points, and keeps all.
        """
        if shares is None:
            return self._points
        few = count < self._polynomial.count and not self._rows.damped and self._own.size > 1
        return np.sqrt(-self._real[: count if few else None] + 0j)

    def arrays(self, plan: FactorPlan, progress: Callable[[int], None]) -> dict[str, AnyArray]:
        """What ``Component`` takes, on the first process alone, nothing on others; collective.

        Args:
            plan: where the body is factored.
            progress: called with the number of factors that were made.

        Raises:
            InaccurateResult: the body has no positive definite stiffness somewhere in the box, or
                it is damped too strongly for polynomials in the frequency.
        """
        missing: Array = np.zeros(0)
        largest, failed, made = 0.0, list[Exception](), dict[str, AnyArray]()

        def succeeded() -> None:
            if failed:
                raise failed[0]

        for i, values in self._values(plan, progress, succeeded):
            try:
                rest = self._take(plan, i, values)
            except Exception as error:  # raised on all by the next factor of this process
                failed.append(error)
                continue
            largest = max(largest, float(np.linalg.norm(rest)))
            missing = rest if i == 0 else missing

        def finish(couplings: Sequence[Array]) -> None:
            # Elsewhere in the box the polynomials may lack more.
            lacking = missing * (largest / max(float(np.linalg.norm(missing)), 1e-300))
            made.update(self._made(plan, lacking, couplings))

        on_first(succeeded, self._comm)
        couplings: list[Array] = []
        if plan.coupling and self._MW is not None:
            couplings = plan.coupling.values(self._W, self._MW, self._P)
        on_first(lambda: finish(couplings), self._comm)
        return made

    def _take(self, plan: FactorPlan, i: int, values: list[AnyArray]) -> Array:
        """Take the values at a point; what polynomials lack there, nothing where no value tells."""
        interpolated = plan.coefficients
        if plan.coupling:
            plan.coupling.found(i, [value[self._X] for value in values])
        if not self._rows.damped and len(values) < self._polynomial.count:
            w = self._w(plan.points[i])
            few = wanted_coefficients(interpolated, i, w, values, self._polynomial)
            interpolated.add(i, few)
            return np.zeros(0)
        coefficients = np.empty((self._polynomial.count, *values[-1].shape))
        # Some rows at a time: no second copy of all values.
        for some in blocks(len(values[-1])):
            own = self._polynomial.coefficients([value[some] for value in values[:-1]])
            coefficients[:, some] = own
        rest = self._polynomial.missing(coefficients, values[-1])
        values.clear()
        if i == 0:
            self._check_convergence(coefficients, float(np.linalg.norm(rest)))
        interpolated.add(i, coefficients[: interpolated.counts[i]])
        return rest

    def _made(
        self, plan: FactorPlan, missing: Array, couplings: Sequence[Array]
    ) -> dict[str, AnyArray]:
        """What ``Component`` takes."""
        held = plan.coefficients.arrays()
        if plan.coupling:
            coupled = plan.coupling.arrays(couplings)
            for name in ("checks", "gain"):
                held[name] *= CAUTION
            # The coupling has all its levels, and estimates of its own.
            held["checks"][(..., *self._X)] = coupled["checks"]
            held |= {COUPLING + name: a for name, a in coupled.items()}
        held["D"] = held["D"].copy()  # or all coefficients would be held with it
        return {
            **self._body.arrays(), **held, "W": self._W, "kappa": self._kappa,
            "beyond": self._beyond, "coupled": np.array(self._coupled), "points": self._points,
            "missing": missing.astype(np.float32),
            "reach": np.array(self._reach),
            "degrees": np.array(plan.degrees), "orders": plan.orders,
            "modal": np.array(self._grams), "modal_C": np.array(self._modal_damping()),
        }  # fmt: skip

    def _modal_damping(self) -> list[Array]:
        """W'C W of a damped body."""
        body, W = self._body, self._W
        damping = [] if body.C is None else [W.T @ (body.C @ W)]
        if body.ratios:
            # C = M W diag(2 zeta omega) W'M couples nothing with what the modes leave out.
            by_ratio = np.diag(body.modal_damping(W, self._kappa))
            damping = [damping[0] + by_ratio] if damping else [by_ratio]
        return damping

    def _values(
        self, plan: FactorPlan, progress: Callable[[int], None], succeeded: Callable[[], None]
    ) -> Iterator[tuple[int, list[AnyArray]]]:
        """Number of each point of the box, and values there, on the first process; collective.

        The processes take the factors in turns.

        Args:
            plan: where the body is factored.
            progress: called with the number of factors that were made.
            succeeded: raises what failed with the values so far.
        """
        works = [(i, k) for i, points in plan.points.items() for k in range(len(points))]
        seen: dict[int, SeenBody] = {}

        def work(n: int) -> AnyArray:
            succeeded()
            i, k = works[n]
            if i not in seen:
                # The matrices of one point of the box at a time.
                factors = [f for body in seen.values() for f in body.factors]
                seen.clear()
                seen[i] = self._seen(plan.coefficients.points[i], plan.shares[i], factors)
            take = partial(plan.coupling.take, i, k) if plan.coupling else None
            found = seen[i].at(plan.points[i][k], take)
            progress(1)
            return found

        values: list[AnyArray] = []
        try:
            for n, value in enumerate(in_turns(len(works), work, self._comm)):
                i = works[n][0]
                if self._comm.rank > 0:
                    continue
                values.append(value)
                if len(values) < len(plan.points[i]):
                    continue
                shares = plan.shares[i]
                if shares is not None and self._rows.damped:
                    values = self._damped(values, shares[0] / self._omega, shares[1] * self._omega)
                yield i, values
                values = []
        finally:
            for body in seen.values():
                body.destroy()

    def _seen(
        self, own: Array, shares: tuple[float, float] | None, factors: list[InterfaceFactor]
    ) -> SeenBody:
        """The body at a point of the box."""
        x = self._at(own)
        K, C, M = self._matrices(x)
        interface = interface_at(self._body, self._parameters, x)
        kept = self._scaled if self._MW is None else Products(self._MW, *self._grams_at(x))
        given = interface, self._body.loads, self._rows, kept, self._omega, self._near, factors
        C = C if shares is None else None
        return SeenBody(K, C, M, self._W, self._centre, *given)

    def _P(self, own: Array, w: float) -> sp.csr_matrix:
        """P of an undamped body at a point of the box and w."""
        return self._seen(own, (0.0, 0.0), []).P(np.sqrt(SIGMA - w + 0j))

    def _at(self, own: Array) -> Array:
        """A point of the box of all parameters, at the centre but for those of the body."""
        x = np.zeros(self._parameters.dimension)
        x[self._own] = own
        return x

    def _softness(self, own: Array) -> float:
        """Trace of the stiffness of the kept modes over that of their mass, at a point."""
        K, M = (float(np.trace(gram)) for gram in self._grams_at(self._at(own)))
        return K / M if M else 0.0

    def _grams_at(self, x: Array) -> Array:
        """W'K W and W'M W at a point of the box of all parameters, shape (2, modes, modes)."""
        K, M, *changes = self._grams
        c = self._parameters.coefficients(x)[[0, 2]][:, list(self._body.changes)]
        changed = np.tensordot(c, np.reshape(changes, (c.shape[1], *K.shape)), 1)
        return np.asarray(np.stack([K, M]) + changed, float)

    def _damped(self, values: list[Array], alpha: float, beta: float) -> list[AnyArray]:
        """Values at the points in lambda of a body with C = alpha M + beta K from those in kappa.

        All in units of the band's end.

        P(lambda) = (1 + beta lambda) (K - kappa M) at a complex kappa.
        """
        out, f = [], self._body.elements.size * len(self._rows.followed)
        g = self._body.elements.size * len(self._rows.acting)
        X = slice(g, g + self._W.shape[1] * self._coupled)
        for n, s in enumerate(self._points):
            s = s if s.imag else s.real
            factor = 1 + beta * s
            kappa = -(s**2 + alpha * s) / factor
            # At the end of the band the value there is known, too.
            nodes = self._real[: len(values) - (n < len(self._points) - 1)]
            powers = np.vander(nodes, increasing=True), kappa ** np.arange(nodes.size)
            weights = np.linalg.solve(powers[0].T, powers[1])
            value = sum(w * A for w, A in zip(weights, values, strict=False))
            value = value if np.imag(s) else value.real
            value[:f] /= factor
            value[:f, X] *= factor
            value[f:, X] *= factor
            out.append(value)
        return out

    def _matrices(self, x: Array) -> tuple[sp.csr_matrix, sp.csr_matrix | None, sp.csr_matrix]:
        """K, C and M at a point of the box of all parameters."""
        return matrices(self._body, self._parameters, x, self._beyond, self._sums)

    def _check_convergence(self, coefficients: Array, missing: float) -> None:
        """Whether the coefficients fall, as they do without a pole within the band.

        Those of round-off do not: what the polynomial lacks at the end of the band tells.

        Raises:
            InaccurateResult: they do not: the body is damped so strongly that its own decay lies
                within the band.
        """
        size = [float(np.linalg.norm(A)) for A in coefficients]
        # W'P(w) is of second degree in w: the first ones may grow.
        if self._rows.damped and max(size[3:]) > max(size[:3]) and missing > ROUND_OFF:
            raise InaccurateResult("""damping too large for the frequency expansion of the reduced
                model up to the end of the band""")


def proportional(
    K: sp.csr_matrix, C: sp.csr_matrix | None, M: sp.csr_matrix
) -> tuple[float, float] | None:
    """Alpha and beta of a damping C = alpha M + beta K, both 0 without; None of any other one."""
    if C is None:
        return 0.0, 0.0
    x = np.random.default_rng(0).standard_normal(M.shape[0])
    columns = np.column_stack([M @ x, K @ x])
    scale = np.linalg.norm(columns, axis=0)
    alpha, beta = np.linalg.lstsq(columns / scale, C @ x, rcond=None)[0] / scale
    rest = abs(C - alpha * M - beta * K).max()
    return (float(alpha), float(beta)) if rest <= PROPORTIONAL * abs(C).max() else None


def kept_modes(
    body: Substructure, parameters: Parameters, omega: float, cutoff: float | None
) -> KeptModes:
    """Real modes of a body at the centre of the box, all of them below a cutoff.

    Args:
        body: the body.
        parameters: of all bodies.
        omega: end of the band [rad/s].
        cutoff: multiple of it; None: so that all poles of what is left out lie beyond ``POLES``.

    Raises:
        InaccurateResult: the stiffness is indefinite, an inertia count finds a mode missing, or
            the shape changes so much that poles stay close to the band.
    """
    softening = parameters.softening
    shaped = np.isin(parameters.acting_on(list(body.changes)), parameters.shapes).any()
    least = POLES / softening
    for _ in range(ATTEMPTS):
        kept = float(np.sqrt(least)) if cutoff is None else cutoff
        W, kappa = _modes_below(body, parameters, omega, kept)
        if not shaped:
            return KeptModes(W, kappa, kept, kept * float(np.sqrt(softening)))
        # Materials soften every shape alike; shapes are compared at the centre of the materials.
        pole = min(
            _lowest_pole(body, parameters, x, W, omega)
            for x in parameters.corners(parameters.shapes)
        )
        if cutoff is not None or softening * pole >= ALMOST * POLES:
            break
        least *= POLES / (softening * pole)
    reach = float(np.sqrt(softening * pole))
    if reach < NEAREST:
        raise InaccurateResult(f"""modes that are left out come down to {reach:.2f} times the end of
            the band where a length, a density or a mass changes: narrow its range, or raise
            stability.cutoff""")
    return KeptModes(W, kappa, kept, reach)


def _lowest_pole(
    body: Substructure, parameters: Parameters, x: Array, W: Array, omega: float
) -> float:
    """Least kappa of the body at a point of the box, held M-orthogonal to its kept modes.

    Args:
        body: the body.
        parameters: of all bodies.
        x: the point, shape (d,).
        W: kept modes, shape (n, modes).
        omega: end of the band [rad/s].

    Returns:
        Over the square of the band's end.
    """
    c = parameters.coefficients(x)
    K, M = body.stiffness(c) / omega**2, body.mass(c)
    complement = Complement((K + SIGMA * M).tocsr(), body.mass(parameters.centre), W)
    inverse = LinearOperator(
        K.shape, lambda b: complement.solve(b.reshape(-1, 1)).ravel(), dtype=float
    )
    start = inverse @ np.ones(K.shape[0])
    near = {"sigma": -SIGMA, "OPinv": inverse, "v0": start, "tol": POLE_TOLERANCE}
    (found,) = eigsh(K, 1, M, return_eigenvectors=False, **near)
    complement.factor.destroy()
    return float(found)


def _modes_below(
    body: Substructure, parameters: Parameters, omega: float, cutoff: float
) -> tuple[Array, Array]:
    """M-orthonormal modes at the centre, shape (n, modes), and their kappa [1/s^2]; as above."""
    centre, limit, lowest = parameters.centre, (cutoff * omega) ** 2, -SIGMA * omega**2
    K, M = body.stiffness(centre), body.mass(centre)
    # One factor at a time.
    counted = count_below(K, M, limit)

    def about(share: float) -> RealModes:
        factor, sigma = factor_near(K, M, share * (limit + lowest))
        try:
            return modes_not_counted(M, factor, sigma, counted[1], counted[0], block=BLOCK)
        finally:
            factor.destroy()

    try:
        found = about(AMID)
    except NotConverged:
        found = about(BESIDE)
    try:
        inside, _ = complete(K, M, found.kappa, counted)
        negative = found.kappa.min(initial=0.0) < lowest
    except InaccurateResult:
        if not (negative := count_below(K, M, lowest)[0] > 0):
            raise
    if negative:
        raise InaccurateResult("the stiffness of a body is not positive definite")
    return found.Phi[:, inside], found.kappa[inside]

"""The offline stage: the bodies of a brake, or its matrices, made into a reduced model.

Over a box of materials it knows the bodies at the anchors and at two points between them. With the
contact of a typical sample these give the errors of modes as the samples will state them. Where too
many exceed the tolerance, the parameters whose highest degree changes the modes most get more.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, log10
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index, frequency_band
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.log import logger
from brake_fenicsx.folder.processes import in_turns
from brake_fenicsx.macro.solver import whole

from ..modes import Modes, relative_errors
from . import component, reduced_model, sample, substructure
from .contact_rows import SIGMA, ContactLinearisation, Rows
from .parameters import BETWEEN, CONSTANT, Parameters
from .reduction import Reduction, kept_modes

# Relative error that five points in kappa reach, with degree 4 over a box of materials, and how
# much one degree and one point more gain: measured on two blocks in perfect contact, moduli +-20 %.
REACHED, GAIN = 1e-5, 12.0

# Share of the modes at the points asked whose errors may exceed the tolerance: of modes that nearly
# merge they do at any degree.
ALLOWED = 0.1

# What one degree more gains until it is known, the highest degree, and points of a body that are
# not exceeded. What gains less than the last number stagnates.
LEAST_GAIN, HIGHEST, MOST, STAGNANT = 5.0, 14, 150, 1.5

# The interpolation is not what makes errors of which it has less than this share.
ELSEWHERE = 0.01

# Modes below this share of the band, or of its square, count with it.
NEAR_ZERO = 1e-2

# What is left of a range that is said to hold, and of a tolerance that degrees aim at, for the
# scatter of errors; parameters that make this share of the largest part of them are narrowed
# together.
MARGIN, ALIKE = 0.7, 0.1


def reduce_bodies(
    substructures: Sequence[substructure.Substructure],
    w: ArrayLike,
    band: tuple[float, float],
    parameters: Parameters = CONSTANT,
    followed: str = "N",
    tolerance: float = 1e-5,
    cutoff: float | None = None,
    contact: ContactLinearisation | None = None,
    comm: MPI.Comm = MPI.COMM_SELF,
    progress: Callable[[int], Callable[[int], None]] = lambda total: lambda done: None,
    keep: Callable[[dict[str, AnyArray]], Mapping[str, AnyArray]] | None = None,
) -> reduced_model.ReducedModel:
    """Reduce the bodies of a brake; collective.

    Args:
        substructures: the bodies, see ``split_substructures``.
        w: areas of all contact elements [m^2], shape (elements,).
        band: lowest and highest frequency [Hz].
        parameters: box of the materials; constant ones by default.
        followed: motions whose rates or values contact forces follow: "N", with "T" (falling
            friction) and "R" (sliding damping) where they act.
        tolerance: wanted relative error of lambda; more points and higher degrees below 1e-5.
        cutoff: kept modes reach up to this frequency [Hz]; chosen from the softening of the box
            if None.
        contact: of a typical sample. Where estimated errors with it exceed the tolerance, the
            degree is raised and the work done again (``higher``); never if None.
        comm: processes that share the work.
        progress: called with the number of factors of this process; what it returns is called
            with the number of those that were done since.
        keep: called by all processes with what the first one made (nothing on others); what
            it returns is what each process works with. All get their own copy if None.

    Raises:
        SceneError: a band, cutoff or tolerance that is none.
        InaccurateResult: a body is not positive definite somewhere in the box, an inertia count
            finds a mode missing, a factor is wrong, or damping is too strong.
    """
    start, band = time.perf_counter(), frequency_band(band)
    if cutoff is not None and not cutoff > band[1]:
        raise SceneError(f"cutoff {cutoff:g} Hz must lie above the band's {band[1]:g} Hz")
    damped = any(body.C is not None or body.ratios for body in substructures)
    rows, omega = Rows(followed, damped), 2 * np.pi * band[1]
    degrees = _degrees(tolerance, rows)
    reach = None if cutoff is None else cutoff / band[1]
    bodies, images = component.originals_and_images(substructures, parameters)
    modes = [
        *in_turns(len(bodies), lambda i: kept_modes(bodies[i], parameters, omega, reach), comm)
    ]

    # Without a sample nothing tells whether it is enough.
    coarse = contact is not None
    reductions = [
        Reduction(body, kept, rows, parameters, len(degrees), omega, comm, coarse)
        for body, kept in zip(bodies, modes, strict=True)
    ]

    def cost(orders: Index) -> tuple[int, int]:
        each = (reduction.cost(_levels(degrees, orders), orders) for reduction in reductions)
        points, factors = zip(*each, strict=True)
        return max(points), sum(factors)

    def computed(orders: Index) -> dict[str, AnyArray]:
        arrays: dict[str, AnyArray] = {}
        plans = [reduction.plan(_levels(degrees, orders), orders) for reduction in reductions]
        advance = progress(ceil(sum(plan.factors for plan in plans) / comm.size))
        # The largest body takes most memory: it comes before the values of others are there.
        for i in sorted(range(len(bodies)), key=lambda i: -bodies[i].dofs.size):
            found = reductions[i].arrays(plans[i], advance)
            arrays |= {f"{i}.{name}": a for name, a in found.items()}
        if comm.rank > 0:
            return {}
        arrays |= {**images, "orders": orders, "followed": np.array(followed)}
        seconds = time.perf_counter() - start
        return {**arrays, "damped": np.array(damped), "seconds": np.array(seconds)}

    def made(orders: Index) -> reduced_model.ReducedModel:
        arrays = computed(orders)
        held = _on_all(arrays, comm) if keep is None else keep(arrays)
        return reduced_model.ReducedModel(held, w, band, parameters)

    model = made(np.full(parameters.dimension, degrees[0]))
    before: list[tuple[Index, Array]] = []
    while contact is not None:
        found = comm.bcast(higher(model, contact, tolerance, cost, before, comm))
        if found is None:
            break
        before.append((model.orders, found[1]))
        model = made(found[0])
    return model


def _degrees(tolerance: float, rows: Rows) -> tuple[int, ...]:
    """Degree of the interpolation of each coefficient in w; two of lambda for each of kappa."""
    if not 0 < tolerance < 1:
        raise SceneError(f"tolerance = {tolerance:g}: a relative error between 0 and 1 is needed")
    top = int(np.clip(4 + ceil(log10(REACHED / tolerance) / log10(GAIN) - 1e-9), 2, 8))
    # Measured: with one degree less for every two coefficients, these err about alike.
    if rows.damped:
        return tuple(max(1, top - (n + 3) // 4) for n in range(2 * top + 3))
    # Modes that grow as fast as they turn lie off the real axis of kappa.
    return tuple(max(1, top - (n + 1) // 2) for n in range(top + 1 + rows.rates))


def _levels(degrees: Sequence[int], orders: Index) -> list[int]:
    """These of ``_degrees`` where the first coefficient has other degrees, shape (d,)."""
    more = int(max(orders, default=degrees[0])) - degrees[0]
    return [degree + more for degree in degrees]


def _on_all(arrays: dict[str, AnyArray], comm: MPI.Comm) -> dict[str, AnyArray]:
    """Arrays of the first process on all of them; collective."""
    return {name: comm.bcast(arrays.get(name)) for name in comm.bcast(list(arrays))}


class Reduced:
    """Reduced model of an undamped brake of constant materials, from its matrices.

    Attributes:
        model: the model.
    """

    def __init__(
        self,
        K: Any,
        M: Any,
        N: sp.csr_matrix,
        T: sp.csr_matrix,
        w: ArrayLike,
        k0: ArrayLike,
        band: tuple[float, float],
        tolerance: float = 1e-5,
        comm: MPI.Comm = MPI.COMM_SELF,
    ):
        """Offline stage.

        Args:
            K: elastic stiffness without contact [N/m], SciPy sparse or PETSc, shape (dofs, dofs).
            M: mass [kg], likewise.
            N: gap operator, shape (elements, dofs).
            T: slip operator, likewise.
            w: areas of the contact elements [m^2], shape (elements,).
            k0: typical contact stiffness [Pa/m], positive; the model is as good for any other.
            band: lowest and highest frequency [Hz].
            tolerance: wanted relative error of lambda.
            comm: processes that share the work.

        Raises:
            SceneError: matrices of the wrong kind or shape, or an area that is not positive.
        """
        own, areas = whole(K), np.asarray(w, float)
        for name, A in (("N", N), ("T", T)):
            if not sp.issparse(A) or A.shape != (areas.size, own.shape[0]):
                raise SceneError(f"""{name}: a sparse matrix of shape ({areas.size}, {own.shape[0]})
                    is needed, one row for each contact element and one column for each dof""")
        for name, value in (("k0", np.asarray(k0, float)), ("w", areas)):
            if value.shape not in ((), areas.shape):
                raise SceneError(f"{name}: shape {value.shape}; give one value, or one per element")
            if not (np.all(np.isfinite(value)) and np.all(value > 0)):
                raise SceneError(f"{name} = {np.min(value):.3g}: positive finite values are needed")
        bodies = substructure.split_substructures(own, whole(M), {"N": N.tocsr(), "T": T.tocsr()})
        self.model: reduced_model.ReducedModel = reduce_bodies(
            bodies, areas, band, tolerance=tolerance, comm=comm
        )

    def modes(self, k: ArrayLike, mu: ArrayLike) -> Modes:
        """Complex modes of one sample in the band, see ``ReducedModel.modes``.

        Args:
            k: contact stiffness of each element [Pa/m], shape (elements,).
            mu: friction coefficient, one or one per element.
        """
        return self.model.modes([], ContactLinearisation.of(k, mu))

    def expand(self, s: Complex, a: Complex, k: ArrayLike, mu: ArrayLike) -> Complex:
        """Displacements of some modes of a sample, shape (dofs, chosen).

        Args:
            s: eigenvalues lambda [1/s], shape (chosen,).
            a: their columns of ``right``.
            k: contact stiffness of the sample [Pa/m].
            mu: its friction coefficient.
        """
        return self.model.displacements([], ContactLinearisation.of(k, mu), s, a)[0]


@dataclass(frozen=True, slots=True)
class Shortfall:
    """A tolerance that is not reached over a box.

    Attributes:
        missed: modes at the points asked whose estimated errors exceed it.
        modes: all of them.
        error: largest error of these over |lambda|.
        usual: error that ``ALLOWED`` of them exceed.
        each: what the highest degree in each parameter makes of them, shape (d,).
        wide: numbers of the parameters that make most of them.
        share: part of their ranges, about the centre, that should hold the tolerance.
    """

    missed: int
    modes: int
    error: float
    usual: float
    each: Array
    wide: Index
    share: float


def shortfall(
    model: reduced_model.ReducedModel,
    contact: ContactLinearisation,
    tolerance: float,
    comm: MPI.Comm = MPI.COMM_SELF,
) -> Shortfall | None:
    """What a model lacks; None where the tolerance holds at the points asked, or no range is why.

    Collective.

    Args:
        model: the model.
        contact: of a typical sample.
        tolerance: wanted relative error of lambda.
        comm: processes that share the work.
    """
    if not model.parameters.dimension:
        return None
    if model.asked is None or model.asked[0] is not contact:
        model.asked = contact, _errors(model, contact, comm)
    errors = model.asked[1]
    usual = float(np.quantile(errors, 1 - ALLOWED)) if errors.size else 0.0
    if usual <= tolerance:
        return None
    each, missed = _of_each_parameter(model, contact), int(np.sum(errors > tolerance))
    if not each.max() > ELSEWHERE * usual:
        return None
    wide = np.flatnonzero(each >= ALIKE * each.max())
    # An interpolation of degree n errs with the power n + 1 of a small width, less of a large one.
    share = MARGIN * (tolerance / usual) ** (1 / model.orders[wide].min())
    return Shortfall(missed, errors.size, float(errors.max()), usual, each, wide, share)


def higher(
    model: reduced_model.ReducedModel,
    contact: ContactLinearisation,
    tolerance: float,
    cost: Callable[[Index], tuple[int, int]],
    before: Sequence[tuple[Index, Array]] = (),
    comm: MPI.Comm = MPI.COMM_SELF,
) -> tuple[Index, Array] | None:
    """Degrees in each parameter with which the tolerance should hold; collective.

    Args:
        model: the model.
        contact: of a typical sample.
        tolerance: wanted relative error of lambda.
        cost: with some degrees, most points of the box where a body is factored, and factors.
        before: degrees of earlier models of the same range, shape (d,), and their errors: what
            each parameter makes, and all together, shape (d + 1,).
        comm: processes that share the work.

    Returns:
        The degrees and the errors of the model, likewise; None where the tolerance holds already,
        or higher degrees cost too much or gain nothing.
    """
    lacking, orders = shortfall(model, contact, tolerance, comm), model.orders
    if lacking is None:
        return None
    errors = np.append(lacking.each, lacking.usual)
    found = _foreseen(lacking, orders, tolerance, _gains(orders, errors, before), cost)
    factors, first = (cost(n)[1] for n in (found, before[0][0] if before else orders))
    said, again = f"no degree below {HIGHEST}, {MOST} points of a body, gains enough", False
    if np.any(found > orders):
        # A dearer model has to gain more in accuracy than it costs.
        again = factors <= first * lacking.usual / tolerance
        said = f"degree {found.max()}: {factors} factorisations, the first model {first}"
    names = np.array(model.parameters.names or range(orders.size), dtype=str)
    where = ", ".join(names[found > orders if again else lacking.wide])
    logger.info(
        "reduced model: 10 %% of the errors beyond %.1e (wanted: %.0e) over the range of %s; %s %s",
        lacking.usual, tolerance, where, "made again," if again else "left so,", said,
    )  # fmt: skip
    return (found, errors) if again else None


def _foreseen(
    lacking: Shortfall,
    orders: Index,
    tolerance: float,
    gains: Array,
    cost: Callable[[Index], tuple[int, int]],
) -> Index:
    """Degrees that are enough if each gains as it did, shape (d,); the same where none helps.

    Args:
        lacking: of the model.
        orders: its degrees, shape (d,).
        tolerance: wanted relative error of lambda.
        gains: see ``_gains``.
        cost: see ``higher``.
    """
    raised, left = gains[:-1] > 1, lacking.usual * lacking.each / lacking.each.sum()
    # What stagnates remains: beyond it, others need not fall.
    aim = max(MARGIN * tolerance, STAGNANT * float(left[~raised].sum()))
    found, most = orders.copy(), max(MOST, cost(orders)[0])
    while gains[-1] > 1 and left.sum() > aim and np.any(able := raised & (found < HIGHEST)):
        j = int(np.argmax(left * able))
        step = found + np.eye(orders.size, dtype=int)[j]
        if cost(step)[0] > most:
            break
        found, left[j] = step, left[j] / gains[j]
    return found if left.sum() * STAGNANT <= lacking.usual else orders


def _gains(orders: Index, errors: Array, before: Sequence[tuple[Index, Array]]) -> Array:
    """What one degree more gains in each parameter, and in any, shape (d + 1,); 1: it stagnates."""
    gains: Array = np.full(errors.size, LEAST_GAIN)
    for lower, earlier in before:
        ratio, steps = earlier / np.maximum(errors, 1e-300), orders - lower
        steps = np.maximum(np.append(steps, steps.max()), 1)
        found = np.where(ratio > STAGNANT, ratio ** (1 / steps), 1.0)
        # By two degrees: what is nearly even or odd in a parameter gains nothing by one.
        gains = np.where(steps > 1, found, gains)
    return gains


def _errors(
    model: reduced_model.ReducedModel, contact: ContactLinearisation, comm: MPI.Comm
) -> Array:
    """Estimated errors of modes over |lambda| at the centre, between anchors and at corners."""
    between = np.resize(BETWEEN, model.parameters.dimension)
    points = 0 * between, between, -between, np.sign(between), -np.sign(between)

    def errors(i: int) -> Array:
        modes = model.modes(points[i], contact)
        return relative_errors(modes.s, modes.error)

    every = np.concatenate([*in_turns(len(points), errors, comm)])
    return np.asarray(every[~np.isnan(every)])


def _of_each_parameter(model: reduced_model.ReducedModel, contact: ContactLinearisation) -> Array:
    """What the highest degree in each parameter makes of the stated errors, shape (d,)."""
    dimension = model.parameters.dimension
    # z is lambda or its square, but for a shift.
    rates, out = model.rows.rates, np.zeros(dimension)
    zero, factor = (-model.rows.shift, sample.SAFETY) if rates else (SIGMA, 0.5 * sample.SAFETY)
    for j in range(dimension):
        largest = [0.0]
        for side in (BETWEEN[0], -BETWEEN[0]):
            x = side * np.eye(dimension)[j]
            # The first estimate is the step from one degree lower: here other parameters add none.
            views = [replace(view, errors=view.errors[:1]) for view in model.at(x)]
            found, _, errors = model.quotient(model.sample(x, contact, views))
            largest += list(factor * errors / np.maximum(np.abs(found.z - zero), NEAR_ZERO))
        out[j] = np.quantile(largest, 1 - ALLOWED)
    return out

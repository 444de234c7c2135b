"""How the kept modes of a body couple through what they leave out, where it is not factored.

The modes W of the centre of a box of parameters are no modes elsewhere. What they lack there,

    x = S P W,        makes        W'P S P W = W'P x,

of second order in what changes, the slowest to converge of all that is interpolated, and by which
eigenvalues move the most. For any x~ that is M-orthogonal to W

    W'P x = W'P x~ + (W'P x~)' - x~'P x~ + (x - x~)'P (x - x~),

so that the first three terms err by the square of what x~ lacks (N. A. Pierce and M. B. Giles, SIAM
Review 42, 2000, doi:10.1137/S0036144598349423). With x~ interpolated between the points where the
body is factored, they need no factor. The round-off of x~ in single precision, made M-orthogonal
to W again, acts by its square too.
"""

from collections.abc import Callable, Mapping, Sequence

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import AnyArray, Array
from brake_fenicsx.folder.processes import in_turns
from brake_fenicsx.macro.solver import BlockProduct

from .parameters import InterpolatedCoefficients
from .polynomials import Polynomial, lowest_coefficients

# Numbers of a point of the box and of a frequency there.
Place = tuple[int, int]


class Coupling:
    """W'P S P W of a body over a box: from its factors where there are any, else by x~."""

    def __init__(
        self,
        fine: InterpolatedCoefficients,
        coarse: InterpolatedCoefficients,
        wanted: Mapping[int, Array],
        factored: Mapping[int, Array],
        polynomial: Polynomial,
        comm: MPI.Comm,
    ):
        """Plan how x~ follows from the x of the factors.

        Args:
            fine: takes W'P S P W, and interpolates it.
            coarse: takes the weights of each x in x~: through fewer of the same anchors.
            wanted: frequencies at the points of ``fine``: number -> w, shape (values,).
            factored: those where there is a factor, likewise.
            polynomial: in w.
            comm: the processes.
        """
        self._fine, self._coarse, self._polynomial, self._comm = fine, coarse, polynomial, comm
        self._wanted, self._factored = wanted, factored
        # W'P S P W of factors, and x: of those that this process made.
        self._known: dict[int, list[Array]] = {}
        self._responses: dict[Place, AnyArray] = {}
        anchors = [i for i in coarse.order if i < coarse.anchors]
        places = [(i, k) for i in anchors for k in range(factored[i].size)]
        self._numbers: dict[Place, int] = {place: n for n, place in enumerate(places)}
        units = np.eye(len(places))[:, None]
        for i in anchors:
            values = [units[self._numbers[i, k]] for k in range(factored[i].size)]
            coarse.add(i, wanted_coefficients(coarse, i, factored[i], values, polynomial))

    def take(self, i: int, k: int, x: Array) -> None:
        """Hold x of factor k at point i, shape (n, modes), on the process that has it."""
        if (i, k) in self._numbers:
            self._responses[i, k] = x.astype(np.float32)

    def found(self, i: int, values: Sequence[Array]) -> None:
        """Take W'P S P W of the factors at point i; on the first process."""
        self._known[i] = [np.array(value) for value in values]

    def values(
        self, W: Array, MW: Array, P: Callable[[Array, float], sp.csr_matrix]
    ) -> list[Array]:
        """W'P S P W by x~ where it is wanted and not known from a factor; collective.

        Args:
            W: kept modes, shape (n, modes).
            MW: mass times them, likewise.
            P: makes the matrix at a point of the box, shape (own parameters,), and w.

        Returns:
            Each of shape (modes, modes), on all processes.
        """
        held = np.empty((len(self._responses), W.size), np.float32)
        own = [*self._responses]
        for row, place in zip(held, own, strict=True):
            row[:] = self._responses.pop(place).ravel()
        numbers, size = [self._numbers[place] for place in own], self._comm.size
        points = [(self._fine.points[i], float(self._wanted[i][k])) for i, k in self._unknown]
        out: list[Array] = []
        for first in range(0, len(points), size):
            some = points[first : first + size]
            weights = np.array([self._weights(*point) for point in some], np.float32)
            x = self._summed(weights[:, numbers] @ held)

            def work(i: int, some: Sequence[tuple[Array, float]] = some, x: AnyArray = x) -> Array:
                return _by_response(P(*some[i]), W, MW, x)

            out += in_turns(len(some), work, self._comm)
        return out

    def arrays(self, values: Sequence[Array]) -> dict[str, AnyArray]:
        """What ``InterpolatedCoefficients`` takes, of these values; on the first process."""
        fine, found = self._fine, dict(zip(self._unknown, values, strict=True))
        for i in fine.order:
            w = self._wanted[i]
            known = self._known.get(i, [])[: w.size]
            known += [found[i, k] for k in range(len(known), w.size)]
            fine.add(i, wanted_coefficients(fine, i, w, known, self._polynomial))
        return fine.arrays()

    @property
    def _unknown(self) -> list[Place]:
        """Where W'P S P W is wanted and there is no factor."""
        factors = {i: w.size for i, w in self._factored.items()}
        wanted = ((i, self._wanted[i].size) for i in self._fine.order)
        return [(i, k) for i, count in wanted for k in range(factors.get(i, 0), count)]

    def _weights(self, own: Array, w: float) -> Array:
        """Weight of each x in x~ at a point of the box and w, shape (factors,)."""
        powers = self._coarse.interpolated(own)[0]
        return np.asarray(sum(w**n * D[0] for n, D in enumerate(powers)))

    def _summed(self, parts: AnyArray) -> AnyArray:
        """The sum over the processes of one row for each of them; its own one on each."""
        if self._comm.size == 1:
            return np.asarray(parts[0])
        found = np.empty_like(parts[0])
        for root, part in enumerate(parts):
            self._comm.Reduce(part, found if self._comm.rank == root else None, root=root)
        return found


def wanted_coefficients(
    placed: InterpolatedCoefficients,
    i: int,
    w: Array,
    values: Sequence[Array],
    polynomial: Polynomial,
) -> Array:
    """The coefficients that an interpolation wants at a point.

    Args:
        placed: the interpolation.
        i: number of the point.
        w: frequencies of the values, shape (values,).
        values: each of one shape.
        polynomial: through as many frequencies as it has coefficients. Where there are fewer
            values, the coefficients beyond are those of the anchors that come before.

    Returns:
        Shape (wanted, ...).
    """
    if len(values) < polynomial.count:
        return lowest_coefficients(w, values, placed.beyond(i))
    return polynomial.coefficients(values)[: placed.counts[i]]


def _by_response(P: sp.csr_matrix, W: Array, MW: Array, x: AnyArray) -> Array:
    """W'P S P W by x~, whose entries come in the order of those of W."""
    x = x.reshape(W.shape).astype(float)
    # What round-off adds along W would act to first order.
    x -= W @ (MW.T @ x)
    times = BlockProduct(P)
    try:
        product = times(x)
    finally:
        times.destroy()
    linear = W.T @ product
    return np.asarray(linear + linear.T - x.T @ product)

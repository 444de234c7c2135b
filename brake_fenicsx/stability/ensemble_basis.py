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

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .changing.anchors import Anchors
from .changing.bodies import split_bodies
from .changing.coordinates import Coordinates, in_spaces
from .changing.damped_together import Standing, check_reach, damped_basis, doubted, standing
from .changing.damped_view import damped_view
from .changing.offline import Reach, see_bodies
from .changing.own_bodies import Whole
from .changing.proportion import Damping
from .changing.refiner import Refiner
from .changing.shifts import Changes, damped_shifts, undamped_shifts
from .changing.springs import on_springs
from .changing.together import Together
from .changing.view import View
from .modes import Complex, Modes
from .reduced.damped_basis import DampedBasis
from .reduced.damped_pairs import sample_modes
from .reduced.damped_sample import DampedSample
from .reduced.sample import Sample
from .reduced.sample_errors import DOUBT
from .reduced.sample_pairs import undamped_modes

Array = NDArray[np.float64]
Index = NDArray[np.intp]

# So many contact elements show how far the series in lambda reaches.
SOME = 200

# Total degree of the interpolation between the anchors.
DEGREE = 4


class EnsembleBasis:
    """Modes and compliance of any sample of stiffnesses, contact and friction.

    Attributes:
        bodies: the bodies and how they are seen.
        coordinates: those of the samples' vectors.
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
        damping: Damping | None = None,
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
            damping: of the samples; None without.

        Raises:
            InaccurateResult: a body has no positive definite stiffness somewhere in the box, an
                inertia count finds a missing mode, or a body is damped as no model of it can take.
        """
        start = time.perf_counter()
        comm = MPI.COMM_SELF if comm is None else comm
        reach = Reach(2 * np.pi * band[1])
        self.band, self.w, self.sigma, self.limit = band, w, reach.sigma, reach.limit
        self.names = "N" if damping is None else damping.names
        across = damping.R if damping is not None and damping.across else None
        C = None if damping is None else damping.C
        bodies = split_bodies(K, M, N, T, loads, list(parts), C, across)
        box = Anchors(dimension, degree), coefficients, len(parts)
        self.bodies, self.damping = see_bodies(bodies, damping, box, reach, comm, progress, known)
        self.coordinates = Coordinates(self.bodies)
        self._refiner = Refiner(self.bodies, self.sigma)
        self._together = Together(self.bodies, w, self.sigma, self.limit + self.sigma)
        if damping is not None:
            some = np.unique(np.linspace(0, w.size - 1, min(SOME, w.size)).astype(int))
            check_reach(self._damped(np.zeros(dimension), some)[0], band)
        self.seconds = time.perf_counter() - start

    def modes(
        self,
        x: Array,
        k: Array,
        mu: float | Array,
        tolerance: float = 1e-6,
        whole: Callable[[], Whole] | None = None,
        doubt: Changes | None = None,
    ) -> Modes:
        """Complex modes of one sample in the band.

        Args:
            x: its stiffness, a point of the box.
            k: contact stiffness of each element [Pa/m], shape (elements,).
            mu: friction coefficient, one or one per element.
            tolerance: relative error of lambda; modes estimated beyond it are refined on the full
                problem, and ``iterations`` says how many.
            whole: the sample at full order; nothing is refined without.
            doubt: errors of what acts at its contact, which are part of each mode's.

        Returns:
            The modes; ``right`` and ``left`` in ``coordinates``.
        """
        start = time.perf_counter()
        views, together = self._look(x), self._together
        k = k[together.order]
        mu = np.broadcast_to(np.asarray(mu, float), k.shape)[together.order]
        # Open elements show nothing; of a brake whose every element is open one is looked at.
        closed = np.flatnonzero(k > 0) if np.any(k > 0) else np.zeros(1, dtype=np.intp)
        basis, rest = together.basis(views, closed), together.doubt(closed)
        poles = self._pole_doubt([v.Lambda for v in views])
        sample = Sample(basis, k[closed], mu[closed], self.sigma, rest, poles)
        shapes, rows = [v.shapes for v in views], together.order[closed]

        steps = None if whole is None else self._refiner.undamped(sample, shapes, rows, whole)
        found = undamped_modes(sample, self.band, start, tolerance, refined=steps)
        if doubt is not None:
            shifts = undamped_shifts(sample, found, doubt, rows)
            found = replace(found, error=found.error + shifts)
        return in_spaces(found, shapes, "det T")

    def damped_modes(
        self,
        x: Array,
        k: Array,
        mu: float | Array,
        along: Array,
        across: Array,
        zeta_max: float,
        tolerance: float = 1e-6,
        whole: Callable[[], Whole] | None = None,
        doubt: Changes | None = None,
    ) -> Modes:
        """Damped complex modes of one sample in the band.

        Args:
            x: its stiffness, a point of the box.
            k: contact stiffness of each element [Pa/m], shape (elements,).
            mu: friction coefficient, one or one per element.
            along: p mu'(V) of each element [Pa s/m].
            across: mu p / V of each element [Pa s/m].
            zeta_max: decaying modes up to this damping ratio are looked for.
            tolerance: as in ``modes``.
            whole: as in ``modes``.
            doubt: as in ``modes``.

        Returns:
            As ``modes``.

        Raises:
            InaccurateResult: the count differs, or the series in lambda does not reach the band's
                end.
        """
        start = time.perf_counter()
        mu = np.broadcast_to(np.asarray(mu, float), k.shape)
        moved = (k > 0) | (along != 0) | (across != 0)
        # Those of a changing body side by side.
        order = self._together.order
        closed = order[moved[order]] if np.any(moved) else order[:1]
        basis, at, shapes, poles = self._damped(x, closed)
        check_reach(basis, self.band)
        sample = DampedSample(basis, k[closed], mu[closed], along[closed], across[closed])
        doubts = [body.every_doubt for body in self.bodies]

        def inner(s: Complex, a: Complex, b: Complex, condition: Array) -> Array:
            bodies = list(zip(doubts, self.damping, at, strict=True))
            return doubted(sample, (s, a, b, condition), bodies, poles)

        steps = None if whole is None else self._refiner.damped(sample, shapes, closed, whole)
        found = sample_modes(sample, self.band, zeta_max, start, tolerance, steps, inner)
        if doubt is not None:
            shifts = damped_shifts(sample, found, doubt, closed)
            found = replace(found, error=found.error + shifts)
        return in_spaces(found, shapes, "det T(lambda)")

    def compliance(self, x: Array, k0: Array) -> tuple[Array, Array, Array]:
        """N K0^-1 N', N K0^-1 T' and N K0^-1 f of the bodies on springs k0, K0 = K + N'W k0 N.

        Args:
            x: a point of the box.
            k0: reference stiffness [Pa/m], shape (elements,), positive.

        Returns:
            Shapes (elements, elements) twice, (elements, loads).
        """
        together = self._together
        D0 = together.w * k0[together.order]
        NN, NT, Nf = on_springs(together.resting(self._look(x)), D0)
        place = together.place
        if not np.array_equal(place, np.arange(place.size)):
            NN, NT = (A[np.ix_(place, place)] for A in (NN, NT))
        return NN, NT, Nf[place]

    def compliance_doubt(self, normal: Array, along: Array, loads: Array) -> Array:
        """Typical errors of the gaps of the bodies under given forces.

        Args:
            normal: forces on the gaps of the elements [N], shape (elements,).
            along: forces on their slips.
            loads: multiples of the unit loads.

        Returns:
            In m, one for each body and point that checks its interpolation, shape (errors,
            elements).
        """
        out = []
        for body in self.bodies:
            own = body.body.elements
            force = np.r_[normal[own], along[own], loads]
            for errors in body.doubt:
                gaps = np.zeros_like(normal)
                gaps[own] = DOUBT * (errors[0] @ force)
                out.append(gaps)
        return np.array(out).reshape(-1, normal.size)

    def _damped(
        self, x: Array, closed: Index
    ) -> tuple[DampedBasis, list[Standing], list[Array], Array]:
        """Damped basis of a sample, where its closed elements stand, the bodies' modes, doubts."""
        bodies = [body.expansion(x) for body in self.bodies]
        at = standing([body.body.elements for body in self.bodies], closed, self.w.size)
        # One after the other: each is as large as the whole may be.
        views = (
            damped_view(b, how, self.sigma, self.names, s.here)
            for b, how, s in zip(bodies, self.damping, at, strict=True)
        )
        kept = [b.kept for b in bodies]
        basis = damped_basis(views, kept, at, self.w[closed], self.names, self.sigma, self.limit)
        poles = self._pole_doubt([b.Lambda[: b.kept] for b in bodies])
        return basis, at, [b.Q[:, : b.kept] for b in bodies], poles

    def _pole_doubt(self, Lambda: list[Array]) -> Array:
        """Typical errors of the bodies' own eigenvalues [1/s^2]."""
        pairs = zip(self.bodies, Lambda, strict=True)
        return np.concatenate([body.pole_doubt(values) for body, values in pairs])

    def _look(self, x: Array) -> list[View]:
        """The bodies at a point."""
        return [body.view(x) for body in self.bodies]

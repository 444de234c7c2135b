"""Reduced model of a brake: undamped or damped, of constant materials or over a box of them.

Offline, each substructure gives its kept modes and polynomials of what they leave out
(``offline``). A sample then needs dense matrices alone: contact and friction enter exactly
(``sample``), every eigenvalue has an estimated error, and no mode is missed, because
an inertia count proves the kept modes complete and no pole of what is left out lies in the band.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index, Mask
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.processes import release_memory

from ..eigensolvers.eigenpairs import with_conjugates
from ..modes import Count, Modes, damped_rows, undamped_rows
from . import vectors
from .component import AtPoint, Component, Placed, placed
from .contact_rows import SIGMA, ContactLinearisation, Rows
from .parameters import CONSTANT, Parameters
from .polynomials import Zeros, zeros
from .sample import (
    FREE,
    AtRest,
    BlockMatrix,
    Chosen,
    Corrected,
    Sample,
    assembled,
    corrected,
    moved_by_others,
    static_compliance,
)
from .sample_problem import Quotient

# Zeros are corrected up to this multiple of the band's end: at the reference brake those of the
# truncated series are off by less than 1e-4. Modes of the band that grow strongly lie further out:
# they are listed up to this multiple of |lambda|.
SEARCHED, LISTED = 1.1, 1.3
# Zeros of growing modes are corrected together with those that move them by more, in units of the
# band's end squared, and with those nearer than this share of their size.
ALONE, NARROW = 1e-10, 2e-4
# Where more than this share of the elements is closed, all are taken as closed.
MOST = 0.9

COUNTED = Count(
    "proven",
    f"zeros of T(z), |lambda| up to {LISTED} times the band's end, on modes of the bodies complete"
    " by inertia",
)


class ReducedModel:
    """Complex modes and static compliance of any sample of a brake, dense and fast.

    Attributes:
        bodies: the reduced bodies and their mirror images.
        band: lowest and highest frequency [Hz].
        omega: end of the band [rad/s].
        rows: blocks of contact rows, and whether anything depends on a rate.
        parameters: those that the materials depend on.
        orders: degree of the interpolation in each of them, shape (d,).
        held: static compliances that are held, at so many points of the box.
        asked: contact of a typical sample, and the errors over the box with it, see ``shortfall``.
        seconds: time of the offline stage [s].
    """

    def __init__(
        self,
        arrays: Mapping[str, AnyArray],
        w: ArrayLike,
        band: tuple[float, float],
        parameters: Parameters = CONSTANT,
    ):
        """Take what an offline stage made, with its arguments; see ``offline``.

        Args:
            arrays: what it gave to ``keep``; large ones may be mapped from a file, so that the
                processes of a machine hold them once.
            w: areas of all contact elements [m^2], shape (elements,).
            band: lowest and highest frequency [Hz].
            parameters: box of the materials.
        """
        self.band: tuple[float, float] = band
        self.parameters: Parameters = parameters
        self.orders: Index = arrays["orders"]
        self.seconds: float = float(arrays["seconds"])
        self._w, self.omega = np.asarray(w, float), 2 * np.pi * band[1]
        self.rows: Rows = Rows(str(arrays["followed"]), bool(arrays["damped"]))
        groups: dict[str, dict[str, AnyArray]] = {}
        for name, values in arrays.items():
            owner, dot, inner = name.partition(".")
            if dot:
                groups.setdefault(owner, {})[inner] = values
        self.bodies: list[Placed] = placed(groups, self.rows, parameters, self.omega)
        self._latest: tuple[Array, dict[int, AtPoint]] | None = None
        # Of constant materials, or a few of them, all samples share the compliance.
        self._rest: dict[bytes, tuple[Array, Array, Array]] = {}
        self.held: int = 1
        self.asked: tuple[ContactLinearisation, Array] | None = None
        # Bodies at rest, each at the last point of its own parameters.
        self._at_last_point: dict[Component, tuple[bytes, AtRest]] = {}
        self._kept: tuple[Array, BlockMatrix] | None = None

    @staticmethod
    def offline(*given: Any, **named: Any) -> "ReducedModel":
        """Reduce the bodies of a brake and take the model; see ``reduce_bodies``."""
        from .offline import reduce_bodies

        return reduce_bodies(*given, **named)

    def at(self, p: ArrayLike) -> list[AtPoint]:
        """The bodies at a point of the box [-1, 1]^d; mirror images share theirs."""
        x = np.asarray(p, float)
        if self._latest is None or not np.array_equal(self._latest[0], x):
            # Equilibrium and modes of a sample, and all samples of constant materials, share it.
            self._latest = x, {id(c): c.at(x) for c in self._originals}
        seen = self._latest[1]
        return [seen[id(body.component)] for body in self.bodies]

    def modes(
        self,
        p: ArrayLike,
        contact: ContactLinearisation,
        zeta_max: float = 0.1,
        growing: bool = False,
    ) -> Modes:
        """Complex modes of one sample in the band.

        Args:
            p: its materials, a point of the box, shape (d,); empty for constant ones.
            contact: what acts in its contact elements.
            zeta_max: where something is damped, decaying modes are returned up to this damping
                ratio.
            growing: whether those that grow or may grow are enough.

        Returns:
            The modes; ``right`` and ``left`` in the coordinates of the kept modes of all bodies.
            ``residual`` is twice the stated error over condition and |lambda|, or the band's end,
            and 2 at most, where lambda is less than its error.

        Raises:
            SceneError: a number of contact elements other than the model's.
        """
        start = time.perf_counter()
        found = corrected(*self.quotient(self.sample(p, contact), growing))
        return self.listed_modes(found, zeta_max, start)

    def zeros(self, p: ArrayLike, contact: ContactLinearisation) -> Complex:
        """Eigenvalues lambda [1/s] near the band, conjugates included, shape (zeros,)."""
        z = corrected(*self.quotient(self.sample(p, contact))).zeros.z
        return self.omega * self._lam(np.r_[z, z[z.imag > 0].conj()])

    def static(self, p: ArrayLike, k0: Array) -> tuple[Array, Array, Array]:
        """Compliance of the bodies at the contact elements, with free coordinates.

        Args:
            p: a point of the box.
            k0: typical stiffness of the contact elements [Pa/m], shape (elements,), positive.

        Returns:
            NN, NT and one column of Nf for each load, see ``macro.equilibrium.Compliance``.
        """
        x = np.asarray(p, float)
        if (key := x.tobytes() + k0.tobytes()) not in self._rest:
            free, stiffness = self.flexibilities == 0, self.areas(p) * k0
            if len(self._rest) >= self.held:
                self._rest.popitem()
            given = self._at_rest(x, free), free, stiffness
            self._rest[key] = static_compliance(self.bodies, *given)
            if not self.parameters.dimension:
                self._at_last_point.clear()
        return self._rest[key]

    def _at_rest(self, x: Array, free: Mask) -> list[AtRest]:
        """The bodies at rest at a point of the box; each at its last point is kept."""
        for body, view in zip(self.bodies, self.at(x), strict=True):
            component = body.component
            own = component.own(x).tobytes()
            if self._at_last_point.get(component, (None,))[0] != own:
                part = AtRest.of(component, view, free[body.modes], self.rows, self.omega)
                self._at_last_point[component] = own, part
        return [self._at_last_point[body.component][1] for body in self.bodies]

    def displacements(
        self,
        p: ArrayLike,
        contact: ContactLinearisation,
        s: Complex,
        a: Complex,
        left: bool = False,
    ) -> tuple[Complex, Array]:
        """Displacements of some modes of a sample, with all that the kept modes leave out.

        Args:
            p: a point of the box.
            contact: what acts in the contact elements of the sample.
            s: eigenvalues lambda [1/s], shape (chosen,).
            a: their coordinates, columns of ``right``, shape (kept modes, chosen).
            left: whether these are columns of ``left``, and left vectors are wanted.

        Returns:
            The displacements, shape (dofs, chosen), and their estimated relative errors, shape
            (chosen,).
        """
        return self.displacements_of_samples([(p, contact, s, a)], left)[0]

    def displacements_of_samples(
        self,
        modes: Sequence[tuple[ArrayLike, ContactLinearisation, Complex, Complex]],
        left: bool = False,
        comm: MPI.Comm = MPI.COMM_SELF,
        aside: int = 0,
        loads: Array | None = None,
    ) -> list[tuple[Complex, Array]]:
        """Displacements of modes of several samples, each matrix factored once; collective.

        Args:
            modes: of each sample p, contact, s and a as for ``displacements``.
            left: likewise.
            comm: processes that share the work.
            aside: of these, the first so many do other work.
            loads: of bodies of constant materials at rest, in equilibrium [N], shape (dofs,
                columns). Their displacements [m], without free motions, come last.
        """
        chosen, rest = [], None
        if loads is not None:
            push = self.coordinates(sp.identity(len(loads), format="csr"), loads)
            moved = self.flexibilities[:, None] * push
            z = self.scaled(np.zeros(loads.shape[1], complex))
            rest = self.bodies, z, np.asarray(loads / self.omega**2), np.asarray(moved)
        for p, contact, s, a in modes:
            chosen.append((self.sample(p, contact), self.scaled(s), a.conj() if left else a))
            release_memory()
        found = vectors.mode_displacements(chosen, self.rows, left, comm, aside, rest)
        return [(u.conj() if left else u, error) for u, error in found]

    def motions(
        self, p: ArrayLike, contact: ContactLinearisation, s: Complex, right: Complex, left: Complex
    ) -> tuple[vectors.ContactMotions, Complex, Complex]:
        """Motions of some modes of a sample at all contact elements.

        Args:
            p: a point of the box.
            contact: what acts in the contact elements of the sample.
            s: eigenvalues lambda [1/s], shape (chosen,).
            right: their coordinates, columns of ``right``, shape (kept modes, chosen).
            left: likewise.

        Returns:
            The motions, under the right vectors of the rows that forces follow, with their errors;
            and the coordinates made sharper: those of ``modes`` are vectors of a truncated series.
        """
        sample, z = self.sample(p, contact), self.scaled(s)
        v, error = vectors.sharpened(sample, z, right, left.conj())
        seen, met = vectors.motions_of_elements(sample, self.rows, self._w.size, z, v)
        slope = vectors.slopes(sample, z, v) * (self.omega if self.rows.rates else -2 * s)
        return vectors.ContactMotions(s, slope, seen, met, error), v.a, v.b.conj()

    def scaled(self, s: Complex) -> Complex:
        """Z of lambda = s [1/s], in units of the model."""
        scaled = s / self.omega
        return scaled - self.rows.shift if self.rows.rates else SIGMA - scaled**2

    def coordinates(self, A: sp.csr_matrix, u: AnyArray | None = None) -> AnyArray:
        """U'A u of the kept modes U of all bodies, or U'A U.

        Args:
            A: symmetric matrix that does not couple the bodies, such as the mass of a layer, shape
                (dofs, dofs).
            u: displacements, shape (dofs, columns); U itself if None.
        """
        size = int(self.bodies[-1].modes.stop)
        if u is not None:
            out = np.zeros((size, u.shape[1]), u.dtype)
            Au = A @ u
            for body in self.bodies:
                part = Au[body.dofs]
                out[body.modes] = body.component.W.T @ (body.signs[:, None] * part)
            return out
        grams = np.zeros((size, size))
        for body in self.bodies:
            inner = A[body.dofs][:, body.dofs].tocsr()
            if inner.nnz:
                U = body.signs[:, None] * body.component.W
                grams[body.modes, body.modes] = U.T @ (inner @ U)
        return grams

    def kept_displacements(self, a: AnyArray) -> AnyArray:
        """Displacements U a of the kept modes of all bodies alone.

        Args:
            a: coordinates, columns of ``right``, shape (kept modes, columns).

        Returns:
            Shape (dofs, columns).
        """
        out = np.zeros((sum(b.dofs.size for b in self.bodies), a.shape[1]), a.dtype)
        for body in self.bodies:
            out[body.dofs] = body.signs[:, None] * (body.component.W @ a[body.modes])
        return out

    @property
    def flexibilities(self) -> Array:
        """1/kappa of the kept modes [s^2], 0 of those that move freely, shape (kept modes,)."""
        kappa = np.concatenate([body.component.kappa for body in self.bodies])
        return 1 / np.where(kappa <= (FREE * self.omega) ** 2, np.inf, kappa)

    @property
    def pole(self) -> float:
        """Least modulus |w|, anywhere in the box, of a pole of what the kept modes leave out."""
        reach, rows = min(body.component.reach for body in self.bodies), self.rows
        return float(np.hypot(reach, rows.shift) if rows.damped else reach**2 + SIGMA)

    @property
    def complete_up_to(self) -> float:
        """Frequency below which no mode of a body is missing anywhere in the box [Hz]."""
        return float(min(body.component.reach for body in self.bodies) * self.band[1])

    @property
    def _originals(self) -> list[Component]:
        """Reduced bodies, each once."""
        return list({id(b.component): b.component for b in self.bodies}.values())

    def sample(
        self, p: ArrayLike, contact: ContactLinearisation, views: list[AtPoint] | None = None
    ) -> Sample:
        """The reduced problem of a sample; arguments as for ``modes``, bodies other than ``at``."""
        if contact.k.shape != self._w.shape:
            raise SceneError(f"""k: {contact.k.size} values for {self._w.size} contact elements of
                the model""")
        x, views = np.asarray(p, float), self.at(p) if views is None else views
        # One open element in place of none: its force is zero. There may be no element at all.
        elements, n = contact.closed, self._w.size
        elements = elements if elements.size else np.arange(min(1, n))
        nearly_all = elements.size > MOST * n
        elements = np.arange(n) if nearly_all else elements
        closed = Chosen.of(self.bodies, elements, n)
        given = self.bodies, views, self.rows, closed
        b = self.blocks(x, keep=True) if nearly_all else assembled(*given)
        own = contact.scaled(self.areas(x), elements, self.omega)
        return Sample(self.bodies, x, views, own, self.rows, closed, b)

    def quotient(self, sample: Sample, growing: bool = False) -> tuple[Zeros, Quotient, Array]:
        """Zeros in the band or a little beyond, their quotients, and errors of the polynomials.

        Args:
            sample: the problem.
            growing: whether zeros of modes that grow or may grow are enough, and others that would
                move these.
        """
        found = zeros(sample.T, 2 if self.rows.rates else 1, *self.searched)
        some: Index = np.arange(found.z.size)
        if growing:
            s, size = self._lam(found.z), np.maximum(np.abs(found.z), SIGMA)
            close = np.abs(found.z[:, None] - found.z) < NARROW * size[:, None]
            grows = s.real > (-NARROW * np.abs(s) if self.rows.rates else 0.0)
            # Of undamped modes, two that are close to one another may be a growing pair.
            pairs = (close.sum(axis=1) > 1) & (not self.rows.rates)
            some = np.flatnonzero(close @ (grows | pairs))

            def with_movers(some: Index, rest: Complex) -> Index:
                moved = moved_by_others(found, some, rest, sample.T)[:, grows[some]]
                return np.union1d(some, np.flatnonzero(moved.sum(axis=1) > ALONE))

            # A residual of few digits tells nearly all of them, and spares a second quotient.
            some = with_movers(some, sample.residual(found.taken(some)))
        q = sample.quotient(found.taken(some))
        if growing and (more := with_movers(some, q.rest)).size > some.size:
            some, q = more, sample.quotient(found.taken(more))
        found = found.taken(some)
        return found, q, sample.polynomial_errors(found.z, q)

    def _lam(self, z: Complex) -> Complex:
        """Lambda of some zeros, in units of the band's end."""
        return np.asarray(z + self.rows.shift if self.rows.rates else np.sqrt(SIGMA - z + 0j))

    def blocks(self, p: ArrayLike, keep: bool = False) -> BlockMatrix:
        """The bodies seen from all contact elements at a point of the box.

        Args:
            p: the point, shape (d,).
            keep: whether the matrix will be asked for again; the latest of these is kept.
        """
        x = np.asarray(p, float)
        if self._kept is not None and np.array_equal(self._kept[0], x):
            return self._kept[1]
        every = Chosen.of(self.bodies, np.arange(self._w.size), self._w.size)
        found = assembled(self.bodies, self.at(x), self.rows, every)
        self._kept = (x, found) if keep else self._kept
        return found

    def areas(self, p: ArrayLike) -> Array:
        """Areas of the contact elements at a point of the box [m^2]."""
        contact = self.parameters.contact
        return self._w if contact is None else contact(np.asarray(p, float))[1]

    @property
    def searched(self) -> tuple[float, Callable[[Complex], Index]]:
        """Reach of the search in z, and which zeros lie in the band or a little beyond.

        Of each conjugate pair one.
        """
        rates = self.rows.rates
        reach = LISTED + abs(self.rows.shift) if rates else LISTED**2 + SIGMA

        def near(z: Complex) -> Index:
            s = self._lam(z)
            size = np.where(np.abs(s.imag) <= SEARCHED, np.abs(s), np.inf)
            size = np.where(np.abs(s) <= SEARCHED, 0.0, size)
            return np.flatnonzero((size <= LISTED) & (z.imag >= 0))

        return reach, near

    def listed_modes(
        self, found: Corrected, zeta_max: float, start: float, counting: Count = COUNTED
    ) -> Modes:
        """Modes of the band from corrected zeros.

        Args:
            found: the zeros.
            zeta_max: see ``modes``.
            start: when the work began, by ``time.perf_counter`` [s].
            counting: how they were counted.
        """
        omega, z, slope, error = self.omega, found.zeros.z, found.slope, found.error
        right, left = found.zeros.right, found.zeros.left.conj()
        if self.rows.rates:
            s = omega * (z + self.rows.shift)
            condition = np.maximum(2 * np.abs(s) / omega / slope, 1.0)
            spread = omega * error
            order, lam = damped_rows(s, right, spread, (2 * np.pi * self.band[0], omega), zeta_max)
            sort = np.lexsort((lam.real, lam.imag))
            order, lam = order[sort], lam[sort]
            spread, real = spread[order], np.zeros(order.size, dtype=bool)
        else:
            kappa = omega**2 * (z - SIGMA)
            # Both of a pair are rows: lambda grows, -conj(lambda) decays.
            both = np.r_[np.arange(kappa.size), np.flatnonzero(kappa.imag)]
            kappa, right = with_conjugates(kappa, right)
            left = with_conjugates(kappa[: left.shape[1]], left)[1]
            condition = np.maximum(1 / slope, 1.0)[both]
            order, lam, spread, real = undamped_rows(kappa, omega**2 * error[both], self.band)
        condition = condition[order]
        # Of rigid modes, which are less than their errors, relative to the larger of these and the
        # band's end.
        size = np.where(np.abs(lam) > spread, np.abs(lam), np.maximum(spread, omega))
        return Modes(
            lam, right[:, order], left[:, order], 2 * spread / condition / size, spread, condition,
            replace(counting, expected=lam.size), time.perf_counter() - start, real,
        )  # fmt: skip

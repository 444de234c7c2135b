"""Laws of pressure over separation, p(d): what a law is, and a library of computed ones.

A computed law interpolates ln p over d by monotone cubics through the solved steps with their
exact slopes. Beyond the first step towards separation stands a quadratic foot, so that p and p'
vanish together at first touch; beyond the last step the law goes on as a straight line. The
stiffness of small vibrations, which the modes read, is interpolated by itself (``vibration.py``).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from brake_fenicsx.arguments import Array, Index, Ints, positive, quantity
from brake_fenicsx.display import html_table
from brake_fenicsx.errors import SceneError

DIFFERENCE = 1e-10  # half a step of central differences over the separation [m]


class LawSteps(NamedTuple):
    """Solved points of a law, from light to heavy load; arrays of one shape (steps,).

    Attributes:
        d: separations [m], falling.
        p: pressures [Pa], rising.
        k: stiffnesses of loading -dp/dd [Pa/m].
        v: stiffnesses of small vibrations [Pa/m]; None where they are those of loading.
        slope: dv/dd of the smooth curve through them [Pa/m^2], negative or zero; None without v.
        area: share of the patch that touches [-]; None where it is not known.
    """

    d: Array
    p: Array
    k: Array
    v: Array | None = None
    slope: Array | None = None
    area: Array | None = None


class Law(Protocol):
    """Penalty law: pressure between pad and disc as a function of the separation, Eq. (10)."""

    @property
    def first_touch(self) -> float:
        """Separation [m] at which the pressure becomes zero."""

    def pressure(self, d: ArrayLike) -> Array:
        """Pressure p [Pa] at the separation d [m]."""

    def stiffness(self, d: ArrayLike) -> Array:
        """Stiffness -dp/dd [Pa/m]."""

    def vibration(self, d: ArrayLike) -> Array:
        """Stiffness of small vibrations about a state reached by loading to d [Pa/m]."""


class Laws(Protocol):
    """Many laws at once: element i of a contact follows law ``index[i]``."""

    def __len__(self) -> int:
        """Number of laws."""

    def first_touch(self, index: Index) -> Array:
        """Separations [m] at which the pressures become zero, shape of ``index``."""

    def loading(self, index: Index, d: Array) -> tuple[Array, Array]:
        """Pressures [Pa] and stiffnesses -dp/dd [Pa/m] at the separations d [m], same shapes."""

    def vibration(self, index: Index, d: Array) -> tuple[Array, Array]:
        """Stiffnesses v of small vibrations [Pa/m] and their slopes dv/dd [Pa/m^2]."""

    def up_to(self, index: Index, p: ArrayLike) -> "Laws":
        """Laws that are known at the pressures p [Pa] too, of the shape of ``index``.

        These laws themselves where they are: a caller that gets others solves again with them.
        """

    def highest(self, index: Index) -> Array:
        """Pressures [Pa] up to which the laws are known, shape of ``index``; inf for a formula."""


class Longer(Protocol):
    """What makes a law of a library again, to a higher pressure."""

    def __call__(self, number: int, pressure: float) -> tuple[LawSteps, float]:
        """Steps of a law, and the pressure [Pa] up to which they are those of the whole law."""


@dataclass(frozen=True, slots=True)
class LawLibrary:
    """Computed laws in arrays of one size, evaluated together.

    Attributes:
        d: separations of the steps, falling along a row; rows are filled up with the last step
            [m], shape (n, m).
        p: pressures of the steps [Pa], shape (n, m).
        k: stiffnesses of the steps [Pa/m], shape (n, m), limited so that ln p is monotone.
        count: number of steps of each law, shape (n,).
        seed: seed of the surface behind each law, shape (n,).
        settings: how the laws were made, for the record.
        v: stiffnesses of small vibrations at the steps [Pa/m], shape (n, m); None where they are
            those of loading.
        slope: dv/dd at the steps [Pa/m^2], shape (n, m).
        area: share of the patch that touches at the steps [-], shape (n, m).
        reach: mean pressures up to which the laws are known [Pa], shape (n,): a law that was made
            for a low pressure goes on as a straight line earlier than the whole one; infinite for
            whole laws, which all are if None.
        longer: makes a law to a higher pressure; not stored.
    """

    d: Array
    p: Array
    k: Array
    count: Index
    seed: Ints
    settings: dict[str, Any] = field(default_factory=dict)
    v: Array | None = None
    slope: Array | None = None
    area: Array | None = None
    reach: Array | None = None
    longer: Longer | None = field(default=None, repr=False, compare=False)
    _flat: tuple[Array, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        flat = tuple(np.ascontiguousarray(a).ravel() for a in (self.d, self.p, self.k))
        object.__setattr__(self, "_flat", flat)

    def __repr__(self) -> str:
        """One line."""
        return f"LawLibrary({len(self)} laws up to {self.p.max():.4g} Pa)"

    def _repr_html_(self) -> str:
        """Medians over the laws at some pressures, as a table of a notebook."""
        pressures = np.geomspace(self.p[:, 0].max(), self.p.max(axis=1).min(), 6).tolist()
        points = [self.at_pressure(p) for p in pressures]
        values = ([1e-6 * x.p, 1e6 * x.d, x.k, np.asarray(x.v)] for x in points)
        rows = [np.median(x, axis=1).tolist() for x in values]
        heads = ("pressure [MPa]", "separation [um]", "loading [Pa/m]", "vibrations [Pa/m]")
        return html_table(repr(self), heads, rows)

    def __len__(self) -> int:
        """Number of laws."""
        return int(self.count.size)

    def __getitem__(self, i: int) -> "ComputedLaw":
        """Law number i."""
        if not -len(self) <= i < len(self):
            raise IndexError(f"law {i} of a library of {len(self)}")
        return ComputedLaw(self, i % len(self))

    def __iter__(self) -> "Iterator[ComputedLaw]":
        """The laws, one after the other."""
        return map(self.__getitem__, range(len(self)))

    def first_touch(self, index: Index) -> Array:
        """Separations [m] at which the pressures become zero, shape of ``index``."""
        i = np.asarray(index, dtype=np.intp)
        return self.d[i, 0] + 2.0 * self.p[i, 0] / self.k[i, 0]

    def loading(self, index: Index, d: Array) -> tuple[Array, Array]:
        """Pressures [Pa] and stiffnesses -dp/dd [Pa/m] at the separations d [m], same shapes."""
        i, x = same_shape(index, d)
        at, place = self._find(i, x)
        p, k = self._inside(at, x)
        d0, p0, k0 = (a[at] for a in self._flat)
        # Exactly zero at first touch.
        touch = d0 + 2.0 * p0 / k0
        foot = np.maximum((touch - x) / (touch - d0), 0.0)
        first, last = place < 0, place >= self.count[i] - 1
        p = np.where(first, p0 * foot**2, np.where(last, p0 + k0 * (d0 - x), p))
        k = np.where(first, k0 * foot, np.where(last, k0, k))
        return p, k

    def vibration(self, index: Index, d: Array) -> tuple[Array, Array]:
        """Stiffnesses v of small vibrations [Pa/m] and their slopes dv/dd [Pa/m^2].

        Between the steps ln v and the slope are interpolated over d. In the foot v falls to zero
        at first touch; beyond the last step it stays.
        """
        if self.v is None or self.slope is None:
            return smooth_vibration(lambda x: self.loading(index, x)[1], d)
        i, x = same_shape(index, d)
        at, place = self._find(i, x)
        d0, p0, k0 = (a[at] for a in self._flat)
        v, slope = self.v.ravel(), self.slope.ravel()
        inside = (place >= 0) & (place < self.count[i] - 1)
        nxt = np.where(inside, at + 1, at)
        width = np.where(inside, d0 - self._flat[0][nxt], 1.0)
        t = np.where(inside, (d0 - x) / width, 0.0)
        between = v[at] ** (1.0 - t) * v[nxt] ** t
        foot = 0.5 * k0 / p0  # one over its length
        share = np.where(place < 0, np.clip(1.0 - (x - d0) * foot, 0.0, 1.0), 1.0)
        fall = np.where(inside, (1.0 - t) * slope[at] + t * slope[nxt], 0.0)
        fall = np.where((place < 0) & (share > 0.0), -v[at] * foot, fall)
        return between * share, fall

    def up_to(self, index: Index, p: ArrayLike) -> "LawLibrary":
        """See ``Laws``: laws that end too low are made again, the others stay as they are."""
        if self.reach is None or self.longer is None:
            return self
        wanted = np.zeros(len(self))
        np.maximum.at(wanted, np.asarray(index), p)
        short = np.flatnonzero(wanted > self.reach)
        if not short.size:
            return self
        steps, reach = [self[i].steps for i in range(len(self))], self.reach.copy()
        for i in short:
            steps[i], reach[i] = self.longer(int(self.seed[i]), float(wanted[i]))
        seeds, ends = [int(s) for s in self.seed], [float(p) for p in reach]
        made = make_library(steps, seeds, self.settings, ends)
        return replace(made, longer=self.longer)

    def highest(self, index: Index) -> Array:
        """Pressures [Pa] up to which the laws are known, shape of ``index``."""
        i = np.asarray(index, dtype=np.intp)
        last = self.p[i, self.count[i] - 1]
        return last if self.reach is None else np.minimum(last, self.reach[i])

    def at_pressure(self, pressure: float | str) -> LawSteps:
        """Every law at one mean pressure.

        Args:
            pressure: [Pa], or with its unit, "0.2 MPa".

        Returns:
            One point of each law, arrays of shape (laws,).
        """
        p, index = quantity("pressure", pressure, "Pa"), np.arange(len(self))
        positive(pressure=p)
        d = separations_at(self, index, p)
        rows = zip(self.p, self.area, self.count, strict=True) if self.area is not None else ()
        area = [np.interp(np.log(p), np.log(x[:n]), a[:n]) for x, a, n in rows]
        k, vibration = self.loading(index, d)[1], self.vibration(index, d)
        return LawSteps(d, np.full_like(d, p), k, *vibration, np.array(area) if area else None)

    def _find(self, i: Index, x: Array) -> tuple[Index, Index]:
        """Flat address of the step left of x (the first step in the foot), and its number."""
        flat, width = self._flat[0], self.d.shape[1]
        base = i * width
        low, high = np.full(i.shape, -1), self.count[i].copy()
        for _ in range(int(np.ceil(np.log2(width + 2)))):
            middle = (low + high) >> 1
            probe = np.clip(middle, 0, width - 1)
            before = (flat[base + probe] >= x) & (middle >= 0)
            open_ = high - low > 1
            low = np.where(open_ & before, middle, low)
            high = np.where(open_ & ~before, middle, high)
        return base + np.maximum(low, 0), low

    def _inside(self, at: Index, x: Array) -> tuple[Array, Array]:
        """Cubic of ln p between the steps ``at`` and ``at + 1``: pressure and stiffness."""
        d, p, k = self._flat
        nxt = np.minimum(at + 1, d.size - 1)
        d0, p0, p1 = d[at], p[at], p[nxt]
        h = d0 - d[nxt]
        between = h > 0.0
        h = np.where(between, h, 1.0)
        m0, m1 = h * k[at] / p0, h * k[nxt] / p1
        rise = np.log(p1 / p0)
        a, b = 3.0 * rise - 2.0 * m0 - m1, m0 + m1 - 2.0 * rise
        # Behind the last step of a row stands another law: nothing of it may enter.
        t = np.where(between, np.clip((d0 - x) / h, 0.0, 1.0), 0.0)
        value = p0 * np.exp(t * (m0 + t * (a + t * b)))
        return value, value * (m0 + t * (2.0 * a + t * 3.0 * b)) / h


@dataclass(frozen=True, slots=True)
class ComputedLaw:
    """One law of a library.

    Attributes:
        library: where the law stands.
        number: its number there.
    """

    library: LawLibrary
    number: int

    @property
    def first_touch(self) -> float:
        """Separation [m] at which the pressure becomes zero."""
        return float(self.library.first_touch(np.array(self.number)))

    @property
    def highest(self) -> float:
        """Pressure [Pa] up to which the law is known."""
        return float(self.library.highest(np.array(self.number)))

    @property
    def steps(self) -> LawSteps:
        """The solved points that the law goes through."""
        n = int(self.library.count[self.number])
        whole: list[Any] = [getattr(self.library, name) for name in LawSteps._fields]
        return LawSteps._make(None if a is None else a[self.number, :n] for a in whole)

    def pressure(self, d: ArrayLike) -> Array:
        """Pressure p [Pa] at the separation d [m]."""
        return self.library.loading(np.array(self.number), np.asarray(d, dtype=float))[0]

    def stiffness(self, d: ArrayLike) -> Array:
        """Stiffness -dp/dd [Pa/m]."""
        return self.library.loading(np.array(self.number), np.asarray(d, dtype=float))[1]

    def vibration(self, d: ArrayLike) -> Array:
        """Stiffness of small vibrations about a state reached by loading to d [Pa/m]."""
        return self.library.vibration(np.array(self.number), np.asarray(d, dtype=float))[0]


def separations_at(laws: Laws, index: Index, pressure: float) -> Array:
    """Separations [m] at which laws carry a pressure, to the last digit, shape of ``index``.

    Args:
        laws: the library.
        index: numbers of the laws.
        pressure: [Pa], positive.
    """
    high = laws.first_touch(index)
    high = np.where(np.isfinite(high), high, 0.0)
    width = np.full(high.shape, 1e-9)
    # Laws fall monotonically: widen until all carry the pressure, then halve.
    while np.any(short := laws.loading(index, high - width)[0] < pressure):
        width = np.where(short, 2 * width, width)
    low = high - width
    for _ in range(60):
        middle = 0.5 * (low + high)
        enough = laws.loading(index, middle)[0] >= pressure
        low, high = np.where(enough, middle, low), np.where(enough, high, middle)
    return np.asarray(low, float)


def make_library(
    steps: Sequence[LawSteps],
    seeds: list[int] | None = None,
    settings: dict[str, Any] | None = None,
    reach: Sequence[float] | None = None,
) -> LawLibrary:
    """Put laws into arrays of one size.

    Args:
        steps: the points of each law; either all laws have ``v`` and ``slope``, or none.
        seeds: seed of the surface behind each law; -1 if not given.
        settings: how the laws were made.
        reach: of each law, see ``LawLibrary``; whole ones if not given.

    Raises:
        SceneError: no law, or steps that are not monotone.

    Example:
        >>> steps = LawSteps(np.array([1e-6, 0.0]), np.array([1e5, 4e5]), np.array([2e11, 6e11]))
        >>> make_library([steps, steps])
        LawLibrary(2 laws up to 4e+05 Pa)
    """
    if not steps:
        raise SceneError("a law library needs at least one law")
    for row, (d, p, k, *_) in enumerate(steps):
        if not (np.all(np.diff(d) < 0.0) and np.all(np.diff(p) > 0.0) and np.all(p > 0.0)):
            raise SceneError(f"law {row}: the pressure must rise as the separation falls")
        if not np.all(k > 0.0):
            raise SceneError(f"law {row}: the stiffness of every step must be positive")
    steps = [law._replace(k=limited(law.d, law.p, law.k)) for law in steps]
    width = max(len(law.d) for law in steps)
    rows: dict[str, Any] = {
        name: None if any(c is None for c in column) else _filled_up(column, width)
        for name, column in zip(LawSteps._fields, zip(*steps, strict=True), strict=True)
    }
    count = np.array([len(law.d) for law in steps], dtype=np.intp)
    seed = np.array(seeds if seeds is not None else [-1] * len(steps), dtype=np.int64)
    ends = None if reach is None or np.isinf(reach).all() else np.array(reach, dtype=float)
    return LawLibrary(count=count, seed=seed, settings=settings or {}, reach=ends, **rows)


def _filled_up(rows: Sequence[Array], width: int) -> Array:
    """Rows of different lengths in one array, filled up with their last values."""
    return np.array([np.pad(row, (0, width - len(row)), mode="edge") for row in rows])


def limited(d: Array, p: Array, k: Array) -> Array:
    """Stiffnesses [Pa/m] lowered where the cubic of ln p would not be monotone.

    Reference: F. N. Fritsch, R. E. Carlson, SIAM J. Numer. Anal. 17 (1980) 238: slopes up to three
    times those of both chords are enough.
    """
    if len(d) < 2:
        return k
    chord = np.diff(np.log(p)) / -np.diff(d)
    most = np.full(len(d), np.inf)
    most[1:] = 3.0 * chord
    most[:-1] = np.minimum(most[:-1], 3.0 * chord)
    return np.asarray(np.minimum(k / p, most) * p)


def smooth_vibration(k: Callable[[Array], Array], d: Array) -> tuple[Array, Array]:
    """Stiffness of vibrations of a law whose loading is smooth: that of loading, and its slope.

    Args:
        k: stiffness [Pa/m] as a function of the separation [m].
        d: separations [m].
    """
    return k(d), (k(d + DIFFERENCE) - k(d - DIFFERENCE)) * (0.5 / DIFFERENCE)


def same_shape(index: Index, d: Array) -> tuple[Index, Array]:
    """Index and separation broadcast to one shape."""
    i, x = np.broadcast_arrays(np.asarray(index, dtype=np.intp), np.asarray(d, dtype=float))
    return i, x

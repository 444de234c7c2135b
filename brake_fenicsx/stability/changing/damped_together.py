"""Damped bodies of a sample together: the basis of ``DampedSample``, and how far it may be off."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult

from ..modes import Complex
from ..reduced.contact_forces import acting_blocks
from ..reduced.damped_basis import DAMPED_ORDER, DampedBasis, convergence_radius
from ..reduced.damped_sample import DampedSample
from ..reduced.sample_errors import DOUBT, INTERPOLATED, doubted_poles
from .bodies import compact, places_of
from .damped_view import DampedView
from .proportion import Proportion

# The series in lambda must converge up to this multiple of the band's end.
REACH = 1.15

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Standing:
    """Closed elements of a body.

    Attributes:
        here: among its own.
        there: among all that are closed.
    """

    here: Index
    there: Index


def standing(elements: Sequence[Index], closed: Index, count: int) -> list[Standing]:
    """Where closed elements stand, for each body.

    Args:
        elements: contact elements of each body.
        closed: the closed ones among all.
        count: number of all.
    """
    at = np.full(count, -1)
    at[closed] = np.arange(closed.size)
    out = []
    for own in elements:
        here = np.flatnonzero(at[own] >= 0)
        here = here[np.argsort(at[own[here]])]
        out.append(Standing(here, at[own[here]]))
    return out


def check_reach(basis: DampedBasis, band: tuple[float, float]) -> None:
    """Whether the series in lambda reaches the end of a band [Hz].

    Raises:
        InaccurateResult: it does not.
    """
    if not basis.radius > REACH * 2 * np.pi * band[1]:
        raise InaccurateResult(
            "damping too strong for the reduced model of changing materials: its series converges"
            f" up to {basis.radius / 2 / np.pi:.0f} Hz"
        )


def damped_basis(
    views: Iterable[DampedView],
    modes: Sequence[int],
    standing: Sequence[Standing],
    w: Array,
    names: str,
    sigma: float,
    limit: float,
) -> DampedBasis:
    """Add up the bodies of a sample.

    Args:
        views: the bodies from their closed elements, looked at one after the other.
        modes: numbers of their modes.
        standing: where these stand.
        w: areas of all closed elements [m^2].
        names: blocks of rows that forces follow.
        sigma: shift [1/s^2].
        limit: no mode of a body below it is missing [1/s^2].
    """
    m, acting = w.size, acting_blocks(names)
    rows, columns = m * len(names), m * len(acting)
    ends = np.cumsum([0, *modes])
    size = int(ends[-1])
    G = np.zeros((DAMPED_ORDER + 1, rows + size, columns + size))
    seen, forced = np.zeros((rows, size)), np.zeros((columns, size))
    Lambda, C = np.zeros(size), np.zeros((size, size))
    answers: dict[str, Array] = {name: np.zeros((m, m)) for name in acting}
    for v, s, first in zip(views, standing, ends, strict=False):
        own = np.arange(first, first + v.Lambda.size)
        O, I = _places(s, len(names), m), _places(s, len(acting), m)
        Lambda[own], C[np.ix_(own, own)] = v.Lambda, v.C
        seen[np.ix_(O, own)], forced[np.ix_(I, own)] = v.seen, v.forced
        _add(G, v.G, _stretches(s, len(names), m, own), _stretches(s, len(acting), m, own))
        for name in acting:
            answers[name][np.ix_(s.there, s.there)] += v.answers[name]
    return DampedBasis(
        Lambda, C, seen, forced, tuple(G), names, answers, w, np.zeros(m), limit,
        convergence_radius([*G], rows, columns, limit), sigma,
    )  # fmt: skip


def _stretches(s: Standing, blocks: int, m: int, own: Index) -> list[tuple[slice, slice | Index]]:
    """Places of a body's rows and modes, stretch by stretch: in its own matrices, in those of all.

    Elements that stand side by side need no copy.
    """
    n = s.here.size
    out: list[tuple[slice, slice | Index]] = [
        (slice(n * i, n * (i + 1)), compact(s.there + m * i)) for i in range(blocks)
    ]
    return [*out, (slice(n * blocks, None), compact(own + m * blocks))]


def _add(
    G: Array,
    part: Array,
    rows: list[tuple[slice, slice | Index]],
    columns: list[tuple[slice, slice | Index]],
) -> None:
    """Add a body's matrices to those of all."""
    for own, place in rows:
        for inner, other in columns:
            if isinstance(place, slice) and isinstance(other, slice):
                G[:, place, other] += part[:, own, inner]
                continue
            every = [np.arange(G.shape[1 + i])[p] for i, p in enumerate((place, other))]
            at = np.ix_(*every)
            for total, matrix in zip(G, part[:, own, inner], strict=True):
                total[at] += matrix


def _places(s: Standing, blocks: int, m: int) -> Index:
    """Places of a body's rows in some blocks."""
    return np.concatenate([s.there + m * i for i in range(blocks)])


def doubted(
    sample: DampedSample,
    modes: tuple[Complex, Complex, Complex, Array],
    bodies: Sequence[tuple[Array, Proportion, Standing]],
    pole_doubt: Array,
) -> Array:
    """Errors of lambda under those of the bodies' interpolation where it was checked [1/s].

    A mode that they happen to leave alone shares the doubt of the others.

    Args:
        sample: the sample.
        modes: eigenvalues, right and left vectors of unit norm, conditions.
        bodies: of each the errors of R_0, R_1, ... at some points, on all its rows and columns, its
            damping, and where its elements stand.
        pole_doubt: typical errors of the eigenvalues of all kept modes [1/s^2].
    """
    s, a, b, condition = modes
    names, m, sigma = sample.basis.names, sample.forces.n, sample.basis.sigma
    acting = acting_blocks(names)
    c, y = sample.forces(s, sample.gaps(s, a)), sample.left_gaps(s, b)
    total: Array = np.zeros(s.size)
    for doubt, how, at in bodies:
        if not doubt.size or not at.here.size:
            continue
        n = doubt.shape[2] // len(names)
        O, I = _places(at, len(names), m), _places(at, len(acting), m)
        rows = np.concatenate([at.here + n * i for i in range(len(names))])
        every = np.arange(doubt.shape[3])
        columns = np.concatenate([every[places_of(names, name, n)][at.here] for name in acting])
        u = 1 / (1 + how.beta * s)
        kappa = sigma - (s**2 + how.alpha * s) * u
        for errors in doubt:
            first = np.zeros(s.size, complex)
            for j, error in enumerate(errors):
                inner = error[np.ix_(rows, columns)]
                answer = inner @ c[I].real + 1j * (inner @ c[I].imag)
                first += kappa**j * u * np.einsum("im,im->m", y[O].conj(), answer)
            total += DOUBT * np.abs(first)
    # |d lambda| = condition |d T| / 2 |lambda| for vectors of unit norm; rigid modes have none.
    size = np.where(s == 0, np.inf, np.abs(s))
    shared = float(np.median(total / size**2)) if s.size else 0.0
    total = np.maximum(total, max(shared, INTERPOLATED) * np.abs(s) ** 2)
    total += doubted_poles(pole_doubt, a, b)
    return np.asarray(condition * total / (2 * size))

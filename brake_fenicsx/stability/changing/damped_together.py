"""Damped bodies of a sample together: the basis of ``DampedSample``, and how far it may be off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult

from ..modes import Complex
from ..reduced.damped_basis import DAMPED_ORDER, DampedBasis, convergence_radius
from ..reduced.damped_sample import DampedSample
from ..reduced.sample import DIGITS, DOUBT
from .bodies import places_of
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
    here = [np.flatnonzero(at[own] >= 0) for own in elements]
    return [Standing(h, at[own[h]]) for own, h in zip(elements, here, strict=True)]


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
    views: Sequence[DampedView],
    standing: Sequence[Standing],
    w: Array,
    names: str,
    sigma: float,
    limit: float,
) -> DampedBasis:
    """Add up the bodies of a sample.

    Args:
        views: the bodies from their closed elements.
        standing: where these stand.
        w: areas of all closed elements [m^2].
        names: blocks of rows that forces follow.
        sigma: shift [1/s^2].
        limit: no mode of a body below it is missing [1/s^2].
    """
    m, acting = w.size, "NT" + "R" * ("R" in names)
    rows, columns = m * len(names), m * len(acting)
    ends = np.cumsum([0, *(v.Lambda.size for v in views)])
    modes = int(ends[-1])
    G = np.zeros((DAMPED_ORDER + 1, rows + modes, columns + modes))
    seen, forced = np.zeros((rows, modes)), np.zeros((columns, modes))
    answers = {name: np.zeros((m, m)) for name in acting}
    for v, s, first in zip(views, standing, ends, strict=False):
        own = np.arange(first, first + v.Lambda.size)
        O, I = _places(s, len(names), m), _places(s, len(acting), m)
        seen[np.ix_(O, own)], forced[np.ix_(I, own)] = v.seen, v.forced
        at = np.ix_(np.r_[O, rows + own], np.r_[I, columns + own])
        for total, part in zip(G, v.G, strict=True):
            total[at] += part
        for name in acting:
            answers[name][np.ix_(s.there, s.there)] += v.answers[name]
    Lambda = np.concatenate([v.Lambda for v in views])
    C = la.block_diag(*(v.C for v in views))
    return DampedBasis(
        Lambda, C, seen, forced, tuple(G), names, answers, w, np.zeros(m), limit,
        convergence_radius([*G], rows, columns, limit), sigma,
    )  # fmt: skip


def _places(s: Standing, blocks: int, m: int) -> Index:
    """Places of a body's rows in some blocks."""
    return np.concatenate([s.there + m * i for i in range(blocks)])


def doubted(
    sample: DampedSample,
    modes: tuple[Complex, Complex, Complex, Array],
    bodies: Sequence[tuple[Array, Proportion, Standing]],
) -> Array:
    """Errors of lambda under those of the bodies' interpolation where it was checked [1/s].

    A mode that they happen to leave alone shares the doubt of the others.

    Args:
        sample: the sample.
        modes: eigenvalues, right and left vectors of unit norm, conditions.
        bodies: of each the errors of R_0, R_1, ... at some points, on all its rows and columns, its
            damping, and where its elements stand.
    """
    s, a, b, condition = modes
    names, m, sigma = sample.basis.names, sample.forces.n, sample.basis.sigma
    acting = "NT" + "R" * ("R" in names)
    c, y = sample.forces(s, sample.gaps(s, a)), sample.left_gaps(s, b)
    total = np.zeros(s.size)
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
    total = np.maximum(total, max(shared, DIGITS) * np.abs(s) ** 2)
    return np.asarray(condition * total / (2 * size))

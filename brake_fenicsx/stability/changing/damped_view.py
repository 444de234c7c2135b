"""A damped body of one sample as its closed contact elements see it, by powers of lambda.

The kept directions of W are modes of the sample, with the damping C between them. Those beyond
answer like the rest of ``damped_basis``, S_n = -Lambda^-1 (C S_(n-1) + S_(n-2)) with their own part
of C, and couple with the kept ones through theirs. The R_jn of ``expansion`` come with

    kappa'^j t^n / (1 + beta lambda),    kappa' = sigma - (lambda^2 + alpha lambda) u,
    t = lambda u / reach,    u = 1 / (1 + beta lambda),

taken to powers of lambda.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..reduced.contact_forces import acting_blocks
from ..reduced.damped_basis import DAMPED_ORDER
from .bodies import places_of
from .expansion import Expansion
from .proportion import Proportion

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class DampedView:
    """A damped body.

    Attributes:
        Lambda: kappa' of its modes [1/s^2].
        C: damping of the modes [1/s], shape (modes, modes).
        seen: rows of O on them, shape (rows, modes).
        forced: rows of I on them.
        G: G_n of ``DampedBasis``, shape (orders, rows of O + modes, rows of I + modes).
        answers: name -> those rows of A^-1 on themselves [m/N].
    """

    Lambda: Array
    C: Array
    seen: Array
    forced: Array
    G: Array
    answers: dict[str, Array]


def damped_view(
    body: Expansion, how: Proportion, sigma: float, names: str, here: Index
) -> DampedView:
    """A body from its closed elements.

    Args:
        body: the body at one stiffness.
        how: its damping.
        sigma: shift [1/s^2].
        names: blocks of rows that forces follow.
        here: its closed elements among its own.
    """
    n = body.elements
    rows = np.concatenate([here + n * i for i in range(len(names))])
    acting = acting_blocks(names)
    every = np.arange(body.Phi.shape[1])
    columns = np.concatenate([every[places_of(names, name, n)][here] for name in acting])
    k, kappa = body.kept, body.Lambda - sigma
    C = np.diag(how.alpha + how.beta * kappa)
    if body.difference is not None:
        C = C + body.difference / how.reach
    O, I = body.Phi[:, rows], body.Phi[:, columns]
    if body.series is not None:
        C, whole = body.series
        first, last = (n * len(blocks) + np.arange(k) for blocks in (names, acting))
        acted = np.concatenate([here + n * i for i in range(len(acting))])
        inner = np.ix_(np.r_[rows, first], np.r_[acted, last])
        G = np.array([A[inner] for A in whole])
    else:
        G = np.zeros((DAMPED_ORDER + 1, rows.size + k, columns.size + k))
        _add_rest(G, body, how, sigma, (rows, columns))
        _add_directions(G, kappa[k:], C[k:, k:], (O[k:], C[k:, :k]), (I[k:], C[k:, :k]), rows.size)
    Lambda, seen, forced = body.Lambda[:k], O[:k].T, I[:k].T
    answers = _answers(body, G[0], names, forced, here)
    return DampedView(Lambda, C[:k, :k], seen, forced, G, answers)


def _add_rest(
    G: Array, body: Expansion, how: Proportion, sigma: float, chosen: tuple[Index, Index]
) -> None:
    """What W leaves out."""
    rows, columns = chosen
    factors = _factors(body, how, sigma)
    inner = np.ix_(rows, columns)
    for moment, own in zip(body.moments, factors, strict=True):
        weights = own @ moment.weights
        some = np.flatnonzero(np.any(weights != 0, axis=1))
        count, *shape = moment.matrices.shape
        if count == 1:
            A = moment.matrices[0][inner]
            for i in some:
                G[i, : rows.size, : columns.size] += weights[i, 0] * A
            continue
        if rows.size == shape[0]:
            flat = moment.matrices.reshape(count, -1)
            total = (weights[some] @ flat).reshape(-1, *shape)[:, :, columns]
        else:
            flat = np.array([A[inner] for A in moment.matrices]).reshape(count, -1)
            total = (weights[some] @ flat).reshape(-1, rows.size, columns.size)
        G[some, : rows.size, : columns.size] += total


def _factors(body: Expansion, how: Proportion, sigma: float) -> list[Array]:
    """For each moment the powers of lambda in kappa'^j t^n u, shape (orders, powers of t)."""
    size = DAMPED_ORDER + 1
    u = (-how.beta) ** np.arange(size)
    kappa = -np.convolve(np.r_[0.0, how.alpha, 1.0], u)[:size]
    kappa[0] += sigma
    t = np.convolve(np.r_[0.0, 1 / how.reach], u)[:size]
    out = []
    for moment in body.moments:
        power = u
        for _ in range(moment.j):
            power = np.convolve(power, kappa)[:size]
        columns = []
        for _ in moment.weights:
            columns.append(power)
            power = np.convolve(power, t)[:size]
        out.append(np.stack(columns, axis=1))
    return out


def _add_directions(
    G: Array, kappa: Array, C: Array, left: tuple[Array, Array], right: tuple[Array, Array], n: int
) -> None:
    """Directions of W beyond the modes.

    Args:
        G: what is added to.
        kappa: their eigenvalues [1/s^2], shape (beyond,).
        C: their own damping.
        left: rows of O on them, and their damping with the modes, shape (beyond, any).
        right: the same of I.
        n: number of rows of O.
    """
    proportional = not np.any(C - np.diag(np.diag(C))) and not np.any(left[1])
    m = right[0].shape[1]
    X = right[0] if proportional else np.hstack(right)
    rows = left[0] if proportional else np.hstack(left)
    before, X = np.zeros_like(X), X / kappa[:, None]
    for i in range(len(G)):
        if i:
            damped = np.diag(C)[:, None] * X if proportional else C @ X
            before, X = X, -(damped + before) / kappa[:, None]
        if not np.any(X):
            continue
        if proportional:
            G[i, :n, :m] += rows.T @ X
        else:
            G[i] += rows.T @ X


def _answers(body: Expansion, G: Array, names: str, forced: Array, here: Index) -> dict[str, Array]:
    """Rows of A^-1 on themselves, modes included."""
    m, out = here.size, {}
    for name in acting_blocks(names):
        at = "NTR".index(name) * m
        P = forced[at : at + m]
        if name in names:
            first = names.index(name) * m
            rest = G[first : first + m, at : at + m]
        else:
            rest = body.TT[np.ix_(here, here)]
        out[name] = rest + (P / body.Lambda[: body.kept]) @ P.T
    return out

"""Stated errors and verdicts of the reduced model on random systems, at every tolerance."""

from functools import cache

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.stability import Reduced, complex_modes
from dense_reference import all_kappa, all_lambda, covered

# Nodes of each of the two bodies, contact elements, modes of the band.
NODES, ELEMENTS, MODES = 120, 24, 25


@cache
def system(seed):
    """Two random networks of springs and masses whose nodes touch in random places."""
    rng = np.random.default_rng(seed)
    K, M = [], []
    for _ in range(2):
        first = np.r_[np.arange(NODES - 1), rng.integers(0, NODES, 3 * NODES)]
        far = np.r_[np.ones(NODES - 1, int), rng.integers(1, 12, 3 * NODES)]
        ends = np.r_[first, (first + far) % NODES]
        stiff = np.r_[10 ** rng.uniform(6, 8, NODES - 1), 10 ** rng.uniform(5, 7, 3 * NODES)]
        row = np.tile(np.arange(first.size), 2)
        J = sp.csr_matrix((np.repeat([1.0, -1.0], first.size), (row, ends)))
        K.append(J.T @ sp.diags(stiff) @ J + sp.diags(10 ** rng.uniform(3, 5, NODES)))
        M.append(sp.diags(10 ** rng.uniform(-2, -1, NODES)))
    rows = np.zeros((2, ELEMENTS, 2 * NODES))
    for row in rows.reshape(-1, 2 * NODES):
        for body, sign in enumerate((1.0, -1.0)):
            row[body * NODES + rng.integers(0, NODES, 3)] = sign * rng.dirichlet(np.ones(3))
    N, T = map(sp.csr_matrix, rows)
    k = 10 ** rng.uniform(6, 7.5, ELEMENTS)
    K, M = (sp.block_diag(A).tocsr() for A in (K, M))
    free = np.sort(np.abs(all_lambda(K + N.T @ sp.diags(k) @ N, M)))
    return K, M, N, T, k, float(free[MODES - 1 : MODES + 1].mean() / 2 / np.pi)


def tangent(seed, mu):
    K, _, N, T, k, _ = system(seed)
    return (K + (N + mu * T).T @ sp.diags(k) @ N).tocsr()


@cache
def reduced(seed, tolerance):
    K, M, N, T, _, end = system(seed)
    return Reduced(K, M, N, T, np.ones(ELEMENTS), 1e11, (0.0, end), tolerance)


@pytest.mark.long
@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-7, 1e-9, 1e-12])
def test_stated_errors_hold_at_every_tolerance(tolerance):
    """The error that the motions leave in the quotient is no less with more moments by itself."""
    stated = []
    for seed in range(3):
        model = reduced(seed, tolerance)
        for mu in (0.0, 0.3, 0.7, 1.1):
            modes = model.modes(system(seed)[4], mu)
            exact = all_lambda(tangent(seed, mu), system(seed)[1])
            nearest = exact[np.abs(modes.s[:, None] - exact).argmin(axis=1)]
            floor = 1e-15 * np.abs(exact).max() ** 2 * modes.condition / np.abs(modes.s)
            covered(modes, np.ones(len(modes), bool), nearest, floor)
            stated.append(np.median(modes.error / np.abs(modes.s)))
    assert np.median(stated) < max(tolerance, 2e-7)


@cache
def merging(seed):
    """Least friction at which a mode of the band grows: a model of 1e-9 finds it to 1e-4."""
    model, k = reduced(seed, 1e-9), system(seed)[4]

    def grows(kappa):
        inside = kappa[np.abs(kappa) < 0.8 * (2 * np.pi * system(seed)[5]) ** 2]
        return bool(np.any(np.abs(inside.imag) > 1e-7 * np.abs(inside)))

    def bisected(of, low, high, width):
        assert not grows(of(low)) and grows(of(high))
        while high - low > width:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if grows(of(middle)) else (middle, high)
        return high

    def near(mu):
        return -(model.modes(k, mu).s ** 2)

    first = next(mu for mu in np.arange(0.1, 6.0, 0.1) if grows(near(mu)))
    mu = bisected(near, first - 0.1, first, 1e-5)
    return bisected(
        lambda mu: all_kappa(tangent(seed, mu), system(seed)[1]), mu - 1e-4, mu + 1e-4, 1e-7
    )


@pytest.mark.long
def test_verdicts_next_to_a_merging():
    """Within 1e-3 of it: right, and neutral at most three times as often as at full order."""
    neutral = np.zeros(2, int)
    for seed in range(3):
        _, M, _, _, k, end = system(seed)
        model, critical = reduced(seed, 1e-5), merging(seed)
        for share in np.r_[-np.logspace(-6, -3, 3), np.logspace(-6, -3, 3)]:
            mu = critical * (1 + share)
            found = model.modes(k, mu)
            exact = all_lambda(tangent(seed, mu), M)
            nearest = exact[np.abs(found.s[:, None] - exact).argmin(axis=1)]
            floor = 1e-15 * np.abs(exact).max() ** 2 * found.condition / np.abs(found.s)
            covered(found, np.ones(len(found), bool), nearest, floor)
            full = complex_modes(M, None, tangent(seed, mu), (0.0, end))
            neutral += ["neutral" in found.verdict, "neutral" in full.verdict]
    assert neutral[0] <= 3 * max(neutral[1], 1)


def test_two_real_modes_next_to_their_merging_are_no_pair():
    """From 1e-5 of the merging on: as many growing modes as at full order, on either side.

    Of three systems in which no second pair merges this near to the first.
    """
    for seed in (0, 1, 3):
        _, M, _, _, k, end = system(seed)
        model, critical = reduced(seed, 1e-5), merging(seed)
        for share in np.r_[-np.logspace(-5, -3, 5), np.logspace(-5, -3, 5)]:
            mu = critical * (1 + share)
            exact = all_lambda(tangent(seed, mu), M)
            exact = exact[exact.imag < 2 * np.pi * end]
            found = model.modes(k, mu).s
            growing = [np.sum(s.real > 1e-7 * np.abs(s)) for s in (found, exact)]
            assert growing[0] == growing[1], f"seed {seed}, {share:.1e}: {growing}"

"""Followed branches and their events against small problems with known merging points."""

from itertools import pairwise

import numpy as np
import pytest
import scipy.linalg as la
from scipy.optimize import brentq

from brake_fenicsx.sweeps.branches import CUT, ENTERED, LEFT, follow
from brake_fenicsx.sweeps.events import END, MERGING, ONSET, SPLITTING, find_events
from brake_fenicsx.sweeps.matching import State
from sweep_models import MERGED, along, hoffmann, modes_of, solver

WIDE = (0.0, 1e5)


def friction_40(damping=None):
    """A random problem of 40 dofs, K_0 + x B: many mergings, splittings and crossings."""
    rng, n = np.random.default_rng(0), 40
    Q = la.qr(rng.standard_normal((n, n)))[0]
    K = Q @ np.diag(np.sort(rng.uniform(1, 100, n))) @ Q.T
    B = 1.2 * rng.standard_normal((n, n))
    C = np.zeros((n, n)) if damping is None else damping(K)
    return lambda x: (np.eye(n), C, K + x * B)


@pytest.mark.parametrize("steps", [4, 7, 40])
def test_two_modes_merge_where_the_closed_form_says(steps):
    solve = solver(hoffmann)
    followed = follow(solve, np.linspace(0, 1.2, steps), WIDE)
    merging, onset = find_events(followed, solve, 1e-3, 1e-4)
    assert (merging.kind, onset.kind) == (MERGING, ONSET)
    assert abs(merging.x - MERGED) <= 1e-4 * 1.2
    # kappa = 5/3 +- i sqrt((mu - MERGED) / 2), and 2 alpha / omega = Im(kappa) / Re(kappa).
    assert abs(onset.x - MERGED - 2 * (1e-3 * 5 / 3) ** 2) <= 1e-4 * 1.2
    assert abs(merging.s - 1j * np.sqrt(5 / 3)) < 1e-3
    assert [b.end for b in followed.branches] == ["last value"] * 2


def test_damping_of_mass_merges_modes_off_the_axis():
    solve = solver(lambda mu: hoffmann(mu, (0.02, 0.02)))
    merging, onset = find_events(follow(solve, np.linspace(0, 1.2, 7), WIDE), solve, 0.0, 1e-4)
    assert merging.kind == MERGING and abs(merging.x - MERGED) <= 1.2e-4
    # alpha = -0.01 + Im(kappa) / (2 omega): zero at Im(kappa) = 0.02 omega.
    assert onset.kind == ONSET and abs(onset.x - MERGED - 2 * 0.02**2 * 5 / 3) <= 1.2e-4


def test_unequal_damping_passes_beside_the_merging():
    """No merging is reported, and the onset is the root of the characteristic polynomial."""
    solve = solver(lambda mu: hoffmann(mu, (0.01, 0.05)))
    (onset,) = find_events(follow(solve, np.linspace(0, 1.2, 13), WIDE), solve, 0.0, 1e-4)

    def growth(mu):
        first, second = [1, 0.01, 2.0], [1, 0.05, 4 / 3]
        polynomial = np.polysub(np.polymul(first, second), [-(mu - 0.5) / 2])
        return np.roots(polynomial).real.max()

    assert onset.kind == ONSET and abs(onset.x - brentq(growth, 0.6, 1.2)) <= 1e-4 * 1.2


@pytest.mark.long
@pytest.mark.parametrize(
    "damping", [None, lambda K: 0.02 * np.eye(40) + 1e-3 * K, lambda K: 0.05 * np.eye(40)]
)
def test_events_do_not_depend_on_the_step(damping):
    solve = solver(friction_40(damping))
    found = []
    for steps in (11, 16, 41):
        followed = follow(solve, np.linspace(0, 1, steps), WIDE)
        assert not any(b.end == CUT for b in followed.branches)
        assert len(followed.branches) == 40
        events = find_events(followed, solve, 1e-3, 1e-4)
        found.append(sorted((e.kind, e.x) for e in events))
    for other in found[1:]:
        assert [kind for kind, _ in other] == [kind for kind, _ in found[0]]
        np.testing.assert_allclose([x for _, x in other], [x for _, x in found[0]], atol=2e-4)


def test_every_merging_is_one_of_the_eigenvalues_alone():
    """Numbers of unstable modes between the events, by eigenvalues without any vectors."""
    matrices = friction_40()
    solve = solver(matrices)
    events = find_events(follow(solve, np.linspace(0, 1, 11), WIDE), solve, 0.0, 1e-6)
    merged = sorted((e.x, 1 if e.kind == MERGING else -1) for e in events
                    if e.kind in (MERGING, SPLITTING))  # fmt: skip
    edges = [0.0, *(x for x, _ in merged), 1.0]
    number = 0
    for n, (low, high) in enumerate(pairwise(edges)):
        if high - low > 1e-4:
            kappa = la.eigvals(matrices(0.5 * (low + high))[2])
            assert np.sum(kappa.imag > 1e-9) == number
        number += merged[n][1] if n < len(merged) else 0
    assert len(merged) > 15


@pytest.mark.parametrize("steps", [5, 6, 24])
def test_modes_that_cross_without_coupling_keep_their_branches(steps):
    """A doublet that crosses, at a computed value and between two."""
    solve = solver(lambda x: (np.eye(2), np.zeros((2, 2)), np.diag([1.0 + x, 1.5 - x])))
    followed = follow(solve, np.linspace(0, 0.5, steps), WIDE)
    assert find_events(followed, solve, 0.0, 1e-4) == []
    (x, one), (_, two) = along(followed)
    np.testing.assert_allclose(one.imag**2, 1.0 + x, rtol=1e-12)
    np.testing.assert_allclose(two.imag**2, 1.5 - x, rtol=1e-12)


@pytest.mark.parametrize("steps", [5, 8])
def test_modes_that_veer_stay_apart(steps):
    K = lambda x: np.array([[1.0 + x, 0.02], [0.02, 1.5 - x]])  # noqa: E731
    solve = solver(lambda x: (np.eye(2), np.zeros((2, 2)), K(x)))
    followed = follow(solve, np.linspace(0, 0.5, steps), WIDE)
    assert find_events(followed, solve, 0.0, 1e-4) == []
    (_, low), (_, high) = along(followed)
    assert np.all(low.imag < high.imag)


def test_a_narrow_window_of_flutter_between_two_values_is_found():
    """K_12 K_21 < 0: the modes merge at |x - 1/4| = sqrt(-K_12 K_21), a step is 0.1 wide."""
    K = lambda x: np.array([[1.0 + x, 2e-3], [-2e-3, 1.5 - x]])  # noqa: E731
    solve = solver(lambda x: (np.eye(2), np.zeros((2, 2)), K(x)))
    events = find_events(follow(solve, np.linspace(0, 0.5, 6), WIDE), solve, 0.0, 1e-5)
    assert {e.kind for e in events} == {MERGING, ONSET, SPLITTING, END}
    for e in events:
        sign = -1 if e.kind in (MERGING, ONSET) else 1
        assert abs(e.x - 0.25 - sign * 2e-3) <= 1e-5


def test_doublet_that_flutters_from_the_start():
    """Equal eigenvalues at the first value, coupled by friction in proportion to it."""
    K = lambda x: np.array([[1.0, x], [-x, 1.0]])  # noqa: E731
    solve = solver(lambda x: (np.eye(2), np.zeros((2, 2)), K(x)))
    followed = follow(solve, np.linspace(0, 0.5, 6), WIDE)
    assert len(followed.branches) == 2
    assert not any(b.end == CUT for b in followed.branches)
    kinds = [e.kind for e in find_events(followed, solve, 0.01, 1e-4)]
    assert kinds.count(ONSET) == 1


def test_modes_come_and_go_at_the_ends_of_the_band():
    band = (0.9 / 2 / np.pi, 1.1 / 2 / np.pi)

    def solve(x):
        modes = modes_of(np.eye(2), np.zeros((2, 2)), np.diag([(1.0 + x) ** 2, (1.3 - x) ** 2]))
        state = State.of(x, modes)
        kept = (state.frequency >= band[0]) & (state.frequency <= band[1])
        return State(
            x, state.s[kept], state.right[:, kept], state.left[:, kept], state.error[kept],
            state.condition[kept], state.verdict[kept],
        )  # fmt: skip

    followed = follow(solve, np.linspace(0, 0.35, 8), band)
    one, two = followed.branches
    assert (one.begin, one.end) == ("first value", LEFT)
    assert (two.begin, two.end) == (ENTERED, "last value")


def test_a_mode_without_a_continuation_is_cut():
    """Another mode in its place, as a wrong solver would give."""

    def solve(x):
        first, second = (1.0, 1.2) if x < 0.3 else (1.1, 1.3)
        modes = modes_of(np.eye(3), np.zeros((3, 3)), np.diag([first, second, 50.0]))
        state = State.of(x, modes)
        return state if x < 0.3 else State(
            x, state.s[1:], state.right[:, 1:], state.left[:, 1:], state.error[1:],
            state.condition[1:], state.verdict[1:],
        )  # fmt: skip

    followed = follow(solve, np.linspace(0, 1, 5), WIDE)
    assert sorted(b.end == CUT for b in followed.branches) == [False, False, True]

"""Hard cases of sweeps: branches are continued correctly or cut with a record, never swapped."""

import numpy as np
import pytest

from brake_fenicsx.errors import NotConverged
from brake_fenicsx.sweeps.branches import CUT, NO_EQUILIBRIUM, follow
from brake_fenicsx.sweeps.events import JUMP, MERGING, SPLITTING, find_events
from brake_fenicsx.sweeps.matching import State
from sweep_models import MERGED, along, hoffmann, modes_of, solver

pytestmark = pytest.mark.hard

WIDE = (0.0, 1e5)
NONE = np.zeros((2, 2))


def kinds(events, *wanted):
    return [(e.kind, e.x) for e in events if e.kind in wanted]


def undamped(K):
    """States of a stiffness as a function of x, of masses of 1."""
    n = len(K(0.0))
    return solver(lambda x: (np.eye(n), np.zeros((n, n)), K(x)))


@pytest.mark.parametrize(
    ("values", "scale", "wanted"),
    [
        # A value lies exactly on the merging point.
        ([0.0, 0.3, MERGED, 0.9, 1.2], 1.0, MERGING),
        # Falling values have a splitting where rising ones have a merging.
        (np.linspace(1.2, 0, 7), 1.0, SPLITTING),
        # Stiffness and mass of any size.
        (np.linspace(0, 1.2, 7), 1e-6, MERGING),
        (np.linspace(0, 1.2, 7), 1e9, MERGING),
    ],
)
def test_one_merging_whatever_values_and_units(values, scale, wanted):
    """On a computed value, from either side and in any unit: one event, branches continue."""
    solve = undamped(lambda mu: scale * hoffmann(mu)[2])
    followed = follow(solve, values, (0.0, 1e9))
    assert not any(b.end == CUT for b in followed.branches)
    ((kind, x),) = kinds(find_events(followed, solve, 0.0, 1e-4), MERGING, SPLITTING)
    assert kind == wanted and abs(x - MERGED) <= 1.2e-4


def test_a_mode_merges_with_one_neighbour_and_then_with_the_other():
    """1 and 2 merge and split, then 2 and 3: K_ij K_ji < 0 in two places."""

    def K(x):
        return np.array([
            [1.00, 0.03, 0.0], [-0.03, 0.90 + 0.4 * x, 0.03], [0.0, -0.03, 1.20],
        ])  # fmt: skip

    solve = undamped(K)
    found = []
    for steps in (4, 9, 40):
        followed = follow(solve, np.linspace(0, 1, steps), WIDE)
        assert len(followed.branches) == 3
        found.append(kinds(find_events(followed, solve, 0.0, 1e-4), MERGING, SPLITTING))
    for one in found:
        assert [kind for kind, _ in one] == [MERGING, SPLITTING, MERGING, SPLITTING]
        np.testing.assert_allclose([x for _, x in one], [x for _, x in found[-1]], atol=2e-4)
    # The number of complex eigenvalues changes just there.
    for _, x in found[0]:
        count = [np.sum(np.linalg.eigvals(K(x + d)).imag > 1e-9) for d in (-1e-3, 1e-3)]
        assert count[0] != count[1]


def test_two_doublets_cross_at_one_value():
    """Four modes meet in two frequencies; nothing couples them."""
    D = lambda x: np.diag([1 + x, 1.5 - x, 2 + x, 2.5 - x])  # noqa: E731
    solve = undamped(D)
    followed = follow(solve, np.linspace(0, 0.5, 5), WIDE)
    assert find_events(followed, solve, 0.0, 1e-4) == []
    squares = [s.imag**2 for _, s in along(followed)]
    ends = sorted(square[-1] for square in squares)
    np.testing.assert_allclose(ends, [1.0, 1.5, 2.0, 2.5], rtol=1e-12)
    for square in squares:
        moved = np.diff(square)
        assert np.all(moved > 0) or np.all(moved < 0)


@pytest.mark.parametrize("radius", [0.1, 1e-3])
@pytest.mark.parametrize(("centre", "swapped"), [(MERGED, True), (MERGED - 0.15, False)])
def test_friction_damping_and_modulus_around_an_exceptional_point(radius, centre, swapped):
    """One round about it exchanges two modes, two rounds do not, nor does one beside it."""

    def model(rounds):
        c, s = np.cos(2 * np.pi * rounds), np.sin(2 * np.pi * rounds)
        M, C, K = hoffmann(centre + radius * c, 0.05 + radius * s * np.array([1, -1]))
        return M, C, (1 + 0.1 * s) * K

    for rounds in (1, 2):
        followed = follow(solver(model), np.linspace(0, rounds, 8 * rounds + 1), WIDE)
        first, last = np.array([s[[0, -1]] for _, s in along(followed)]).T
        wanted = first[::-1] if swapped and rounds == 1 else first
        np.testing.assert_allclose(last, wanted, rtol=1e-9)


@pytest.mark.parametrize("coupling", [1e-3, 1e-5, 1e-7])
def test_weak_veering_never_leaves_a_gap_or_a_jump(coupling):
    """A veering narrower than the smallest step counts as a crossing: smooth branches."""
    K = lambda x: np.array([[1.0 + x, coupling], [coupling, 1.5 - x]])  # noqa: E731
    followed = follow(undamped(K), np.linspace(0, 0.5, 6), WIDE)
    assert [b.end for b in followed.branches] == ["last value"] * 2
    for x, s in along(followed):
        assert np.all(np.abs(np.diff(s.imag**2)) <= np.diff(x) + 2 * coupling)


def test_a_doublet_that_stays_together_costs_no_steps():
    """Two modes equal to round-off at all values, and a third one that changes."""
    rng = np.random.default_rng(5)

    def K(x):
        return np.diag([2.0, 2.0 + 1e-7 * rng.standard_normal(), 1.0 + 0.5 * x])

    followed = follow(undamped(K), np.linspace(0, 1, 11), WIDE)
    assert not any(b.end == CUT for b in followed.branches)
    assert len(followed.states) < 200


def test_defective_everywhere():
    """Two modes are merged at every value (Jordan block): no spurious branch."""
    K = lambda x: np.array([[1.0 + x, 1.0], [0.0, 1.0 + x]])  # noqa: E731
    followed = follow(undamped(K), np.linspace(0, 0.5, 4), WIDE)
    for x, s in along(followed):
        np.testing.assert_allclose(s.imag**2, 1 + x, rtol=1e-6)


def test_jump_of_the_contact_state():
    """An element opens at 0.3 and modes jump: the most similar continue, with a row `jump`."""

    def solve(x):
        opened = x > 0.3
        angle = 0.7 if opened else 0.0
        Q = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        stiff = np.diag([0.9, 2.0]) if opened else np.diag([1.0, 2.2])
        modes = modes_of(np.eye(2), NONE, Q @ stiff @ Q.T)
        return State.of(x, modes, np.array([0.0 if opened else 1.0]))

    followed = follow(solve, np.linspace(0, 1, 6), WIDE)
    assert [b.end for b in followed.branches] == ["last value"] * 2
    events = find_events(followed, solve, 0.0, 1e-4)
    assert [e.kind for e in events] == [JUMP]
    assert abs(events[0].x - 0.3) <= events[0].error <= 1e-3


def test_modes_that_jump_are_cut_once():
    """Two modes rotate by 50 degrees and rise by 10 % at 0.43: cut, then followed again."""
    turn = np.deg2rad(50.0)
    R = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])

    def K(x):
        K = 1e6 * np.diag([1.0, 1.4, 9.0]) * (1 + 0.1 * x)
        return R @ K @ R.T * 1.2 if x > 0.43 else K

    followed = follow(undamped(K), np.linspace(0, 1, 11), WIDE)
    assert len(followed.states) < 80
    ends = sorted(b.end == CUT for b in followed.branches)
    assert sum(ends) == 2 and len(ends) == 5
    whole = [b for b in followed.branches if len(b.states) == len(followed.states)]
    assert len(whole) == 1


def test_modes_that_are_noise_end():
    """Random modes at every value: branches are cut, without many extra values."""
    rng = np.random.default_rng(0)

    def K(x):
        Q = np.linalg.qr(rng.normal(size=(6, 6)))[0]
        return 1e6 * Q @ np.diag(np.arange(1.0, 7.0)) @ Q.T

    followed = follow(undamped(K), np.linspace(0, 1, 5), WIDE)
    assert len(followed.states) < 200
    assert any(b.end == CUT for b in followed.branches)


def test_no_equilibrium_beyond_a_value():
    """Branches end at the last value with an equilibrium; no equilibrium at all is an error."""

    def solve(x):
        if x > 0.5:
            raise NotConverged("equilibrium: none")
        return solver(hoffmann)(x)

    followed = follow(solve, np.linspace(0, 1, 5), WIDE)
    assert {b.end for b in followed.branches} == {NO_EQUILIBRIUM}
    assert followed.states[-1].x == 0.5 and "none" in followed.stopped
    with pytest.raises(NotConverged):
        follow(solve, [0.9, 1.0], WIDE)

"""Families of modes over samples: permuted, mixed and new shapes."""

import numpy as np
import pytest
import scipy.linalg as la

from brake_fenicsx.mac import mac
from brake_fenicsx.results.families import ModeFamilies, Onsets, known_numbers

STABLE = np.zeros(6, bool)


def test_families_follow_permuted_modes():
    """Shuffled, rescaled in the complex plane and slightly mixed: numbers stay with shapes."""
    rng = np.random.default_rng(0)
    X = la.qr(rng.normal(size=(12, 6)), mode="economic")[0].astype(complex)
    f = np.linspace(1000, 1400, 6)
    shapes, frequencies, wanted = [X], [f], [np.arange(6)]
    for _ in range(8):
        turn = rng.permutation(6)
        noise = 0.1 * rng.normal(size=X.shape)
        phase = np.exp(2j * np.pi * rng.random(6)) * rng.uniform(0.1, 10, 6)
        shapes.append((X + noise)[:, turn] * phase)
        frequencies.append(f[turn] * (1 + 0.01 * rng.normal(size=6)))
        wanted.append(turn)
    families = ModeFamilies()
    for X, f, want in zip(shapes, frequencies, wanted, strict=True):
        np.testing.assert_array_equal(families.add(X, f, STABLE), want)


def test_a_new_shape_founds_a_family_and_a_distant_frequency_too():
    X = np.eye(4, dtype=complex)
    first = (X[:, :2], np.array([100.0, 200.0]))
    second = (X[:, [2, 0]], np.array([150.0, 101.0]))
    third = (X[:, [0]], np.array([900.0]))
    families = ModeFamilies()
    got = [
        families.add(*sample, STABLE[: sample[1].size]).tolist()
        for sample in (first, second, third)
    ]
    assert got == [[0, 1], [2, 0], [3]]
    np.testing.assert_array_equal(np.array(families.vectors).T, X[:, [0, 1, 2, 0]])
    assert families.frequencies == [100.0, 200.0, 150.0, 900.0]


def flutter(detuning, third=1.3, damping=0.0):
    """Modes of two of three oscillators coupled by friction, and which grow.

    They merge while the detuning is below 0.02, in a growing and a decaying mode.
    """
    K = np.diag([1.0 + detuning, 1.0 - detuning, third])
    K[0, 1], K[1, 0] = 0.02, -0.02
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-K, -damping * np.eye(3)]])
    s, Z = la.eig(A)
    order = np.lexsort((s.real, s.imag))[3:]
    s, X = s[order], Z[:3, order]
    return X / np.linalg.norm(X, axis=0), 1000 * s.imag, s.real > 1e-9


@pytest.mark.parametrize("damping", [0.0, 1e-3])
@pytest.mark.parametrize("seed", range(6))
def test_flutter_of_random_detuning_is_one_family(seed, damping):
    """Its growing mode has a MAC of 0 to 1 with itself over the window, and 0.5 with real modes."""
    rng = np.random.default_rng(seed)
    families = ModeFamilies()
    growing, third = [], []
    for detuning in rng.uniform(-0.05, 0.05, 200):
        X, f, grows = flutter(detuning, damping=damping)
        turn = rng.permutation(3)
        family = families.add(X[:, turn], f[turn], grows[turn])
        growing += family[grows[turn]].tolist()
        third.append(family[turn == 2].item())
    assert len(growing) > 50 and len({*growing}) == 1
    assert len({*third}) == 1 and third[0] not in growing
    assert len(families.grown) == 1


def test_blocks_know_the_family_that_has_grown():
    """A family founded by real modes is one with that of a block that began in flutter."""
    first, beyond = ModeFamilies(), ModeFamilies()
    first.add(*flutter(0.06))
    for detuning in (0.019, -0.019, 0.0, 0.05):
        X, f, grows = flutter(detuning)
        known = ModeFamilies(known=first)
        (family,) = known.add(X, f, grows)[grows] if grows.any() else (0,)
        assert len(known.vectors) == 3 and family in (0, 1)
        beyond.add(X, f, grows)
        assert len(beyond.vectors) == 3 and len(beyond.grown) == 1


def test_another_growing_mode_is_no_member_of_a_grown_family():
    """Modes that share one of two merging modes, and a mode of its own that grows by little."""
    families = ModeFamilies()
    eye = np.eye(4, dtype=complex)
    f = np.full(4, 1000.0)
    assert families.add(eye, f, STABLE[:4]).tolist() == [0, 1, 2, 3]
    grows = np.array([True])
    pair = begins(0, 1, 0.03)[:, None]
    one = families.add(pair, f[:1], grows).item()
    other = families.add(begins(2, 3, 0.07)[:, None], f[:1], grows).item()
    alone = families.add(eye[:, [1 - one]] + 0.01j * eye[:, [3]], f[:1], grows).item()
    assert one in (0, 1) and other in (2, 3) and alone == 1 - one
    assert families.add(pair.conj(), f[:1], grows).item() == one


def begins(first, second, mu):
    """Growing mode of two of four oscillators just beyond the friction at which they merge."""
    K = np.diag([1.0, 1.04, 1.1, 1.2])
    K[first, second], K[second, first] = mu, -mu
    kappa, X = la.eig(K)
    return X[:, np.argmax(kappa.imag)]


def test_sum_and_difference_of_two_modes_that_merge_are_one_family():
    """What couples them has either sign; modes that share one of the two are others."""
    one, other = begins(0, 1, 0.0205), begins(0, 1, -0.0205)
    assert mac(one[:, None], other[:, None])[0, 0] < 0.1
    merging = np.array([1.0, 1.0, 0.0, 0.0]) / np.sqrt(2) + 0j
    vectors = [merging, one, begins(2, 3, 0.055), 1j * other, begins(1, 2, 0.035)]
    onsets = Onsets(np.array(vectors).T)
    family, first = onsets.families(np.ones(5))
    assert family == [0, 0, 1, 0, 2] and first == [1, 2, 4]
    assert onsets.sizes.tolist() == [1, 2, 2, 2, 2]


def test_onsets_take_the_number_of_the_mode_that_squeals():
    """Not that of the real mode which they resemble as much."""
    known = np.eye(4, dtype=complex)
    known[:, 1] = begins(0, 1, 0.03)
    onsets = Onsets(np.array([begins(0, 1, -0.0205), begins(2, 3, 0.055)]).T)
    likeness = onsets.like([0, 1], Onsets(known))
    numbers = known_numbers(likeness.T)
    assert numbers[0] == 1 and numbers[1] in (2, 3)
    assert likeness[0, 1] > 0.99 and likeness[0, 0] < 0.7
    assert known_numbers(onsets.like([0, 1], Onsets(np.zeros((4, 0)))).T) == [0, 1]
    assert known_numbers(mac(known, np.eye(4)[:, :0])) == []

"""Families of modes over samples: permuted, mixed and new shapes."""

import numpy as np
import scipy.linalg as la

from brake_fenicsx.mac import mac
from brake_fenicsx.results.families import ModeFamilies, Onsets, known_numbers


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
        np.testing.assert_array_equal(families.add(X, f), want)


def test_a_new_shape_founds_a_family_and_a_distant_frequency_too():
    X = np.eye(4, dtype=complex)
    first = (X[:, :2], np.array([100.0, 200.0]))
    second = (X[:, [2, 0]], np.array([150.0, 101.0]))
    third = (X[:, [0]], np.array([900.0]))
    families = ModeFamilies()
    got = [families.add(*sample).tolist() for sample in (first, second, third)]
    assert got == [[0, 1], [2, 0], [3]]
    np.testing.assert_array_equal(np.array(families.vectors).T, X[:, [0, 1, 2, 0]])
    assert families.frequencies == [100.0, 200.0, 150.0, 900.0]


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

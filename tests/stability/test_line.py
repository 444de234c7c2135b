"""Modes along a line, on the vectors of a few of its values, against dense full order at each."""

from itertools import pairwise

import numpy as np
import pytest

from brake_fenicsx.stability import ContactLinearisation
from brake_fenicsx.stability.substructures.parameter_line import HELD, Basis
from reduced_samples import K0, ZETA, Sample, offline, scattered

FRICTION = np.r_[0.0, 0.8, np.linspace(0.1, 0.7, 7)]
CONSTANT, CHANGING = (), (0.3, -0.5)


def stiffness(scene, mu):
    """Two decades, three in ten elements open, all moved by friction; two open one by one."""
    k = scattered(scene, 3) * (1 + 0.3 * mu * np.sin(np.arange(scene.w.size)))
    first, second = np.flatnonzero(k)[:2]
    k[first] *= max(0.0, 1 - mu / 0.35)
    k[second] *= mu < 0.55
    return k


@pytest.mark.parametrize(
    "case, x",
    [
        ("undamped", CONSTANT), ("undamped", CHANGING),
        *(pytest.param(*given, marks=pytest.mark.slow)
          for given in [("rayleigh", CONSTANT), ("loss", CONSTANT), ("layers", CHANGING)]),
    ],
)  # fmt: skip
def test_every_mode_between_full_values(two_blocks, case, x):
    """Elements open along the line, by degrees and at once: none missed, errors covered.

    Catches a residual that forgets a term, a trial space of right vectors alone, and errors of the
    interpolated moments that are lost between full values.
    """
    scene, line = two_blocks("coarse"), Basis(1e-5)
    model = offline(scene, case, changing=bool(x))
    for mu in FRICTION:
        sample = Sample(scene, case, x, mu, k=stiffness(scene, mu))
        found = line.modes(model, sample.x, sample.contact, ZETA)
        assert sample.agrees(found) < 3e-5
    assert line.full + line.projected == FRICTION.size
    assert line.projected >= 3


@pytest.mark.parametrize("case", ["turning", "sliding", "falling"])
def test_what_a_line_does_not_know_is_computed_in_full(two_blocks, case):
    """Rotation, and forces that follow rates: no residual is known of them."""
    scene, line = two_blocks("coarse"), Basis(1e-5)
    model = offline(scene, case)
    for mu in FRICTION[:5]:
        sample = Sample(scene, case, mu=mu, k=stiffness(scene, mu))
        found = line.modes(model, sample.x, sample.contact, ZETA)
        assert found.s.tobytes() == sample.modes(model).s.tobytes()
    assert line.projected == 0


def test_other_materials_begin_anew(two_blocks):
    """A point of the box has no vectors for another one."""
    scene, line = two_blocks("coarse"), Basis(1e-5)
    model = offline(scene, changing=True)
    for x in ((0.0, 0.0), (0.5, 0.5), (-0.5, 0.2)):
        sample = Sample(scene, x=x, mu=0.4)
        found = line.modes(model, sample.x, sample.contact, ZETA)
        assert found.s.tobytes() == sample.modes(model).s.tobytes()
    assert (line.full, line.projected) == (3, 0)


def test_where_nothing_suffices_the_line_gives_up(two_blocks):
    """Stiffness drawn anew at each value: after some in a row no more are tried; all are right."""
    scene, line = two_blocks("coarse"), Basis(1e-12)
    model = offline(scene)
    for seed in range(HELD + 4):
        sample = Sample(scene, mu=0.1 * seed, seed=seed)
        found = line.modes(model, sample.x, sample.contact, ZETA)
        assert found.s.tobytes() == sample.modes(model).s.tobytes()
    assert (line.full, line.projected) == (HELD + 4, 0)


@pytest.mark.hard
def test_modes_that_cross_between_full_values(two_blocks):
    """No friction, contact 300 times stiffer at the end: crossings without coupling, to 1e-5."""
    scene, line = two_blocks("coarse"), Basis(1e-5)
    model, orders = offline(scene), []
    scales = 10 ** np.r_[-1.5, 1.0, np.linspace(-1.4, 0.9, 12)]
    for scale in scales:
        sample = Sample(scene, mu=0.0, k=np.full(scene.w.size, scale * K0))
        found = line.modes(model, sample.x, ContactLinearisation.of(sample.k, 0.0), ZETA)
        assert sample.agrees(found) < 3e-5
        orders.append(found)
    assert line.projected >= 6
    # Of neighbours in frequency some have changed places: their shapes say so.
    swapped = 0
    for a, b in pairwise(orders[2:]):
        likeness = np.abs(a.left.conj().T @ b.right)
        swapped += int(np.sum(np.diff(likeness.argmax(axis=1)) < 0))
    assert swapped

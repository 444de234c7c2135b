"""Random inputs of a sample."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from brake_fenicsx.build.values import quantile
from brake_fenicsx.samples.sampling import (
    Roughness,
    draw_sample,
    points_of,
    sample_count,
    sample_seed,
)
from brake_fenicsx.scene import Distribution, read_scene
from brake_fenicsx.surface import match_moments
from coarse_block import BLOCK
from contact_alone import at_contact

CHANGES = [
    "stages=['surface','equilibrium','stability','uncertainty']",
    "surface.statistics={ S_q = '3 um' }",
    "contact.block_plate.gap=hdf",
    "samples.n=4",
]
HDF = Roughness(hdf=match_moments(33.1e-6, -0.241, 3.6549))


def contact(elements):
    interface = np.zeros(elements, dtype=int)
    return SimpleNamespace(interface=interface, speed=np.full(elements, 2.0))


def sample(k: int, changes=(), elements: int = 4000):
    scene = read_scene(BLOCK, [*CHANGES, *changes])
    return draw_sample(scene, "multi-scale", k, at_contact(contact(elements)), HDF)


def test_sample_can_be_drawn_again_alone():
    assert np.array_equal(sample(3).laws.g_cr, sample(3).laws.g_cr)
    assert sample(3).seed == sample_seed(1, 3)


def test_samples_and_seeds_differ():
    assert not np.array_equal(sample(0).laws.g_cr, sample(1).laws.g_cr)
    assert not np.array_equal(sample(0).laws.g_cr, sample(0, ["samples.seed=2"]).laws.g_cr)


def test_naming_another_random_input_leaves_the_gaps_alone():
    """Each kind of draw has its own stream."""
    law = "{ law = 'normal', mean = 0.5, sd = 0.05 }"
    with_mu = sample(0, [f'samples.random."contact.block_plate.friction"={law}'])
    assert np.array_equal(sample(0).laws.g_cr, with_mu.laws.g_cr)
    assert np.all(sample(0).friction.mu == 0.5)
    assert np.all(with_mu.friction.mu == with_mu.friction.mu[0])
    assert with_mu.friction.mu[0] != 0.5


def test_rows_of_saltelli_share_their_gaps():
    """Two inputs, five rows of a block: A, two crossed ones; A and B with the roughness of B."""
    laws = [
        f"samples.random.{key}={{ law='uniform', spread=0.1 }}"
        for key in ('"contact.block_plate.friction"', '"materials.lining.E_3"')
    ]
    joint = [*laws, "samples.design=saltelli", "samples.n=80", "samples.approaches=['joint']"]
    scene = read_scene(BLOCK, [*CHANGES, *joint])
    points = points_of(scene, "joint")
    assert sample_count(scene, "joint") == len(points) == 80
    rows = [
        draw_sample(scene, "joint", k, at_contact(contact(50)), HDF, points[k]) for k in range(10)
    ]
    gaps = [row.laws.g_cr for row in rows]
    same = [[np.array_equal(a, b) for b in gaps] for a in gaps]
    group = [0, 0, 0, 1, 1, 2, 2, 2, 3, 3]
    assert same == [[a == b for b in group] for a in group]
    assert rows[3].values == rows[0].values and rows[4].values != rows[0].values
    assert len({row.seed for row in rows}) == 10
    # Beside joint, multi-scale samples are independent ones, whatever the design.
    alone = draw_sample(scene, "multi-scale", 1, at_contact(contact(50)), HDF)
    assert not np.array_equal(alone.laws.g_cr, gaps[0])


def test_critical_gaps_follow_the_heights():
    """Eq. (16): distribution of the heights, zero mean; bounds are four standard errors."""
    g = np.concatenate([sample(k).laws.g_cr for k in range(10)])
    n = g.size
    assert abs(g.mean()) < 4 * 33.1e-6 / np.sqrt(n)
    assert g.std() == pytest.approx(33.1e-6, rel=4 * np.sqrt((3.6549 - 1) / 4 / n))
    assert stats.skew(g) == pytest.approx(-0.241, abs=0.1)


def test_classical_sample_is_perfect_contact():
    scene = read_scene(BLOCK, CHANGES)
    s = draw_sample(scene, "classical", 0, at_contact(contact(5)))
    assert np.all(s.laws.g_cr == 0)
    np.testing.assert_array_equal(s.friction.mu, 0.5)
    assert s.laws.stiffness(np.full(5, -1e-6)) == pytest.approx(2e13)
    assert np.all(s.laws.pressure(np.full(5, 1e-9)) == 0)


def test_friction_may_be_left_out_of_the_equilibrium():
    s = sample(0, ["contact.block_plate.friction_in_equilibrium=false"])
    np.testing.assert_array_equal(s.friction.mu, 0.5)
    np.testing.assert_array_equal(s.friction.equilibrium, 0.0)


def test_truncated_normal_has_its_closed_form_mean():
    """mean + sd (phi(a) - phi(b)) / (Phi(b) - Phi(a))."""
    d = Distribution("normal", 0.5, 0.05, 0.5, 0.7)
    values = quantile(d, np.random.default_rng(1).random(20000))
    b = 0.2 / 0.05
    exact = 0.5 + 0.05 * (stats.norm.pdf(0) - stats.norm.pdf(b)) / (stats.norm.cdf(b) - 0.5)
    assert np.mean(values) == pytest.approx(exact, abs=4 * 0.03 / np.sqrt(20000))
    assert min(values) >= 0.5
    assert max(values) <= 0.7

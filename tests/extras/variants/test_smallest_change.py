"""The smallest change that is enough: samples whose borders are known."""

import numpy as np
import pytest
from scipy.stats import beta, binom

from brake_fenicsx.extras.variants.countermeasure_keys import Countermeasure
from brake_fenicsx.extras.variants.together import Grid, _cells
from brake_fenicsx.extras.variants.trial import MOST, allowed, few, limits, needed, smallest_change

N, STEPS, ACCURACY = 160, 8, 0.01


class Samples:
    """Samples that each squeal from the scene's value to a border of their own."""

    def __init__(self, squeal):
        self.squeal, self.asked = squeal, []

    def __call__(self, x):
        for k in range(N):
            self.asked.append(x)
            yield bool(self.squeal(x, k))


@pytest.mark.parametrize(("start", "stop"), [(0.5, 0.1), (0.1, 0.5), (2e9, 5e9), (-1.0, 1.0)])
def test_border_of_the_sample_that_must_be_stopped(start, stop):
    """Of 160 samples three may squeal: the answer is the fourth border from the far end."""
    borders = np.random.default_rng(4).permutation(np.linspace(0.05, 0.93, N))
    samples = Samples(lambda x, k: (x - start) / (stop - start) < borders[k])
    found = smallest_change(samples, (start, stop), N, STEPS, ACCURACY)
    share, exact = (found.value - start) / (stop - start), np.sort(borders)[-4]
    assert 0 <= share - exact <= ACCURACY * (1 + 1e-6)
    assert (found.share.hits, found.share.n) == (np.sum(borders > share), N)
    assert found.share.hits <= 3 == allowed(N)
    # Eight steps and the halves of one: 1 % of the range after four.
    assert np.unique(samples.asked).size <= 8 + 4


def test_samples_that_cannot_change_the_answer_are_not_asked():
    """All squeal: four samples a value; at the farthest one, whose share is told, all of them."""
    samples = Samples(lambda x, k: True)
    found = smallest_change(samples, (0.0, 8.0), N, STEPS, ACCURACY)
    assert found.value is None and found.share.hits == N
    values, counts = np.unique(samples.asked, return_counts=True)
    np.testing.assert_allclose(values, np.arange(1.0, 9.0))
    assert list(counts) == [4] * 7 + [4 + N]


def test_none_is_enough_and_the_share_left_is_told():
    samples = Samples(lambda x, k: k < 40 or x < 0.3)
    found = smallest_change(samples, (0.0, 1.0), N, STEPS, ACCURACY)
    assert found.value is None
    assert found.share.value == pytest.approx(1 / 4) and found.share.low < 1 / 4 < found.share.high


@pytest.mark.parametrize("n", [1, 20, 58, 59, 60, 92, 93, 160, 300, 1000])
def test_samples_that_may_squeal_by_the_binomial_distribution(n):
    """One more, and 5 % of all could squeal with a probability above 5 %."""
    hits = allowed(n)
    assert hits == 0 or binom.cdf(hits, n, MOST) < 0.05
    assert binom.cdf(hits + 1, n, MOST) >= 0.05
    high = limits(hits, n)[1]
    assert (high <= MOST) == (n >= 59)
    assert high == pytest.approx(beta.isf(0.05, hits + 1, n - hits))
    assert binom.cdf(hits, n, high) == pytest.approx(0.05)


def test_limits_of_a_share_cover_it_and_say_how_many_samples_are_needed():
    """Nine of ten intervals hold the true share, one-sided 95 of 100; none of none, all of all."""
    hits = np.random.default_rng(3).binomial(80, 0.3, 4000)
    low, high = np.array([limits(int(h), 80) for h in hits]).T
    assert np.mean(low > 0.3) < 0.06 and np.mean(high < 0.3) < 0.06
    assert limits(0, 12)[0] == 0.0 and limits(12, 12)[1] == 1.0
    for h, n in ((0, 12), (1, 60), (3, 80)):
        more = needed(h, n)
        again = int(np.ceil(h / n * more - 1e-9))
        assert (
            limits(again, more)[1] <= MOST < limits(int(np.ceil(h / n * (more - 1))), more - 1)[1]
        )
    assert needed(0, 12) == 59 and needed(10, 100) is None and few(5, 100) and not few(6, 100)


def test_the_smallest_change_of_two_numbers():
    """Least sum of both steps; of equal sums that with fewer samples; none where none is enough."""
    hits = np.array([[60, 30, 9, 0], [40, 20, 0, 0], [30, 0, 0, 0], [1, 0, 0, 0]])
    lever, line = Countermeasure("a.b", 1.0), np.linspace(0, 1, 4)

    def smallest(hits):
        return Grid((lever, lever), (line, line), hits, 60).smallest

    assert smallest(hits) in {(0, 3), (1, 2), (2, 1)}
    hits[0, 3] = hits[2, 1] = 1
    assert smallest(hits) == (1, 2) and smallest(hits + 1) is None


def found_shares(n, most, seeds=2000):
    """True shares at the values that searches find: borders of all samples are uniform."""
    out = []
    for seed in range(seeds):
        borders = np.sort(np.random.default_rng(seed).random(n))
        # The search without its steps: the border of the sample that must be stopped.
        out.append(1 - borders[-1 - most])
    return np.array(out)


@pytest.mark.parametrize("n", [60, 300])
def test_a_found_change_is_seldom_too_small_and_its_run_confirms_it(n):
    """Against the closed form, and against a search that stops at 5 % of its own samples."""
    found, draws = found_shares(n, allowed(n)), np.random.default_rng(1)
    wrong = binom.cdf(allowed(n), n, MOST)
    assert np.mean(found > MOST) == pytest.approx(wrong, abs=0.02) and wrong < 0.05
    confirmed = np.mean([few(draws.binomial(n, q), n) for q in found])
    # The true share is beta distributed: expectation of the binomial distribution over it.
    q = (np.arange(2000) + 0.5) / 2000
    weights = beta.pdf(q, allowed(n) + 1, n - allowed(n)) / 2000
    assert confirmed == pytest.approx(weights @ binom.cdf(int(MOST * n), n, q), abs=0.02)
    assert confirmed > 0.9
    bare = found_shares(n, int(MOST * n))
    assert np.mean(bare > MOST) > 0.5
    assert np.mean([few(draws.binomial(n, q), n) for q in bare]) < 0.6


def test_where_no_pair_is_enough_the_best_one_is_named():
    """Of two countermeasures; a value of the scene is marked."""
    ends = [Countermeasure(key, 1.0, 1.0, 2.0) for key in ("contact.a.friction", "materials.b.nu")]
    grid = Grid((ends[0], ends[1]), (np.array([1.0, 2]),) * 2, np.array([[9, 8], [5, 7]]), 10)
    said, share, *_ = _cells(grid, {"verified": "no"}, "")
    best = "contact.a.friction = 2.0, materials.b.nu = 1.0 (as now)"
    assert said == f"none; fewest samples squeal with {best}" and share.startswith("50 %")

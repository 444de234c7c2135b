"""The smallest change that is enough: samples whose borders are known."""

import numpy as np
import pytest

from brake_fenicsx.variants.trial import smallest_change

N, STEPS, ACCURACY = 60, 8, 0.01


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
    """Of 60 samples three may squeal: the answer is the fourth border from the far end."""
    borders = np.random.default_rng(4).permutation(np.linspace(0.05, 0.93, N))
    samples = Samples(lambda x, k: (x - start) / (stop - start) < borders[k])
    found = smallest_change(samples, (start, stop), N, STEPS, ACCURACY)
    share, exact = (found.value - start) / (stop - start), np.sort(borders)[-4]
    assert 0 <= share - exact <= ACCURACY * (1 + 1e-6)
    assert (found.share.hits, found.share.n) == (np.sum(borders > share), N)
    assert found.share.hits <= 3


def test_samples_that_cannot_change_the_answer_are_not_asked():
    """All squeal: four samples a value; at the farthest one, whose share is told, all of them."""
    samples = Samples(lambda x, k: True)
    found = smallest_change(samples, (0.0, 8.0), N, STEPS, ACCURACY)
    assert found.value is None and found.share.hits == N
    values, counts = np.unique(samples.asked, return_counts=True)
    np.testing.assert_allclose(values, np.arange(1.0, 9.0))
    assert list(counts) == [4] * 7 + [4 + N]


def test_none_is_enough_and_the_share_left_is_told():
    samples = Samples(lambda x, k: k < 20 or x < 0.3)
    found = smallest_change(samples, (0.0, 1.0), N, STEPS, ACCURACY)
    assert found.value is None
    assert found.share.value == pytest.approx(1 / 3) and found.share.low < 1 / 3 < found.share.high


def test_accuracy_is_reached_by_few_values():
    """Eight steps and the halves of one: 1 % of the range after four."""
    samples = Samples(lambda x, k: x < 0.99)
    found = smallest_change(samples, (0.0, 1.0), N, STEPS, ACCURACY)
    assert found.value == pytest.approx(0.9921875)
    assert np.unique(samples.asked).size == 8 + 4

"""The end of an iteration: each column by itself, at its tolerance or where steps gain nothing."""

import numpy as np
import pytest

from brake_fenicsx.iteration import Steps, remaining, sizes


def iterated(rates, noise=0.0, tolerance=1e-8, most=60, seed=0):
    """x = rate x + 1 of a column for each rate, every step with some noise; steps and errors."""
    rates = np.asarray(rates, float)
    rng = np.random.default_rng(seed)
    x, exact = np.zeros((1, rates.size)), 1 / (1 - rates)
    steps = Steps(rates.size, tolerance, most)
    while steps.moving.any():
        step = rates * x + 1 - x + noise * exact * rng.uniform(-1, 1, x.shape)
        x = np.where(steps.take(*sizes(step, x)), x + step, x)
    return steps, np.abs(x[0] / exact - 1)


def test_what_is_left_bounds_the_error_of_every_column():
    """Fast, slow and alternating contraction: each ends by itself, the estimate above the error."""
    steps, error = iterated([0.01, 0.5, 0.8, -0.6], most=200)
    assert np.all(error <= 1.001 * steps.left) and np.all(steps.left <= 1e-8)


@pytest.mark.parametrize("noise", [1e-12, 1e-7, 1e-3])
def test_ends_where_noise_leaves_nothing_to_gain(noise):
    """A tolerance below the noise ends at the noise, in steps that no allowance limits."""
    steps, error = iterated([0.1, 0.3], noise, tolerance=1e-300, most=10_000)
    assert steps.taken < 100
    assert np.all(error <= steps.left) and np.all(steps.left < 100 * noise)


def test_a_column_that_diverges_spoils_no_other():
    """The contraction of one column is lost; the other reaches its tolerance."""
    steps, error = iterated([0.3, 3.0])
    assert error[0] <= steps.left[0] <= 1e-8
    assert steps.left[1] > 0.1 and not np.isnan(steps.left).any()


def test_too_few_steps_say_what_is_left():
    steps, error = iterated([0.9], most=10)
    assert steps.taken == 10
    assert 1e-8 < error[0] <= steps.left[0]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_step_that_is_no_number_is_not_taken(bad):
    """The column ends with an infinite rest, never nan; the step is not to be added."""
    steps = Steps(2, 1e-8, 60)
    assert steps.take(np.array([0.1, bad])).tolist() == [True, False]
    assert steps.moving.tolist() == [True, False]
    assert np.isinf(steps.left[1]) and np.isfinite(steps.left[0])


def test_steps_of_columns_without_size():
    """Zero columns, of an open contact: no overflow, and the end after the first step."""
    zero = np.zeros((3, 1))
    steps = Steps(1, 1e-8, 60)
    with np.errstate(all="raise"):
        steps.take(*sizes(zero, zero))
    assert not steps.moving.any() and steps.left[0] == 0.0


def test_remaining_is_the_sum_of_the_steps_to_come():
    """1/2 + 1/4 + ... = 1; of no rate, what the slowest believed one leaves."""
    assert remaining(1.0, 0.5) == pytest.approx(1.0)
    assert np.isfinite(remaining(1.0, np.nan)) and remaining(np.nan, 0.5) == np.inf

"""No estimated error is nan, and one that is counts as missed wherever it is read."""

from dataclasses import replace

import numpy as np
import pytest

from brake_fenicsx.results.run import eigenvalue_errors
from brake_fenicsx.samples.solve import _missed
from brake_fenicsx.stability.modes import relative_errors
from brake_fenicsx.stability.substructures.parameters import InterpolatedCoefficients
from brake_fenicsx.sweeps.matching import State, equal
from dense_reference import all_damped
from reduced_samples import BAND, HIGH, Sample, followed, substructures
from sweep_models import hoffmann, modes_of


@pytest.fixture
def undefined():
    """Two modes, of which the second has an estimate that is no number."""
    modes = modes_of(*hoffmann(0.8))
    return replace(modes, error=np.array([1e-9, np.nan]))


def test_modes_hold_no_nan(undefined):
    """The verdict is neutral, the error infinite and so beyond any tolerance."""
    assert undefined.error.tolist() == [1e-9, np.inf]
    assert undefined.verdict[1] == "neutral"
    assert _missed(undefined, 1e300) == 1


def test_stored_nan_counts_as_missed():
    """Tables of an earlier version may hold nan: relative errors are infinite."""
    s = np.array([1j, 2j, 1e-9j])
    found = relative_errors(s, np.array([1e-6, np.nan, 1.0]))
    assert found[1] == np.inf and np.isnan(found[2])
    table = {"real_1_s": s.real, "frequency_hz": s.imag / (2 * np.pi)}
    assert eigenvalue_errors({**table, "error_estimate": np.array([0, np.nan, 0])})[1] == np.inf


def test_eigenvalues_of_unknown_error_may_be_equal(undefined):
    """A sweep takes two of them for one as far as is known: it looks closer."""
    state = State.of(0.8, undefined)
    assert equal(state, (0, 1))


@pytest.mark.parametrize("last", [0.0, 1e-30, 1e-24, 1e-10, 1.0])
def test_gain_of_moments_that_hardly_change(last):
    """Moments whose changes are round-off, down to squares that single precision cannot hold.

    A body far above the band: a ratio of two round-offs was nan, and with it every verdict neutral.
    """
    moments, rng = InterpolatedCoefficients([4], [4, 2, 1]), np.random.default_rng(0)
    A = rng.standard_normal((3, 4, 4)) * np.array([1.0, 1e-9, last])[:, None, None]
    for i in moments.order:
        x, n = float(moments.points[i][0]), moments.counts[i]
        moments.add(i, (A / (1 + 0.2 * x) + A * 1e-9 * rng.standard_normal(A.shape))[:n])
    arrays = moments.arrays()
    assert np.all(np.isfinite(arrays["gain"]))
    known = {**arrays, "higher": arrays["higher"], "checks": arrays["checks"]}
    D, errors, growth = InterpolatedCoefficients([4], [4, 2, 1], known).at(np.array([0.37]))
    assert np.isfinite(growth) and all(np.isfinite(e).all() for e in errors)
    off = [np.abs(D[n] - A[n] / (1 + 0.2 * 0.37)).max() for n in range(3)]
    stated = [sum(np.abs(e[n]).max() for e in errors) for n in range(3)]
    single = 1e-6 * np.abs(A).max(axis=(1, 2))
    assert np.all(np.array(off) <= growth * np.array(stated) + single)


def test_a_mode_that_grows_as_fast_as_it_turns_is_listed(two_blocks):
    """Falling friction, lambda = (0.80 + 0.84i) of the band's end: |lambda| lies beyond 1.1 of it.

    Its frequency lies within the band; the search ended at |lambda| of 1.1, and the count said
    complete. Beyond the band's end the polynomials in the frequency are continued, and the stated
    error is per cents, by the mesh; the true one lies within it.
    """
    from brake_fenicsx.stability import reduce_bodies
    from brake_fenicsx.stability.damping_matrices import friction_damping
    from brake_fenicsx.stability.substructures import CONSTANT
    from brake_fenicsx.stability.substructures.reduced_model import LISTED

    scene = two_blocks("coarse")
    bodies = substructures(scene, "falling", False)
    model = reduce_bodies(bodies, scene.w, BAND, CONSTANT, followed("falling"))
    sample = Sample(scene, "falling", mu=0.3, seed=6)
    sample.along = 40 * sample.along
    rates = sample.along, sample.across
    C = friction_damping(scene.T, scene.R, scene.w, *rates).toarray()
    exact = all_damped(sample.M.toarray(), C, sample.K.toarray(), HIGH)
    far = (np.abs(exact) > 1.1 * HIGH) & (np.abs(exact) < LISTED * HIGH)
    (exact,) = exact[far & (exact.imag > 0) & (exact.imag < HIGH)]
    modes = sample.modes(model)
    near = int(np.abs(modes.s - exact).argmin())
    assert abs(modes.s[near] - exact) <= modes.error[near] < 0.05 * abs(exact)
    assert modes.verdict[near] == "unstable"
    assert "1.3 times" in modes.count.how


def test_second_order_where_the_matrix_is_singular():
    """A zero of T just where T is inverted, beside another: an error beyond the band."""
    from brake_fenicsx.stability.substructures.sample_problem import BESIDE, _second_order

    T = np.stack([np.diag([-0.15, -0.15 - BESIDE]), np.eye(2)])
    one = np.ones((2, 1), complex)
    assert _second_order(T, np.array([0.15 + 0j]), BESIDE, one, one)[0] > 1.0
    beside = _second_order(T, np.array([0.16 + 0j]), BESIDE, one, one)
    assert beside[0] == pytest.approx(1 / 0.11 + 1 / 0.01)

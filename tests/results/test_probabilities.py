"""Outcomes of samples and the tables of causes, against closed forms."""

from dataclasses import asdict, replace

from mpi4py import MPI

import numpy as np
import pytest
from scipy import stats

from brake_fenicsx.build.values import quantile
from brake_fenicsx.results.probabilities import (
    Ensemble,
    Outcome,
    cause_tables,
    convergence_rows,
    ensembles,
    find_causes,
    probability_facts,
    probability_rows,
    sensitivity_rows,
)
from brake_fenicsx.results.run import RunData
from brake_fenicsx.samples.designs import design_points, roughness_of
from brake_fenicsx.scene import Distribution, Samples

MU, E3 = "contact.pad_disc.friction", "materials.lining.E_3"
SAMPLES = Samples(approaches=("joint",), random={MU: Distribution("normal", 0.5, 0.05)})


def ensemble(x, growth, good=None):
    good = np.ones(len(x), dtype=bool) if good is None else good
    found = (
        Outcome(scope, where, hertz, growth, -1e-4 * growth)
        for scope, where, hertz in (("band", "0-16000", 8000.0), ("family", "3", 1900.0))
    )
    return explained([Ensemble("joint", (MU, E3), x, good, tuple(found))])[0]


def explained(found):
    find_causes(SAMPLES, found, MPI.COMM_SELF)
    return found


def table(rows):
    return [asdict(row) for row in rows]


def drawn(n, seed=2):
    rng = np.random.default_rng(seed)
    mu = quantile(Distribution("normal", 0.5, 0.05), rng.random(n))
    E = quantile(Distribution("uniform", spread=0.2), rng.random(n), 2e9)
    return np.column_stack([mu, E]), rng


def test_probability_of_a_border_in_one_parameter():
    """Flutter beyond mu_c = 0.54: P = 1 - Phi(0.8), within the interval; mu dominates."""
    x, _ = drawn(4000)
    growth = 300.0 * np.sqrt(np.maximum(x[:, 0] - 0.54, 0.0))
    row = table(probability_rows(SAMPLES, [ensemble(x, growth)]))[1]
    assert row["low"] <= stats.norm.sf(0.8) <= row["high"]
    assert row["dominant_input"] == MU
    assert row["correlation_low"] > 0.5
    assert row["above_limit"] == "no"
    assert (row["scope"], row["where"]) == ("family", "3")


def test_shares_of_the_variance_of_a_sum():
    """growth = 100 + a mu + b E_3 + roughness: shares are the variances of the terms."""
    x, rng = drawn(4000)
    terms = np.array([2.0, 1.0, 1.0])
    z = np.column_stack(
        [(x[:, 0] - 0.5) / 0.05, (x[:, 1] - 2e9) / (0.4e9 / np.sqrt(12)) / 2, rng.normal(size=4000)]
    )
    growth = 100 + z @ terms
    row = table(probability_rows(SAMPLES, [ensemble(x, growth)]))[0]
    exact = np.array([4.0, np.var(z[:, 1]), 1.0])
    exact /= exact.sum()
    found = [row["share_friction"], row["share_materials"], row["share_rest"]]
    np.testing.assert_allclose(found, exact, atol=0.03)
    assert row["share_loads"] == 0.0
    index = table(sensitivity_rows([ensemble(x, growth)]))
    # Always unstable: the verdict never changes and has no index, the growth has two for each.
    assert [r["outcome"] for r in index] == ["growth"] * 4
    assert index[0]["first_low"] <= exact[0] <= index[0]["first_high"]


def test_roughness_is_a_row_of_its_own():
    """Growth of friction and roughness alike, by Saltelli's design: half each, 0 of the modulus."""
    samples = Samples(approaches=("joint",), design="saltelli", random=SAMPLES.random,
                      roughness=True)  # fmt: skip
    plan = samples.plan("joint")
    u = design_points(replace(plan, n=1024 * 5), 2, np.random.SeedSequence(1))
    w = np.random.default_rng(2).random(len(u))
    growth = 1.0 + u[:, 0] + w[[roughness_of(plan, 2, k) for k in range(len(u))]]
    outcome = Outcome("band", "0-16000", 8000.0, growth, -1e-4 * growth)
    e = Ensemble("joint", (MU, E3), u, np.ones(len(u), dtype=bool), (outcome,))
    find_causes(samples, [e], MPI.COMM_SELF)
    rows = table(sensitivity_rows([e]))
    assert [row["input"] for row in rows] == [MU, E3, "roughness"]
    np.testing.assert_allclose([row["total"] for row in rows], [0.5, 0, 0.5], atol=0.05)
    shares = table(probability_rows(samples, [e]))[0]
    assert shares["share_friction"] == pytest.approx(0.5, abs=0.06)
    assert shares["share_rest"] == pytest.approx(0.5, abs=0.06)


def test_failed_samples_count_for_nothing():
    """A failed sample is neither stable nor unstable."""
    x, _ = drawn(100)
    good = np.arange(100) % 4 > 0
    growth = np.where(good, 5.0, 0.0)
    row = table(probability_rows(SAMPLES, [ensemble(x, growth, good)]))[0]
    assert (row["samples"], row["squeal_samples"], row["probability"]) == (75, 75, 1.0)
    assert row["above_limit"] == "yes"
    assert row["median_damping"] == row["severity"] * -1 == pytest.approx(-5e-4)


def test_probability_settles_with_the_samples():
    x, _ = drawn(300)
    growth = np.where(x[:, 0] > 0.5, 1.0, 0.0)
    rows = table(convergence_rows(SAMPLES, [ensemble(x, growth)]))
    whole = [r for r in rows if r["scope"] == "band"]
    assert [r["samples"] for r in whole] == [10, 20, 40, 80, 160, 300]
    width = [r["high"] - r["low"] for r in whole]
    assert width[-1] < 0.5 * width[1]


def results(threshold=0.0):
    """Two samples and a failed one; a family that is stable in one of them."""
    rows = [
        (0, 1000.0, -3.0, "stable", 1), (0, 1000.0, 3.0, "unstable", 0),
        (0, 9000.0, 0.2, "neutral", 2), (1, 1010.0, 1e-9, "stable", 0),
        (1, 15999.0, 7.0, "unstable", 4),
    ]  # fmt: skip
    sample, f, alpha, verdict, family = map(np.array, zip(*rows, strict=True))
    modes = {
        "approach": np.full(5, "joint"), "sample": sample, "mode": np.arange(5), "frequency_hz": f,
        "real_1_s": alpha, "damping": -alpha / (np.pi * f), "verdict": verdict, "family": family,
    }  # fmt: skip
    samples = {
        "approach": np.array(["joint"] * 3 + ["classical"]), "sample": np.array([0, 1, 2, 0]),
        "status": np.array(["ok", "ok", "no", "ok"]), MU: np.array([0.5, 0.5, np.nan, np.nan]),
    }  # fmt: skip
    summary = {"in_effect": {"stability": {"threshold": threshold}}}
    return RunData(None, modes=modes, samples=samples, summary=summary)


def test_outcomes_of_bands_and_families():
    """Decaying and neutral modes are no growth; bands are those of probability_per_band.csv."""
    (e,) = explained(ensembles(results(), (0.0, 16e3)))
    assert e.approach == "joint"
    np.testing.assert_array_equal(e.good, [True, True, False])
    np.testing.assert_array_equal(np.isnan(e.x[:, 0]), [False, False, True])
    growth = {(o.scope, o.where): o.growth[:2].tolist() for o in e.outcomes}
    assert growth["band", "0-16000"] == [3.0, 7.0]
    assert growth["band", "1000-2000"] == [3.0, 0.0]
    assert growth["band", "9000-10000"] == [0.0, 0.0]
    assert growth["band", "15000-16000"] == [0.0, 7.0]
    assert growth["family", "0"] == [3.0, 0.0]
    assert growth["family", "4"] == [0.0, 7.0]
    assert ("family", "2") not in growth


def test_a_threshold_takes_weak_modes_out_of_the_outcomes():
    """Damping -9.5e-4 and -1.4e-4: one of the two is left."""
    (e,) = explained(ensembles(results(2e-4), (0.0, 16e3)))
    growth = {(o.scope, o.where): o.growth[:2].tolist() for o in e.outcomes}
    assert growth["band", "0-16000"] == [3.0, 0.0]
    assert ("family", "4") not in growth
    rows = table(probability_rows(SAMPLES, [e]))
    assert {row["threshold"] for row in rows} == {2e-4}
    assert (rows[0]["probability"], rows[0]["squeal_samples"]) == (0.5, 1)


def test_families_are_ranked_by_share_times_damping():
    """Each in one of two samples; the one that grows more slowly is damped less still."""
    (e,) = explained(ensembles(results(), (0.0, 16e3)))
    found = [o for o in e.outcomes if o.scope == "family"]
    assert [o.where for o in found] == ["0", "4"]
    first = table(probability_rows(SAMPLES, [e]))[len(e.outcomes) - 2]
    assert first["median_damping"] == pytest.approx(-6.0 / (2e3 * np.pi))
    assert first["severity"] == pytest.approx(0.5 * 6.0 / (2e3 * np.pi))


def test_one_sample_that_ended_well_has_no_interval():
    """Three samples of which two failed are one run."""
    x, _ = drawn(3)
    e = ensemble(x, np.array([5.0, 0.0, 0.0]), np.array([True, False, False]))
    rows = table(probability_rows(SAMPLES, [e]))
    rows += table(convergence_rows(SAMPLES, [e]))
    for row in rows:
        assert (row["samples"], row["probability"]) == (1, 1.0)
        assert row["low"] is row["high"] is None
    assert rows[0]["above_limit"] == "open"
    assert probability_facts(SAMPLES, [e])["joint"]["interval"] == [None, None]


def test_tables_are_written_and_the_summary_says_how_stable_modes_count(tmp_path):
    found = explained(ensembles(results(), (0.0, 16e3)))
    facts, tables = probability_facts(SAMPLES, found), cause_tables(SAMPLES, found)
    assert facts["stable_modes"] == "count as growth 0 in every index"
    assert facts["joint"]["probability_of_any"] == 1.0
    for name in ("sensitivity", "probabilities", "convergence"):
        path = tables[name].write(tmp_path / f"{name}.csv")
        assert path.read_text().startswith("approach,threshold,scope,where")

"""Rows and figures of stored samples."""

from types import SimpleNamespace

import numpy as np
import pytest

from brake_fenicsx.results.output import sample_facts, verification
from brake_fenicsx.results.stored import StoredSamples
from brake_fenicsx.results.tables import SAMPLES, write_rows
from brake_fenicsx.samples.forces import mean_friction
from run_tables import read_rows


def sample(kind, missed, how="zeros of T(z)"):
    mode = {"s": np.array([1j, 2j]), "verdict": np.array(["stable", "neutral"]), "count_kind": kind,
            "counted": how, "error": 1e-6 * (1 + missed) * np.array([1.0, 4.0])}  # fmt: skip
    seconds = {f"{name}_seconds": 1.0 for name in ("stability", "equilibrium")}
    return {
        "status": "ok", "seed": 1, "mu": np.ones(2), "random_names": [], "random": [],
        "tolerance_missed": missed, "equilibrium_iterations": 3, **mode, **seconds,
    }  # fmt: skip


def results(*samples):
    """Of one approach, its stored samples."""
    tasks = [("parametric", k) for k in range(len(samples))]
    files = dict(zip(tasks, samples, strict=True))
    return StoredSamples(SimpleNamespace(samples=SimpleNamespace(load=files.get)), tasks)


def test_open_points_of_a_sample_reach_its_row_and_the_summary(tmp_path):
    """What is not counted or not proven is not complete; a failed sample says nothing."""
    found = results(
        sample("proven", 0),
        sample("not counted", 3),
        sample("counted", 1),
        {"status": "no equilibrium"},
    )
    write_rows(tmp_path / "samples.csv", [*found.rows], zip(*found.rows.values(), strict=True))
    rows = read_rows(tmp_path / "samples.csv")
    assert [row["complete"] for row in rows] == ["yes", "no", "no", ""]
    assert [row["tolerance_missed"] for row in rows] == [0, 3, 1, None]
    about = sample_facts(found)["samples"]["parametric"]
    assert (about["not_complete"], about["tolerance_missed"], about["neutral"]) == (2, 4, 3)
    assert about["largest_error"] == pytest.approx(8e-6)


@pytest.mark.parametrize(
    ("kind", "proven", "said"), [("proven", "yes", ""), ("counted", "no", "not proven: "),
                                 ("not counted", "no", "not counted: ")],
)  # fmt: skip
@pytest.mark.parametrize("how", ["", "not counted: by hand, not proven", "complete, proven"])
def test_the_kind_of_a_count_decides_and_no_word(how, kind, proven, said):
    found = results(sample(kind, 0, how))
    assert found.rows["complete"] == [proven]
    about = sample_facts(found)["samples"]["parametric"]
    assert about["not_complete"] == (proven == "no")
    assert about["counted_by"] == said + how


def test_true_errors_of_verified_samples_are_compared_with_their_estimates():
    """Both estimates together bound the difference; one that is no number bounds nothing."""
    one = sample("proven", 0)
    moved, own = np.array([3e-6, 5e-6]), np.array([1.1e-6, 1.1e-6])
    for estimate, beyond in ((np.array([2e-6, 2e-6]), 1), (np.array([2e-6, np.nan]), 1),
                             (np.array([2e-6, 4e-6]), 0)):  # fmt: skip
        full = {"s": one["s"] + moved, "verdict": one["verdict"], "error": own}
        files = {("parametric", 0): one | {"error": estimate}, ("verify", 0): full}
        store = SimpleNamespace(samples=SimpleNamespace(load=files.get))
        study = SimpleNamespace(store=store, verify=[("verify", 0)], verified="parametric")
        check = verification(study)
        assert (check["samples_compared"], check["errors_beyond_estimates"]) == (1, beyond)
        assert check["largest_relative_error"] == pytest.approx(3e-6)


def test_samples_without_modes_have_no_such_columns():
    data = sample("proven", 0)
    for name in ("s", "counted", "count_kind", "tolerance_missed"):
        del data[name]
    assert [*results(data).rows] == [*SAMPLES, "mu"]


def test_equal_friction_is_given_with_every_digit():
    """samples.csv had it twice, in two precisions; only elements that slide count."""
    mu = 0.24797111763653748
    for speed, values, mean in (
        (np.ones(7), np.full(7, mu), mu), (np.ones(7), np.full(7, 0.1), 0.1),
        ([1.0, 2.0, 0.0], np.array([0.2, 0.4, 0.9]), 0.3), (np.zeros(2), np.ones(2), 0.0),
    ):  # fmt: skip
        assert mean_friction(SimpleNamespace(speed=np.array(speed)), values) == mean

"""Entries of the budget against synthetic results whose bias and scatter are known."""

import numpy as np
import pytest

from brake_fenicsx.extras.variants.budget import (
    COLUMNS,
    bias_and_scatter,
    entries,
    extrapolate,
    richardson,
    statistical,
)
from brake_fenicsx.extras.variants.budget_page import sentence, worst_family, write_budget_page
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.tables import write_rows
from run_tables import read_rows

FAMILIES = np.array([3, 8])


def synthetic(folder, frequency, damping, seeds=None):
    """Results of two families with given values in each sample, shape (samples, 2)."""
    folder.mkdir(exist_ok=True)
    n = len(frequency)
    points = np.eye(4, 3)
    shapes = np.zeros((2, 4, 3), np.complex64)
    shapes[0, :, 2], shapes[1, :, 0] = [1, 2, 3, 4], [1, -2, 3, -4]
    path = folder / "shapes.npz"
    if not path.exists():
        np.savez(path, points=points, body=np.zeros(4), families=FAMILIES, shapes=shapes)
    k = np.arange(n)
    flat = damping.ravel()
    modes = {
        "approach": np.full(2 * n, "multi-scale"), "sample": np.repeat(k, 2),
        "mode": np.tile([0, 1], n), "frequency_hz": frequency.ravel(), "damping": flat,
        "verdict": np.where(flat < 0, "unstable", "stable"), "family": np.tile(FAMILIES, n),
    }  # fmt: skip
    samples = {
        "approach": np.full(n, "multi-scale"), "sample": k, "status": np.full(n, "ok"),
        "seed": k if seeds is None else seeds,
    }  # fmt: skip
    return RunData(folder, modes=modes, samples=samples)


def draw(rng, n):
    """Frequencies [Hz] and damping [-] of two families: the first squeals half of the time."""
    frequency = np.array([2000.0, 6000.0]) + 20.0 * rng.standard_normal((n, 2))
    return frequency, np.array([0.0, -0.03]) + 0.01 * rng.standard_normal((n, 2))


def of_family(rows, family):
    return next(r for r in rows if r["family"] == family)


def test_bias_and_scatter_of_a_variant_are_recovered(tmp_path):
    rng, n = np.random.default_rng(1), 400
    f, d = draw(rng, n)
    g = f + np.array([15.0, 0.0]) + np.array([4.0, 0.0]) * rng.standard_normal((n, 2))
    e = d + np.array([2e-3, 0.0]) + np.array([5e-4, 0.0]) * rng.standard_normal((n, 2))
    one, two = synthetic(tmp_path / "a", f, d), synthetic(tmp_path / "b", g, e)
    rows = entries(one, two, True)
    row = of_family(rows, 3)
    # Five standard errors of a median (1.25 s / n^0.5) and of a deviation (s / (2 n)^0.5).
    assert row["frequency_bias_hz"] == pytest.approx(15.0, abs=5 * 1.25 * 4.0 / n**0.5)
    assert row["frequency_scatter_hz"] == pytest.approx(4.0, abs=5 * 4.0 / (2 * n) ** 0.5)
    assert row["damping_bias"] == pytest.approx(2e-3, abs=5 * 1.25 * 5e-4 / n**0.5)
    assert row["damping_scatter"] == pytest.approx(5e-4, abs=5 * 5e-4 / (2 * n) ** 0.5)
    # 0.42 = P(N(0.2, 1.0012) < 0): the damping moved by a fifth of its scatter.
    assert row["change_low"] < 0.42 - 0.5 < row["change_high"]
    silent = of_family(rows, 8)
    assert silent["frequency_bias_hz"] == 0.0 and silent["damping_scatter"] == 0.0
    assert silent["change"] == 0.0


def test_independent_samples_have_no_scatter_of_their_own(tmp_path):
    rng = np.random.default_rng(2)
    one, two = (synthetic(tmp_path / name, *draw(rng, 50)) for name in "ab")
    row = of_family(entries(one, two, False), 3)
    assert row["paired"] == "no" and row["frequency_scatter_hz"] is None
    assert row["frequency_bias_hz"] is not None
    assert of_family(entries(one, two, True), 3)["paired"] == "yes"
    assert bias_and_scatter(np.zeros(0), np.ones(3), False) == (None, None)


@pytest.mark.slow
@pytest.mark.parametrize("paired", [True, False])
def test_intervals_hold_the_truth_at_their_rate(tmp_path, paired):
    """Of 30 budgets of a knob that changes the probability from 0.5 to 0.42, and of none."""
    rng, n, held, zero, budgets = np.random.default_rng(4), 40, 0, 0, 30
    for _ in range(budgets):
        f, d = draw(rng, n)
        other = d if paired else draw(rng, n)[1]
        one = synthetic(tmp_path / "a", f, d)
        moved = of_family(entries(one, synthetic(tmp_path / "b", f, other + 2.0e-3), paired), 3)
        same = of_family(entries(one, synthetic(tmp_path / "b", f, other), paired), 3)
        truth = 0.42074 - 0.5  # of the normal distribution at -0.2
        held += moved["change_low"] <= truth <= moved["change_high"]
        zero += same["change_low"] <= 0.0 <= same["change_high"]
    # Four standard errors below 95 %.
    assert min(held, zero) / budgets >= 0.95 - 4 * (0.95 * 0.05 / budgets) ** 0.5


@pytest.mark.parametrize("order", [1.0, 2.0, 3.7])
@pytest.mark.parametrize("ratio", [1.25, 2.0])
def test_order_and_limit_of_a_series_of_known_order(order, ratio):
    coarse, middle, fine = (1500.0 + 40.0 * ratio ** (-order * k) for k in range(3))
    limit = richardson(coarse, middle, fine, ratio)
    assert limit.order == pytest.approx(order, rel=1e-9)
    assert limit.value == pytest.approx(1500.0, rel=1e-12)
    assert limit.index == pytest.approx(1.25 * (fine - 1500.0), rel=1e-9)


@pytest.mark.parametrize("values", [(1, 2, 1.5), (1, 2, 4), (1, 1, 1), (1, 2, 2), (1, 2, 3)])
def test_values_that_do_not_settle_have_no_order(values):
    """Oscillating, diverging, constant, stopped and growing at a constant rate."""
    assert richardson(*map(float, values), 2.0) is None


def test_two_refinements_give_the_limit_of_the_table(tmp_path):
    rng = np.random.default_rng(5)
    f, d = draw(rng, 30)
    scene = synthetic(tmp_path / "a", f, d)
    rows = []
    for n in (1, 2):
        fine = f + 12.0 * (2.0 ** (-2 * n) - 1.0)
        about = {"knob": "mesh", "variant": f"mesh-{n}", "says": "the mesh"}
        wavy = d + (1e-3 if n == 1 else -1e-3)
        rows += [r | about for r in entries(scene, synthetic(tmp_path / "b", fine, wavy), True)]
    extrapolate(rows, "mesh", 2.0, scene)
    row = [r for r in rows if r["family"] == 3][1]
    assert row["frequency_order"] == pytest.approx(2.0, rel=1e-6)
    assert row["frequency_limit_hz"] == pytest.approx(np.median(f[:, 0]) - 12.0)
    assert row["frequency_gci_hz"] == pytest.approx(1.25 * 12.0 / 16.0)
    assert row["damping_order"] is None and "damping does not settle" in row["reason"]


def test_page_names_the_family_and_the_largest_change(tmp_path):
    rng = np.random.default_rng(6)
    f, d = draw(rng, 40)
    scene = synthetic(tmp_path / "a", f, d)
    rows = statistical(scene)
    for knob, shift, paired in (("mesh", 1e-4, True), ("laws", -8e-3, False)):
        about = {"knob": knob, "variant": f"{knob}-1", "says": f"the {knob}"}
        about |= {"change_made": "finer", "seconds": 1.0, "memory_mb": 100}
        variant = synthetic(tmp_path / "b", f, d + shift)
        rows += [r | about for r in entries(scene, variant, paired)]
    assert worst_family(rows) == ("multi-scale", 3)
    share = float((d[:, 0] < 0).mean())
    said = sentence(rows)
    assert (
        said.startswith("The probability of the 1.998 kHz") and f" family is {share:.2f} [" in said
    )
    assert "the largest other uncertainty is the laws (finer: +0." in said
    write_rows(tmp_path / "budget.csv", COLUMNS, rows)
    assert len(read_rows(tmp_path / "budget.csv")) == len(rows)
    page = write_budget_page(tmp_path, rows, "made <up>").read_text()
    assert "made &lt;up&gt;" in page and said.split(";")[0] in page and "data:image/png" in page


@pytest.mark.hard
def test_budget_of_a_scene_without_squeal_says_so(tmp_path):
    """No family squeals: the sentence says this, and the page has no picture."""
    f, d = draw(np.random.default_rng(7), 10)
    scene = synthetic(tmp_path / "a", f, np.abs(d))
    rows = [*statistical(scene), *entries(scene, scene, True)]
    assert sentence(rows) == "No mode squeals in any sample of the scene."
    assert "data:image" not in write_budget_page(tmp_path, rows, "calm").read_text()


@pytest.mark.hard
def test_family_that_a_variant_silences_changes_by_its_whole_probability(tmp_path):
    """The family has no match in the variant: its probability is zero and its bias unknown."""
    f, d = draw(np.random.default_rng(8), 30)
    quiet = d.copy()
    quiet[:, 1] = 0.01
    one, two = synthetic(tmp_path / "a", f, d), synthetic(tmp_path / "b", f, quiet)
    row = of_family(entries(one, two, True), 8)
    assert row["probability_variant"] == 0.0 and row["change"] == -row["probability"]
    assert row["damping_bias"] is None and row["family_variant"] is None


@pytest.mark.hard
def test_family_that_only_a_variant_has_is_named(tmp_path):
    """The picture shows a family of the scene; the sentence reports the other family."""
    f, d = draw(np.random.default_rng(9), 30)
    quiet = np.column_stack([d[:, 0], np.full(30, 0.01)])
    scene = synthetic(tmp_path / "a", f, quiet)
    about = {"knob": "scan", "variant": "scan-1", "says": "the scan", "change_made": "coarser"}
    rows = [*statistical(scene)]
    rows += [r | about for r in entries(scene, synthetic(tmp_path / "b", f, d), True)]
    (arisen,) = (r for r in rows if r["family"] is None)
    assert arisen["change"] == arisen["probability_variant"] == (d[:, 1] < 0).mean()
    assert worst_family(rows) == ("multi-scale", 3)
    said = sentence(rows)
    assert (
        " kHz squeals in no sample of the scene and in 100 % of 30 samples after a change" in said
    )


@pytest.mark.hard
def test_scene_of_one_sample_has_no_interval(tmp_path):
    """One deterministic sample: the change and the sentence have no interval."""
    f, d = np.array([[2000.0, 6000.0]]), np.array([[-0.01, -0.03]])
    one, two = synthetic(tmp_path / "a", f, d), synthetic(tmp_path / "b", f + 3.0, d)
    rows = statistical(one)
    same = {"knob": "mesh", "variant": "mesh-1", "says": "the mesh", "change_made": "finer"}
    rows += [r | same for r in entries(one, two, True)]
    assert all(r["change_low"] is None for r in rows)
    assert of_family(rows[3:], 3)["frequency_bias_hz"] == pytest.approx(3.0)
    said = sentence(rows)
    assert said.endswith("squeals in the one sample; no variant that was run changes it.")
    write_budget_page(tmp_path, rows, "one")
    # Solved at full order alone it has no families.
    assert sentence([r for r in rows if r["family"] == "any"]).startswith("Modes squeal, but a")

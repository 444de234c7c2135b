"""The hardness of a lining from its compressibility curve."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from brake_fenicsx.errors import SceneError
from brake_fenicsx.micro import LawRecipe, LawSettings, fit_hardness, law_steps
from brake_fenicsx.micro import hardness as module
from brake_fenicsx.surface import given_statistics

PAPER = given_statistics(10e-6, -0.2410, 3.6549)
E_STAR, BULK, TRUTH = 2.3734e9, 2e11, 1.5e8  # a lining of 10 mm; 150 MPa
RECIPE = LawRecipe(
    PAPER.bifractal, PAPER.hdf, LawSettings(E_STAR, boundary="periodic"), shape=(64, 64)
)
NODES = np.geomspace(0.02e6, 2e6, 30)


@pytest.fixture(scope="module")
def pad():
    """Approach [m] of a pad of 24 other patches at 150 MPa, loading and unloading."""
    return np.mean([module._approach(RECIPE, 77, i, TRUTH, NODES) for i in range(24)], axis=0)


@pytest.fixture(scope="module", autouse=True)
def pressed_once():
    """Contacts do not depend on the noise of a curve: each is computed once."""
    memory, press = {}, module._approach

    def remembered(recipe, seed, i, hardness, nodes):
        key = seed, i, hardness, tuple(np.round(nodes, 3))
        if key not in memory:
            memory[key] = press(recipe, seed, i, hardness, nodes)
        return memory[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_approach", remembered)
        yield


def curve(pad, rng=None, bulk=BULK):
    """One cycle of a machine: 0.5 um of noise, 1 % of the closure of each point, an offset."""
    p = np.concatenate([NODES, NODES[-2::-1]])
    closure = np.concatenate([pad[0], pad[1, -2::-1]]) + p / bulk
    closure -= closure[0]
    if rng is not None:
        closure = closure * (1.0 + 0.01 * rng.standard_normal(p.size))
        closure += 0.5e-6 * rng.standard_normal(p.size)
    return np.stack([p, closure + 3e-6], axis=1)


@pytest.mark.parametrize(
    ("families", "least"), [(2, 4), pytest.param(8, 24, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("bulk", [pytest.param(None, marks=pytest.mark.slow), BULK])
def test_interval_contains_the_truth_as_often_as_it_says(pad, bulk, families, least):
    """Four noises on each of some families of surfaces: 90 %, and not far fewer.

    Of 2 independent families 1 or more with a probability of 99 %, of 8 6 or more with 96 %.
    """
    fits = [
        fit_hardness(curve(pad, np.random.default_rng([seed, noise])), RECIPE, bulk, seed=seed)
        for seed in range(families)
        for noise in range(4)
    ]
    assert sum(fit.low <= TRUTH <= fit.high for fit in fits) >= least
    assert np.median([fit.high / fit.low for fit in fits]) < 3.0
    assert np.median([fit.hardness for fit in fits]) == pytest.approx(TRUTH, rel=0.3)


def test_bulk_is_taken_out(pad):
    """A softer lining under the same surface has the same hardness, known or fitted."""
    first, softer = (fit_hardness(curve(pad, bulk=b), RECIPE) for b in (BULK, BULK / 3.0))
    assert softer.hardness == pytest.approx(first.hardness, rel=1e-6)
    added = 1.0 / softer.bulk_stiffness - 1.0 / first.bulk_stiffness
    assert added == pytest.approx(2.0 / BULK, rel=1e-6)
    known = [fit_hardness(curve(pad, bulk=b), RECIPE, b) for b in (BULK, BULK / 3.0)]
    assert known[0].hardness == pytest.approx(known[1].hardness, rel=1e-6)
    assert first.low < known[0].hardness < first.high


def test_first_slope_of_unloading_is_the_stiffness_of_vibrations():
    """From a law, which never unloads: its v at the largest pressure."""
    settings = replace(RECIPE.settings, tolerance=1e-12, hardness=TRUTH, max_pressure=1e6)
    recipe = replace(RECIPE, settings=settings)
    v = law_steps(recipe.surface(3, 0), settings).v[-1]
    falling = module._approach(recipe, 3, 0, TRUTH, np.array([0.5e6, 0.999e6, 1e6]))[1]
    assert 1e3 / (falling[2] - falling[1]) == pytest.approx(v, rel=0.01)


def test_loading_alone_hardly_tells(pad):
    fit = fit_hardness(curve(pad)[: NODES.size], RECIPE)
    assert any("loading alone" in text for text in fit.doubts)


WRONG = {
    "fewer than 5": lambda c: c[26:30],
    "does not rise": lambda c: c * (1.0, -1.0),
    "pressure.*units": lambda c: c * (1e-3, 1.0),
    "pressure .*units": lambda c: c * (1e3, 1.0),
    "closure.*units": lambda c: c * (1.0, 1e3),
    "closure .*units": lambda c: c * (1.0, 1e-3),
    "shape": lambda c: c[:, 0],
    "finite": lambda c: np.where(c == c.max(), np.nan, c),
    "no such file": lambda c: "none.csv",
    "not a table": lambda c: [["a", "b"]],
}


@pytest.mark.parametrize("text", WRONG)
def test_bad_curves_are_refused(pad, text):
    with pytest.raises(SceneError, match=text):
        fit_hardness(WRONG[text](curve(pad)), RECIPE)


def test_the_page_runs(pad, tmp_path, monkeypatch, capsys):
    page = Path(__file__).parents[2] / "docs" / "howto_hardness.md"
    rows = curve(pad) * (1e-6, 1e6)
    np.savetxt(tmp_path / "curve.csv", rows, "%.5f", ",", header="pressure,closure", comments="")
    monkeypatch.chdir(tmp_path)
    exec(re.search(r"```python\n(.*?)```", page.read_text(), re.S)[1], {"recipe": RECIPE})
    assert "MPa" in capsys.readouterr().out

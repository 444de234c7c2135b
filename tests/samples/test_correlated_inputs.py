"""Correlated random inputs: moments of the drawn samples, and what check refuses."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.special import ndtri

from brake_fenicsx.build.values import quantile
from brake_fenicsx.cli import main
from brake_fenicsx.errors import SceneError
from brake_fenicsx.results.probabilities import Ensemble, Outcome, find_causes, probability_rows
from brake_fenicsx.samples.designs import correlated, correlation_root
from brake_fenicsx.samples.sampling import draw_inputs, points_of
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.samples_section import Distribution, Samples
from places import SQUEALING

C33, C44 = (f"materials.lining.{name}" for name in ("C33", "C44"))
FRICTION = "contact.block_plate.friction"
LAW = "law = 'lognormal', mean = '{} GPa', sd = '{} GPa'"


def changes(r=0.7, other=0.0, design="random"):
    """Two stiffnesses and a friction coefficient."""
    return [
        "countermeasures=[]",
        f"samples.design={design}",
        f"samples.random.'{C33}'={{ {LAW.format(2.27, 0.2)}, correlation = {{ '{C44}' = {r} }} }}",
        f"samples.random.'{C44}'={{ {LAW.format(1.18, 0.15)} }}",
        f"samples.random.'{FRICTION}'={{ law = 'normal', mean = 0.45, sd = 0.05, correlation ="
        f" {{ '{C33}' = {other}, '{C44}' = {-other} }} }}",
    ]


@pytest.mark.long
@pytest.mark.parametrize("design", ["random", "latin-hypercube"])
def test_moments_of_drawn_samples(design):
    """Means and deviations of each law stay; the logarithms have the correlation."""
    n = 4000
    scene = read_scene(SQUEALING, [*changes(design=design), f"samples.n={n}"])
    rng, points = np.random.default_rng(3), points_of(scene, "multi-scale")
    drawn = [draw_inputs(scene, "multi-scale", None if points is None else points[k], rng)[0]
             for k in range(n)]  # fmt: skip
    a, b, mu = (np.array([d[name] for d in drawn]) for name in (C33, C44, FRICTION))
    for values, mean, sd in ((a, 2.27e9, 0.2e9), (b, 1.18e9, 0.15e9), (mu, 0.45, 0.05)):
        assert np.mean(values) == pytest.approx(mean, abs=4 * sd / np.sqrt(n))
        assert np.std(values) == pytest.approx(sd, rel=0.06)
    assert np.corrcoef(np.log(a), np.log(b))[0, 1] == pytest.approx(0.7, abs=0.035)
    assert abs(np.corrcoef(np.log(a), mu)[0, 1]) < 0.07


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"r": 0.95, "other": 0.9}, "not positive definite (smallest eigenvalue -"),
        ({"r": 1.2}, "must lie between -1 and 1"),
        ({"design": "saltelli"}, "design = 'saltelli' needs independent inputs"),
    ],
)
def test_check_refuses_correlations_of_no_inputs(words, said, capsys):
    given = [w for change in changes(**words) for w in ("--set", change)]
    assert main(["check", str(SQUEALING), *given, "--set", "samples.n=100"]) == 2
    assert said in capsys.readouterr().err


def test_correlation_with_no_input_is_refused(capsys):
    given = [c.replace("C44' = 0.7", "C66' = 0.7") for c in changes()]
    assert main(["check", str(SQUEALING), *(w for c in given for w in ("--set", c))]) == 2
    assert 'C66": is no random input' in capsys.readouterr().err


def test_a_correlation_with_itself_is_named():
    """It is one; others that there are are named for a key that is none."""
    law = Distribution("uniform", min=0.0, max=1.0, correlation={"a": 0.5})
    with pytest.raises(SceneError, match="of an input with itself; leave it out"):
        correlation_root({"a": law, "b": law}, "random")
    with pytest.raises(SceneError, match=r"is no random input; others are c$"):
        correlation_root({"b": law, "c": law}, "random")


@pytest.mark.hard
@pytest.mark.parametrize("r", [-0.9, 0.0, 0.6, 0.999])
def test_probability_and_index_of_dependent_inputs(r):
    """Both beyond their medians, one truncated, one of two values: P = 1/4 + asin(r) / (2 pi).

    Growth by the score of the first alone: the index of the second is r^2, no shares are given.
    """
    n, names = 4000, (FRICTION, C33)
    laws = {
        FRICTION: Distribution("normal", 0.45, 0.05, 0.35, 0.6, correlation={C33: r} if r else {}),
        C33: Distribution("measured", values=(2e9, 3e9)),
    }
    root = correlation_root(laws, "random")
    u = np.array([correlated(row, root) for row in np.random.default_rng(4).random((n, 2))])
    x = np.column_stack([quantile(laws[name], v) for name, v in zip(names, u.T, strict=True)])
    both = (x[:, 0] > quantile(laws[FRICTION], 0.5)) & (x[:, 1] > 2.5e9)
    growths = both * 1.0, 10 + ndtri(u[:, 0])
    found = [Outcome("band", "0-1", 0.5, growth, -growth) for growth in growths]
    e = Ensemble("joint", names, np.column_stack([x[:, 0], u[:, 1]]), both >= 0, tuple(found))
    samples = Samples(approaches=("joint",), random=laws)
    find_causes(samples, [e], MPI.COMM_SELF)
    row, _ = probability_rows(samples, [e])
    exact = 0.25 + np.arcsin(r) / (2 * np.pi)
    assert abs(row.probability - exact) < 5 * np.sqrt(exact * (1 - exact) / n)
    np.testing.assert_allclose(e.causes[1].growth.first, [1, r**2], atol=0.05)
    assert (row.share_rest is None) == (r != 0)

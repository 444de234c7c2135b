"""Newton's iteration on all displacements against the condensed one."""

from types import SimpleNamespace

import numpy as np
import pytest

from brake_fenicsx.errors import NotConverged, Separated
from brake_fenicsx.macro import EnrichedGap, displacement
from brake_fenicsx.macro.equilibrium import equilibrium, solved
from brake_fenicsx.micro import OneLaw, exponential_law, linear_law
from sparse_equilibrium import sparse_equilibrium


def operators(scene, load=1.0):
    return SimpleNamespace(
        K=scene.elastic.K, N=scene.N, T=scene.T, w=scene.w, g0=scene.g0, f=load * scene.f,
        compliance=scene.compliance,
    )  # fmt: skip


def enriched(law, n):
    g_cr = np.random.default_rng(11).normal(0, 1.5e-6, n)
    return EnrichedGap(OneLaw(law), np.zeros(n, int), g_cr)


LAWS = {"exponential": exponential_law(4e5, 0.8e-6), "linear": linear_law(5e11)}


@pytest.mark.parametrize("kind", list(LAWS))
@pytest.mark.parametrize("mu", [0.0, 0.5, "per element"])
def test_sparse_and_condensed_agree(two_blocks, kind, mu):
    """To 1e-10 in pressures, displacement, iterations: catches friction of an element's neighbour,
    a factor taken for symmetric with friction."""
    scene = two_blocks("guided")
    if mu == "per element":
        mu = np.linspace(0.1, 0.8, scene.w.size)
    ops, laws = operators(scene), enriched(LAWS[kind], scene.w.size)
    dense = equilibrium(ops, laws, mu, steps=2, tolerance=1e-12)
    sparse = sparse_equilibrium(ops, laws, mu, steps=2, tolerance=1e-12)
    np.testing.assert_allclose(sparse.p, dense.p, atol=1e-10 * dense.p.max())
    u = displacement(ops, dense, scene.f)
    np.testing.assert_allclose(sparse.u, u, atol=1e-9 * np.abs(u).max())
    assert len(sparse.iterations) == 2
    assert sparse.residual < 1e-12


def test_residual_of_the_record_is_that_of_the_full_system(two_blocks):
    scene = two_blocks("guided")
    laws, mu = enriched(LAWS["exponential"], scene.w.size), 0.4
    eq = sparse_equilibrium(operators(scene), laws, mu, tolerance=1e-11)
    push = (scene.N + mu * scene.T).T @ (scene.w * laws.pressure(scene.g0 + scene.N @ eq.u))
    assert np.linalg.norm(scene.K @ eq.u - push - scene.f) < 1e-9 * np.linalg.norm(push)


def test_loads_that_pull_and_iterations_that_run_out_are_named(two_blocks):
    scene = two_blocks("guided")
    laws = enriched(LAWS["exponential"], scene.w.size)
    with pytest.raises(Separated):
        sparse_equilibrium(operators(scene, load=-1.0), laws)
    with pytest.raises(NotConverged, match="after 1 iterations"):
        sparse_equilibrium(operators(scene), laws, 0.5, max_iterations=1)


@pytest.mark.parametrize("spread", [0.0, 3.0, 9.0])
def test_refinement_solves_to_double_precision(spread):
    """Backward stable whatever the condition: single precision alone would leave 1e-7, and at a
    spread of nine decades it does not converge and double precision takes over."""
    rng = np.random.default_rng(0)
    n = 120
    A = rng.normal(size=(n, n))
    NN, NT = A @ A.T / n, rng.normal(size=(n, n)) / n
    k = 10 ** rng.uniform(-spread / 2, spread / 2, n)
    dense = np.eye(n) + NN * k + NT * (0.3 * k)
    b = rng.normal(size=n)
    x = solved(dense, b, n)
    backward = np.linalg.norm(dense @ x - b) / (
        np.linalg.norm(dense, 2) * np.linalg.norm(x) + np.linalg.norm(b)
    )
    assert backward < 1e-14
    forward = np.linalg.norm(x - np.linalg.solve(dense, b)) / np.linalg.norm(x)
    assert forward < 1e-13 * np.linalg.cond(dense)

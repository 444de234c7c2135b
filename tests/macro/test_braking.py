"""The public equilibrium: one law, a list, a library; its displacement solves the full system."""

import re

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.errors import NotConverged, SceneError
from brake_fenicsx.macro import equilibrium
from brake_fenicsx.macro.equilibrium import compliance
from brake_fenicsx.micro import exponential_law, linear_law
from brake_fenicsx.pipeline import assemble
from places import BLOCK


@pytest.fixture(scope="module")
def ops():
    return assemble(BLOCK, MPI.COMM_SELF)


@pytest.mark.parametrize("law", [exponential_law(10e6, 10e-6), linear_law(1e12)])
@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_displacement_solves_the_full_system(ops, law, mu):
    """K u = f + (N + mu T)' W p(g0 + N u - g_cr), assembled independently."""
    g_cr = np.random.default_rng(0).normal(0, 2e-6, len(ops.w))
    eq = equilibrium(ops, law, g_cr, mu)
    p = law.pressure(ops.g0 + ops.N @ eq.u - g_cr)
    force = (ops.N + mu * ops.T).T @ (ops.w * p)
    K = ops.K
    assert np.linalg.norm(K @ eq.u - ops.f - force) < 1e-8 * np.linalg.norm(ops.f)
    assert eq.residual < 1e-10
    assert p == pytest.approx(eq.p, rel=1e-6, abs=1e-3)


def test_list_library_and_single_law_agree(ops):
    law, n = exponential_law(10e6, 10e-6), len(ops.w)
    one = equilibrium(ops, law, 0.0, 0.3)
    many = equilibrium(ops, [law] * n, np.zeros(n), 0.3)
    named = equilibrium(ops, [linear_law(1e9), law], 0.0, 0.3, index=np.ones(n, dtype=int))
    assert np.allclose(one.p, many.p, rtol=1e-9)
    assert np.allclose(one.p, named.p, rtol=1e-9)


def test_wrong_number_of_laws_is_refused(ops):
    laws = [linear_law(1e12)] * 3
    with pytest.raises(SceneError, match="3 laws for"):
        equilibrium(ops, laws, 0.0, 0.0)
    with pytest.raises(SceneError, match="index"):
        equilibrium(ops, laws, 0.0, 0.0, index=np.full(len(ops.w), 7))


def named_limit(raised):
    return float(re.search(r"was followed up to ([0-9.]+) and no further", str(raised.value))[1])


@pytest.mark.parametrize(
    ("length", "height", "law", "scatter", "mu"),
    [
        (44.482, 32.52, exponential_law(435e3, 25e-9), 59e-9, 1.74),
        (55.765, 41.867, exponential_law(118e3, 15.7e-9), 2.37e-6, 1.25),
    ],
)
def test_limit_of_friction_of_a_block_that_tips(length, height, law, scatter, mu):
    """Held at its top against friction: mu = x / h of its outer elements, on which it stands then.

    A bisection of the friction in four load steps named 0.39 for 0.513, and for 0.499 none.
    """
    size = f"parts.block.size='{length / 4:.3f} mm'"
    sets = [f"parts.block.length='{length} mm'", f"parts.block.height='{height} mm'", size]
    block = assemble(
        BLOCK, MPI.COMM_SELF, [*sets, "parts.plate.size='20 mm'", "mesh.cells=hexahedra"]
    )
    outer = np.abs(block.points[:, 0]).max() / (1e-3 * height)
    g_cr = scatter * np.random.default_rng(1).standard_normal(len(block.w))
    with pytest.raises(NotConverged, match="was followed") as raised:
        equilibrium(block, law, g_cr, mu, steps=4)
    assert 0.99 * outer < named_limit(raised) < 1.002 * outer
    reached = equilibrium(block, law, g_cr, 0.98 * outer, steps=4)
    # All pressure on the outer elements of one side, under the load of 5 bar.
    on_one_side = np.sum((block.w * reached.p)[block.points[:, 0] > 0])
    assert max(on_one_side, block.w @ reached.p - on_one_side) > 0.95 * block.w @ reached.p


@pytest.mark.parametrize("mu", [1.2, 8.0])
def test_friction_that_tips_the_part_is_named_with_its_limit(ops, mu):
    """Load steps do not help: the message says up to which friction there is an equilibrium."""
    law = exponential_law(10e6, 10e-6)
    with pytest.raises(NotConverged, match=r"tips or locks a part") as raised:
        equilibrium(ops, law, 0.0, mu)
    limit = named_limit(raised)
    assert 0.5 < limit < 1.1
    assert equilibrium(ops, law, 0.0, 0.98 * limit).residual < 1e-10
    with pytest.raises(NotConverged):
        equilibrium(ops, law, 0.0, 1.1 * limit)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (dict(g_cr=[0.0, 1e-6]), r"g_cr: shape \(2,\); give one value, or one for each of the"),
        (dict(g_cr=np.nan), "g_cr: a value is not finite"),
        (dict(mu=np.inf), "mu: a value is not finite"),
    ],
)
def test_arguments_that_do_not_fit_are_one_line(ops, given, said):
    with pytest.raises(SceneError, match=said):
        equilibrium(ops, linear_law(1e12), **{"g_cr": 0.0, "mu": 0.3, **given})


def test_reference_stiffness_must_be_positive(ops):
    with pytest.raises(SceneError, match="k0: positive finite values"):
        compliance(ops.K, ops.N, ops.T, ops.w, ops.f, np.zeros(len(ops.w)), MPI.COMM_SELF)

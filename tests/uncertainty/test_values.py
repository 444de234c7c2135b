"""Values of a sample by dotted key, in place of those of the scene: each against full order."""

from pathlib import Path

import numpy as np
import pytest

from brake_fenicsx import model
from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene import read_scene
from brake_fenicsx.uncertainty.sampling import draw_sample
from brake_fenicsx.uncertainty.solve import full_modes

pytestmark = pytest.mark.alone

BLOCK = Path(__file__).parents[2] / "scripts" / "scenes" / "block_on_plate.toml"
COARSE = [
    "stages=['equilibrium','stability']", "parts.block.size='10 mm'", "parts.plate.size='14 mm'",
    "stability.band=['0 Hz','20 kHz']", "stability.zeta_max=0.3", "stability.method=reduced",
]  # fmt: skip
MU, LOAD, C44 = (
    "contact.block_plate.friction", "loads.block.top.pressure", "materials.lining.C44",
)  # fmt: skip


def agrees(found, exact):
    """Every mode of full order within its stated error, none missed."""
    assert found.s.size == exact.s.size >= 5
    distance = np.abs(found.s - exact.s)
    # The equilibria differ by the interpolation of the compliance.
    assert np.all(distance <= found.error + exact.error + 1e-6 * np.abs(exact.s))


def at_full_order(prepared, values, approach="multi-scale"):
    """Modes at full order, the equilibrium too."""
    study = prepared.study
    sample = study._draw(approach, 0, values)
    return full_modes(study.models, sample, study._prepared.of(approach, sample))


def test_values_replace_and_complete_the_drawn_ones():
    random = f"samples.random.\"{MU}\"={{ law='uniform', min=0.3, max=0.7 }}"
    changes = ["stages=['equilibrium','uncertainty']", random, "samples.n=3"]
    scene = read_scene(BLOCK, [*changes, "samples.approaches=['multi-scale','classical']"])
    contact = type("Contact", (), {"interface": np.zeros(4, int), "speed": np.ones(4)})

    def drawn(approach, values=None):
        return draw_sample(scene, approach, 1, contact, None, None, values=values)

    own = drawn("multi-scale")
    loaded = drawn("multi-scale", {LOAD: 3e5})
    assert loaded.random == {**own.random, LOAD: 3e5}
    np.testing.assert_array_equal(loaded.mu, own.mu)
    assert loaded.pressures == {"block.top": 3e5}
    for approach in ("multi-scale", "classical"):
        given = drawn(approach, {MU: 0.61, C44: 1e9})
        np.testing.assert_array_equal(given.mu, 0.61)
        np.testing.assert_array_equal(given.mu_equilibrium, 0.61)
        assert given.materials["lining"][3, 3] == 1e9
    with pytest.raises(SceneError, match=r"friction = -0.1: must be zero or more"):
        drawn("classical", {MU: -0.1})


def test_a_swept_modulus_is_that_of_full_order():
    """Over C44, with friction and load beside it; beyond what was prepared, too."""
    prepared = model.prepare(BLOCK, COARSE, parameters={C44: (0.9e9, 1.5e9)})
    branches = prepared.sweep(C44, [0.9e9, 1.2e9, 1.5e9])
    assert branches.frequency.shape[0] >= 5
    for i, value in enumerate(branches.values):
        exact = at_full_order(prepared, {C44: value})
        followed = branches.frequency[:, i]
        followed = np.sort(followed[np.isfinite(followed)])
        np.testing.assert_allclose(followed, np.sort(exact.frequency), rtol=5e-6)
    for values in ({C44: 0.9e9, MU: 0.2, LOAD: 9e5}, {C44: 3e9}):
        agrees(prepared.modes(values), at_full_order(prepared, values))
    with pytest.raises(SceneError, match=r"materials.lining.C33: .*sweep.parameters"):
        prepared.modes({"materials.lining.C33": 2e9})

"""Hard cases of thicknesses: modes within their stated errors, or an error message."""

from pathlib import Path

import numpy as np
import pytest

from brake_fenicsx import model
from brake_fenicsx.errors import InaccurateResult, SceneError
from brake_fenicsx.uncertainty.solve import full_modes

pytestmark = pytest.mark.hard

BLOCK = Path(__file__).parents[2] / "scripts" / "scenes" / "block_on_plate.toml"
COARSE = [
    "stages=['equilibrium','stability']", "parts.block.size='12 mm'", "parts.plate.size='15 mm'",
    "mesh.cells='hexahedra'", "stability.band=['0 Hz','20 kHz']", "stability.method=reduced",
]  # fmt: skip
HEIGHT = "parts.block.height"


@pytest.mark.parametrize("lowest", [4e-3, 2e-3])
def test_a_thickness_over_a_factor_of_five_and_ten(lowest):
    """The interpolation errs by up to 2e-3: modes within their stated errors, no wrong verdict."""
    prepared = model.prepare(BLOCK, COARSE, parameters={HEIGHT: (lowest, 20e-3)})
    study = prepared.study
    for height in np.geomspace(lowest, 20e-3, 6):
        sample = study._draw("multi-scale", 0, {HEIGHT: height})
        exact = full_modes(study.models, sample, study._prepared.of("multi-scale", sample))
        found = prepared.modes({HEIGHT: height})
        assert found.s.size == exact.s.size >= 7
        distance = np.abs(found.s - exact.s)
        # The equilibria differ by the interpolation of the compliance.
        assert np.all(distance <= found.error + exact.error + 1e-5 * np.abs(exact.s))
        pairs = zip(found.verdict, exact.verdict, strict=True)
        assert not any({a, b} == {"stable", "unstable"} for a, b in pairs)


def test_a_range_too_wide_for_the_kept_modes():
    """A cutoff just above the band, and a block that becomes soft: rejected."""
    narrow = [*COARSE, "stability.cutoff='21 kHz'"]
    with pytest.raises((SceneError, InaccurateResult), match="narrow its range"):
        model.prepare(BLOCK, narrow, parameters={HEIGHT: (5e-3, 60e-3)})


def test_a_thickness_beyond_what_was_prepared():
    """Far outside of the range the sample is solved at full order, on a body of that thickness."""
    prepared = model.prepare(BLOCK, COARSE, parameters={HEIGHT: (18e-3, 22e-3)})
    study, height = prepared.study, 30e-3
    sample = study._draw("multi-scale", 0, {HEIGHT: height})
    exact = full_modes(study.models, sample, study._prepared.of("multi-scale", sample))
    found = prepared.modes({HEIGHT: height})
    np.testing.assert_allclose(found.frequency, exact.frequency, rtol=1e-6)


def test_a_law_that_reaches_a_thickness_of_zero():
    """A normal law whose lower tail has no body: rejected before anything is reduced."""
    law = "{ law='normal', mean='20 mm', sd='10 mm' }"
    many = "stages=['equilibrium','stability','uncertainty']"
    with pytest.raises(SceneError, match=r"the law reaches -0\.0109 m .*write a positive min"):
        model.prepare(BLOCK, [*COARSE, many, f'samples.random."{HEIGHT}"={law}'])

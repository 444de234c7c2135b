"""Hard cases of countermeasures: squeal that returns, values without a valid brake."""

from mpi4py import MPI

import pytest

from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.variants import countermeasures as module
from brake_fenicsx.extras.variants.trial import smallest_change
from coarse_block import BLOCK, FRICTION, ROUGH, levers
from run_tables import read_rows

pytestmark = pytest.mark.hard

COMM = MPI.COMM_SELF


def test_squeal_that_comes_back_beyond_the_smallest_change():
    """The brake is stable only between 0.3 and 0.5 of the range: the first border is found."""
    found = smallest_change(lambda x: iter([not 0.3 <= x <= 0.5] * 40), (0.0, 1.0), 40, 8, 0.01)
    assert 0.3 <= found.value <= 0.31


def test_one_sample_must_be_stable_itself():
    """With fewer than 93 samples, no sample may squeal."""
    found = smallest_change(lambda x: iter([x < 0.4, False]), (0.0, 1.0), 2, 8, 0.01)
    assert 0.4 <= found.value <= 0.41 and found.share.hits == 0


def test_a_window_narrower_than_a_step_is_not_seen():
    """Stable only in 2 % of the range between two values: reported as "not sufficient"."""
    found = smallest_change(lambda x: iter([abs(x - 0.44) > 0.01] * 40), (0.0, 1.0), 40, 8, 0.01)
    assert found.value is None and found.share.value == 1.0


@pytest.mark.slow
def test_values_without_an_equilibrium_are_no_remedy(tmp_path):
    """The block tips above a friction of about 0.9: failed samples count as squeal."""
    page = module.find_countermeasures(
        BLOCK, COMM, tmp_path, [*ROUGH, "samples.n=2", levers((FRICTION, "2.5"))]
    )
    (row,) = read_rows(page.with_suffix(".csv"))
    assert row["smallest_value"] is None and row["verified"] == "no"
    assert row["share_after"] == 1.0 and "not sufficient even at the limit" in row["note"]


@pytest.mark.long
def test_a_length_that_one_brake_cannot_have_is_named(tmp_path):
    """It deforms a loaded face: the row gives the reason, the other countermeasure is found."""
    both = levers(("parts.block.length", "'30 mm'"), (FRICTION, "0.05"))
    page = module.find_countermeasures(BLOCK, COMM, tmp_path, [*ROUGH, both])
    first, second = read_rows(page.with_suffix(".csv"))
    assert first["key"] == FRICTION and first["smallest_value"] is not None
    assert second["key"] == "parts.block.length"
    assert "the length deforms or tilts the face block.top" in second["note"]
    assert second["first_order"] is second["smallest_value"] is second["share_after"] is None


def test_a_single_sample_has_no_families(tmp_path):
    """The modes squeal but form no family: an error message, not "nothing squeals"."""
    with pytest.raises(SceneError, match="raise samples"):
        module.find_countermeasures(
            BLOCK, COMM, tmp_path, [*ROUGH, "samples.n=1", levers((FRICTION, "0.1"))]
        )

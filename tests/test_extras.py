"""What a run makes beside its tables costs itself where it fails; log and page name it."""

import errno
from html import unescape

from mpi4py import MPI

import pytest

from brake_fenicsx.folder.log import spared
from brake_fenicsx.pipeline import run
from coarse_block import BLOCK, ROUGH
from run_tables import read_columns

PAGE = "stages=['surface','equilibrium','stability','uncertainty','report']"
WHOLE = [*ROUGH[1:], PAGE, "stability.drivers=true", "limit_cycle={}", "stability.verify=1"]


def fails(*_, **__):
    raise FloatingPointError("made to fail")


# What is replaced, and how the page names what is lost; what nobody asks for once another one fails
# stands in the second run.
BROKEN = (
    {
        "brake_fenicsx.samples.drivers.Drivers.of": "drivers left out",
        "brake_fenicsx.extras.limit_cycle.cycles.Cycles.of": "limit cycles left out",
        "brake_fenicsx.stability.substructures.reduced_model.ReducedModel"
        ".displacements_of_samples": "shapes of modes left out",
        "brake_fenicsx.report.fields.write_facets": "fields of the equilibria left out",
        "brake_fenicsx.pipeline.draw_mesh": "picture of the mesh left out",
        "brake_fenicsx.report.figure_inputs.contact_maps": "maps of the contact left out",
    },
    {
        "brake_fenicsx.report.render.render_mode": "picture of the mode at",
        "brake_fenicsx.report.figures.save": "figure figure9_squeal_map left out",
    },
)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Tables of the run in which nothing fails."""
    out = tmp_path_factory.mktemp("whole") / "out"
    run(BLOCK, MPI.COMM_SELF, out, WHOLE)
    assert "left out" not in (out / "report.html").read_text()
    return read_columns(out / "modes.csv")


@pytest.mark.parametrize("broken", BROKEN)
def test_extras_that_fail_cost_themselves(broken, whole, tmp_path, monkeypatch):
    """The run ends with its page and the same modes, and the page says what is missing, and why."""
    for place in broken:
        monkeypatch.setattr(place, fails)
    out = tmp_path / "out"
    run(BLOCK, MPI.COMM_SELF, out, WHOLE)
    modes = read_columns(out / "modes.csv")
    assert modes["frequency_hz"].tolist() == whole["frequency_hz"].tolist()
    page = unescape((out / "report.html").read_text())
    log = (out / "log.txt").read_text()
    assert "made to fail" in page
    assert [named for named in broken.values() if named not in page or named not in log] == []


def test_a_verified_sample_that_fails_is_counted(whole, tmp_path, monkeypatch):
    """Full order fails: all samples stand, and the summary says that none was compared."""
    monkeypatch.setattr("brake_fenicsx.samples.solve.full_modes", fails)
    out = tmp_path / "out"
    found = run(BLOCK, MPI.COMM_SELF, out, [*WHOLE, "limit_cycle={}"])
    assert (
        found.facts["verification"] | {"samples_asked": 1, "samples_compared": 0}
        == (found.facts["verification"])
    )
    assert found.facts["failed_samples"] == 0


def test_a_full_disc_is_not_spared():
    """No later work survives it: the run ends with the line that it has for that."""

    def full():
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        spared("picture", full)
    assert spared("picture", lambda: 3) == (3, [])

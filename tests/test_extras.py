"""What a run makes beside its tables costs itself where it fails; log and page name it."""

import errno
from html import unescape

from mpi4py import MPI

import pytest

from brake_fenicsx.folder.log import spared
from brake_fenicsx.pipeline import run
from coarse_block import BLOCK, ROUGH
from run_tables import read_columns

pytestmark = pytest.mark.long

PAGE = "stages=['surface','equilibrium','stability','uncertainty','report']"
CYCLE = "limit_cycle={ harmonics = 1, points = 8 }"
WHOLE = [*ROUGH[1:], "samples.n=2", PAGE, "stability.drivers=true", CYCLE, "stability.verify=1"]


def fails(*_, **__):
    raise FloatingPointError("made to fail")


# Two runs, in each of which some of these fail: what is replaced, and how the page names it.
BROKEN = (
    {
        "brake_fenicsx.extras.limit_cycle.cycles.Cycles.of": "limit cycles left out",
        "brake_fenicsx.report.mode_fields.write_facets": "fields of the equilibria left out",
        "brake_fenicsx.report.render.Shapes.still": "picture of the mode at",
        "brake_fenicsx.report.figure_inputs.contact_maps": "maps of the contact left out",
        "brake_fenicsx.samples.solve.full_modes": "",  # of the verification
    },
    {
        "brake_fenicsx.samples.drivers.driver_arrays": "drivers left out",
        "brake_fenicsx.stability.substructures.reduced_model.ReducedModel"
        ".displacements_of_samples": "shapes of modes left out",
        "brake_fenicsx.pipeline.draw_mesh": "picture of the mesh left out",
        "brake_fenicsx.report.figures.save": "figure figure9_squeal_map left out",
    },
)


@pytest.fixture(scope="module")
def whole(tmp_path_factory, all_without_pixels):
    """Tables of the run in which nothing fails."""
    out = tmp_path_factory.mktemp("whole") / "out"
    run(BLOCK, MPI.COMM_SELF, out, WHOLE)
    assert "left out" not in (out / "report.html").read_text()
    return read_columns(out / "modes.csv")


@pytest.mark.parametrize("failing", [0, 1])
def test_an_extra_that_fails_costs_itself(failing, whole, tmp_path, monkeypatch):
    """The run ends with its page and the same modes, and the page says what is missing, and why.

    Where full order fails, the summary says that no sample was compared.
    """
    for place in BROKEN[failing]:
        monkeypatch.setattr(place, fails)
    out = tmp_path / "out"
    facts = run(BLOCK, MPI.COMM_SELF, out, WHOLE).facts
    modes = read_columns(out / "modes.csv")
    assert modes["frequency_hz"].tolist() == whole["frequency_hz"].tolist()
    page, log = unescape((out / "report.html").read_text()), (out / "log.txt").read_text()
    assert "made to fail" in page
    for group, broken in enumerate(BROKEN):
        for said in filter(None, broken.values()):
            assert [said in page, said in log] == [group == failing] * 2, said
    verified = {name: facts["verification"][name] for name in ("samples_asked", "samples_compared")}
    assert verified == {"samples_asked": 1, "samples_compared": failing}
    assert facts["failed_samples"] == 0


def test_a_full_disc_is_not_spared():
    """No later work survives it: the run ends with the line that it has for that."""

    def full():
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        spared("picture", full)
    assert spared("picture", lambda: 3) == (3, [])

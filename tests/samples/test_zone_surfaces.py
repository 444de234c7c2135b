"""A surface for each zone of a face: laws and critical gaps of two scans in one scene."""

import re

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import prepare
from brake_fenicsx.description import describe
from brake_fenicsx.errors import SceneError
from brake_fenicsx.micro import load_laws
from brake_fenicsx.pipeline import run
from brake_fenicsx.results.run import read_run
from brake_fenicsx.scene import read_scene
from coarse_block import BLOCK
from run_tables import read_columns

STAGES = "['surface','micro','equilibrium','stability','uncertainty','report']"
NEW, WORN = "{ statistics={ S_q='1 um' } }", "{ statistics={ S_q='0.2 um', S_sk=-1.0, S_ku=4.5 } }"
FACES = "faces=['block.bottom','plate.top'], friction=0.5"
SCENE = [
    "stages=['surface','micro','equilibrium','stability','uncertainty']",
    "micro={ patch='2.825 mm', pixels=32, laws=3, E='1 GPa', nu=0.3, scans=0, hardness='200 MPa' }",
    "parts.block.size='14 mm'", "parts.plate.size='20 mm'", "samples.n=2",
    "stability.band=['0 Hz','30 kHz']", "stability.method=reduced",
    f"contact.block_plate={{ {FACES}, gap='hdf', zone={{ x=['-1 m','0 mm'] }} }}",
]  # fmt: skip


def scene(whole, own=None):
    """The face's surface, and that of its trailing half."""
    more = "" if own is None else f", surface={own}"
    trailing = f"contact.trailing={{ {FACES}, gap='hdf', zone={{ x=['0 mm','1 m'] }}{more} }}"
    return [*SCENE, f"surface={whole}", trailing]


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """A new pad whose trailing half is worn, and pads that are new and worn all over."""
    folder = tmp_path_factory.mktemp("zones")
    made = {"zones": scene(NEW, WORN), "new": scene(NEW), "worn": scene(WORN),
            "same": scene(NEW, NEW)}  # fmt: skip
    return {name: prepare(BLOCK, changes, folder / name) for name, changes in made.items()}, folder


def test_laws_and_gaps_of_each_zone_are_those_of_its_surface_alone(both):
    """The same random numbers: element by element those of a pad that is like this all over."""
    models, folder = both
    laws = (
        load_laws(folder / "zones" / "zones" / "laws_0.npz"),
        load_laws(folder / "worn" / "laws.npz"),
    )
    np.testing.assert_array_equal(laws[0].p, laws[1].p)
    np.testing.assert_array_equal(laws[0].d, laws[1].d)
    mixed, new, worn = (
        models[n].study.sample(("multi-scale", 1)).laws for n in ("zones", "new", "worn")
    )
    trailing = models["zones"].study.brake.contact.interface == 1
    assert trailing.any() and not trailing.all()
    g = np.full(trailing.size, -0.3e-6)
    pressures = [x.pressure(g + x.g_cr) for x in (mixed, new, worn)]
    alike = np.where(trailing, pressures[2], pressures[1])
    np.testing.assert_allclose(pressures[0], alike, rtol=1e-12)
    assert not np.allclose(pressures[1][trailing], pressures[2][trailing], rtol=0.1)
    np.testing.assert_array_equal(mixed.g_cr, np.where(trailing, worn.g_cr, new.g_cr))


@pytest.mark.together
def test_several_processes_make_the_laws_and_samples_of_one(processes, tmp_path):
    """Three laws of each surface, which two processes cannot divide evenly."""
    comm, together = processes
    alone = prepare(BLOCK, scene(NEW, WORN), tmp_path / "alone")
    shared = prepare(BLOCK, scene(NEW, WORN), together / "shared", comm=comm)
    for name in ("laws.npz", "zones/laws_0.npz"):
        one, several = load_laws(tmp_path / "alone" / name), load_laws(together / "shared" / name)
        assert len(one.p) == 3
        np.testing.assert_array_equal(several.p, one.p)
        np.testing.assert_array_equal(several.d, one.d)
    for k in range(2):
        own, theirs = (m.study.sample(("multi-scale", k)).laws for m in (alone, shared))
        np.testing.assert_array_equal(theirs.g_cr, own.g_cr)
        np.testing.assert_allclose(shared.modes(sample=k).s, alone.modes(sample=k).s, rtol=1e-6)


def test_a_zone_with_the_surface_of_the_whole_changes_nothing(both):
    models, _ = both
    for k in range(2):
        own, whole = (models[name].modes(sample=k).s for name in ("same", "new"))
        np.testing.assert_allclose(own, whole, rtol=1e-12)
    assert not np.allclose(models["zones"].modes().s[:4], models["new"].modes().s[:4], rtol=1e-6)


def test_check_and_page_show_every_surface(tmp_path, capsys):
    """With the warnings of each by the key that is to be changed."""
    smooth = [*scene(NEW, WORN.replace("0.2 um", "0.02 um")), "samples.n=1", f"stages={STAGES}"]
    describe(BLOCK, MPI.COMM_SELF, smooth)
    said = capsys.readouterr().out
    assert "surface: S_q 1.00 um, S_sk 0.000" in said
    own = "contact.trailing.surface"
    assert f"{own}: S_q 0.02 um, S_sk -1.000, S_ku 4.500" in said
    assert f"{own}: laws: 3 of 32 x 32 points" in said
    warned = f"{own}: S_q of 0.02 um: smooth as a mirror"
    assert warned in said and f"correct {own}.height_unit" in said
    run(BLOCK, MPI.COMM_SELF, tmp_path / "out", smooth, pictures=False)
    page = (tmp_path / "out" / "report.html").read_text()
    assert warned in page
    rows = re.findall(r"<tr>\s*<td[^>]*>S_q,.*?</tr>", page, re.DOTALL)
    cells = [re.findall(r"<td[^>]*>(.*?)</td>", row, re.DOTALL) for row in rows]
    assert [row[1:] for row in cells][-1] == ["1", "0.02", "µm"]


def test_a_run_of_two_surfaces(both, tmp_path):
    """Its samples are those of the prepared scene; the second run takes what is there."""
    models, _ = both
    out = tmp_path / "out"
    run(BLOCK, MPI.COMM_SELF, out, scene(NEW, WORN))
    table = read_columns(out / "modes.csv")
    for k in range(2):
        found = table["frequency_hz"][table["sample"] == k]
        # They begin at the equilibrium of the first one.
        np.testing.assert_allclose(found, models["zones"].modes(sample=k).frequency, rtol=1e-7)
    kept = (out / "zones" / "laws_0.npz").stat().st_mtime_ns
    run(BLOCK, MPI.COMM_SELF, out, [*scene(NEW, WORN), "samples.n=3"])
    assert (out / "zones" / "laws_0.npz").stat().st_mtime_ns == kept
    assert {*read_run(out).modes["sample"]} == {0, 1, 2}
    with pytest.raises(SceneError, match="another scene"):
        run(BLOCK, MPI.COMM_SELF, out, scene(NEW, WORN.replace("0.2 um", "0.3 um")))


@pytest.mark.parametrize(
    ("own", "said"),
    [
        ("{ scan='no.npz' }", r"contact.trailing.surface.scan = 'no.npz': no such file"),
        ("{}", "contact.trailing.surface: name a scan or statistics"),
        ("{ scan=3 }", "contact.trailing.surface.scan"),
        ("{ statistics={ S_q='1 um', S_sk=3.0, S_ku=2.0 } }", "contact.trailing.surface"),
    ],
)
def test_mistakes_name_the_zone_and_nothing_is_written(own, said, tmp_path):
    with pytest.raises(SceneError, match=said):
        run(BLOCK, MPI.COMM_SELF, tmp_path / "out", scene(NEW, own))
    assert not (tmp_path / "out").exists()


def test_a_surface_of_which_nothing_is_made_is_refused():
    changes = [*scene(NEW, WORN), "contact.trailing.law={ p0='1 MPa', u0='1 um' }",
               "contact.trailing.gap='none'"]  # fmt: skip
    with pytest.raises(SceneError, match=r"trailing\.surface: nothing is made of it"):
        read_scene(BLOCK, changes)

"""What is allowed and most probably not meant: said by check, in the log and on the page."""

import json
import re
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.build.brake_doubts import brake_doubts
from brake_fenicsx.build.measured_surface import read_surface
from brake_fenicsx.checks import surface_warnings, warnings, with_patch, with_pixels
from brake_fenicsx.description import describe
from brake_fenicsx.errors import SceneError
from brake_fenicsx.micro import load_laws
from brake_fenicsx.pipeline import run
from brake_fenicsx.report.html import render_page
from brake_fenicsx.results.run import read_run
from brake_fenicsx.samples.sampling import draw_sample
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.digest import laws_key
from brake_fenicsx.scene.scene import friction_texts, listed
from brake_fenicsx.scene.warnings import unusual
from contact_alone import at_contact
from places import BLOCK, SCENES

ROUGH = [
    "stages=['surface','micro','equilibrium']", "surface.statistics={ S_q='3 um' }",
    "contact.block_plate.law=library", "parts.block.size='10 mm'", "parts.plate.size='14 mm'",
    "samples.approaches=['multi-scale','classical']", "contact.block_plate.friction=0.1",
]  # fmt: skip
FALLING = "contact.block_plate.friction={ static=0.6, kinetic=0.4, decay='1 m/s' }"
SMALL = "micro={ patch='%s', pixels=16, laws=1, steps=8 }"


@pytest.mark.parametrize(
    ("change", "key", "band"),
    [
        ("contact.block_plate.friction=5", "contact.block_plate.friction = 5", "0.0 and 1.5"),
        ("samples.classical.friction=2", "samples.classical.friction = 2", "0 and 1.5"),
        ("materials.iron.E=125 MPa", "materials.iron: rho = 7200", "5000 MPa"),
        ("materials.iron.E=125 mPa", "materials.iron.E = 1.25e-07 MPa", "1 MPa and 2000000 MPa"),
        ("materials.iron.rho=7.2 kg/m^3", "materials.iron.rho = 7.2", "100 kg/m^3 and 25000"),
        ('loads."block.top".pressure=5 GPa', 'loads."block.top".pressure = 5000', "100 MPa"),
        ("stability.band=['0 Hz','12 MHz']", "stability.band = 12000000 Hz", "100000 Hz"),
        ("parts.block={ builder='block', length='2 m', material='iron' }", "parts.block.length",
         "10 mm and 1000 mm"),
        ("micro.patch=80 mm", "micro.patch = 80 mm", "0.01 mm and 50 mm"),
        ("contact.block_plate.law={ p0='10 MPa', u0='10 mm' }", "law.u0 = 10 mm", "1 mm"),
    ],
)  # fmt: skip
def test_values_outside_their_band_are_named(change, key, band):
    """A slip of the unit, which no sign or dimension shows."""
    (line,) = unusual(read_scene(BLOCK, [change]))
    assert key in line and band in line
    assert ("check the value" if "friction" in key else "correct the unit") in line


MANY = "stages=['equilibrium','stability','uncertainty']"


FRICTION = '"contact.block_plate.friction"'


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("materials.lining.loss=0.02", "materials.lining.loss = 0.02: acts only with stability"),
        (f"samples.random.{FRICTION}={{ law='measured', values=[0.3, -0.5, 0.4, -0.1] }}",
         "2 of 4 measured values must be zero or more, the least is -0.5"),
        (f"samples.random.{FRICTION}={{ law='uniform', min=-0.1, max=0.4 }}", "min = -0.1"),
    ],
)  # fmt: skip
def test_what_acts_nowhere_or_cannot_be_is_refused(change, said):
    """A loss factor that no damping term reads; friction below zero was drawn anew in silence."""
    with pytest.raises(SceneError, match=re.escape(said)):
        read_scene(BLOCK, [MANY, change])


@pytest.mark.parametrize(
    "changes",
    [
        ["materials.lining.loss=0.02", "stability.damping={ loss=true, omega_ref='5 kHz' }"],
        ["materials.lining.loss=0.02", "stages=['equilibrium']"],
        [f"samples.random.{FRICTION}={{ law='measured', values=[0.3, -0.5, 0.4], min=0 }}"],
    ],
)
def test_what_acts_or_is_left_out_is_taken(changes):
    read_scene(BLOCK, [MANY, *changes])


@pytest.mark.parametrize(
    ("E", "nu", "hardness", "warned"),
    [
        ("2 MPa", 0.0, "200 MPa", True),
        ("2 GPa", 0.4, "200 MPa", False),
        ("2 GPa", 0.4, None, False),
    ],
)
def test_a_hardness_above_the_modulus(E, nu, hardness, warned):
    """Metals and polymers yield at a hundredth to a tenth of E*."""
    micro = f"micro={{ E='{E}', nu={nu}"
    if hardness:
        micro += f", hardness='{hardness}'"
    lines = unusual(read_scene(BLOCK, [*ROUGH, micro + " }"]))
    assert any("above E*" in line and "2 MPa" in line for line in lines) == warned


@pytest.mark.parametrize(("patch", "warned"), [("20 mm", True), ("3 mm", False)])
def test_a_patch_several_times_the_scan(tmp_path, patch, warned):
    """Said with both sides: 20 mm of a scan of 3.5 x 2.5 mm."""
    white = np.random.default_rng(0).standard_normal((350, 250))
    heights = 1e-5 * gaussian_filter(white, 4, mode="wrap")
    np.savez(tmp_path / "scan.npz", heights=heights, size=[3.5e-3, 2.5e-3])
    scene = tmp_path / "scene.toml"
    scene.write_text(
        f"stages = ['surface', 'micro']\nsurface.scan = 'scan.npz'\nmicro.patch = '{patch}'\n"
    )
    parsed = read_scene(scene)
    lines = [x for x in surface_warnings(parsed, read_surface(parsed)) if "micro.patch" in x]
    assert len(lines) == warned
    if warned:
        assert "20 mm: 8 times the shortest side of a scan, 2.5 mm" in lines[0]


def test_fewer_than_six_nodes_per_wavelength():
    """The shear wave of a lining of G = 1.18 GPa and 2510 kg/m^3 at 40 kHz: 17.1 mm.

    On cells of 10 mm and second order, nodes are 5 mm apart: 3.4; with 12 kHz 11.4.
    """
    coarse = ["mesh.cells=hexahedra", "parts.block.length='20 mm'", "parts.block.width='20 mm'",
              "parts.block.height='20 mm'", "parts.block.size='10 mm'"]  # fmt: skip

    def said(*changes):
        scene = read_scene(BLOCK, [*coarse, *changes])
        brake = assemble_brake(scene, MPI.COMM_SELF)
        return [line for line in brake_doubts(scene, brake) if "nodes per wavelength" in line]

    (line,) = said("stability.band=['0 Hz','40 kHz']", "parts.plate.size='3 mm'")
    assert line.startswith("parts.block: 3.4 nodes per wavelength (17.1 mm in block.body) at the")
    assert "take cells of 5.7 mm at most, or end the band at 23000 Hz" in line
    assert not said("stability.band=['0 Hz','12 kHz']")


@pytest.mark.parametrize(("moved", "warned"), [("1 m", True), ("0.1 mm", False)])
def test_an_imposed_displacement_of_the_size_of_the_part(moved, warned):
    load = f"loads={{ 'block.top'={{ displacement={{ z='-{moved}' }} }} }}"
    changes = ["supports.'block.top'=['x','y','z']", load]
    scene = read_scene(BLOCK, changes)
    lines = brake_doubts(scene, assemble_brake(scene, MPI.COMM_SELF))
    said = [line for line in lines if "displacement" in line]
    assert len(said) == warned
    if warned:
        assert "1000 mm: the shortest side of the part is 20 mm" in said[0]


def test_fast_with_a_roughness_has_no_total_indices():
    """Said by check, not where the contact is perfect and not of other designs."""
    joint = [
        "stages=['surface','equilibrium','stability','uncertainty']", "samples.n=1200",
        "surface.statistics={ S_q='3 um' }", "contact.block_plate.gap=hdf",
        "samples.random.\"contact.block_plate.friction\"={ law='uniform', spread=0.1 }",
    ]  # fmt: skip

    def said(approach, design):
        more = [f"samples.approaches=['{approach}']", f"samples.{approach}.design={design}"]
        return [line for line in unusual(read_scene(BLOCK, [*joint, *more])) if "total" in line]

    (line,) = said("joint", "fast")
    assert 'design = "fast" of joint' in line and 'design = "saltelli" gives them' in line
    assert not said("parametric", "fast") and not said("joint", "saltelli")


FRICTION = 'samples.random."contact.block_plate.friction"'


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (FRICTION + "={ law='normal', mean=0.2, sd=0.3 }", "25 % of a normal law .* negative"),
        (FRICTION + "={ law='measured', values=[0.4, 0.4] }", "all measured values are equal"),
        ("stability.verify=100", "stability.verify = 100: there are 1 samples"),
    ],
)
def test_draws_that_are_cut_or_do_not_differ_are_named(change, words):
    (line,) = unusual(read_scene(BLOCK, [MANY, change]))
    assert re.search(words, line)
    narrow = FRICTION + "={ law='normal', mean=0.5, sd=0.05 }"
    assert unusual(read_scene(BLOCK, [MANY, narrow])) == []


def test_random_inputs_have_the_band_of_their_key():
    stages = "stages=['equilibrium','stability','uncertainty']"
    law = "{ law='normal', mean='5 GPa', sd='1 bar', min='2 bar' }"
    scene = read_scene(BLOCK, [stages, f"samples.random.'loads.\"block.top\".pressure'={law}"])
    (line,) = unusual(scene)
    assert "mean = 5000 MPa" in line and "100 MPa" in line


@pytest.mark.parametrize("path", SCENES.glob("*.toml"), ids=lambda path: path.stem)
def test_shipped_scenes_are_usual(path):
    assert unusual(read_scene(path)) == []


def test_patch_of_the_laws_is_compared_with_the_contact_elements(capsys):
    """Laws of 2.825 mm patches on elements of 11.8 mm: 17 times the area."""
    for patch, factor in (("2.825 mm", "17.4"), ("20 mm", "0.348"), ("9 mm", ""), ("mesh", "")):
        scene = read_scene(BLOCK, [*ROUGH, SMALL % patch])
        lines = warnings(scene, 11.79e-3)
        assert len(lines) == bool(factor)
        assert all(f"{factor} times the area" in line for line in lines)
    describe(BLOCK, MPI.COMM_SELF, [*ROUGH, SMALL % "1 mm"])
    said = capsys.readouterr().out
    assert "with a side of 1 mm; mean area of a contact element" in said
    assert "warning: micro.patch = 1 mm: contact elements have" in said
    assert "friction: multi-scale 0.1, classical 0.1" in said
    describe(BLOCK, MPI.COMM_SELF, [*ROUGH, SMALL % "mesh"])
    said = capsys.readouterr().out
    assert "mean area of a contact element / patch = 1" in said and "warning" not in said


def test_laws_of_the_mesh_and_warnings_of_a_run(tmp_path):
    """The patch is the mean element's; what is unusual stands in log, summary and page."""
    for patch in ("mesh", "1 mm"):
        run(BLOCK, MPI.COMM_SELF, tmp_path / patch, [*ROUGH, SMALL % patch])
        folder = read_run(tmp_path / patch)
        facts, page = folder.summary, render_page(folder)
        side = load_laws(tmp_path / patch / "laws.npz").settings["size"][0]
        log = (tmp_path / patch / "log.txt").read_text()
        assert facts["friction"] == {"multi-scale": "0.1", "classical": "0.1"}
        assert "friction: multi-scale 0.1, classical 0.1" in log
        digest = (tmp_path / patch / "scene.sha256").read_text()
        assert facts["scene_sha256"] == digest
        assert f'<p class="meta">{facts["finished"]} · scene {digest[:12]} · ' in page
        assert re.fullmatch(r"\d{4}-\d\d-\d\d \d\d:\d\d UTC", facts["finished"])
        assert "<dt>Friction coefficient</dt><dd>0.1</dd>" in page
        told = "micro.patch = 1 mm: contact elements have"
        if patch == "mesh":
            assert side == pytest.approx(1e-3 * facts["mean_patch_mm"], rel=1e-5)
            assert facts["warnings"] == [] and "Warning" not in page
        else:
            assert side == pytest.approx(1e-3)
            assert told in facts["warnings"][0] and told in log and f"Warning: {told}" in page


def test_laws_of_another_mesh_are_others():
    """In the cache that runs share."""
    scene = read_scene(BLOCK, [*ROUGH, SMALL % "mesh"])
    one, other, again = (laws_key(with_patch(scene, side)) for side in (5e-3, 6e-3, 5e-3 + 1e-17))
    assert one == again != other
    assert json.dumps(one)


@pytest.mark.parametrize(
    ("changes", "mu"),
    [([], 0.1), (["samples.classical.friction=0.4"], 0.4), (["samples.classical.friction=0"], 0.0)],
)
def test_perfect_contact_has_the_friction_of_the_scene_unless_its_own_is_written(changes, mu):
    scene = read_scene(BLOCK, [*ROUGH, SMALL % "1 mm", *changes])
    contact = SimpleNamespace(interface=np.zeros(3, dtype=int), speed=np.ones(3))
    sample = draw_sample(scene, "classical", 0, at_contact(contact))
    np.testing.assert_array_equal(sample.friction.mu, mu)
    assert friction_texts(scene) == {"multi-scale": "0.1", "classical": f"{mu:g}"}


def test_friction_that_depends_on_the_speed_is_inherited_too():
    scene = read_scene(BLOCK, [*ROUGH, SMALL % "1 mm", FALLING])
    contact = SimpleNamespace(interface=np.zeros(2, dtype=int), speed=np.array([0.0, 1e3]))
    sample = draw_sample(scene, "classical", 0, at_contact(contact))
    np.testing.assert_allclose(sample.friction.mu, [0.6, 0.4])
    assert friction_texts(scene)["classical"] == "0.6 to 0.4"


@pytest.mark.parametrize(
    ("changes", "warned"),
    [
        ([], True),
        (["stability.threshold=0.01"], False),
        ([FALLING, "stability.damping={ slope=true }"], True),
        (["stability.damping={ rayleigh=['50 1/s','0 s'] }"], False),
        (["stability.damping={ sliding=true }"], False),
        (["contact.block_plate.friction=0"], False),
        (["stages=['equilibrium']"], False),
    ],
)
def test_a_scene_with_friction_and_without_damping_is_warned_of(changes, warned):
    said = [line for line in warnings(read_scene(BLOCK, changes)) if "no damping" in line]
    assert len(said) == warned


def test_a_threshold_in_place_of_damping_is_said_and_no_warning(capsys):
    line = "the model has no damping; squeal is counted below -0.01 instead"
    for changes, said in (([], False), (["stability.threshold=0.01"], True)):
        describe(BLOCK, MPI.COMM_SELF, [*changes])
        lines = capsys.readouterr().out.splitlines()
        assert (line in lines) == said
        assert any("warning: no damping" in text for text in lines) != said


def test_contact_without_roughness_is_not_called_multi_scale():
    assert listed(read_scene(BLOCK)) == "smooth contact 0.5"
    assert listed(read_scene(BLOCK, [*ROUGH, SMALL % "1 mm"])).startswith("multi-scale 0.1")


def test_what_acts_on_a_clamped_face_is_warned_of():
    on = 'masses={ "plate.bottom"={ mass="1 kg" }, "plate.top"={ mass="1 kg" } }'
    push = 'loads."plate.bottom"={ pressure="1 bar" }'
    spring = 'springs={ "plate.bottom"={ stiffness=["1 N/m", "1 N/m", "1 N/m"] } }'
    said = [text for text in warnings(read_scene(BLOCK, [on, push, spring])) if "no effect" in text]
    assert [text.partition(": ")[0] for text in said] == [
        f'{section}."plate.bottom"' for section in ("masses", "springs", "loads")
    ]
    assert not any("no effect" in text for text in warnings(read_scene(BLOCK)))


CAP = [
    "parts.cap={ builder='block', z='20 mm', material='iron' }", "loads={}",
    "loads.'cap.top'={ pressure='1 bar' }", "ties.cap.faces=['cap.bottom', 'block.top']",
]  # fmt: skip
SWAPPED = "contact.block_plate.faces=['plate.top', 'block.bottom']"


@pytest.mark.parametrize(
    ("changes", "warned"),
    [
        ([], False),
        ([SWAPPED], True),
        # A load on both bodies says nothing, nor do faces that stick.
        ([SWAPPED, "loads.'plate.top'={ pressure='1 bar' }"], False),
        ([SWAPPED, "contact.block_plate.slip=stuck",
          "contact.block_plate.tangential_stiffness='1e13 Pa/m'"], False),
        # A pad that a loaded body presses on through a tie.
        ([SWAPPED, *CAP], True),
        (CAP, False),
    ],
)  # fmt: skip
def test_swapped_faces_are_warned_of(changes, warned):
    said = [text for text in warnings(read_scene(BLOCK, changes)) if "body that moves" in text]
    assert len(said) == warned
    assert all("contact.block_plate.faces" in text and "'block'" in text for text in said)


def test_coarse_pixels_and_scans_in_millimetres_are_warned_of(tmp_path):
    """Pixels of 1/51 of a patch of 100 resolved pixels pass, those of 1/40 do not."""
    content = dict(np.load(SCENES / "pad_scan.npz"))
    (tmp_path / "s.toml").write_text('stages = ["surface", "micro"]\n')

    def said(size, patch, pixels):
        np.savez(tmp_path / "scan.npz", **content | {"size": [size, size]})
        micro = f"micro={{ patch='{patch} mm', pixels={pixels} }}"
        scene = read_scene(tmp_path / "s.toml", ["surface.scan=scan.npz", micro])
        stats = read_surface(scene)
        return stats.pixel, surface_warnings(with_pixels(scene, stats), stats)

    fine, lines = said(1.8e-3, 1, "'scan'")
    assert not any("micro.pixels" in text or "metres" in text for text in lines)
    _, lines = said(1.8e-3, 1e5 * fine, 51)
    assert not any("micro.pixels" in text for text in lines)
    _, lines = said(1.8e-3, 1e5 * fine, 40)
    (line,) = [text for text in lines if "micro.pixels" in text]
    assert f"micro.pixels = 40: pixels of {2.5e6 * fine:.3g} um" in line
    assert "(100 pixels" in line
    _, lines = said(0.4, 1, 64)
    (line,) = [text for text in lines if "metres" in text]
    assert "a scan of 400 x 400 mm" in line


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ('loads={ "block.bottom"={ pressure="5 bar" } }',
         'block.bottom, has a pressure of its own, loads."block.bottom", which pushes'),
        ("supports={ 'plate.bottom'='clamped', 'block.bottom'='clamped' }",
         "block.bottom, is held in all directions by supports, so that the loads on block do not"),
    ],
)  # fmt: skip
def test_loads_that_do_not_press_the_contact_faces_together_are_named(change, said):
    (line,) = warnings(read_scene(BLOCK, [*ROUGH, SMALL % "mesh", change]))
    assert line.startswith(f"contact.block_plate.faces: {said}")

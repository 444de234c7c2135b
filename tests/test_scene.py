"""The scene: units at the border, and one clear line for every mistake."""

import json
import shutil
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pint
import pytest

from brake_fenicsx.checks import check
from brake_fenicsx.cli import main
from brake_fenicsx.errors import SceneError
from brake_fenicsx.pipeline import run
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.digest import in_effect, result_digest
from brake_fenicsx.scene.keys import walk
from brake_fenicsx.scene.read import with_values
from brake_fenicsx.scene.units import FACTORS, to_si, usual_unit, with_unit
from places import BLOCK, DEMO, SCENES, WHOLE

DAMPED = 'damping = { rayleigh = ["9 1/s", "0.1 us"] }\nthreshold'
RANDOM = """
[samples.random]
'loads."block.top".pressure' = { law = "lognormal", mean = "5e3 mbar", sd = "1 bar" }
"""


def test_values_written_back_keep_their_units(tmp_path):
    """Lengths, rates, a list of two units, a frequency in rad/s, and the mean of a random load."""
    text = (SCENES / "squealing_block.toml").read_text()
    for old, new in (("18 kHz", "90 krad/s"), ("threshold", DAMPED), ("1 m/s", "0.1 cm/ms")):
        text = text.replace(old, new)
    file = tmp_path / "scene.toml"
    file.write_text(text.partition("[[countermeasures]]")[0] + RANDOM)
    values = {
        ("parts", "block", "length"): 0.0412, ("contact", "block_plate", "law", "u0"): 4e-7,
        ("loads", "block.top", "pressure"): 6e5, ("motion", "speed"): 1.3,
        ("stability", "band"): (0.0, 14e3), ("stability", "damping", "rayleigh"): (12.0, 2e-7),
        ("samples", "random", 'loads."block.top".pressure', "mean"): 4.4e5,
    }  # fmt: skip
    file.write_text(with_values(read_scene(file), values))
    scene = read_scene(file)
    found = {keys: value for keys, _, value in walk(scene) if keys in values}
    found["parts", "block", "length"] = scene.parts["block"].parameters.length
    found["motion", "speed"] = scene.motion.rate
    assert found == {k: pytest.approx(v, rel=1e-5) for k, v in values.items()}
    for said in ('"41.2 mm"', '"0.13 cm/ms"', '"87.9646 krad/s"', '"0.2 us"', '"4400 mbar"'):
        assert said in file.read_text()


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("5 bar", "Pa", 5e5),
        ("1983.3 MPa", "Pa", 1983.3e6),
        ("2.825 mm", "m", 2.825e-3),
        ("60 deg", "rad", np.pi / 3),
        ("8 N/mm^3", "Pa/m", 8e9),
        ("16 kHz", "Hz", 16e3),
        ("6 rad/s", "Hz", 3 / np.pi),
        ("3 Hz", "rad/s", 6 * np.pi),
        ("60 rpm", "rad/s", 2 * np.pi),
        ("60 rpm", "Hz", 1.0),
        ("30 1/mm", "1/m", 30e3),
        ("7.2 g/cm^3", "kg/m^3", 7200.0),
    ],
)
def test_units_become_si(text, unit, value):
    """A factor of ten in a unit would go through every later stage unseen."""
    assert to_si(text, unit) == pytest.approx(value, rel=1e-12)


def test_usual_units_are_those_of_pint():
    """They are converted without it."""
    registry = pint.UnitRegistry()
    for unit, factors in FACTORS.items():
        assert usual_unit(unit) in factors
        for name in factors:
            for text in (f"7 {name}", f"-0.37 {name}", f"1983.3e-2 {name}"):
                assert to_si(text, unit) == registry.Quantity(text).m_as(unit), text
            value = 1234.5678901234 * factors[name]
            known = registry.Quantity(value, unit).m_as(usual_unit(unit))
            assert with_unit(value, unit) == f"{known:.10g} {usual_unit(unit)}"


def test_reference_scene_has_the_sizes_of_the_study():
    scene = read_scene(SCENES / "disc_brake.toml")
    assert (scene.micro.laws, scene.micro.pixels, scene.samples.n) == (100, 128, 300)
    assert scene.micro.patch == "mesh"
    assert scene.stability.band == pytest.approx((0.0, 16e3))
    assert scene.samples.classical.penalty == pytest.approx(2e13)


def test_override_replaces_a_key():
    scene = read_scene(
        BLOCK, ["contact.block_plate.friction=0.25", "stability.band=['0 Hz', '5 kHz']"]
    )
    assert scene.contact["block_plate"].friction == 0.25
    assert scene.stability.band[1] == 5e3


def test_override_with_quoted_key():
    scene = read_scene(BLOCK, ['loads."block.top".pressure=7 bar'])
    assert scene.loads["block.top"].pressure == pytest.approx(7e5)


MATERIAL = "{ model='isotropic', E='1 GPa', nu=0.3, rho='1000 kg/m^3' }"
MISTAKES = [
    ("contact.block_plate.frcition=0.3", "contact.block_plate.frcition", "friction"),
    ('loads."block.top".pressure=5 mm', "5 mm", "pressure"),
    ('loads."block.top".pressure=5', "unit is missing", "MPa"),
    ("parts.block.size=-3 mm", "parts.block.size", "positive"),
    ("materials.lining.C12=9 GPa", "materials.lining", "positive definite"),
    ("materials.iron.nu=0.5", "materials.iron", "nu"),
    ("parts.block.material=wood", "wood", "[materials.wood]"),
    ('supports."block.left"=clamped', "block.left", "block.top"),
    ("stages=['equilibrium','statbility']", "statbility", "stability"),
    ("stages=['micro','equilibrium']", "micro", "[micro]"),
    ("contact.block_plate.gap=hdf", "hdf", "surface"),
    ("stability.band=['9 kHz','1 kHz']", "stability.band", "lowest"),
    ("motion.speed=3 bar", "motion.speed", "m/s"),
    ("parts.block.builder=cube", "cube", "block"),
    ("samples.approaches=['parametric']", "parametric", "samples.random"),
    ("contact.block_plate.friction=-0.1", "friction", "zero or more"),
    ("samples.n=2.5", "samples.n", "whole number"),
    ("stability.tolerance=0", "stability.tolerance", "positive"),
    ("stability.zeta_max=0.8", "stability.zeta_max", "between 1e-06 and 0.7"),
    ("stability.tolerance=1e-16", "stability.tolerance = 1e-16", "between 1e-12 and 0.01"),
    ("samples.n=9223372036854775808", "samples.n = 9223372036854775808", "10000000 at most"),
    (f"materials.'a.b'={MATERIAL}", 'materials."a.b"', "without dots"),
    (f'materials."a\\u202eb"={MATERIAL}', 'materials."a\\u202eb"', "visible characters"),
    (f"materials.{5000 * 'a'}={MATERIAL}", "materials.aaa", "1 to 100"),
    ("stability.damping={}", "stability.damping: no term", "rayleigh"),
    ("motion.friction=0.3", "motion.friction", "friction belongs to [contact.NAME]"),
    ("stability.hardness='1 MPa'", "stability.hardness", "hardness belongs to [micro]"),
    ("surface.pressure='5 bar'", "surface.pressure", "pressure belongs to [loads.NAME]"),
    ("stability.damping.raleigh=[0, 0]", "raleigh", "did you mean 'rayleigh'"),
    ("stability.damping.rayleigh=['1 1/s']", "['1 1/s']", "2 values, [1/s, s]"),
    ("stability.damping.rayleigh=['1 s', '1 s']", "wrong unit", "rate"),
    ("stability.damping.rayleigh=[0, 0]", "rayleigh", "leave it out"),
    ("stability.damping.loss=1", "stability.damping.loss = 1", "true or false"),
    ("stability.damping.loss=true", "stability.damping.loss", "omega_ref, where"),
    ("stability.damping.omega_ref=2 kHz", "omega_ref = '2 kHz'", "loss = true"),
    ("stability.damping={ loss=true, omega_ref='2 mm' }", "'2 mm'", "write a frequency"),
    ("stability.damping={ loss=true, omega_ref='-2 kHz' }", "omega_ref", "positive"),
    ("stability.damping={ loss=true, omega_ref='2 kHz' }", "loss factor", "materials.NAME.loss"),
    ("stability.damping.slope=true", "stability.damping.slope", "static"),
    ("stability.damping.gyroscopic=true", "gyroscopic", "motion.axis"),
    ("stability.band=high", "stability.band = 'high'", "write a list"),
    ("samples.approaches=[]", "samples.approaches = []", "classical"),
    ("samples.limit=50", "samples.limit = 50", "fraction"),
    ("stability.threshold=1", "stability.threshold = 1", "fraction"),
    ("stability={ band=['0 Hz','18 kHz'], method='reduced', cutoff='1 kHz' }", "cutoff", "above"),
    ("micro={ pixels=1 }", "micro.pixels = 1", "write 2 to"),
    ("micro={ nu=1.5 }", "micro.nu = 1.5", "between -1 and 1"),
    ("motion.direction=[0, 0, 0]", "motion.direction", "not all zero"),
    ("materials.iron.rho=7800", "materials.iron.rho", "unit is missing"),
    ("materials.iron.rho='7800'", "no unit; write a density", "'7800 kg/m^3'"),
    ("stability.band=['0 Hz', '30 KHz']", "unknown unit 'KHz'", "did you mean 'kHz'?"),
    ("materials.iron.E='125 Gpa'", "unknown unit 'Gpa'", "did you mean 'GPa'?"),
    ("materials.iron.E='125 bananas'", "unknown unit 'bananas'", "write pressure or modulus"),
    ("materials.iron.E=GPa", "not a quantity", "pressure or modulus"),
    ("stability.threshold=-0.01", "zero or more", "damping below -0.01"),
    ("materials.irno.E=1 GPa", "materials.irno.model: missing", "there are beside irno: iron"),
    (
        "stability.damping.modal={ ratio=0.02 }",
        "ratio = 0.02: write a table",
        "belongs to [stability.damping.modal.NAME]",
    ),
    ("micro={ hardness='1 Pa' }", "micro.hardness = 1 Pa", "correct the unit"),
    # A value in the place of a table, and the other way round.
    ("parts=[]", "parts = []", "write a table"),
    ("contact=nan", "contact = nan", "write a table"),
    ("stages={}", "stages = {}", "write a list"),
    ("parts.block.builder=[]", "parts.block.builder = []", "use one of"),
    ("parts.block.material=3", "parts.block.material = 3", "text or table"),
    ("parts.block.material.body=3", "--set", "parts.block.material is 'lining', no table"),
    ("contact.block_plate.law=libary", "contact.block_plate.law = 'libary'", '"library", { linear'),
    ("contact.block_plate.friction=true", "friction = True", "number or table"),
    ("contact.block_plate.faces=[1, 2]", "faces = [1, 2]", "write text"),
    ('supports."block.top"=[["x"]]', 'supports."block.top" = [[', "use one of x, y, z"),
    ("materials.iron.E={}", "materials.iron.E = {}", "modulus"),
    ("micro={ patch='msh' }", "micro.patch = 'msh'", 'write "mesh" or length'),
    ("micro={ laws='many' }", "micro.laws = 'many'", "whole number"),
    ("stability.damping.gyroscopic=disc", "gyroscopic = 'disc'", "true or false or list of text"),
    ("mesh.order=true", "mesh.order = True", "use one of 1, 2"),
    # A comma is a decimal point to some readers and a separator to others.
    ('loads."block.top".pressure=2,5 bar', "'2,5 bar'", "write the decimal point"),
    ("stability.damping={ loss=true, omega_ref='1,5 kHz' }", "'1,5 kHz'", "write a frequency"),
    (
        "samples.random.'loads.\"block.top\".pressure'={ law='uniform', min='1,5 bar' }",
        "min = '1,5 bar'",
        "write the decimal point",
    ),
    # Neither infinite nor no number.
    ("materials.iron.rho=1e400 kg/m^3", "materials.iron.rho", "finite"),
    ("contact.block_plate.friction=nan", "friction = nan", "finite"),
    (f"stability.zeta_max=1{400 * '0'}", "stability.zeta_max", "finite"),
    # Longer or shorter than any brake: refused before gmsh is asked.
    ("parts.block.length=40 m", "parts.block.length = 40 m", "mesh.extent"),
    ("parts.block.size=5 parsec", "parts.block.size", "mesh.extent"),
    # One sample, whatever is asked for.
    ("samples.n=300", "samples.n", "the stage uncertainty"),
    (
        "samples.random.'materials.iron.E'={ law='uniform', spread=0.1 }",
        "samples.random",
        "the stage uncertainty",
    ),
    # A list that is not one value for each axis, with the unit of what is shown.
    ("loads={ 'block.top'={ force=['1 kN', 0] } }", "force = [1000.0, 0.0] N: write three", "kN"),
    ("loads={ 'block.top'={ moment=[0, 0, 0] } }", "[0.0, 0.0, 0.0] N m: write three", '"50 N m"'),
    ("motion={ point=['1 mm', 0] }", "motion.point = [0.001, 0.0] m", "write three numbers"),
    ("springs.link={ faces=['a', 'a'], damping=[0, 0, '1 N s/m'] }", "springs.link.faces", "two"),
    # Meshing would go on for days.
    ("parts.block.size=1 um", "parts.block", "cells of the mesh size asked for"),
]


@pytest.mark.parametrize(("change", "named", "remedy"), MISTAKES)
def test_mistake_is_one_line_with_status_2_and_writes_nothing(
    change, named, remedy, tmp_path, capsys, monkeypatch
):
    """File, key, value and remedy in one line; no results folder is left behind."""
    monkeypatch.chdir(tmp_path)
    assert main(["run", str(BLOCK), "--set", change]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert str(BLOCK) in error
    assert named in error
    assert remedy in error
    assert list(tmp_path.iterdir()) == []


def test_what_only_the_mesh_can_tell_leaves_no_folder_either(tmp_path, capsys):
    """The plate would move away from the block; by then the log had begun."""
    words = ["run", str(BLOCK), "--set", "motion.direction=[0, 0, 1]", "-o", str(tmp_path / "new")]
    assert main(words) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert str(BLOCK) in error and "does not slide" in error and "motion" in error
    assert list(tmp_path.iterdir()) == []


CONTRADICTIONS = [
    (["contact.block_plate.friction=0"], "sliding=true", "contact.NAME.friction"),
    (["contact.block_plate.friction={ static=0.5, kinetic=0.5, decay='1 m/s' }"], "slope=true",
     "depends on the speed"),
    (["contact.block_plate.friction={ static=0.6, kinetic=0.5, decay='1 m/s' }",
      "samples.classical.friction=0.5", "samples.approaches=['classical']"], "slope=true",
     "name multi-scale"),
    (["motion={ axis='z', speed='0 rad/s' }"], "gyroscopic=true", "needs a rotation"),
    (["motion={ axis='z', speed='3 rad/s' }"], "gyroscopic=['disc']", "no part 'disc'"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "term", "remedy"), CONTRADICTIONS)
def test_a_damping_term_without_what_it_acts_on(changes, term, remedy):
    """It would be silently zero."""
    with pytest.raises(SceneError, match=remedy) as error:
        read_scene(BLOCK, [*changes, f"stability.damping.{term}"])
    assert "damping" in str(error.value)


def test_what_cannot_be_read_is_named_before_what_contradicts():
    changes = ["stability.threshold=2", "parts.block.length=3", "stability.zeta_max=0.9"]
    for named in ("parts.block.length = 3: the unit", "stability.zeta_max = 0.9", "threshold = 2"):
        with pytest.raises(SceneError, match=named):
            read_scene(BLOCK, changes)
        changes = [text for text in changes if text.partition("=")[0] not in named]


SPEEDS = [("direction=[0, 2, 0]", 1.0), ("axis='z'", 1.0), ("axis='z', speed='60 rpm'", 2 * np.pi)]


@pytest.mark.parametrize(("motion", "speed"), SPEEDS)
def test_speed_that_is_not_given(motion, speed):
    """One metre a second along a direction, one radian a second about the axis."""
    from brake_fenicsx.build.interfaces import scene_motion
    from brake_fenicsx.scene.scalars import si_unit

    scene = read_scene(BLOCK, [f"motion={{ {motion} }}"])
    assert si_unit(scene, "motion.speed") == ("rad/s" if "axis" in motion else "m/s")
    found = scene_motion(scene)
    np.testing.assert_allclose(found.velocity(np.array([[1.0, 0, 0]])), [[0, speed, 0]], rtol=1e-12)


def test_an_empty_scene_has_no_stages(tmp_path):
    """Nothing in the file: refused; stages = [] is that of parts alone."""
    (tmp_path / "a.toml").write_text("")
    with pytest.raises(SceneError, match="stages: missing; name some of surface, micro"):
        read_scene(tmp_path / "a.toml")
    assert read_scene({"stages": []}).stages == ()


RANGES = [
    ("samples.random={'materials.lining.C33'={law='normal', mean='2.27 GPa', sd='0.8 GPa'}}",
     "the law reaches -202 MPa with a probability of 0.001; write a positive min"),
    ("samples.random={'materials.lining.C33'={law='uniform', spread=0.9}}",
     "materials.lining is not positive definite everywhere in the range of its values, with"
     " materials.lining.C33 = 231 MPa"),
    ("sweep.parameters={'materials.lining.C33'={start='0.1 GPa', stop='2.27 GPa'}}",
     "materials.lining is not positive definite"),
    ("sweep.parameters={'materials.lining.C33'={start='-1 GPa', stop='2.27 GPa'}}",
     "-1e+09: must be positive"),
    ("samples.random={'materials.lining.rho'={law='normal', mean='2 t/m^3', sd='1 t/m^3'}}",
     "the law reaches"),
    ("samples.random={'contact.pad_disc.friction'={law='measured', values=[-0.5, 0.4]}}",
     "1 of 2 measured values must be zero or more, the least is -0.5"),
    ("samples.random={'materials.lining.rho'={law='measured', values=['-1 t/m^3', '2 t/m^3']}}",
     "1 of 2 measured values must be positive, the least is -1000"),
    ("samples.random={'contact.pad_disc.friction'={law='uniform', min=-0.1, max=0.4}}",
     ".min = -0.1: must be zero or more"),
]  # fmt: skip


@pytest.mark.hard
@pytest.mark.parametrize(("change", "text"), RANGES)
def test_ranges_that_hold_no_material_are_refused_by_check(change, text):
    """Random and swept moduli, densities and friction beyond what they can be: refused at once.

    The lining is positive definite from C33 = 0.29 GPa on: C13^2 = C33 (C11 + C12) / 2.
    """
    least = 2 * 0.98**2 / (5.94 + 0.76)
    assert abs(least - 0.287) < 1e-3
    with pytest.raises(SceneError) as caught:
        joint = ["samples.approaches=['joint']"] * change.startswith("samples")
        check(read_scene(DEMO, [*joint, change]), MPI.COMM_SELF)
    assert text in str(caught.value) and "disc_brake_demo.toml: " in str(caught.value)


def test_a_face_size_with_a_slip_of_its_unit_is_refused():
    """Ten decades finer than the disc: gmsh would never end."""
    scene = BLOCK.with_name("vented_brake.toml")
    for value in ("1e-13 m", "10 um"):
        with pytest.raises(SceneError, match=r"disc\.face_size = 1e-\d+ m: less than 0\.0003 of"):
            read_scene(scene, [f"parts.disc.face_size={value}"])
    read_scene(scene, ["parts.disc.face_size=1 mm"])


def test_what_is_no_scene(tmp_path, capsys):
    """Nothing, a folder, noise: a line with its path."""
    (tmp_path / "noise.toml").write_bytes(bytes(range(128, 256)))
    for path in (tmp_path / "none.toml", tmp_path, tmp_path / "noise.toml"):
        assert main(["check", str(path)]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1 and str(path) in error
        assert ("no such file" in error) == (not path.exists())


def test_encodings_of_a_scene(tmp_path):
    """A byte order mark is no part of the text; another encoding is named."""
    text = BLOCK.read_text().replace("# The smallest", "# For the caf\u00e9: the smallest")
    (marked := tmp_path / "marked.toml").write_text(text, encoding="utf-8-sig")
    assert read_scene(marked).table == read_scene(BLOCK).table
    (other := tmp_path / "latin.toml").write_text(text, encoding="latin-1")
    with pytest.raises(SceneError, match=r"latin.toml: line 1: not UTF-8 text; save .* as UTF-8"):
        read_scene(other)


def test_a_tilde_is_the_home_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert read_scene(BLOCK).path("~/scan.npz") == tmp_path / "scan.npz"


@pytest.mark.parametrize("words", [[], ["frobnicate"], ["run"], ["run", "a", "--from", "lunch"]])
def test_a_wrong_command_line_is_one_line_too(words, capsys):
    assert main(words) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "--help" in error


def test_results_folder_that_cannot_be_made(tmp_path, capsys):
    """A file stands in its place, or in its way."""
    (tmp_path / "file").write_text("precious")
    path = _surface_scene(tmp_path, rough())
    for folder in (tmp_path / "file", tmp_path / "file" / "sub"):
        assert main(["run", str(path), "-o", str(folder)]) == 2
        error = capsys.readouterr().err.splitlines()[-1]
        assert "cannot be written" in error and str(folder) in error and "-o" in error
    assert (tmp_path / "file").read_text() == "precious"


def rough() -> np.ndarray:
    """Self-affine heights [m]; white noise would be taken for the instrument's."""
    n = 128
    q = np.hypot(np.fft.fftfreq(n)[:, None], np.fft.fftfreq(n)[None, :])
    q[0, 0] = np.inf
    white = np.fft.fft2(np.random.default_rng(0).standard_normal((n, n)))
    return 1e-8 * np.fft.ifft2(white / q**2).real


def _surface_scene(folder: Path, heights: np.ndarray) -> Path:
    np.savez(folder / "scan.npz", heights=heights, size=np.array([1e-3, 1e-3]))
    path = folder / "surface.toml"
    path.write_text('stages = ["surface"]\n[surface]\nscan = "scan.npz"\n')
    return path


@pytest.mark.parametrize("there", [True, False])
def test_scan_that_is_not_there_or_has_no_valid_point(there, tmp_path, capsys, monkeypatch):
    path = _surface_scene(tmp_path, np.full((16, 16), np.nan))
    if not there:
        (tmp_path / "scan.npz").unlink()
    (work := tmp_path / "work").mkdir()
    monkeypatch.chdir(work)
    assert main(["run", str(path)]) == 2
    assert "surface.scan" in capsys.readouterr().err
    assert list(work.iterdir()) == []


@pytest.mark.parametrize(
    ("change", "named", "ratio"),
    [
        ("surface.statistics={ S_q='3 um' }", "surface.scan", "give either surface.scan or"),
        ("surface.size=['1.8 m', '1.4 m']", "correct surface.size", " times the longer side of"),
        ("surface.height_unit=mm", "correct surface.height_unit", " times the longer side of"),
    ],
)
def test_a_surface_that_contradicts_itself(change, named, ratio, tmp_path, capsys):
    """Heights of a thousand times the sides, sides of metres, two surfaces in one."""
    heights = 1e6 * rough()
    np.savetxt(tmp_path / "scan.txt", heights)
    path = tmp_path / "surface.toml"
    path.write_text(
        'stages = ["surface"]\n[surface]\nscan = "scan.txt"\nsize = ["1 mm", "1 mm"]\n'
        'height_unit = "um"\n'
    )
    assert main(["check", str(path)]) == 0
    capsys.readouterr()
    assert main(["check", str(path), "--set", change]) == 2
    error = capsys.readouterr().err.splitlines()
    assert len(error) <= 2 and named in error[-1] and ratio in error[-1]


def test_results_of_another_scene_are_not_overwritten(tmp_path):
    path = _surface_scene(tmp_path, rough())
    run(path, MPI.COMM_SELF, tmp_path / "out")
    with pytest.raises(SceneError, match="another scene"):
        run(path, MPI.COMM_SELF, tmp_path / "out", ["surface.level=none"])


def test_results_depend_on_the_content_of_files(tmp_path):
    """A scan, mesh or matrix made again under its name is another scene; a moved folder is none."""
    one, two = tmp_path / "one", tmp_path / "two"
    one.mkdir(), two.mkdir()
    first, moved = (result_digest(read_scene(_surface_scene(f, rough()))) for f in (one, two))
    assert first == moved
    again = result_digest(read_scene(_surface_scene(one, 2 * rough())))
    assert again != first
    scene = Path(shutil.copy(WHOLE, tmp_path))
    shutil.copy(WHOLE.parent / "pad_scan.npz", tmp_path)
    caliper = Path(shutil.copytree(WHOLE.parent / "caliper", tmp_path / "caliper"))
    before = {result_digest(read_scene(scene))}
    for count, file in enumerate(sorted(caliper.iterdir()), start=2):
        file.write_bytes(file.read_bytes() + b"\n")
        before.add(result_digest(read_scene(scene)))
        assert len(before) == count, file


def test_another_threshold_is_no_other_scene():
    """What counts as squeal changes no result of a sample."""
    usual, other, band = (
        read_scene(BLOCK, changes)
        for changes in ([], ["stability.threshold=0.01"], ["stability.band=['0 Hz', '9 kHz']"])
    )
    assert (usual.stability.threshold, other.stability.threshold) == (0.0, 0.01)
    assert result_digest(other) == result_digest(usual) != result_digest(band)


def test_settings_in_effect_hold_defaults_in_si_units():
    scene = read_scene(SCENES / "disc_brake_study.toml", ["stability.band=['0 Hz', '9 kHz']"])
    found = in_effect(scene)
    assert found["stability"]["band"] == [0.0, 9000.0]
    assert found["stability"]["zeta_max"] == 0.1 and "damping" not in found["stability"]
    default = in_effect(read_scene(SCENES / "disc_brake.toml"))["stability"]["tolerance"]
    assert default == 1e-5
    assert found["micro"]["steps"] == 40 and "steps" not in scene.table["micro"]
    assert found["parts"]["disc"]["parameters"]["radius"] == pytest.approx(0.144)
    assert found["samples"]["random"]["materials.lining.E_3"] == {"law": "uniform", "spread": 0.2}
    assert "table" not in found and json.loads(json.dumps(found)) == found

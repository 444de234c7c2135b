"""What a scene says of its surface: pixels, distribution, spectrum, a second scan, hardness."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.build.law_stage import law_recipe
from brake_fenicsx.build.measured_surface import read_surface
from brake_fenicsx.checks import check, surface_warnings, with_pixels
from brake_fenicsx.errors import SceneError
from brake_fenicsx.micro import load_laws, save_laws
from brake_fenicsx.pipeline import run
from brake_fenicsx.report.figure_inputs import contact_maps
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.digest import laws_key, result_digest
from brake_fenicsx.surface import given_statistics, synthesise
from brake_fenicsx.surface.psd import wave_numbers
from places import SCENES

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
TEXT = """
stages = ["surface", "micro"]
[surface]
scan = "scan.npz"
{surface}
[micro]
patch = "1 mm"
laws = 2
scans = 4
{micro}
"""


def saved(path, heights, size):
    np.savez(path, heights=heights, size=np.array(size))


@pytest.fixture
def scene(tmp_path):
    """A scene of a scan of 128 pixels over 1.28 mm, with more keys."""
    topo = synthesise(
        PAPER.bifractal, PAPER.hdf, (128, 128), (1.28e-3, 1.28e-3), np.random.default_rng(0)
    )
    saved(tmp_path / "scan.npz", topo.heights, topo.size)

    def write(surface="", micro=""):
        file = tmp_path / "scene.toml"
        file.write_text(TEXT.format(surface=surface, micro=micro))
        return read_scene(file)

    return write


def test_pixels_of_the_scan(scene):
    """A patch of 1 mm has 100 pixels of 10 um; an instrument's cutoff of 40 um leaves 50."""
    named = scene()
    assert with_pixels(named, read_surface(named)).micro.pixels == 100
    cut = scene(surface='cutoff = "40 um"')
    assert with_pixels(cut, read_surface(cut)).micro.pixels == 50
    own = scene(micro="pixels = 32")
    assert with_pixels(own, read_surface(own)).micro.pixels == 32


def test_a_patch_of_too_many_pixels_is_refused(scene):
    named = scene()
    big = read_scene(named.file, ["micro.patch=30 mm"])
    with pytest.raises(SceneError, match=r"micro.pixels = .*write a number"):
        with_pixels(big, read_surface(big))


def test_the_source_is_a_choice_of_keys(scene):
    words = 'S_q = "scan"\nlow = "extend"\ndistribution = "johnson"\nspectrum = "fit"'
    named = scene(surface=words, micro="pixels = 64")
    stats = check(named, MPI.COMM_SELF)["surface"]
    recipe = law_recipe(named, stats)
    assert (recipe.variance, recipe.low, recipe.hdf.name) == ("scan", "extend", "johnson")
    assert recipe.psd is stats.bifractal and recipe.surface(0, 0).record.S_q == stats.hdf.S_q
    named = scene(micro="pixels = 64")
    measured = law_recipe(named, check(named, MPI.COMM_SELF)["surface"])
    assert measured.psd.misfit is not None and measured.hdf.name == "measured"


def test_measured_heights_need_a_scan(tmp_path):
    file = tmp_path / "scene.toml"
    text = TEXT.format(surface='distribution = "measured"', micro="")
    file.write_text(text.replace('scan = "scan.npz"', 'statistics = { S_q = "33 um" }'))
    with pytest.raises(SceneError, match="numbers hold no measured heights"):
        read_surface(read_scene(file))


def test_a_second_scan_holds_the_long_waves(scene, tmp_path):
    """The spectrum below the band of the scan is that of the form; a shorter form is refused."""
    rng = np.random.default_rng(5)
    long = synthesise(PAPER.bifractal, PAPER.hdf, (256, 256), (40e-3, 40e-3), rng, low="extend")
    saved(tmp_path / "face.npz", 3.0 * long.heights, long.size)
    stats = read_surface(scene(surface='form = "face.npz"'))
    fit = stats.spectrum
    assert fit.form is not None and fit.form.band[0] < 0.1 * fit.band[0]
    q = np.array([0.5 * fit.band[0]])
    assert fit(q)[0] == pytest.approx(fit.form(q)[0])
    plain = read_surface(scene()).spectrum
    assert fit(2 * q)[0] == pytest.approx(plain(2 * q)[0])
    topo = synthesise(fit, stats.hdf, (64, 64), (5e-3, 5e-3), rng)
    shorter = synthesise(plain, stats.hdf, (64, 64), (5e-3, 5e-3), rng)
    assert topo.record.S_q > 1.3 * shorter.record.S_q
    with pytest.raises(SceneError, match=r"surface.form = 'scan.npz': its longest wave"):
        read_surface(scene(surface='form = "scan.npz"'))
    with pytest.raises(SceneError, match=r"surface.form = 'none.npz': no such file"):
        scene(surface='form = "none.npz"')


def test_a_spectrum_that_ends_in_noise_is_named_with_its_cutoff(scene, tmp_path):
    """Correlated noise of the instrument: the fit is convex, and the wave length to cut at."""
    rng = np.random.default_rng(1)
    steep = given_statistics(10e-6, c1=-3.9, c2=-4.0, q_c=1e4)
    clean = synthesise(steep.bifractal, steep.hdf, (256, 256), (2e-3, 2e-3), rng)
    q = wave_numbers((256, 256), np.array([2e-3, 2e-3]))
    q[0, 0] = np.inf
    noise = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((256, 256))) / q, s=(256, 256))
    saved(tmp_path / "scan.npz", clean.heights + 0.3e-6 * noise / noise.std(), (2e-3, 2e-3))
    stats = read_surface(scene())
    assert stats.bifractal.convex
    (text,) = stats.warnings
    assert 'surface.cutoff = "' in text
    cut = float(text.split('"')[1].split()[0])
    assert 15 < cut < 200
    assert not read_surface(scene(surface=f'cutoff = "{cut} um"')).warnings


@pytest.mark.parametrize("hardness", [None, "200 MPa"])
def test_elastic_laws_say_what_they_carry(scene, tmp_path, hardness):
    """The page and the log warn of force beyond 400 MPa; with a hardness nothing carries more."""
    named = scene(micro="" if hardness is None else f'hardness = "{hardness}"')
    done = run(named.file, MPI.COMM_SELF, tmp_path / "out")
    texts = [t for t in done.facts["warnings"] if "elastic laws" in t]
    assert len(texts) == (1 if hardness is None else 0)
    with np.load(tmp_path / "out" / "laws.npz") as laws:
        if hardness is not None:
            own = laws["p"] > 0
            ratio = laws["v"][own] / laws["k"][own]
            assert np.median(ratio) > 1.5


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        (['micro.hardness="1 MPa"', "micro.max_pressure=0.1"], "must lie below micro.hardness"),
        (["micro.pixels=5000"], "write 2 to 2048"),
        (["surface.scan=[]"], r"surface.scan = \[\]: an empty list"),
        (['surface.S_q="scan"', "contact.a={ faces=['a', 'b'], gap='waviness' }"], "shares the"),
        (['surface.S_q="scan"', 'surface.form="scan.npz"'], "leave one out"),
        (["equilibrium.tolerance=1e-14"], "equilibrium.tolerance = 1e-14: must lie between 1e-13"),
        (["equilibrium.tolerance=0.1"], "equilibrium.tolerance = 0.1: must lie between"),
    ],
)
def test_keys_that_contradict_each_other(scene, changes, named):
    file = scene().file
    with pytest.raises(SceneError, match=named):
        read_scene(file, changes)


@pytest.mark.parametrize("line", ['cutoff = "20 um"', 'size = ["1 mm"]', 'height_unit = "um"'])
def test_scan_keys_beside_statistics_are_refused(tmp_path, line):
    file = tmp_path / "scene.toml"
    text = TEXT.format(surface=line, micro="")
    file.write_text(text.replace('scan = "scan.npz"', 'statistics = { S_q = "33 um" }'))
    with pytest.raises(SceneError, match=rf"surface.{line.split()[0]}: there is no scan"):
        read_scene(file)


def test_results_and_laws_depend_on_the_spectrum(scene):
    file = scene().file
    changes = ([], ["surface.spectrum=fit"], ["equilibrium.tolerance=1e-9"])
    read = [read_scene(file, change) for change in changes]
    assert len({result_digest(s) for s in read}) == 3
    laws = [laws_key(s) for s in read]
    assert laws[1] != laws[0] and laws[2] == laws[0]


@pytest.mark.parametrize(("factor", "stretch"), [(1e-3, 1.0), (0.01, 100.0)])
def test_heights_far_too_small_for_a_brake_are_named(scene, tmp_path, factor, stretch):
    """Millimetres read as micrometres, or pixels a hundred times too long."""
    with np.load(tmp_path / "scan.npz") as file:
        heights, size = factor * file["heights"], stretch * file["size"]
    saved(tmp_path / "scan.npz", heights, size)
    named = scene()
    quiet = surface_warnings(named, read_surface(named))
    brake = read_scene(SCENES / "disc_brake.toml", [f"surface.scan='{tmp_path / 'scan.npz'}'"])
    texts = surface_warnings(brake, read_surface(brake))
    assert not any("smooth" in t for t in quiet)
    assert sum("smooth" in t and "surface.height_unit" in t for t in texts) == 1


def test_laws_that_end_below_the_pressure_of_the_brake_are_named(scene, tmp_path):
    """A hardness of 1 MPa: laws end at 0.1 MPa, a usual braking pressure is 0.2 MPa."""
    named = scene(micro='hardness = "1 MPa"\npixels = 48')
    done = run(named.file, MPI.COMM_SELF, tmp_path / "out")
    assert any("laws end at 0.1 MPa" in text for text in done.facts["warnings"])


@pytest.mark.parametrize("hardness", [None, "200 MPa"])
def test_contact_maps_are_the_contact_of_the_first_law(scene, tmp_path, hardness):
    """Touching shares of the maps are those of the law; no point passes the hardness."""
    more = "pixels = 64\nseed = 5" + ("" if hardness is None else f'\nhardness = "{hardness}"')
    done = run(scene(micro=more).file, MPI.COMM_SELF, tmp_path / "out")
    contact_maps(tmp_path / "out")
    law, maps = load_laws(done.store.path("laws.npz")), done.store.load("contact_maps.npz")
    steps, E_star = law[0].steps, law.settings["E_star"]
    mean = maps["pressures"].mean(axis=(1, 2))
    np.testing.assert_allclose(mean, maps["p_over_E"] * E_star, rtol=1e-5)
    assert mean[-1] <= steps.p[-1] * (1 + 1e-5) and maps["pressures"].shape[1:] == (64, 64)
    share = np.interp(np.log(mean), np.log(steps.p), steps.area)
    np.testing.assert_allclose(maps["area_fraction"], share, atol=2 / 64**2, rtol=0.03)
    if hardness is not None:
        assert maps["pressures"].max() == pytest.approx(200e6, rel=1e-6)


def test_laws_of_an_older_version_are_refused_in_one_line(scene, tmp_path):
    done = run(scene(micro="pixels = 32").file, MPI.COMM_SELF, tmp_path / "out")
    path = done.store.path("laws.npz")
    laws = load_laws(path)
    save_laws(path, replace(laws, settings={"E_star": 1.0}))
    with pytest.raises(SceneError, match="made by an older version"):
        contact_maps(tmp_path / "out")

"""Surfaces with a direction: grooves of known spectrum, their statistics, surfaces and laws."""

from dataclasses import replace

import numpy as np
import pytest

from brake_fenicsx.build.measured_surface import read_surface
from brake_fenicsx.errors import SceneError
from brake_fenicsx.micro import LawSettings, make_library
from brake_fenicsx.micro.law_of_surface import law_steps
from brake_fenicsx.scene import read_scene
from brake_fenicsx.surface import averaged, characterise, make_topography, resampled, synthesise
from brake_fenicsx.surface.hdf import iso_parameters
from brake_fenicsx.surface.psd import anisotropy
from brake_fenicsx.surface.spectrum import Waviness
from brake_fenicsx.surface.topography import form

N, SIDE, S_Q = 128, 1.8e-3, 33e-6


def density(k):
    """Of the stretched wave number [rad/m], without a unit."""
    return np.where(k < 1.5e4, 1.0, (np.maximum(k, 1.0) / 1.5e4) ** -3.5)


def stretched(qx, qy, ratio, turn=0.0):
    """Grooves along y before they are turned: ``ratio`` times as long as wide."""
    c, s = np.cos(turn), np.sin(turn)
    return np.hypot((c * qx + s * qy) / np.sqrt(ratio), (c * qy - s * qx) * np.sqrt(ratio))


def cuts(seed, ratio, turn=0.0, many=4):
    """Scans cut from one long surface, not made by the program's own synthesis: many x many."""
    n = (many + 1) * N
    q = 2 * np.pi * np.fft.fftfreq(n, SIDE / N)
    C = density(stretched(q[:, None], q, ratio, turn))
    C[0, 0] = 0.0
    noise = np.fft.fft2(np.random.default_rng(seed).standard_normal((n, n)))
    z = np.fft.ifft2(noise * np.sqrt(C)).real
    z *= S_Q / z.std()
    return [
        make_topography(z[i * N : (i + 1) * N, j * N : (j + 1) * N], (SIDE, SIDE))
        for i in range(many) for j in range(many)
    ]  # fmt: skip


def artificial(stats, many, seed=0):
    rng = np.random.default_rng(seed)
    made = [synthesise(stats.spectrum, stats.hdf, (N, N), (SIDE, SIDE), rng) for _ in range(many)]
    return [make_topography(t.heights, t.size) for t in made]


def levelled(topo):
    return make_topography(topo.heights - form(topo, "plane"), topo.size)


def laws(surfaces):
    """Logarithms of k and v at 0.2 MPa, shape (surfaces, 2)."""
    settings = LawSettings(2.37e9, hardness=200e6, max_pressure=0.5e6)
    found = make_library([law_steps(levelled(t), settings) for t in surfaces]).at_pressure(0.2e6)
    return np.log(np.stack([found.k, found.v], axis=1))


@pytest.mark.parametrize("ratio", [1, 4, 16])
def test_anisotropy_is_that_of_the_variance(ratio):
    """(r - 1) / (r + 1) of a spectrum stretched by r; wave vectors lie across the grooves."""
    turn = 0.7
    surfaces = cuts(0, ratio, turn)
    found = [anisotropy(levelled(t), (5e3, 2e5)) for t in surfaces]
    strength, direction = np.transpose(found)
    assert strength.mean() == pytest.approx(
        (ratio - 1) / (ratio + 1), abs=0.2 if ratio == 1 else 0.12
    )
    if ratio > 1:
        assert np.all(np.abs(np.sin(direction - turn)) < 0.2)
    warned = [
        any("has a direction: grooves at" in text for text in characterise(t).warnings)
        for t in surfaces[::3]
    ]
    assert all(warned) if ratio > 1 else not any(warned)


@pytest.mark.long
@pytest.mark.parametrize("ratio", [4, 16])
def test_surfaces_have_the_two_dimensional_spectrum(ratio):
    """Density in eight sectors of three rings against the known one, from the mean of 16 scans."""
    turn = np.radians(33.75)  # the middle of a sector
    stats = averaged([characterise(t, spectrum="fit") for t in cuts(1, ratio, turn)],
                     spectrum="directional")  # fmt: skip
    for q in (2e4, 5e4, 1e5):
        angle = np.pi * (np.arange(720) + 0.5) / 720
        truth = density(stretched(q * np.cos(angle), q * np.sin(angle), ratio, turn))
        found = stats.spectrum.on(q * np.cos(angle), q * np.sin(angle), "flat")
        share = [x.reshape(8, 90).sum(axis=1) / x.sum() for x in (truth, found)]
        # Forty waves of the lowest ring lie in a sector.
        np.testing.assert_allclose(share[1], share[0], atol=0.06 if q > 2e4 else 0.12)
    # And of the surfaces themselves, against isotropic ones.
    isotropic = replace(stats, spectrum=replace(stats.spectrum, lay=None))
    texture = [
        np.median([iso_parameters(levelled(t))["S_tr"] for t in surfaces])
        for surfaces in (cuts(2, ratio, turn, 3), artificial(stats, 9), artificial(isotropic, 9))
    ]
    assert texture[1] == pytest.approx(texture[0], rel=0.35) and texture[2] > 2 * texture[1]
    assert not any("direction" in text for text in stats.warnings)


@pytest.mark.parametrize("ratio", [4, 16])
def test_laws_of_grooved_surfaces_are_those_of_independent_cuts(ratio):
    """One scan's artificial surfaces, and 12 cuts of one long surface, at 0.2 MPa."""
    stats = averaged([characterise(t, spectrum="fit") for t in cuts(3, ratio, many=2)],
                     spectrum="directional")  # fmt: skip
    own, other = laws(artificial(stats, 12)), laws(cuts(4, ratio, many=4)[:12])
    scatter = np.sqrt((own.var(0, ddof=1) + other.var(0, ddof=1)) / 12)
    assert np.all(np.abs(own.mean(0) - other.mean(0)) < 3 * scatter), (own.mean(0), other.mean(0))


def test_statistics_drawn_anew_keep_the_direction():
    stats = characterise(cuts(5, 16, 0.3)[0], spectrum="directional")
    drawn = resampled(stats, np.random.default_rng(0))
    assert drawn.spectrum.lay is not None and drawn.anisotropy > 0.7
    assert abs(np.sin(drawn.direction - stats.direction)) < 0.1


def test_the_scene_turns_the_grooves(tmp_path):
    """Grooves named at 60 deg: wave vectors at 150 deg, of patches and of the waves of a face."""
    topo = cuts(6, 16, 0.2)[0]
    np.savez(tmp_path / "scan.npz", heights=topo.heights, size=topo.size)
    text = 'stages = ["surface"]\n[surface]\nscan = "scan.npz"\nspectrum = "directional"\n'
    (tmp_path / "a.toml").write_text(text + 'grooves = "60 deg"\n')
    stats = read_surface(read_scene(tmp_path / "a.toml"))
    for made in artificial(stats, 3):
        _, direction = anisotropy(made, (5e3, 2e5))
        assert abs(np.sin(direction - np.radians(150))) < 0.12
    n, patch = 96, 0.1e-3
    x = np.stack(np.meshgrid(*[np.arange(n) * patch] * 2, indexing="ij"), -1).reshape(-1, 2)
    field = Waviness(stats.spectrum, patch).sample(x, np.random.default_rng(0)).reshape(n, n)
    face = make_topography(field, (n * patch, n * patch))
    strength, direction = anisotropy(levelled(face), (8e3, 2.5e4))
    assert strength > 0.5 and abs(np.sin(direction - np.radians(150))) < 0.2

    with pytest.raises(
        SceneError, match=r'surface.grooves: spectrum = "measured" has no direction'
    ):
        read_scene(tmp_path / "a.toml", ["surface.spectrum=measured"])
    stats_ = "surface.statistics={ S_q = '1 um' }"
    (tmp_path / "b.toml").write_text('stages = ["surface"]\n[surface]\nspectrum = "directional"\n')
    with pytest.raises(SceneError, match="statistics have no direction"):
        read_scene(tmp_path / "b.toml", [stats_])

"""Reading: own formats there and back, instrument files, and files that lie."""

import logging
import os
from pathlib import Path

import h5py
import numpy as np
import pytest

from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.surface import characterise, read_topography
from brake_fenicsx.surface.readers import MISSING

HEIGHTS = 1e-6 * np.random.default_rng(0).standard_normal((12, 9))
SIZE = (1.2e-3, 0.9e-3)

SCANS = os.environ.get("BRAKE_FENICSX_SCANS")
needs_scans = pytest.mark.skipif(SCANS is None, reason="BRAKE_FENICSX_SCANS is not set")


def test_npz_in_metres(tmp_path):
    np.savez(tmp_path / "a.npz", heights=HEIGHTS, size=SIZE)
    topo = read_topography(tmp_path / "a.npz")
    np.testing.assert_array_equal(topo.heights, HEIGHTS)
    np.testing.assert_array_equal(topo.size, SIZE)
    assert topo.warnings == ()


def test_npz_of_scaled_integers_with_holes(tmp_path):
    counts = np.rint(HEIGHTS / 1e-9).astype(np.int16)
    counts[2, 3] = MISSING
    np.savez(tmp_path / "a.npz", heights=counts, size=SIZE, scale=1e-9)
    topo = read_topography(tmp_path / "a.npz")
    assert np.isnan(topo.heights[2, 3]) and np.isnan(topo.heights).sum() == 1
    np.testing.assert_allclose(topo.heights[topo.valid], HEIGHTS[topo.valid], atol=0.51e-9)


def test_hdf5(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["heights"], file["size"], file["scale"] = HEIGHTS * 1e6, SIZE, 1e-6
    np.testing.assert_allclose(read_topography(tmp_path / "a.h5").heights, HEIGHTS, rtol=1e-14)


def test_text_matrix_needs_size_and_unit(tmp_path):
    """A bare table of numbers says nothing of lengths: the reader asks for them."""
    np.savetxt(tmp_path / "a.txt", HEIGHTS * 1e6)
    with pytest.raises(SurfaceError, match="size"):
        read_topography(tmp_path / "a.txt")
    topo = read_topography(tmp_path / "a.txt", size=SIZE, height_unit="um")
    np.testing.assert_array_equal(topo.size, SIZE)
    np.testing.assert_allclose(np.sort(topo.heights.ravel()), np.sort(HEIGHTS.ravel()), rtol=1e-9)


def truemap(nx, ny, lengths, heights):
    head = b"Binary TrueMap Data File v2.0\r\n\0made by a test\r\n\0"
    numbers = np.array([nx, ny], "<i4").tobytes() + np.array([*lengths, 0, 0], "<f4").tobytes()
    return head + numbers + heights.T.astype("<f4").tobytes()


def test_truemap_heights_are_millimetres(tmp_path):
    (tmp_path / "a.tmd").write_bytes(truemap(12, 9, (1.2, 0.9), HEIGHTS * 1e3))
    topo = read_topography(tmp_path / "a.tmd")
    np.testing.assert_allclose(topo.heights, HEIGHTS, rtol=1e-6)
    np.testing.assert_allclose(topo.size, SIZE, rtol=1e-6)


def test_size_and_unit_of_the_caller_win(tmp_path):
    np.savez(tmp_path / "a.npz", heights=HEIGHTS, size=SIZE)
    topo = read_topography(tmp_path / "a.npz", size=(1.0, 2.0), height_unit="nm")
    np.testing.assert_array_equal(topo.size, (1.0, 2.0))
    np.testing.assert_allclose(topo.heights, HEIGHTS * 1e-9)


@pytest.mark.parametrize(
    ("heights", "size", "remedy"),
    [
        (HEIGHTS, (1.2e6, 0.9e6), "'size'"),
        (HEIGHTS, (1.2e-3, 0.9e-5), "'size'"),
        (HEIGHTS * 1e4, SIZE, "'height_unit'"),
        (HEIGHTS * 1e-6, SIZE, "'height_unit'"),
    ],
)
def test_implausible_scans_are_named_with_the_remedy(tmp_path, caplog, heights, size, remedy):
    """For example NMS files, whose lateral size comes out 1e9 too large."""
    np.savez(tmp_path / "a.npz", heights=heights, size=size)
    with caplog.at_level(logging.WARNING, logger="brake_fenicsx"):
        topo = read_topography(tmp_path / "a.npz")
    assert len(topo.warnings) == 1 and remedy in topo.warnings[0]
    assert "a.npz" in topo.warnings[0] and topo.warnings[0] in caplog.text


@pytest.mark.parametrize(
    ("name", "content", "named"),
    [
        ("a.npz", b"not a zip", "npz"),
        ("a.h5", b"not hdf5", "HDF5"),
        ("a.tmd", b"something", "TrueMap"),
        ("a.tmd", truemap(12, 9, (1.2, 0.9), HEIGHTS)[:-8], "cut short"),
        ("a.sur", b"\x00\x01\x02\xff" * 50, "a.sur"),
    ],
)
def test_broken_files_are_named(tmp_path, name, content, named):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SurfaceError, match=named):
        read_topography(tmp_path / name)


def test_missing_file_and_bad_arguments(tmp_path):
    with pytest.raises(SurfaceError, match="no such file"):
        read_topography(tmp_path / "none.npz")
    np.savez(tmp_path / "a.npz", heights=HEIGHTS, size=SIZE)
    with pytest.raises(SurfaceError, match="height_unit"):
        read_topography(tmp_path / "a.npz", height_unit="inch")
    np.savez(tmp_path / "b.npz", h=HEIGHTS)
    with pytest.raises(SurfaceError, match="heights"):
        read_topography(tmp_path / "b.npz")
    np.savez(tmp_path / "c.npz", heights=HEIGHTS)
    with pytest.raises(SurfaceError, match="size"):
        read_topography(tmp_path / "c.npz")


def test_the_virtual_pad_scan():
    """The demo's scan: the published statistics within their standard errors."""
    file = Path(__file__).parents[2] / "scripts" / "scenes" / "pad_scan.npz"
    stats = characterise(read_topography(file))
    assert stats.missing > 100 and stats.topography.shape == (256, 256)
    assert stats.mean == pytest.approx(25.6e-6, abs=0.1e-6)
    assert stats.S_q == pytest.approx(33.1e-6, rel=0.03)
    assert stats.S_sk == pytest.approx(-0.2410, abs=2 * stats.errors[2])
    assert stats.S_ku == pytest.approx(3.6549, abs=2 * stats.errors[3])
    fit = stats.bifractal
    for found, true, error in zip(
        (fit.c1, fit.c2, np.log(fit.q_c)), (-2.0, -4.5, np.log(30e3)), fit.errors, strict=False
    ):
        assert abs(found - true) < 4 * error + 0.1


@needs_scans
@pytest.mark.parametrize(
    ("name", "shape", "size"),
    [
        ("wyko_wli_736x480.opd", (736, 480), (1.2028e-3, 0.91518e-3)),
        ("alicona_200x296.al3d", (200, 296), (87.605e-6, 129.656e-6)),
        ("truemap_300x300.tmd", (300, 300), (18.957e-3, 18.957e-3)),
        ("sensofar_768x576.plu", (768, 576), None),
        ("matrix_text.txt", (75, 305), (75 * 0.369862e-6, 305 * 0.369862e-6)),
    ],
)
def test_real_instruments(name, shape, size):
    """Every file is read, characterised, and gives a surface to press."""
    topo = read_topography(Path(SCANS) / name)
    assert topo.shape == shape
    if size is not None:
        np.testing.assert_allclose(topo.size, size, rtol=1e-3)
    assert topo.warnings == ()
    stats = characterise(topo, level="second-order")
    assert 1e-9 < stats.S_q < 1e-4 and 1.0 < stats.S_ku < 20.0
    assert np.isfinite([stats.bifractal.c1, stats.bifractal.c2, stats.spread]).all()
    assert stats.psd.band[0] < stats.bifractal.q_c < stats.psd.band[1]


@needs_scans
def test_wyko_roughness():
    """S_q about 1.1 um, as other readers find it."""
    stats = characterise(read_topography(Path(SCANS) / "wyko_wli_736x480.opd"))
    assert stats.S_q == pytest.approx(1.11e-6, rel=0.08)


@needs_scans
def test_truemap_roughness():
    """47.7 um after a second-order form: millimetres in the file, not micrometres."""
    stats = characterise(read_topography(Path(SCANS) / "truemap_300x300.tmd"), "second-order")
    assert stats.S_q == pytest.approx(47.7e-6, rel=0.15)

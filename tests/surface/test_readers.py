"""Reading: own formats there and back, instrument files, and files that lie."""

import os
import re
import struct
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest

from brake_fenicsx.errors import SceneError, SurfaceError
from brake_fenicsx.surface import characterise, read_topography
from brake_fenicsx.surface.instruments import missing_points
from brake_fenicsx.surface.readers import MISSING
from brake_fenicsx.surface.topography import implausible

HEIGHTS = 1e-6 * np.random.default_rng(0).standard_normal((12, 9))
SIZE = (1.2e-3, 0.9e-3)

SCANS = os.environ.get("BRAKE_FENICSX_SCANS")
needs_scans = pytest.mark.skipif(not SCANS, reason="BRAKE_FENICSX_SCANS is not set")


def test_npz_in_metres(tmp_path):
    np.savez(tmp_path / "a.npz", heights=HEIGHTS, size=SIZE)
    topo = read_topography(tmp_path / "a.npz")
    np.testing.assert_array_equal(topo.heights, HEIGHTS)
    np.testing.assert_array_equal(topo.size, SIZE)
    assert implausible(topo) == ()


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


def table(rows=HEIGHTS, delimiter=",", header="", end="\n", number="{:.9e}"):
    lines = [delimiter.join(number.format(1e6 * z) for z in row) for row in rows]
    return header + "".join(line + end for line in lines)


def xyz(delimiter, order=1):
    places = [(i, j) for i in range(12) for j in range(9)][::order]
    lines = (
        f"{i * 0.1:.1f}{delimiter}{j * 0.1:.1f}{delimiter}{1e6 * HEIGHTS[i, j]:.9e}"
        for i, j in places
    )
    return f"X{delimiter}Y{delimiter}Z\n" + "\n".join(lines)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("comma.csv", table()),
        ("semicolon.csv", table(delimiter=";", end=";\r\n")),
        ("tab.txt", table(delimiter="\t")),
        ("blank.txt", table(delimiter=" ")),
        ("blanks.asc", table(delimiter="  ")),
        ("byte_order_mark.csv", "\ufeff" + table()),
        ("header.csv", table(header='"Instrument","VK-X"\n"Unit","um"\n\nHeight\n')),
        ("numbers_above.csv", table(header="12,9\n")),
        ("columns.txt", xyz(" ")),
        ("columns.csv", xyz(",", -1)),
        ("columns.xyz", xyz("\t")),
    ],
)
def test_tables_of_every_kind(tmp_path, name, text):
    (tmp_path / name).write_text(text, newline="")
    topo = read_topography(tmp_path / name, SIZE, "um")
    np.testing.assert_allclose(topo.heights, HEIGHTS, rtol=1e-9)
    turned = read_topography(tmp_path / name, SIZE[::-1], "um", rows="y")
    np.testing.assert_allclose(turned.heights, HEIGHTS.T, rtol=1e-9)


GWYDDION = {
    "blanks": ("# Channel: Height\n# Width: 1.2 mm\n# Height: 0.9 mm\n# Value units: um\n", " "),
    "tabs": ("# Channel: Height\n# Width: 1.2 mm\n# Height: 0.9 mm\n# Value units: um\n", "\t"),
    "semicolons": ("# Width: 1200 um\n# Height: 900 \u00b5m\n# Value units: um\n", ";"),
    "commas": ("Width: 1.2 mm\nHeight: 0.9 mm\nValue units: um\n", ","),
    "German": ("# Kanal: Z\n# Breite: 1,2 mm\n# H\u00f6he: 0,9 mm\n# Werteinheiten: um\n", "\t"),
    "SPIP": ("# x-pixels = 12\n# x-length = 1200\n# y-length = 900\n# x-unit = um\n# y-unit = um\n"
             "# z-unit = um\n# Start of Data:\n", "\t"),
}  # fmt: skip


@pytest.mark.parametrize("name", GWYDDION)
def test_headers_whatever_the_delimiter(name, tmp_path):
    """Width is along a row: a map of 12 x 9 points of 0.1 mm, turned by none (tabs are what
    Gwyddion 2.62 proposes). A unit that is missing is asked for; a side exchanged is a doubt."""
    header, delimiter = GWYDDION[name]
    file = tmp_path / "a.txt"
    file.write_text(table(HEIGHTS.T, delimiter, header), encoding="utf-8")
    topo = read_topography(file)
    np.testing.assert_allclose(topo.heights, HEIGHTS, rtol=1e-9)
    np.testing.assert_allclose(topo.size, SIZE, rtol=1e-9)
    assert implausible(topo) == ()
    with pytest.raises(SurfaceError, match="the file itself says it"):
        read_topography(file, rows="y")
    (doubt,) = implausible(read_topography(file, size=SIZE[::-1]))
    assert "square with the sides of the map exchanged" in doubt
    lines = [line for line in header.splitlines() if not re.search("nits?:|einh|z-unit", line)]
    file.write_text(table(HEIGHTS.T, delimiter, "\n".join(lines) + "\n"), encoding="utf-8")
    with pytest.raises(SurfaceError, match="height_unit"):
        read_topography(file)
    np.testing.assert_allclose(read_topography(file, height_unit="um").heights, HEIGHTS, rtol=1e-9)


def test_a_pixel_and_a_factor_in_a_header(tmp_path):
    """As LynceeTec writes phases: 12 x 9 pixels of 0.1 mm, heights of 1e-6 / 4 m each."""
    head = "h=9 w=12\npixel size=1.0e-004 m\ndata unit=rad\n"
    head += "height conversion factor (-> m)=2.5e-007\n"
    (tmp_path / "a.txt").write_text(table(4 * HEIGHTS.T, " ", head))
    topo = read_topography(tmp_path / "a.txt")
    np.testing.assert_allclose(topo.heights, HEIGHTS, rtol=1e-9)
    np.testing.assert_allclose(topo.size, SIZE, rtol=1e-9)


def test_sdf_of_iso_25178_71(tmp_path):
    """Scales of all three axes stand in the header, in metres; BAD is no height."""
    rows = "\n".join(" ".join(f"{1e9 * z:.3f}" for z in row) for row in HEIGHTS.T)
    rows = rows.replace(rows.split()[3], "BAD", 1)
    head = "aISO-1.0\nManufacID = test\nNumPoints = 12\nNumProfiles = 9\nXscale = 1e-4\n"
    head += "Yscale = 1e-4\nZscale = 1e-9\nZresolution = -1\nDataType = 7\n*\n"
    file = tmp_path / "a.sdf"
    file.write_text(head + rows + "\n*\n")
    topo = read_topography(file)
    np.testing.assert_allclose(topo.size, SIZE, rtol=1e-9)
    assert np.argwhere(~topo.valid).tolist() == [[3, 0]]
    np.testing.assert_allclose(topo.heights[topo.valid], HEIGHTS[topo.valid], atol=1e-12)
    for wrong in (head.replace("NumProfiles = 9", "NumProfiles = 8"), head.replace("Xscale", "Q")):
        file.write_text(wrong + rows)
        with pytest.raises(SurfaceError, match="cannot be read"):
            read_topography(file)


def test_known_formats_that_are_refused_say_why(tmp_path):
    """A series is not its first surface, an X3P of absolute axes no unknown format."""
    for count, kind in ((4, 2), (1, 5)):
        data = bytearray(sur(COUNTS))
        struct.pack_into("<3h", data, 14, count, 1, kind)
        (tmp_path / "a.sur").write_bytes(bytes(data))
        with pytest.raises(SurfaceError, match=f"holds {count} surfaces, of kind {kind}; export"):
            read_topography(tmp_path / "a.sur")
    with zipfile.ZipFile(tmp_path / "a.x3p", "w") as archive:
        axes = "<Axes><CX>\n<AxisType>A</AxisType></CX><CY><AxisType>I</AxisType></CY></Axes>"
        archive.writestr("main.xml", f"<x><Record1>{axes}</Record1></x>")
    with pytest.raises(SurfaceError, match="axis CX of type 'A'"):
        read_topography(tmp_path / "a.x3p")
    (tmp_path / "a.nms").write_bytes(struct.pack("<3I2HI", 2, 1, 0, 65535, 0, 1 << 29) + 12 * b"\1")
    with pytest.raises(SurfaceError, match=r"a\.nms: is read from release 1\.27 on"):
        read_topography(tmp_path / "a.nms")


def test_npy_is_a_table_too(tmp_path):
    np.save(tmp_path / "a.npy", 1e6 * HEIGHTS)
    topo = read_topography(tmp_path / "a.npy", SIZE, "um")
    np.testing.assert_allclose(topo.heights, HEIGHTS, rtol=1e-14)
    with pytest.raises(SurfaceError, match="height_unit"):
        read_topography(tmp_path / "a.npy", SIZE)


def test_missing_points_of_a_table(tmp_path):
    lines = table().splitlines()
    lines[2] = lines[2].replace(lines[2].split(",")[3], "")
    lines[5] = lines[5].replace(lines[5].split(",")[0], "***")
    (tmp_path / "a.csv").write_text("\n".join(lines))
    missing = np.argwhere(~read_topography(tmp_path / "a.csv", SIZE, "um").valid)
    assert missing.tolist() == [[2, 3], [5, 0]]
    # A grid some of whose points are not listed.
    (tmp_path / "b.csv").write_text(xyz(",").replace("\n0.3,0.2,", "\n0.3,0.1,"))
    assert not read_topography(tmp_path / "b.csv", SIZE, "um").valid[3, 2]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0,12;0,13\n0,14;0,15\n", "decimal commas, as in 0,1"),
        ("0,12 0,13\n0,14 0,15\n", "decimal commas, as in 0,1"),
        ("0,12, 0,13\n0,14, 0,15\n", "decimal commas, as in 0,1"),
        ("head\n1,2,3\n1,2,3,4\n1,2,3\n", "line 3: 4 numbers"),
        ("1,2,3\n1,two,3\n1,2,3\n", "line 2: 'two' is no number"),
        ("nothing\nbut words\n", "columns x, y, z"),
    ],
)
def test_tables_that_are_none(tmp_path, text, said):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(SurfaceError, match=said):
        read_topography(tmp_path / "a.csv", SIZE, "um")


def test_coordinates_are_the_size_of_columns(tmp_path):
    """In the unit of the heights if nothing else is said; a size may only name their unit."""
    file = tmp_path / "a.csv"
    file.write_text(xyz(","))
    np.testing.assert_allclose(read_topography(file, height_unit="um").size, [1.2e-6, 0.9e-6])
    turned = read_topography(file, height_unit="um", rows="y")
    np.testing.assert_allclose(turned.size, [0.9e-6, 1.2e-6])
    # From the first to the last point, as some give it.
    read_topography(file, (1.1e-3, 0.8e-3), "um")
    for size in ((0.9e-3, 1.2e-3), (2.4e-3, 1.8e-3), (1.2e-3, 0.9e-6)):
        with pytest.raises(SurfaceError, match=r"span 1.2 x 0.9, which no unit makes"):
            read_topography(file, size, "um")


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (lambda t: "".join(f"{i},{row}\n" for i, row in enumerate(t)), "column"),
        (lambda t: "x,a,b,c\n" + "".join(f"{i},{row}\n" for i, row in enumerate(t)), "column"),
        (lambda t: "," + ",".join(map(str, range(9))) + "\n" + "".join(
            f"{i},{row}\n" for i, row in enumerate(t)), "column"),
        (lambda t: ",".join(map(str, range(9))) + "\n" + "\n".join(t), "row"),
        (lambda t: "".join(f"{0.5 * i + 3} {row.replace(',', ' ')}\n"
                           for i, row in enumerate(t)), "column"),
    ],
)  # fmt: skip
def test_numbers_of_rows_are_no_heights(tmp_path, text, what):
    """As pandas writes a table, with an index and a header of numbers."""
    file = tmp_path / "a.csv"
    file.write_text(text(table().splitlines()))
    with pytest.raises(SurfaceError, match=rf"the first {what} counts .*index=False"):
        read_topography(file, SIZE, "um")
    # An exact tilt is like its neighbours.
    tilt = 0.25 * np.arange(12)[:, None] + 0.5 * np.arange(9)
    np.savetxt(file, tilt, delimiter=",")
    np.testing.assert_allclose(read_topography(file, SIZE, "um").heights, 1e-6 * tilt)


@pytest.mark.parametrize(
    ("changes", "settings", "named"),
    [
        ({"scale": -1.0}, {}, "scale = .*positive number"),
        ({"scale": 0.0}, {}, "scale = .*positive number"),
        ({"scale": np.ones(3)}, {}, "scale = .*positive number"),
        ({"scale": "um"}, {}, "scale.*positive number"),
        ({"size": "1 mm"}, {}, "size.*real numbers"),
        ({"size": [1e-3, 1e-3, 1e-3]}, {}, "two positive lengths"),
        ({"heights": HEIGHTS + 1j}, {}, "heights.*complex128; give real numbers"),
        ({}, {"rows": "z"}, "rows = 'z'; choose one of x, y"),
        ({}, {"channel": 99}, "channel = 99 has no meaning"),
        ({}, {"height_unit": -1.0}, "height_unit = -1.0; give one positive number"),
        ({}, {"height_unit": [1.0, 2.0]}, "height_unit = .*one positive number"),
    ],
)
def test_arrays_and_settings_that_mean_nothing(tmp_path, changes, settings, named):
    file = tmp_path / "a.npz"
    np.savez(file, **({"heights": HEIGHTS, "size": SIZE} | changes))
    with pytest.raises(SceneError, match=named) as said:
        read_topography(file, **settings)
    assert "a.npz" in str(said.value)


@needs_scans
@pytest.mark.parametrize("name", ["alicona_200x296.al3d", "wyko_wli_736x480.opd",
                                  "sensofar_768x576.plu", "truemap_300x300.tmd"])  # fmt: skip
def test_files_cut_short_are_named_in_one_line(tmp_path, name):
    """Whatever the reader stumbles over: its header alone, half of the heights, a byte too few."""
    whole = (Path(SCANS) / name).read_bytes()
    for size in (1, 60, 3000, 20_000, len(whole) // 2):
        (tmp_path / name).write_bytes(whole[:size])
        try:
            read_topography(tmp_path / name)
        except SurfaceError as error:
            assert len(str(error)) < 600 and name in str(error)


def test_rows_have_no_meaning_where_the_file_says_it(tmp_path):
    np.savez(tmp_path / "a.npz", heights=HEIGHTS, size=SIZE)
    with pytest.raises(SurfaceError, match="rows = 'y'"):
        read_topography(tmp_path / "a.npz", rows="y")


COUNTS = np.random.default_rng(1).integers(-1000, 1000, (12, 9))
LOST = [[0, 8], [3, 2], [11, 0]]


def sur(counts):
    """Digital Surf: a header of 512 bytes, then 32-bit integers, x fastest."""
    head = bytearray(512)
    head[:12] = b"DIGITAL SURF"
    struct.pack_into("<hhhh", head, 12, 0, 1, 1, 2)
    struct.pack_into("<hiiiiiifff", head, 98, 32, -1000, 1000, 12, 9, 108, 0, 0, 0, 0)
    struct.pack_into("<iiI", head, 108, 12, 9, 108)
    struct.pack_into("<fff", head, 120, 1e-4, 1e-4, 1e-6)
    for place, text in (
        (180, b"mm"),
        (196, b"mm"),
        (212, b"mm"),
        (228, b"mm"),
        (244, b"mm"),
        (260, b"mm"),
    ):
        head[place : place + 2] = text
    return bytes(head) + counts.T.astype("<i4").tobytes()


def test_missing_points_of_instruments_are_no_heights(tmp_path):
    """What each format writes where nothing was measured."""
    mask = np.zeros(COUNTS.shape, dtype=bool)
    mask[tuple(np.transpose(LOST))] = True
    opd = np.where(mask, 32767, COUNTS).astype(float)
    (tmp_path / "a.opd").write_bytes(b"\x01\x00Directory\0" + bytes(200))
    np.testing.assert_array_equal(missing_points(tmp_path / "a.opd", opd), mask)
    # In waves, as real numbers, a height of 40000 is one.
    assert not missing_points(tmp_path / "a.opd", opd * 1.001).any()

    (tmp_path / "a.sur").write_bytes(sur(np.where(mask, -1002, COUNTS)))
    np.testing.assert_array_equal(~read_topography(tmp_path / "a.sur").valid, mask)

    rows = np.pad(mask.T.astype(np.uint8), ((0, 0), (0, 4)))
    with zipfile.ZipFile(tmp_path / "zip", "w") as archive:
        archive.writestr(
            "heights", struct.pack("<4i", 12, 9, 4, 48) + COUNTS.T.astype("<i4").tobytes()
        )
        archive.writestr("mask", struct.pack("<4i", 12, 9, 1, 16) + rows.tobytes())
    (tmp_path / "a.zon").write_bytes(b"KPK0" + bytes(60) + (tmp_path / "zip").read_bytes())
    np.testing.assert_array_equal(missing_points(tmp_path / "a.zon", COUNTS * 1.0), mask)


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
    with pytest.raises(SceneError, match="height_unit"):
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
    assert implausible(topo) == ()
    stats = characterise(topo, level="second-order")
    assert 1e-9 < stats.S_q < 1e-4 and 1.0 < stats.S_ku < 20.0
    assert np.isfinite([stats.bifractal.c1, stats.bifractal.c2]).all()
    assert stats.psd.band[0] < stats.bifractal.q_c < stats.psd.band[1]


@needs_scans
def test_wyko_roughness():
    """As two independent readers find it, 231 of the points missing."""
    stats = characterise(read_topography(Path(SCANS) / "wyko_wli_736x480.opd"))
    assert stats.missing == 231
    assert stats.S_q == pytest.approx(1.165e-6, rel=1e-3)
    assert stats.S_ku == pytest.approx(3.045, abs=1e-3)


@needs_scans
def test_truemap_roughness():
    """47.7 um after a second-order form: millimetres in the file, not micrometres."""
    stats = characterise(read_topography(Path(SCANS) / "truemap_300x300.tmd"), "second-order")
    assert stats.S_q == pytest.approx(47.7e-6, rel=0.15)

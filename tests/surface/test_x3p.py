"""X3P: heights of all four types, their offset and mask, and layouts that are no grid."""

import re
import zipfile
from importlib.metadata import version

import numpy as np
import pytest

from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.surface import characterise, given_statistics, read_topography, synthesise
from brake_fenicsx.surface.instruments import BELOW, FORMATS, LOWEST, TYPES
from places import ROOT

PAPER = given_statistics(1.8e-6)
SIZE = (1.2e-3, 0.9e-3)
XML = """<?xml version="1.0"?><p:ISO5436_2 xmlns:p="http://www.opengps.eu/2008/ISO5436_2">
<Record1><Revision>ISO5436 - 2000</Revision><FeatureType>SUR</FeatureType><Axes>
<CX><AxisType>I</AxisType><DataType>D</DataType><Increment>{dx}</Increment><Offset>0</Offset></CX>
<CY><AxisType>I</AxisType><DataType>D</DataType><Increment>{dy}</Increment><Offset>0</Offset></CY>
<CZ><AxisType>A</AxisType><DataType>{kind}</DataType>{scale}</CZ></Axes></Record1>
<Record3><MatrixDimension><SizeX>{nx}</SizeX><SizeY>{ny}</SizeY><SizeZ>1</SizeZ></MatrixDimension>
<DataLink><PointDataLink>bindata/data.bin</PointDataLink>{mask}</DataLink></Record3></p:ISO5436_2>
"""


@pytest.fixture(scope="module")
def heights():
    """Levels of 2 nm, of both signs."""
    made = synthesise(PAPER.bifractal, PAPER.hdf, (48, 36), SIZE, np.random.default_rng(0)).heights
    return 2e-9 * np.rint(made / 2e-9)


def write(path, heights, kind, offset=0.0, changes=(), mask=None):
    """An X3P file as the standard has it: x fastest, integers times the increment plus offset."""
    whole = kind in "IL"
    scale = f"<Increment>2e-9</Increment><Offset>{offset}</Offset>" if whole else ""
    numbers = np.rint((heights - offset) / 2e-9) if whole else heights
    (nx, ny), link = heights.shape, "<ValidPointsLink>bindata/valid.bin</ValidPointsLink>"
    xml = XML.format(dx=SIZE[0] / nx, dy=SIZE[1] / ny, kind=kind, scale=scale, nx=nx, ny=ny,
                     mask=link if mask is not None else "")  # fmt: skip
    for one, other in changes:
        assert one in xml
        xml = xml.replace(one, other)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("main.xml", xml)
        archive.writestr("bindata/data.bin", numbers.T.astype(TYPES[kind]).tobytes())
        if mask is not None:
            bits = np.packbits(mask.T.reshape(-1), bitorder="little")
            archive.writestr("bindata/valid.bin", bits.tobytes())
    return path


@pytest.mark.parametrize("kind", TYPES)
def test_every_type_has_the_same_heights(tmp_path, heights, kind):
    """SurfaceTopography 1.18.2 took types I and L for unsigned: S_q 4.93 um where it is 1.81."""
    topo = read_topography(write(tmp_path / "a.x3p", heights, kind, 3e-6))
    np.testing.assert_allclose(topo.heights, heights, atol=1e-12)
    np.testing.assert_allclose(topo.size, SIZE, rtol=1e-12)
    assert characterise(topo).warnings == ()


def test_missing_points(tmp_path, heights):
    """By the file of bits, and nan in floating point."""
    valid = np.ones(heights.shape, bool)
    valid[[0, 3, 40], [35, 2, 0]] = False
    whole = read_topography(write(tmp_path / "a.x3p", heights, "I", mask=valid))
    np.testing.assert_array_equal(whole.valid, valid)
    real = write(tmp_path / "b.x3p", np.where(valid, heights, np.nan), "F")
    np.testing.assert_array_equal(read_topography(real).valid, valid)


def test_size_and_unit_of_the_caller_win(tmp_path, heights):
    path = write(tmp_path / "a.x3p", heights, "L", 1e-6)
    topo = read_topography(path, (2e-3, 1e-3), "nm")
    np.testing.assert_allclose(topo.heights, np.rint((heights - 1e-6) / 2e-9) * 1e-9, atol=1e-15)
    np.testing.assert_array_equal(topo.size, (2e-3, 1e-3))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (
            ("<CX><AxisType>I", "<CX><AxisType>A"),
            "axis CX of type 'A': its points have no",
        ),
        (("SUR<", "PCL<"), "an X3P of type 'PCL'"),
        (("<SizeX>48", "<SizeX>49"), "data.bin is cut short"),
        (("<SizeX>48</SizeX>", ""), "SizeX is missing"),
        (("<SizeZ>1", "<SizeZ>2"), "one layer"),
        (("<DataType>I", "<DataType>Q"), "heights of type 'Q'"),
        (("bindata/data.bin", "bindata/none.bin"), "cannot be read as X3P"),
        (("</Record3>", ""), "cannot be read as X3P"),
    ],
)
def test_other_layouts_are_refused_with_the_reason(tmp_path, heights, change, named):
    path = write(tmp_path / "a.x3p", heights, "I", changes=[change])
    with pytest.raises(SurfaceError, match=re.escape(named)) as found:
        read_topography(path)
    assert "a.x3p" in str(found.value)


def test_no_archive_is_named(tmp_path):
    (tmp_path / "a.x3p").write_bytes(b"nothing")
    with pytest.raises(SurfaceError, match=r"a\.x3p: cannot be read as X3P"):
        read_topography(tmp_path / "a.x3p")


def test_one_range_of_releases_of_surfacetopography():
    """The installed release, the requirement and the installer agree with the table."""
    installed = tuple(int(n) for n in version("SurfaceTopography").split(".")[:2])
    assert LOWEST <= installed < BELOW
    low, below = (".".join(map(str, v)) for v in (LOWEST, BELOW))
    assert f"SurfaceTopography>={low},<{below}" in (ROOT / "pyproject.toml").read_text()
    assert f"SurfaceTopography>={low},<{below}" in (ROOT / "scripts" / "setup").read_text()


@pytest.mark.parametrize("ending", [e for e, row in FORMATS.items() if row.refused])
def test_formats_that_the_release_reads_wrongly_are_refused(tmp_path, ending):
    (tmp_path / f"a{ending}").write_bytes(bytes(64))
    with pytest.raises(SurfaceError, match=re.escape(FORMATS[ending].refused)):
        read_topography(tmp_path / f"a{ending}")

"""Builders: volumes and areas against closed forms, names, mirror images, hexahedra."""

from mpi4py import MPI

import numpy as np
import pytest

import hertz_parts
from brake_fenicsx.errors import SceneError
from brake_fenicsx.geometry import block, disc, pad
from brake_fenicsx.meshing.brake_mesh import check_cells, raw_mesh, tagged_mesh
from brake_fenicsx.meshing.gmsh_mesh import MeshSettings, gmsh_session
from brake_fenicsx.meshing.rawmesh import jacobians, quality
from mesh_measures import measures

MODULES = {
    "disc": lambda **values: (disc, disc.Disc(**values)),
    "pad": lambda **values: (pad, pad.Pad(**values)),
    "block": lambda **values: (block, block.Block(**values)),
    "sphere": hertz_parts.sphere,
}


def mesh(name, cells="tetrahedra", order=1, quality=0.01, **values):
    table = MeshSettings(cells=cells, order=order, quality=quality)
    found = raw_mesh({"p": MODULES[name](**values)}, table)
    check_cells(found, table)
    return found


MEASURED = {}


def measured(m):
    """Volumes and areas by DOLFINx, once for each mesh."""
    if id(m) not in MEASURED:
        mesh = tagged_mesh(lambda: m, MPI.COMM_SELF, MeshSettings(quality=1e-9))
        MEASURED[id(m)] = m, measures(mesh)
    return MEASURED[id(m)][1]


def volume(m):
    """Total volume [m^3]."""
    return sum(measured(m)[layer][1] for layer in m.layers)


def area(m, face):
    return measured(m)[f"p.{face}"][1]


R, BORE, T = 144e-3, 75e-3, 20e-3
RING = np.pi * (R**2 - BORE**2)


@pytest.mark.parametrize("cells", ["tetrahedra", "hexahedra"])
def test_plain_disc(cells):
    """Volume and faces; second order is a hundred times closer than straight sides."""
    errors = []
    for order in (1, 2):
        m = mesh("disc", cells, order, size=16e-3)
        # Straight chords at bore and rim take the same from both circles; the rim's own area tells.
        errors.append(abs(area(m, "rim") / (2 * np.pi * R * T) - 1))
        assert volume(m) == pytest.approx(RING * T, rel=6e-3 if order == 1 else 1e-5)
        assert area(m, "friction") == pytest.approx(2 * RING, rel=1e-2 if order == 1 else 1e-4)
        assert area(m, "bore") == pytest.approx(2 * np.pi * BORE * T, rel=5e-3)
        assert area(m, "rim") == pytest.approx(2 * np.pi * R * T, rel=5e-3)
    assert errors[0] < 3e-3
    assert errors[1] < errors[0] / 100


def test_hexahedra_of_a_disc_are_regular():
    """Each quarter is a quarter turn of the first, so that double modes stay double."""
    m = mesh("disc", "hexahedra", 2, size=20e-3)
    turned = m.points[:, [1, 0, 2]] * [-1, 1, 1]
    away = np.linalg.norm(m.points[:, None] - turned[None], axis=2).min(axis=0)
    assert away.max() < 1e-12
    assert quality(m).worst > 0.99


def test_hat_bolts_and_vanes():
    """Volumes of ring, wall, flange less holes, and channels; faces to clamp are there."""
    d = disc.Disc(hat=40e-3, vanes=10, thickness=24e-3, size=9e-3)
    m = mesh("disc", hat=40e-3, vanes=10, thickness=24e-3, size=9e-3, order=2)
    # A straight vane between two circles: strip of width b, its ends arcs.
    b = d.vane_width

    def strip(r):
        return r**2 * np.arcsin(b / 2 / r) + b / 2 * np.sqrt(r**2 - b**2 / 4)

    channel = RING - d.vanes * (strip(R) - strip(BORE))
    wall, flange = BORE + d.hat_wall, d.flange
    hat = np.pi * (wall**2 - BORE**2) * d.hat + np.pi * (BORE**2 - d.hub**2) * flange
    hat -= d.bolts * np.pi / 4 * d.bolt_diameter**2 * flange
    exact = RING * 24e-3 - channel * (24e-3 - 2 * d.cheek) + hat
    assert volume(m) == pytest.approx(exact, rel=2e-4)
    assert area(m, "bolts") == pytest.approx(5 * np.pi * d.bolt_diameter * flange, rel=5e-3)
    assert area(m, "hub") == pytest.approx(2 * np.pi * d.hub * flange, rel=2e-3)
    ring = np.pi * (R**2 - wall**2)
    assert area(m, "friction") == pytest.approx(RING + ring, rel=1e-3)
    bore = 2 * np.pi * BORE * (24e-3 + 40e-3 - flange) - (10 * 10e-3) * (
        2 * np.pi * BORE / 10 - 2 * BORE * np.arcsin(b / 2 / BORE)
    )
    assert area(m, "bore") == pytest.approx(bore, rel=2e-3)


def lining_area(shape):
    r1, r2, angle = 96e-3, 140e-3, np.pi / 3
    if shape == "sector":
        return 0.5 * angle * (r2**2 - r1**2)
    w = (r1 + r2) * np.sin(angle / 2)
    if shape == "rectangle":
        return (r2 - r1) * w

    def strip(r):
        return r**2 * np.arcsin(w / 2 / r) + w / 2 * np.sqrt(r**2 - w**2 / 4)

    return strip(r2) - strip(r1)


@pytest.mark.parametrize("cells", ["tetrahedra", "hexahedra"])
@pytest.mark.parametrize("shape", ["sector", "parallel", "rectangle"])
def test_pad(shape, cells):
    """Three outlines with shim, ears and piston; one pad or two, on either side."""
    values = dict(shape=shape, shim=1e-3, size=7e-3, plate_size=7e-3)
    flat = lining_area(shape)
    one = mesh("pad", cells, 2, side="bottom", **values)
    assert one.points[:, 2].max() < -9.99e-3
    assert area(one, "friction") == pytest.approx(flat, rel=1e-5)
    assert area(one, "ears") == pytest.approx(2 * 16e-3 * 6e-3, rel=1e-9)
    piston = area(one, "piston")
    assert 0.8 * np.pi / 4 * 54e-3**2 < piston < np.pi / 4 * 54e-3**2
    ears = 2 * 16e-3 * 10e-3 * 6e-3
    assert volume(one) == pytest.approx(flat * 17e-3 + ears, rel=2e-3)
    if cells == "hexahedra":
        # No slivers in a shim of 1 mm.
        assert quality(one).worst > 0.4
    assert set(one.layers) == {"p.lining", "p.plate", "p.shim"}


def lens(d, a, b):
    """Area common to circles of radii a and b whose centres are d apart."""
    x = (d**2 + a**2 - b**2) / (2 * d)
    y = d - x
    return sum(r**2 * np.arccos(t / r) - t * np.sqrt(r**2 - t**2) for r, t in ((a, x), (b, y)))


@pytest.mark.parametrize("side", ["top", "both"])
def test_piston_that_the_outline_cuts_off(side):
    """Of a circle of 54 mm on a sector 44 mm wide: what lies between two arcs, closed form."""
    with gmsh_session() as gmsh:
        gmsh.model.add("p")
        found = pad.cut_faces(gmsh.model.occ, pad.Pad(side=side, shim=1e-3))
    (left, whole), a = found["piston"], 27e-3
    assert whole == pytest.approx(np.pi * a**2)
    assert left == pytest.approx(lens(118e-3, a, 140e-3) - lens(118e-3, a, 96e-3), rel=1e-6)
    m = mesh("pad", order=2, side="top", size=7e-3, plate_size=4e-3)
    assert area(m, "piston") == pytest.approx(left, rel=1e-4)


@pytest.mark.parametrize(
    "values", [{"piston_diameter": 43.9e-3}, {"r_inner": 90e-3, "r_outer": 146e-3}]
)
def test_piston_inside_the_outline_is_whole(values):
    with gmsh_session() as gmsh:
        gmsh.model.add("p")
        assert pad.cut_faces(gmsh.model.occ, pad.Pad(**values)) == {}


@pytest.mark.parametrize("cells", ["tetrahedra", "hexahedra"])
def test_two_pads_are_mirror_images_to_the_last_bit(cells):
    """Nodes and cells of the lower pad are those of the upper one; catches a second mesh."""
    m = mesh("pad", cells, 2, size=10e-3, plate_size=10e-3)
    half = len(m.points) // 2
    np.testing.assert_array_equal(m.points[half:], m.points[:half] * [1, 1, -1])
    up, down = np.array_split(m.cells, 2)
    np.testing.assert_array_equal(np.sort(up, axis=1), np.sort(down - half, axis=1))
    assert jacobians(m).min() > 0
    below = m.facets[m.facet_tag == m.faces["p.friction"]] >= half
    assert np.count_nonzero(below) == np.count_nonzero(~below)


def test_two_pads_meshed_apart_if_the_scene_says_so():
    m = mesh("pad", size=14e-3, plate_size=14e-3, mirror=False)
    up = m.points[m.points[:, 2] > 0]
    assert not np.array_equal(np.sort(up, axis=0), np.sort(-m.points[m.points[:, 2] < 0], axis=0))
    assert volume(m) == pytest.approx(2 * volume(mesh("pad", side="top", size=14e-3)), rel=1e-2)


@pytest.mark.parametrize("cells", ["tetrahedra", "hexahedra"])
def test_slot_and_layered_shim(cells):
    """A slot of part of the depth takes its own volume; each layer of shim has its name."""
    values = dict(
        shape="rectangle", side="top", slot=5e-3, slot_depth=6e-3, shim=(2e-3, 1e-3, 2e-3)
    )
    m = mesh("pad", cells, size=10e-3, plate_size=8e-3, **values)
    w = 236e-3 * np.sin(np.pi / 6)
    assert area(m, "friction") == pytest.approx(44e-3 * (w - 5e-3), rel=1e-9)
    exact = 44e-3 * w * 21e-3 - 44e-3 * 5e-3 * 6e-3 + 2 * 16e-3 * 10e-3 * 6e-3
    assert volume(m) == pytest.approx(exact, rel=1e-9)
    assert list(m.layers) == ["p.lining", "p.plate", "p.shim1", "p.shim2", "p.shim3"]
    z = {n: m.points[m.cells[m.cell_tag == t], 2].mean() for n, t in m.layers.items()}
    assert z["p.plate"] < z["p.shim1"] < z["p.shim2"] < z["p.shim3"]


def test_chamfers():
    """Two wedges less; the friction face ends before them."""
    m = mesh("pad", shape="rectangle", side="top", chamfer=8e-3, chamfer_depth=3e-3, size=7e-3)
    w = 236e-3 * np.sin(np.pi / 6)
    assert area(m, "friction") == pytest.approx(44e-3 * (w - 16e-3), rel=1e-9)
    exact = 44e-3 * (w * 16e-3 - 8e-3 * 3e-3) + 2 * 16e-3 * 10e-3 * 6e-3
    assert volume(m) == pytest.approx(exact, rel=1e-9)


def test_block_of_hexahedra():
    """Same names and exact volume."""
    m = mesh("block", "hexahedra", z=-3e-3, size=7e-3)
    assert volume(m) == pytest.approx(40e-3 * 20e-3 * 20e-3, rel=1e-12)
    assert m.points[:, 2].min() == pytest.approx(-3e-3)
    assert area(m, "sides") == pytest.approx(120e-3 * 20e-3, rel=1e-12)
    assert {*m.faces} == {*mesh("block").faces}


WRONG = [
    ("disc", {"bore": 0.2}, "must lie between 0 and radius"),
    ("disc", {"vanes": 10, "cheek": 10e-3}, "no room for vanes"),
    ("disc", {"vanes": 90}, "do not fit around the bore"),
    ("disc", {"hat": 40e-3, "bolt_circle": 70e-3}, "must lie between hub"),
    ("disc", {"hat": 5e-3}, "thinner than the hat"),
    ("pad", {"side": "left"}, "use top, bottom or both"),
    ("pad", {"shape": "round"}, "use sector, parallel or rectangle"),
    ("pad", {"r_inner": 0.2}, "below r_outer"),
    ("pad", {"width": 0.1}, "write angle"),
    ("pad", {"chamfer": 12e-3}, "more than the lining"),
    ("pad", {"slot": 4e-3, "slot_depth": 20e-3}, "more than the lining"),
    ("pad", {"slot": 100e-3}, "leave no lining"),
    ("pad", {"shim": (1e-3, 0.0)}, "every layer needs a thickness"),
    ("pad", {"shim": (1e-3, 1e-3), "shim_layers": 2}, "already names its layers"),
]


@pytest.mark.parametrize("name, values, text", WRONG)
def test_bad_parameters_are_named(name, values, text):
    """Before gmsh meets them; the part is named."""
    with pytest.raises(SceneError, match=rf"parts.p: .*{text}"):
        mesh(name, **values)


@pytest.mark.parametrize(
    "name, values",
    [("disc", {"hat": 40e-3}), ("disc", {"vanes": 9}), ("pad", {"chamfer": 2e-3}), ("sphere", {})],
)
def test_shapes_that_are_not_swept(name, values):
    """No hexahedra for them, and the remedy."""
    with pytest.raises(SceneError, match=r'is not swept along z.*cells = "tetrahedra"'):
        mesh(name, "hexahedra", **values)


def test_growth_limits_the_size_beside_a_finer_layer():
    """A plate of 15 mm on a lining of 2 mm: sizes at its top stay below 2 + growth * 6 mm."""
    for growth, most in ((0.25, 3.5e-3), (5.0, 15e-3)):
        table = MeshSettings(growth=growth, quality=1e-6)
        p = pad.Pad(side="top", size=2.5e-3, plate_size=15e-3, angle=0.3, piston_diameter=20e-3)
        m = raw_mesh({"p": (pad, p)}, table)
        top = np.abs(m.points[m.facets][:, :, 2] - 26e-3).max(axis=1) < 1e-9
        x = m.points[m.facets[top]]
        edge = np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2)
        limit = 2.5e-3 + growth * 6e-3
        assert edge.mean() < 1.2 * min(limit, most), growth
        if growth > 1:
            assert edge.mean() > 4e-3


def test_face_size_of_the_disc():
    """Fine at the friction faces, coarser at half the thickness."""
    ring = dict(radius=90e-3, bore=60e-3)
    m = mesh("disc", size=18e-3, face_size=6e-3, **ring)
    x = m.points[m.facets[m.facet_tag == m.faces["p.friction"]]]
    edge = np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2)
    assert edge.mean() == pytest.approx(6e-3, rel=0.15)
    assert len(m.cells) < 0.7 * len(mesh("disc", size=6e-3, **ring).cells)


def test_thin_layers_are_meshed_in_layers(caplog):
    """A shim layer of 0.2 mm: tetrahedra have a quality of 0.01 there, layers of prisms 0.06."""
    values = dict(side="top", shape="rectangle", shim=(1e-3, 0.2e-3, 1e-3), size=8e-3)
    with caplog.at_level("INFO", logger="brake_fenicsx"):
        m = mesh("pad", plate_size=5e-3, quality=0.03, **values)
    assert "meshed in layers" in caplog.text
    w = 236e-3 * np.sin(np.pi / 6)
    assert volume(m) == pytest.approx(44e-3 * w * 18.2e-3 + 2 * 16e-3 * 10e-3 * 6e-3, rel=1e-9)
    assert area(m, "ears") == pytest.approx(2 * 16e-3 * 6e-3, rel=1e-9)
    assert m.shape == "tetrahedron"


def test_a_bad_mesh_is_refused_with_its_place():
    """A shim of 0.02 mm and a chamfer, which cannot be swept: slivers, named with their place."""
    values = dict(shim=0.02e-3, plate_size=20e-3, size=20e-3, side="top")
    with pytest.raises(SceneError, match=r"worst cell, at \(.*\) mm in p\.shim, has quality"):
        mesh("pad", chamfer=4e-3, **values)
    assert quality(mesh("pad", "hexahedra", **values)).worst > 0.3


def test_quality_measures():
    """Regular cells have measure 1; angles are the known ones; a flat cell tends to zero."""
    from brake_fenicsx.meshing.rawmesh import corner_jacobians, dihedral, radius_ratio

    regular = np.array([[[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1.0]]])
    assert radius_ratio(regular) == pytest.approx(1.0)
    assert dihedral(regular) == pytest.approx(np.arccos(1 / 3))
    flat = regular * [1, 1, 1e-3]
    assert radius_ratio(flat) < 1e-2
    cube = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]], dtype=float)
    cube = np.concatenate([cube, cube + np.array([0, 0, 1.0])], axis=1)
    assert corner_jacobians(cube) == pytest.approx(np.ones((1, 8)))
    sheared = cube + cube[:, :, 2:] * [1.0, 0, 0]
    assert corner_jacobians(sheared).min() == pytest.approx(np.sqrt(0.5))


def test_curved_cells_inside_out_are_refused():
    """A middle node pulled beyond its edge: positive corners, negative Jacobian."""
    m = mesh("block", order=2, size=20e-3)
    m.points[m.cells[0, 4]] += 3 * (m.points[m.cells[0, 2]] - m.points[m.cells[0, 4]])
    with pytest.raises(SceneError, match="inside out by its middle nodes"):
        check_cells(m, MeshSettings())


def test_gmsh_is_closed_after_an_error():
    """The next mesh starts anew; catches a session left open."""
    with pytest.raises(SceneError):
        mesh("disc", bore=0.2)
    with gmsh_session() as gmsh:
        assert gmsh.model.getEntities() == []

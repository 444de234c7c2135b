"""Masses, extents, areas and gaps to compare with another model, and what looks misplaced."""

import json
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.build.brake import assemble_brake, interfaces_of, parts_of
from brake_fenicsx.build.brake_doubts import placement_doubts
from brake_fenicsx.description import describe
from brake_fenicsx.macro.contact_elements import contact_elements
from brake_fenicsx.macro.contact_forces import Rotation
from brake_fenicsx.macro.elasticity import assemble_elastic
from brake_fenicsx.macro.material import Material, isotropic
from brake_fenicsx.meshing.brake_mesh import tagged_mesh
from brake_fenicsx.meshing.gmsh_mesh import MeshSettings
from brake_fenicsx.meshing.rawmesh import RawMesh, exterior_facets, joined, volumes
from brake_fenicsx.scene import read_scene
from places import BLOCK

COARSE = ["stages=['equilibrium']", "parts.block.size='14 mm'", "parts.plate.size='20 mm'"]


def built(*changes):
    scene = read_scene(BLOCK, [*COARSE, *changes])
    return scene, assemble_brake(scene, MPI.COMM_SELF)


@pytest.mark.parametrize("cells", ["tetrahedra", "hexahedra"])
def test_masses_and_extents_of_boxes(cells):
    """Density times length, width and height, by hand."""
    parts = parts_of(*built(f"mesh.cells={cells}"))
    assert parts["block"]["mass_kg"] == pytest.approx(2510 * 40e-3 * 20e-3 * 20e-3, rel=1e-12)
    assert parts["plate"]["mass_kg"] == pytest.approx(7200 * 60e-3 * 30e-3 * 10e-3, rel=1e-12)
    assert parts["plate"]["extent_mm"] == pytest.approx([60, 30, 10])


@pytest.mark.parametrize("cells", ["tetrahedra", "hexahedra"])
def test_volumes_of_curved_cells(cells):
    """A ring of a disc: pi (R^2 - r^2) h, to the accuracy of second-order geometry."""
    from brake_fenicsx.geometry import disc
    from brake_fenicsx.meshing.brake_mesh import raw_mesh

    shape = disc.Disc(radius=100e-3, bore=60e-3, thickness=10e-3, size=15e-3)
    exact = np.pi * (100e-3**2 - 60e-3**2) * 10e-3
    for order, error in ((1, 3e-2), (2, 2e-4)):
        mesh = raw_mesh({"disc": (disc, shape)}, MeshSettings(cells=cells, order=order))
        assert volumes(mesh).sum() == pytest.approx(exact, rel=error)


def test_an_interface_covers_its_first_face():
    scene, brake = built()
    (one,) = interfaces_of(scene, brake).values()
    assert one["area_mm2"] == pytest.approx(800) and one["faces_nothing_mm2"] == 0
    assert one["contact_elements"] == len(brake.w) and one["gap_um"] == [0.0, 0.0]
    assert placement_doubts(scene, brake) == []


def test_a_lifted_pad_is_warned_of():
    """The plate 0.5 mm lower, and 0.5 mm into the pad; 5 um are within the limit."""
    scene, brake = built("parts.plate.z='-10.5 mm'")
    assert interfaces_of(scene, brake)["block_plate"]["gap_um"] == pytest.approx([500, 500])
    (line,) = placement_doubts(scene, brake)
    assert line.startswith("contact.block_plate: the faces are 0.500 mm apart before the load")
    (line,) = placement_doubts(*built("parts.plate.z='-9.5 mm'"))
    assert "the faces overlap by 0.500 mm before the load" in line
    assert placement_doubts(*built("parts.plate.z='-10.005 mm'")) == []


def test_a_pad_that_faces_nothing_in_part_is_warned_of():
    """A block of 40 x 20 mm on a plate of 20 x 30 mm, both centred: half of it has no partner."""
    scene, brake = built("parts.plate.length='20 mm'")
    assert interfaces_of(scene, brake)["block_plate"]["faces_nothing_mm2"] == pytest.approx(400)
    (line,) = placement_doubts(scene, brake)
    assert line.startswith(
        "contact.block_plate: 400 of 800 mm^2 of block.bottom have no opposite face"
    )
    # What a zone leaves out is meant.
    zone = "contact.block_plate.zone={ x=['-10 mm', '10 mm'] }"
    assert placement_doubts(*built(zone)) == []


def test_two_bodies_below_one_face_cover_it_together():
    scene, _ = built()
    table = scene.contact["block_plate"]
    other = SimpleNamespace(faces=("block.bottom", "other.top"), slip="motion")
    both = SimpleNamespace(contact={"one": table, "two": other}, motion=None)
    contact = SimpleNamespace(interface=np.array([0, 1]))
    brake = SimpleNamespace(contact=contact, g0=np.zeros(2), faced={"one": (5e-4, 8e-4)})
    brake.faced["two"] = (3e-4, 8e-4)
    assert placement_doubts(both, brake) == []


def sector(name, low, high, count):
    """Hexahedra with plane faces between two radii over 60 degrees, 5 mm high."""
    angle = np.linspace(-np.pi / 6, np.pi / 6, count + 1)
    r, a, z = np.meshgrid([low, high], angle, [0.0, 5e-3], indexing="ij")
    points = np.stack([r * np.cos(a), r * np.sin(a), z], axis=-1).reshape(-1, 3)
    n = np.arange(len(points)).reshape(2, count + 1, 2)
    cells = np.array([
        [n[0, i, k], n[1, i, k], n[1, i + 1, k], n[0, i + 1, k]]
        for i in range(count) for k in (0, 1)
    ]).reshape(count, 8)  # fmt: skip
    none = np.zeros((0, 4), dtype=np.int64)
    layers = {f"{name}.body": 1}
    mesh = RawMesh(points, "hexahedron", cells, np.ones(count, int), none, none[:, 0], layers, {})
    facets = exterior_facets(mesh, name)
    inner, outer = (np.isclose(np.hypot(*points[:, :2].T), r)[facets].all(axis=1)
                    for r in (low, high))  # fmt: skip
    tag = np.where(inner, 1, 2)[inner | outer]
    faces = {f"{name}.inner": 1, f"{name}.outer": 2}
    return RawMesh(
        points, "hexahedron", cells, np.ones(count, int), facets[inner | outer], tag, layers, faces
    )  # fmt: skip


@pytest.mark.parametrize("lift, warned", [(0.0, False), (0.5e-3, True)])
def test_plane_facets_of_curved_faces_are_not_taken_for_a_gap(lift, warned):
    """A fine shoe on a drum with facets of 6 degrees: gaps of 21 um and more, of 68 um at most."""
    R = 50e-3
    raw = joined([sector("drum", R - 10e-3, R, 10), sector("shoe", R + lift, R + 8e-3, 60)])
    mesh = tagged_mesh(lambda: raw, MPI.COMM_SELF, MeshSettings(cells="hexahedra", quality=1e-3))
    steel = Material(isotropic(2e11, 0.3), 7800.0)
    elastic = assemble_elastic(mesh, dict.fromkeys(mesh.layers, steel), {}, degree=1)
    faces = ("shoe.inner", "drum.outer")
    contact = contact_elements(mesh, elastic.free, faces, Rotation(1.0))
    assert 10e-6 + lift < contact.g0.min() < contact.g0.max() < 70e-6 + lift
    scene = SimpleNamespace(contact={"pair": SimpleNamespace(faces=faces)}, motion=None)
    area = float(contact.w.sum())
    brake = SimpleNamespace(
        mesh=mesh, elastic=elastic, contact=contact, g0=contact.g0, faced={"pair": (area, area)}
    )  # fmt: skip
    assert len(placement_doubts(scene, brake)) == warned


def test_check_prints_parts_and_interfaces(capsys):
    describe(BLOCK, MPI.COMM_SELF, [*COARSE, "parts.plate.z='-10.5 mm'"])
    said = capsys.readouterr().out
    assert "part block: 0.04016 kg, 40 x 20 x 20 mm" in said
    assert "contact block_plate: 'plate' slides over 'block' along (1, 0, 0) at 1 m/s" in said
    assert "area 800 mm^2" in said and "gap before the load 500 to 500 um" in said
    assert "warning: contact.block_plate: the faces are 0.500 mm apart" in said
    describe(BLOCK, MPI.COMM_SELF, COARSE, as_json=True)
    found = json.loads(capsys.readouterr().out)
    assert found["contact"]["block_plate"]["area_mm2"] == pytest.approx(800)
    assert found["parts"]["plate"]["mass_kg"] == pytest.approx(0.1296)

"""Hard cases of geometry and meshes: each gives a correct result or an error message."""

import numpy as np
import pytest

import hertz_parts
from brake_fenicsx.errors import SceneError
from brake_fenicsx.geometry import block, disc, pad
from brake_fenicsx.meshing.brake_mesh import check_cells, raw_mesh
from brake_fenicsx.meshing.filemesh import completed
from brake_fenicsx.meshing.gmsh_mesh import MeshSettings, gathered, gmsh_session
from brake_fenicsx.meshing.rawmesh import (
    exterior_facets,
    facet_keys,
    facet_nodes,
    orientation,
    quality,
)

pytestmark = pytest.mark.hard


def mesh(module, values, **table):
    return raw_mesh({"p": (module, values)}, MeshSettings(**table))


def body_is_closed(m):
    """Every edge of the boundary belongs to two facets: no hole, no crack between layers."""
    facets = exterior_facets(m, "p")
    edges = np.concatenate(
        [facets[:, [i, (i + 1) % facets.shape[1]]] for i in range(facets.shape[1])]
    )
    _, count = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    return bool(np.all(count % 2 == 0))


@pytest.mark.parametrize("cells", ["tetrahedra", "hexahedra"])
@pytest.mark.parametrize(
    "values",
    [
        pad.Pad(side="top", shim=(0.5e-3, 0.1e-3, 0.5e-3), size=8e-3, plate_size=8e-3),
        pad.Pad(side="top", angle=0.25, ear_length=0.0, piston_diameter=80e-3),
        pad.Pad(side="top", angle=2.0, size=9e-3, plate_size=9e-3, ear_length=4e-3),
        pad.Pad(side="top", position=-2.0, shape="parallel", slot=1e-3, slot_depth=1e-3),
        pad.Pad(side="top", piston_diameter=2e-3),
        pad.Pad(side="top", ear_width=40e-3, ear_length=30e-3),
    ],
    ids=["foils", "piston-beyond-pad", "wide", "thin-slot", "small-piston", "big-ears"],
)
def test_odd_pads(values, cells):
    """Foils of 0.1 mm, a piston larger than the pad or tiny: meshed without holes or slivers."""
    m = mesh(pad, values, cells=cells)
    assert quality(m).worst > 0.01
    assert np.all(orientation(m) == 1)
    assert body_is_closed(m)
    assert (m.facet_tag == m.faces["p.piston"]).any()
    assert ("p.ears" in m.faces) == (values.ear_length > 0)


def test_nodes_of_no_cell_are_left_out():
    """A construction point near a box gets a node without a cell: the node is removed."""
    with gmsh_session() as gmsh:
        gmsh.model.add("box")
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.addPoint(3, 3, 3)
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.generate(3)
        nodes = len(gmsh.model.mesh.getNodes()[0])
        m = gathered(gmsh.model, "p", {"body": [1]}, {"one": [1]}, "tetrahedron", 1)
    assert len(m.points) == nodes - 1 == np.unique(m.cells).size
    assert np.ptp(m.points, axis=0) == pytest.approx(1.0)
    assert np.isin(m.facets, m.cells).all()


def test_one_vane_many_vanes_and_none():
    """Vanes that nearly close the channels, and a single vane: each disc is one body."""
    for vanes in (1, 24):
        d = disc.Disc(vanes=vanes, vane_width=14e-3, thickness=24e-3, size=12e-3)
        m = mesh(disc, d)
        assert body_is_closed(m)
        assert quality(m).worst > 0.01


def test_thin_ring_of_hexahedra_keeps_positive_jacobians():
    """Curved cells of a tenth of the circumference: inverted cells are rejected."""
    thin = disc.Disc(radius=100e-3, bore=97e-3, thickness=3e-3, size=3e-3)
    assert (
        check_cells(mesh(disc, thin, cells="hexahedra", order=2), MeshSettings()).distortion > 0.5
    )
    coarse = disc.Disc(radius=100e-3, bore=97e-3, thickness=3e-3, size=60e-3)
    for order in (1, 2):
        try:
            worst = check_cells(mesh(disc, coarse, order=order), MeshSettings())
        except SceneError as error:
            assert "mesh" in str(error)
        else:
            assert worst.distortion > 0


def test_very_fine_contact_on_a_large_ball():
    """Mesh sizes from 5 um to 10 mm, a ratio of two thousand: no sliver elements."""
    m = mesh(*hertz_parts.sphere(50e-3, 60e-6, 5e-6, 10e-3), order=2)
    assert check_cells(m, MeshSettings()).distortion > 0.3
    assert len(m.points) < 20000


def test_no_process_is_left_waiting():
    """An impossible size makes gmsh fail: an error message of one line."""
    with pytest.raises(SceneError, match=r"parts\.p: the mesh cannot be built"):
        mesh(block, block.Block(length=0.0, size=1e-3))


def test_serendipity_is_exact_for_quadratic_maps():
    """Mid-face and centre nodes reproduce x^2 + y z on a curved cube."""
    m = mesh(block, block.Block(size=10e-3), cells="hexahedra", order=2)

    def bend(x):
        return x + 3 * np.stack([x[:, 1] ** 2, x[:, 2] * x[:, 0], x[:, 0] ** 2], axis=1)

    points, cells = completed(bend(m.points), m.cells[:, :20])
    np.testing.assert_allclose(points[cells], bend(m.points)[m.cells], atol=1e-15)
    assert len(points) - len(m.points) == len(np.unique(m.cells[:, 20:]))


def test_facets_are_told_apart_by_their_corners():
    """No two facets of a mesh have the same key, also for large node numbers."""
    big = np.array([[2_600_000, 2_600_001, 2_600_002], [2_600_000, 2_600_001, 2_600_003]])
    assert len(np.unique(facet_keys(big))) == 2
    m = mesh(block, block.Block(size=5e-3), cells="hexahedra")
    facets = exterior_facets(m, "p")
    assert len(np.unique(facet_keys(facets))) == len(facets)
    assert facet_nodes(m).shape[1] == 4

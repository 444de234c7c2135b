"""The mesh: cells, faces, areas and volumes, the same on every process."""

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

import hertz_parts
from brake_fenicsx.errors import SceneError
from brake_fenicsx.geometry import block, disc, pad
from brake_fenicsx.macro.elasticity import assemble_elastic, unit_loads
from brake_fenicsx.macro.material import Material, isotropic
from brake_fenicsx.meshing.brake_mesh import build_mesh, raw_mesh
from brake_fenicsx.meshing.gmsh_mesh import MeshSettings
from mesh_measures import measures

STEEL = Material(isotropic(2e11, 0.3), 7800.0)


PARTS = {
    "disc": (disc, disc.Disc(size=30e-3)),
    "pad": (pad, pad.Pad(size=14e-3, plate_size=14e-3, shim=1e-3)),
}


@pytest.mark.together
@pytest.mark.parametrize("cells", ["tetrahedra", "hexahedra"])
@pytest.mark.parametrize("order", [1, 2])
def test_all_processes_hold_the_same_mesh(comm, cells, order):
    """Counts equal the plain mesh's, areas and volumes those of process 0."""
    table = MeshSettings(cells=cells, order=order)
    together = measures(build_mesh(PARTS, comm, table))
    first = comm.bcast(together, root=0)
    raw = raw_mesh(PARTS, table)
    for name, (count, value) in together.items():
        assert count == first[name][0], name
        assert value == pytest.approx(first[name][1], rel=1e-12), name
    for name, tag in raw.layers.items():
        assert together[name][0] == np.count_nonzero(raw.cell_tag == tag), name
    for name, tag in raw.faces.items():
        assert together[name][0] == np.count_nonzero(raw.facet_tag == tag), name
    flat = np.pi / 6 * (140e-3**2 - 96e-3**2)
    assert together["pad.friction"][1] == pytest.approx(2 * flat, rel=1e-2 if order == 1 else 1e-4)
    assert together["pad.lining"][1] == pytest.approx(
        2 * flat * 10e-3, rel=1e-2 if order == 1 else 1e-4
    )


def test_middle_nodes_lie_on_the_sphere(comm):
    """DOLFINx integrates over the curved face; catches middle nodes in gmsh's order."""
    r, c = 50e-3, 4e-3
    parts = {
        "ball": hertz_parts.sphere(r, c, 0.5e-3),
        "base": hertz_parts.base(r, r, c, 0.5e-3),
    }
    found = measures(build_mesh(parts, comm, MeshSettings(order=2)))
    assert found["ball.body"][1] == pytest.approx(np.pi * r**3 / 6, rel=2e-4)
    exact = np.pi / 2 * r * (r - np.sqrt(r**2 - c**2))
    assert found["ball.contact"][1] == pytest.approx(exact, rel=2e-6)


@pytest.mark.parametrize("order", [1, 2])
def test_hexahedra_stretch_exactly(comm, order):
    """A bar of nu = 0 under tension: u = p L / E to round-off; catches a wrong node order."""
    bar = block.Block(length=30e-3, width=10e-3, height=12e-3, size=5e-3)
    table = MeshSettings(cells="hexahedra", order=order)
    mesh = build_mesh({"bar": (block, bar)}, comm, table)
    material = Material(isotropic(2e11, 0.0), 7800.0)
    held = {"bar.bottom": ["x", "y", "z"]}
    solved = assemble_elastic(mesh, {"bar.body": material}, held)
    f = 1e6 * unit_loads(mesh, solved.free, "bar.top")
    work = f @ spsolve(solved.K.tocsc(), f)
    assert work == pytest.approx(1e6**2 / 2e11 * 12e-3 * 300e-6, rel=1e-9)
    assert mesh.shape == "hexahedron"


@pytest.mark.together
def test_mistakes_are_raised_on_all_processes(comm):
    """A part that cannot be built, and a mesh below the quality asked for."""
    with pytest.raises(SceneError, match=r"parts.disc: .*between 0 and radius"):
        build_mesh({"disc": (disc, disc.Disc(bore=0.2))}, comm)
    with pytest.raises(SceneError, match=r"at least 0\.9 is needed"):
        build_mesh({"b": (block, block.Block())}, comm, MeshSettings(quality=0.9))
    with pytest.raises(SceneError, match="none is named"):
        build_mesh({}, comm)

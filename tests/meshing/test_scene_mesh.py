"""[mesh] of a scene: builders and files side by side, and mistakes in one line."""

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.build.brake import assemble_brake, check_brake
from brake_fenicsx.build.scene_mesh import scene_mesh, scene_raw_mesh
from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene import BUILDERS, read_scene
from places import BLOCK, SCENES
from small_meshes import HELD, SCENE


@pytest.fixture
def own(tmp_path, meshes):
    """A scene with a mesh file of its own, two boxes that share their nodes."""
    meshes.write_gmsh(meshes.glued(meshes.boxes()), tmp_path / "own.msh")
    path = tmp_path / "own.toml"
    path.write_text(SCENE + HELD + '[mesh.split]\n"block.bottom" = "plate.top"\n')
    return path


def test_a_scene_runs_on_its_own_mesh(own):
    """Load, supports and contact refer to the file's faces as to a builder's."""
    scene = read_scene(own)
    check_brake(scene, MPI.COMM_SELF)
    brake = assemble_brake(scene, MPI.COMM_SELF)
    assert brake.pressed == pytest.approx(5e5 * 800e-6)
    assert brake.w.sum() == pytest.approx(800e-6)
    np.testing.assert_allclose(brake.g0, 0, atol=1e-12)


def test_builder_and_file_side_by_side(own):
    """The block from the file on a plate of the builder."""
    text = own.read_text().replace('plate = { material = "iron" }', "")
    for line in ('plate_body = "plate.body"\n', 'plate_top = "plate.top"\n',
                 'plate_bottom = "plate.bottom"\n', '"block.bottom" = "plate.top"\n'):  # fmt: skip
        text = text.replace(line, "")
    text += '[parts.plate]\nbuilder = "block"\nz = "-20 mm"\nmaterial = "iron"\n'
    own.write_text(text)
    mesh = scene_raw_mesh(read_scene(own))
    assert mesh.parts() == ["plate", "block"]
    assert {"plate.top", "block.bottom"} <= set(mesh.faces)
    with pytest.raises(SceneError, match=r'write mesh.cells = "tetrahedra" and mesh.order = 1'):
        scene_raw_mesh(read_scene(own, ["mesh.order=2"]))


MISTAKES = [
    ("mesh.unit=m", "mesh.unit", "correct the unit"),
    ("mesh.file=other.msh", "other.msh", "no such file"),
    ("mesh.groups.pad_bottem=block.x", "pad_bottem", "did you mean 'pad_bottom'"),
    ("mesh.groups.pad_bottom=bottom", "mesh.groups", 'write "part.name"'),
    ('supports."block.left"=clamped', "block.left", "block.top"),
    ("mesh.cells=wedges", "wedges", "hexahedra"),
    ("mesh.order=3", "mesh.order", "use one of 1, 2"),
    ("mesh.extent=['1 m','1 mm']", "mesh.extent", "[smallest, largest]"),
    ("mesh.quality=0.99", "quality", "change the mesh sizes"),
    ("parts.block.size=3 mm", "parts.block.size", "without a builder"),
]


@pytest.mark.parametrize("change, named, remedy", MISTAKES)
def test_mistakes_are_one_line(change, named, remedy, own):
    """File, key and remedy in one line, before anything is meshed."""
    with pytest.raises(SceneError) as caught:
        check_brake(read_scene(own, [change]), MPI.COMM_SELF)
    error = str(caught.value)
    assert error.startswith(f"{own}: ")
    assert named in error
    assert remedy in error


def test_a_layer_without_material_is_found_before_any_mesh():
    """Catches a mistake that shows only after minutes of surfaces and laws."""
    shim = "parts.pad.material={lining='lining', plate='steel'}"
    scene = read_scene(SCENES / "disc_brake.toml", [shim])
    with pytest.raises(SceneError, match=r"parts.pad.material: no material for layer 'shim'"):
        check_brake(scene, MPI.COMM_SELF)


def test_groups_without_a_file():
    with pytest.raises(SceneError, match=r"mesh.groups: needs mesh.file"):
        read_scene(BLOCK, ["mesh.groups.a=b.c"])
    with pytest.raises(SceneError, match=r"parts.plate.builder: missing; .*or name a mesh.file"):
        read_scene(BLOCK, ["parts.plate={material='iron'}"])


def test_all_builders_are_there():
    """Each name of the table is a module with its dataclass, and builds with its defaults."""
    from importlib import import_module

    for name, cls in BUILDERS.items():
        module = import_module(f"brake_fenicsx.geometry.{name}")
        assert hasattr(module, cls)
        assert hasattr(module, "build") or hasattr(module, "sweep")


def test_hexahedra_of_a_whole_scene():
    """The reference brake of hexahedra, pads mirrored; no sliver in the shim."""
    changes = ["mesh.cells=hexahedra", "parts.disc.size=20 mm", "parts.pad.size=12 mm",
               "parts.pad.plate_size=12 mm"]  # fmt: skip
    mesh = scene_mesh(read_scene(SCENES / "disc_brake.toml", changes), MPI.COMM_SELF)
    assert mesh.shape == "hexahedron"
    assert mesh.quality > 0.4
    assert {"pad.lining", "pad.plate", "pad.shim", "disc.body"} == set(mesh.layers)


def test_reference_scene_has_its_contact_facets():
    """About 1360 facets of 2.825 mm squared in the mean."""
    mesh = scene_raw_mesh(read_scene(SCENES / "disc_brake.toml"))
    x = mesh.points[mesh.facets[mesh.facet_tag == mesh.faces["pad.friction"]]]
    area = 0.5 * np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1)
    assert abs(len(area) - 1360) < 20
    assert np.sqrt(area.mean()) == pytest.approx(2.825e-3, rel=0.01)

"""Layers of a mesh file that take other thicknesses: against the file with its nodes moved."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import model
from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.build.changes import assemble_changes
from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene import read_scene

SCENE = """
stages = ["equilibrium", "stability"]
[mesh]
file = "{file}"
unit = "mm"
[mesh.groups]
pad_body = "pad.lining"
plate_body = "plate.body"
pad_bottom = "pad.friction"
plate_top = "plate.top"
pad_top = "pad.back"
plate_bottom = "plate.bottom"
[parts.pad]
material = "lining"
layers = {{ lining = "{thickness} mm" }}
[parts.plate]
material = "iron"
[materials.iron]
model = "isotropic"
E = "125 GPa"
nu = 0.24
rho = "7200 kg/m^3"
[materials.lining]
model = "isotropic"
E = "4 GPa"
nu = 0.3
rho = "2500 kg/m^3"
[contact.pad_plate]
faces = ["pad.friction", "plate.top"]
law = {{ p0 = "10 MPa", u0 = "10 um" }}
friction = 0.4
[supports]
"plate.bottom" = "clamped"
"pad.back" = ["x", "y"]
[loads]
"pad.back" = {{ pressure = "5 bar" }}
[motion]
direction = [1, 0, 0]
speed = "1 m/s"
[stability]
band = ["0 Hz", "25 kHz"]
method = "reduced"
"""
KEY = "parts.pad.layers.lining"


@pytest.fixture
def written(tmp_path, meshes):
    """``written(thickness, stated)``: a scene whose file has a pad of that thickness [mm]."""

    def write(thickness, stated):
        mesh = meshes.boxes("hexahedra", 2)
        points = mesh.points.copy()
        points[points[:, 2] > 0, 2] *= thickness / 12
        name = f"pad_{thickness}.msh"
        meshes.write_gmsh(replace(mesh, points=points), tmp_path / name, 4.1)
        scene = tmp_path / f"{thickness}_{stated}.toml"
        scene.write_text(SCENE.format(file=name, thickness=stated))
        return scene

    return write


def test_matrices_are_those_of_the_file_with_moved_nodes(written):
    sweep = f'sweep.parameters={{ "{KEY}"={{ values=["9 mm", "13 mm"] }} }}'
    scene = read_scene(written(12, 12), [sweep])
    brake = assemble_brake(scene, MPI.COMM_SELF)
    changes = assemble_changes(scene, brake)
    exact = assemble_brake(read_scene(written(9, 9)), MPI.COMM_SELF)
    for A, B in (
        (brake.K + changes.change({KEY: 9e-3}, "K"), exact.K),
        (brake.M + changes.change({KEY: 9e-3}, "M"), exact.M),
    ):
        assert abs(A - B).max() < 1e-9 * abs(B).max()


def test_modes_are_those_of_the_file_with_moved_nodes(written):
    found = model.prepare(written(12, 12), parameters={KEY: (9e-3, 13e-3)}).modes({KEY: 10e-3})
    exact = model.prepare(written(10, 10), ["stability.method=full"]).modes()
    np.testing.assert_allclose(found.frequency, exact.frequency, rtol=1e-4)


@pytest.mark.parametrize(
    ("stated", "key", "text"),
    [
        (11, KEY, r"parts.pad.layers.lining = 0.011 m: the layer of the mesh is 0.012 m thick"),
        (12, "parts.pad.layers.shim", "is no thickness of a layer of this part"),
        (12, "parts.plate.layers.body", "is no thickness of a layer of this part"),
    ],
)
def test_refusals(stated, key, text, written):
    with pytest.raises(SceneError, match=text):
        model.prepare(written(12, stated), parameters={key: (9e-3, 13e-3)})

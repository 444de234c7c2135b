"""A scene's parts to its mesh: builders, the user's own file, or both."""

from __future__ import annotations

from collections.abc import Mapping

from mpi4py import MPI

from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import provided
from brake_fenicsx.meshing.brake_mesh import (
    Builder,
    Mesh,
    check_cells,
    check_faces,
    known_names,
    on_rank_0,
    raw_mesh,
    tagged_mesh,
)
from brake_fenicsx.meshing.gmsh_mesh import MeshSettings, gmsh_session
from brake_fenicsx.meshing.rawmesh import RawMesh, joined
from brake_fenicsx.scene import Scene

from .mesh_files import file_mesh


def scene_parts(scene: Scene) -> dict[str, Builder]:
    """Builder module and parameters of each part that has a builder."""
    return {
        name: (part.shape, part.parameters)
        for name, part in scene.parts.items()
        if part.builder is not None
    }


def file_parts(scene: Scene) -> list[str]:
    """Names of the parts that come from the mesh file."""
    return [
        name for name, part in scene.parts.items() if part.builder is None and part.matrices is None
    ]


def mesh_settings(scene: Scene) -> MeshSettings:
    """How the parts of a scene are meshed."""
    table = scene.mesh
    return MeshSettings(table.cells, table.order, table.growth, table.quality)


def scene_mesh(scene: Scene, comm: MPI.Comm) -> Mesh:
    """Mesh of all parts of a scene, whole on every process; collective.

    Raises:
        SceneError: a part or the mesh file is wrong, or the mesh too bad; on all ranks.
    """
    try:
        return tagged_mesh(lambda: scene_raw_mesh(scene), comm, mesh_settings(scene))
    except SceneError as error:
        raise SceneError(f"{scene.file}: {error}") from None


def scene_raw_mesh(scene: Scene) -> RawMesh:
    """Plain mesh of all parts, on this process.

    Raises:
        SceneError: a part or the mesh file is wrong, or their cells are of two kinds.
    """
    built = scene_parts(scene)
    if scene.mesh.file is None:
        return raw_mesh(built, mesh_settings(scene))
    read, _ = file_mesh(scene, file_parts(scene))
    if not built:
        return read
    made = raw_mesh(built, mesh_settings(scene))
    if (made.shape, made.order) != (read.shape, read.order):
        cells = "tetrahedra" if read.shape == "tetrahedron" else "hexahedra"
        raise SceneError(
            f"mesh.file: its cells are {cells} of order {read.order}, those of the builders are"
            f' not; write mesh.cells = "{cells}" and mesh.order = {read.order}'
        )
    return joined([made, read])


def check_mesh(scene: Scene, faces: Mapping[str, str], comm: MPI.Comm) -> list[str]:
    """Refuse what cannot be built, before anything is meshed.

    Args:
        scene: the scene.
        faces: key of the scene -> face that it names.
        comm: communicator of the run.

    Returns:
        Layers of all parts.

    Raises:
        SceneError: a part's parameters, the mesh file or a face's name is wrong; on all ranks.
    """

    def checked() -> list[str]:
        layers, known = known_names(scene_parts(scene), mesh_settings(scene))
        if scene.mesh.file is not None:
            mesh, _ = file_mesh(scene, file_parts(scene))
            check_cells(mesh, mesh_settings(scene))
            layers, known = [*layers, *mesh.layers], [*known, *mesh.faces]
        check_faces(faces, [*known, *_sets(scene)])
        return layers

    try:
        return on_rank_0(checked, comm)
    except SceneError as error:
        raise SceneError(f"{scene.file}: {error}") from None


def _sets(scene: Scene) -> list[str]:
    """Sets of nodes of bodies given by matrices, "part.set"."""
    given = [name for name, part in scene.parts.items() if part.matrices]
    return provided("nodes", f"parts.{given[0]}.matrices", "matrices")(scene) if given else []


def cut_loads(scene: Scene) -> list[str]:
    """Loads on a face that is smaller than its parameters say, a line each.

    Args:
        scene: the scene, checked; of parts with a builder the geometry is built, not meshed.

    Returns:
        Key, share that is left, and the force; nothing where every face is whole.
    """
    lines = []
    with gmsh_session() as gmsh:
        for name, (builder, values) in scene_parts(scene).items():
            if not hasattr(builder, "cut_faces"):
                continue
            gmsh.model.add(name)
            for face, (left, whole) in builder.cut_faces(gmsh.model.occ, values).items():
                load = scene.loads.get(f"{name}.{face}")
                if load is not None and load.pressure is not None:
                    lines.append(
                        f'loads."{name}.{face}": {100 * left / whole:.1f} % of the {face} lies'
                        f" within the outline of {name} ({1e6 * left:.0f} of {1e6 * whole:.0f}"
                        f" mm^2); {1e-6 * load.pressure:g} MPa gives {load.pressure * left:.0f} N"
                        f" each, not {load.pressure * whole:.0f} N"
                    )
    return lines

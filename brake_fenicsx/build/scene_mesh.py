"""A scene's parts to its mesh: builders, the user's own file, or both."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import SceneError, lines, located
from brake_fenicsx.extensions import provided
from brake_fenicsx.macro.morphing import EVEN
from brake_fenicsx.meshing import brake_mesh, gmsh_mesh, rawmesh
from brake_fenicsx.meshing.brake_mesh import Builder, Mesh, known_names, raw_mesh
from brake_fenicsx.meshing.groups import GroupedFile, mesh_of_file
from brake_fenicsx.scene import Scene, parts_section, units


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


def mesh_settings(scene: Scene) -> gmsh_mesh.MeshSettings:
    """How the parts of a scene are meshed."""
    table = scene.mesh
    return gmsh_mesh.MeshSettings(table.cells, table.order, table.growth, table.quality)


def scene_mesh(scene: Scene, comm: MPI.Comm) -> Mesh:
    """Mesh of all parts of a scene, whole on every process; collective.

    Raises:
        SceneError: a part or the mesh file is wrong, or the mesh too bad; on all ranks.
    """
    with located(scene.file):
        return brake_mesh.tagged_mesh(lambda: scene_raw_mesh(scene), comm, mesh_settings(scene))


def scene_raw_mesh(scene: Scene) -> rawmesh.RawMesh:
    """Plain mesh of all parts, on this process.

    Raises:
        SceneError: a part or the mesh file is wrong, or their cells are of two kinds.
    """
    built = scene_parts(scene)
    if scene.mesh.file is None:
        return raw_mesh(built, mesh_settings(scene))
    read, _ = file_mesh(scene)
    if not built:
        return read
    made = raw_mesh(built, mesh_settings(scene))
    if (made.shape, made.order) != (read.shape, read.order):
        cells = "tetrahedra" if read.shape == "tetrahedron" else "hexahedra"
        raise SceneError(f"""mesh.file: its cells are {cells} of order {read.order}, those of the
            builders are not; write mesh.cells = "{cells}" and mesh.order = {read.order}""")
    return rawmesh.joined([made, read])


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
            mesh, _ = file_mesh(scene)
            brake_mesh.check_cells(mesh, mesh_settings(scene))
            layers, known = [*layers, *mesh.layers], [*known, *mesh.faces]
        if given := [name for name, part in scene.parts.items() if part.matrices]:
            # Sets of nodes of bodies given by matrices, "part.set".
            known += provided("nodes", f"parts.{given[0]}.matrices", "matrices")(scene)
        brake_mesh.check_faces(faces, known)
        return layers

    with located(scene.file):
        return brake_mesh.on_rank_0(checked, comm)


@lines
def cut_loads(scene: Scene) -> Iterator[str]:
    """Loads on a face that is smaller than its parameters say, a line each.

    Args:
        scene: the scene, checked; of parts with a builder the geometry is built, not meshed.

    Returns:
        Key, share that is left, and the force; nothing where every face is whole.
    """
    with gmsh_mesh.gmsh_session() as gmsh:
        for name, (builder, values) in scene_parts(scene).items():
            if not hasattr(builder, "cut_faces"):
                continue
            gmsh.model.add(name)
            for face, (left, whole) in builder.cut_faces(gmsh.model.occ, values).items():
                load = scene.loads.get(f"{name}.{face}")
                if load is not None and load.pressure is not None:
                    yield f"""loads."{name}.{face}": {100 * left / whole:.1f} % of the {face} lies
                        within the outline of {name} ({1e6 * left:.0f} of {1e6 * whole:.0f} mm^2);
                        {1e-6 * load.pressure:g} MPa gives {load.pressure * left:.0f} N each, not
                        {load.pressure * whole:.0f} N"""


def grouped_file(folder: Path, table: parts_section.MeshTable) -> GroupedFile:
    """The mesh file of a scene and its groups.

    Args:
        folder: of the scene.
        table: the section [mesh].

    Raises:
        SceneError: the unit is missing or is none of length.
    """
    if table.unit is None:
        raise SceneError('mesh.unit: missing; write the unit of the file\'s lengths, as "mm"')
    with located(f"mesh.unit = {table.unit!r}", ValueError):
        metres = units.to_si(f"1 {table.unit}", "m")
    file, unit = str(table.file), table.unit
    groups = {name: t if isinstance(t, str) else [*t] for name, t in table.groups.items()}
    return GroupedFile(folder, file, unit, metres, table.extent, groups, table.split)


def _movement(scene: Scene, read: rawmesh.RawMesh, part: str, name: str) -> Array:
    """Movement of the nodes of a mesh file per length [m/m], shape (nodes, 3).

    Raises:
        SceneError: the displaced mesh is another one, the same, or moves other parts.
    """
    morph, where = scene.parts[part].morph[name], f"parts.{part}.morph.{name}.displaced"
    file = grouped_file(scene.file.parent, scene.mesh)
    moved = mesh_of_file(file, file_parts(scene), (morph.displaced, where))
    step = moved.points - read.points
    others = np.ones(len(step), dtype=bool)
    others[read.cells[read.part(part)]] = False
    size = float(np.abs(step).max())
    if not size > 0:
        raise SceneError(f"{where} = {morph.displaced!r}: no node is at another place")
    if np.abs(step[others]).max(initial=0.0) > EVEN * size:
        raise SceneError(f"""{where} = {morph.displaced!r}: nodes of other parts than {part} are
            moved; leave them where they are in mesh.file""")
    return np.asarray(step / (morph.ends[1] - morph.ends[0]))


def file_mesh(scene: Scene) -> tuple[rawmesh.RawMesh, dict[str, Array]]:
    """Mesh of the mesh file, its nodes where the lengths of the scene have them.

    Returns:
        The mesh, and the movement of its nodes under each length, "parts.PART.morph.NAME", per
        length [m/m], shape (nodes, 3).
    """
    read = mesh_of_file(grouped_file(scene.file.parent, scene.mesh), file_parts(scene))
    points, moves = read.points.copy(), {}
    for part in file_parts(scene):
        for name, morph in scene.parts[part].morph.items():
            moves[f"parts.{part}.morph.{name}"] = v = _movement(scene, read, part, name)
            points += (morph.length - morph.ends[0]) * v
    return replace(read, points=points), moves

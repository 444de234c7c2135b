"""Readers of mesh files: gmsh by gmsh, decks by the extra of that name, others by meshio.

Meshio reads no .cdb, of an .inp neither surfaces nor two element blocks of one set, and of a .bdf
neither coordinate systems nor included files.
"""

from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from brake_fenicsx.arguments import Ints
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import absent, extras, load
from brake_fenicsx.folder.arrays import reading

from .filemesh import SOLIDS, FileMesh, each_once, in_gmsh_order, listed, one_kind, same_length
from .gmsh_mesh import elements, gmsh_session, nodes_of_model

MSH = b"$MeshFormat"  # how every mesh of gmsh begins since its format 2
REMEDY = (
    "export the mesh once more, or as another of .msh, .inp, .cdb and .bdf; if another program"
    " reads the file, tell us of it"
)
# Gmsh's numbers of solid elements.
_GMSH_SOLIDS = {4: "tetra", 11: "tetra10", 5: "hexahedron", 17: "hexahedron20", 12: "hexahedron27",
                6: "wedge", 7: "pyramid", 13: "wedge18", 18: "wedge15"}  # fmt: skip
_SKINS = {"triangle": 3, "triangle6": 3, "quad": 4, "quad8": 4, "quad9": 4}


def read_mesh_file(path: Path) -> FileMesh:
    """Read a mesh file by its ending.

    Args:
        path: .msh of gmsh; .inp of Abaqus or CalculiX; .cdb of Ansys; what meshio reads (.bdf,
            .nas, .med, .vtu, ...).

    Raises:
        SceneError: the file is missing, of no known kind, or damaged, or its reader is not there.
    """
    read, how = {".msh": (read_gmsh, "by gmsh")}.get(path.suffix, (read_other, "by meshio"))
    found = [extra.readers[path.suffix] for extra in extras() if path.suffix in extra.readers]
    if found:
        read, how = load(found[0][0]), found[0][1]
    elif text := absent(path.suffix):
        raise SceneError(f"{path.suffix}: {text}")
    with reading(path, how, REMEDY, at=""):
        mesh = read(path)
    each_once(mesh, merge=path.suffix == ".msh")
    return mesh


def read_gmsh(path: Path) -> FileMesh:
    """Read gmsh's own format, 2.2 or 4.1; physical groups by name, or by number without one.

    Gmsh takes a file that does not begin as one of its meshes for a script, and runs it; it runs
    the file beside it whose name ends with ".opt" too. It is shown meshes alone, by a link in a
    folder of its own.
    """
    with path.open("rb") as stream:
        begin = stream.read(len(MSH) + 1)
    if begin.rstrip() != MSH:
        raise SceneError("""does not begin with $MeshFormat and is no mesh of gmsh; save the mesh in
            gmsh's format 2.2 or 4.1, or name the file by its own ending""")
    with gmsh_session() as gmsh, TemporaryDirectory() as folder:
        link = Path(folder, "mesh.msh")
        link.symlink_to(path.resolve())
        gmsh.open(str(link))
        model = gmsh.model
        x, place = nodes_of_model(model)
        kinds = [int(kind) for kind in model.mesh.getElementTypes(3)]
        kind = one_kind(_GMSH_SOLIDS.get(k, f"gmsh {k}") for k in kinds)
        shape = SOLIDS[kind][0]
        cells: list[Ints] = []
        start: dict[int, tuple[int, int]] = {}
        for _, entity in model.getEntities(3):
            first = sum(map(len, cells))
            cells.append(elements(model, place, kinds[0], entity))
            start[entity] = (first, first + len(cells[-1]))
        mesh = FileMesh(x, shape, np.concatenate(cells))
        for dim, group in model.getPhysicalGroups():
            name = model.getPhysicalName(dim, group) or str(group)
            entities = model.getEntitiesForPhysicalGroup(dim, group)
            if dim == 3:
                mesh.cell_groups[name] = np.concatenate([np.arange(*start[e]) for e in entities])
            elif dim == 2:
                mesh.facet_groups[name] = _gmsh_skin(model, entities, place, shape)
    return mesh


def _gmsh_skin(model: Any, entities: Any, place: Ints, shape: str) -> Ints:
    """Corner nodes of the facets of some surfaces."""
    corners = 3 if shape == "tetrahedron" else 4
    found: list[Ints] = [np.zeros((0, corners), dtype=np.int64)]
    for entity in entities:
        for kind in model.mesh.getElementTypes(2, entity):
            if model.mesh.getElementProperties(kind)[5] == corners:
                found.append(elements(model, place, kind, entity)[:, :corners])
    return np.concatenate(found)


def read_other(path: Path) -> FileMesh:
    """Read what meshio reads; groups are its sets, and integers of cells by their value."""
    said = StringIO()
    try:
        import meshio

        if path.suffix not in meshio.extension_to_filetypes:
            raise SceneError(f"files {path.suffix} are not known; write .msh, .inp or .bdf instead")
        with redirect_stderr(said), redirect_stdout(said):
            read = meshio.read(path)
    except ImportError as error:
        raise SceneError(f"""{path.suffix} needs {error.name}: pip install {error.name}, or convert
            the mesh to .msh or .inp""") from None
    except SystemExit:  # what meshio makes of every file that it cannot read (5.3.5)
        raise ValueError(" ".join(said.getvalue().split())) from None
    kind = one_kind(block.type for block in read.cells if block.dim == 3)
    points, shape = np.asarray(read.points, dtype=float), SOLIDS[kind][0]
    cells = read.get_cells_type(kind).astype(np.int64)
    mesh = FileMesh(points, shape, in_gmsh_order(points, cells, shape))
    read.cell_sets = _meshio_groups(read)
    for name, members in read.cell_sets_dict.items():
        if members.get(kind, np.zeros(0)).size:
            mesh.cell_groups[name] = members[kind]
        skins = {skin: own for skin, own in members.items() if skin in _SKINS and own.size}
        if skins:
            tables = (read.get_cells_type(s)[own][:, : _SKINS[s]] for s, own in skins.items())
            mesh.facet_groups[name] = same_length(chain(*map(listed, tables)))
            mesh.shell_sets[name] = True
    for name, nodes in read.point_sets.items():
        mesh.node_groups[name] = np.asarray(nodes, dtype=np.int64)
    for name, families in _families(read, "point_tags", read.point_data).items():
        mesh.node_groups[name] = np.flatnonzero(np.isin(read.point_data["point_tags"], families))
    none = [k for k, g in (("cells", mesh.cell_groups), ("nodes", mesh.node_groups)) if not g]
    if none:
        mesh.advice = (
            f"; meshio found no sets of {' or '.join(none)} in it and does not read those of every"
            " format (docs/meshes.md): write .msh, .inp or .cdb"
        )
    return mesh


def _meshio_groups(read: Any) -> dict[str, list[Ints]]:
    """Group -> members in each block of cells.

    Whole numbers of cells are groups by their value; where arrays differ, as "ARRAY:VALUE".
    """
    groups = {
        name: [np.asarray([] if m is None else m, dtype=np.int64) for m in members]
        for name, members in read.cell_sets.items()
    }
    for value, arrays in _numbers(read).items():
        first, *rest = arrays.values()
        if all(np.array_equal(a, b) for m in rest for a, b in zip(first, m, strict=True)):
            groups.setdefault(value, first)
        else:
            groups |= {f"{array}:{value}": members for array, members in arrays.items()}
    for name, own in _families(read, "cell_tags", read.cell_data).items():
        groups[name] = [np.flatnonzero(np.isin(v, own)) for v in read.cell_data["cell_tags"]]
    return groups


def _numbers(read: Any) -> dict[str, dict[str, list[Ints]]]:
    """Whole number -> array of cells -> members in each block of cells."""
    numbers: dict[str, dict[str, list[Ints]]] = {}
    for array, blocks in read.cell_data.items():
        values = [np.ravel(v) for v in blocks]
        pairs = zip(values, read.cells, strict=True)
        if all(np.issubdtype(v.dtype, np.integer) and len(v) == len(b.data) for v, b in pairs):
            for value in np.unique(np.concatenate(values)):
                members = [np.flatnonzero(v == value) for v in values]
                numbers.setdefault(str(value), {})[array] = members
    return numbers


def _families(read: Any, tags: str, data: Any) -> dict[str, list[int]]:
    """Group of a MED file -> its families, by which the data number cells or nodes."""
    groups: dict[str, list[int]] = {}
    for family, names in getattr(read, tags, {}).items() if tags in data else ():
        for name in names:
            groups.setdefault(name, []).append(family)
    return groups

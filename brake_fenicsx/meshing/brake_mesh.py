"""Parts to one mesh: gmsh on rank 0, names kept in a table.

All bodies live in one mesh, as components that share no node; layers of one part share faces.
"""

import hashlib
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx import compat
from brake_fenicsx.arguments import AnyArray
from brake_fenicsx.errors import OfOneProcess, SceneError
from brake_fenicsx.folder.processes import on_first
from brake_fenicsx.geometry.part import PartEntities, Swept

from .gmsh_mesh import MeshSettings, built_part, discrete_model, gmsh_session, mesh_part
from .rawmesh import Quality, RawMesh, Unread, facet_nodes, joined, orientation, quality, volumes


class PartBuilder(Protocol):
    """A shape: a module, or any object with this function."""

    def build(self, occ: Any, parameters: Any) -> PartEntities:
        """Volumes and faces of one part by name, in the current gmsh model.

        Args:
            occ: ``gmsh.model.occ``.
            parameters: dimensions and mesh sizes [m].
        """


Builder = tuple[PartBuilder, Any]

Result = TypeVar("Result")

# Cells of one part beyond which its size is taken for a slip: gmsh would mesh for hours.
MOST_CELLS = 1e8


@dataclass(frozen=True, slots=True)
class Mesh(OfOneProcess):
    """A tagged mesh.

    Attributes:
        domain: the DOLFINx mesh.
        cell_tags: tag of each cell, by ``layers``.
        facet_tags: tag of each named boundary facet, by ``faces``.
        layers: "part.layer" -> cell tag.
        faces: "part.face" -> facet tag.
        quality: worst cell: smallest ratio of inscribed to circumscribed radius (3 r / R) of
            tetrahedra, smallest scaled Jacobian of hexahedra.
        worst: all measures of the worst cells.
        shape: "tetrahedron" or "hexahedron".
        volumes: "part.layer" -> volume [m^3].
        extents: part -> sides of the box around it along x, y, z [m].
        unread: what the mesh file holds beside, which is not read.
        raw: the plain mesh that it was made from.
    """

    domain: Any
    cell_tags: Any
    facet_tags: Any
    layers: dict[str, int]
    faces: dict[str, int]
    quality: float
    worst: Quality | None = None
    shape: str = "tetrahedron"
    volumes: dict[str, float] = field(default_factory=dict)
    extents: dict[str, tuple[float, ...]] = field(default_factory=dict)
    unread: Unread = field(default_factory=Unread)
    raw: RawMesh | None = None

    @property
    def digest(self) -> str:
        """Hash of nodes and cells; "" of a mesh that was made otherwise."""
        arrays = () if self.raw is None else (self.raw.points, self.raw.cells)
        content = b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)
        return hashlib.sha256(content).hexdigest() if content else ""

    def cells_of(self, part: str) -> NDArray[np.int32]:
        """Cells of all layers of a part."""
        tags = [tag for layer, tag in self.layers.items() if layer.partition(".")[0] == part]
        return np.asarray(self.cell_tags.indices[np.isin(self.cell_tags.values, tags)])


def build_mesh(
    parts: Mapping[str, Builder], comm: MPI.Comm, table: MeshSettings | None = None
) -> Mesh:
    """Build and mesh all parts with gmsh; collective.

    Args:
        parts: part name -> (builder module with ``build(occ, parameters)``, its parameters).
        comm: the processes, each of which gets the whole mesh.
        table: kind of cells, order, growth and the quality asked for.

    Returns:
        The tagged mesh.

    Raises:
        SceneError: a builder refuses its parameters, or the mesh is too bad; on all ranks.
    """
    settings = table or MeshSettings()
    return tagged_mesh(lambda: raw_mesh(parts, settings), comm, settings)


def raw_mesh(parts: Mapping[str, Builder], table: MeshSettings) -> RawMesh:
    """Build and mesh all parts on this process.

    Raises:
        SceneError: a builder refuses its parameters; the part is named.
    """
    meshes = []
    with gmsh_session() as gmsh:
        for name, (builder, values) in parts.items():
            try:
                meshes.append(mesh_part(gmsh, name, builder, values, table))
            except Exception as error:
                raise SceneError(f"parts.{name}: the mesh cannot be built: {error}") from None
    if not meshes:
        raise SceneError("parts: none is named; write [parts.NAME]")
    return joined(meshes)


def tagged_mesh(make: Callable[[], RawMesh], comm: MPI.Comm, table: MeshSettings) -> Mesh:
    """Make a plain mesh on rank 0, check it, and tag it on every process; collective.

    Every process has the whole mesh: the matrices are small beside their factors, and what solves
    samples needs all of them.

    Args:
        make: makes the mesh; called on rank 0 only.
        comm: the processes.
        table: the quality asked for.

    Returns:
        The tagged mesh.

    Raises:
        SceneError: the mesh cannot be made, or is too bad; on all ranks.
    """

    def checked() -> tuple[RawMesh, Any, Quality]:
        raw = make()
        return raw, facet_nodes(raw), check_cells(raw, table)

    raw, facets, worst = on_rank_0(checked, comm)
    with gmsh_session() as gmsh:
        model = discrete_model(gmsh, raw, facets)
        domain, cell_tags, facet_tags = compat.mesh_from_gmsh(model)
    volume = volumes(raw)
    filled = {n: float(volume[raw.cell_tag == tag].sum()) for n, tag in raw.layers.items()}
    sizes = {n: extent(raw.points[raw.cells[raw.part(n)].reshape(-1)]) for n in raw.parts()}
    tagged = domain, cell_tags, facet_tags, raw.layers, raw.faces, worst.worst, worst, raw.shape
    return Mesh(*tagged, filled, sizes, raw.unread, raw)


def extent(points: AnyArray) -> tuple[float, ...]:
    """Sides of the box around points [m], shape (n, 3)."""
    return tuple(map(float, np.ptp(points, axis=0)))


def check_cells(mesh: RawMesh, table: MeshSettings) -> Quality:
    """Refuse cells that are inside out, flat or skew.

    Raises:
        SceneError: the cell, its measure and the remedy.
    """
    bad = np.flatnonzero(orientation(mesh) != 1)
    if bad.size:
        raise SceneError(f"""mesh: {bad.size} cells are flat or twisted, one at
            {_place(mesh, bad[0])}: change the mesh sizes or repair the mesh""")
    worst = quality(mesh)
    if worst.worst < table.quality:
        raise SceneError(f"""mesh: the worst cell, at {_place(mesh, worst.cell)}, has quality
            {worst.worst:.3g}, at least {table.quality} is needed: change the mesh sizes, or
            mesh.cells""")
    if not worst.distortion > 0:
        raise SceneError("""mesh: a curved cell is turned inside out by its middle nodes: take finer
            cells at curved faces, or mesh.order = 1""")
    return worst


def _place(mesh: RawMesh, cell: int) -> str:
    """Layer and centre of a cell, for messages."""
    layer = next(n for n, tag in mesh.layers.items() if tag == mesh.cell_tag[cell])
    x, y, z = 1e3 * mesh.points[mesh.corners[cell]].mean(axis=0)
    return f"({x:.1f}, {y:.1f}, {z:.1f}) mm in {layer}"


def on_rank_0(make: Callable[[], Result], comm: MPI.Comm) -> Result:
    """What something run on rank 0 gives, on all ranks; collective.

    Raises:
        SceneError: what went wrong on rank 0.
    """

    def made() -> Result:
        try:
            return make()
        except SceneError:
            raise
        except Exception as error:
            raise SceneError(f"the mesh cannot be built: {error}") from None

    return on_first(made, comm)


def known_names(parts: Mapping[str, Builder], table: MeshSettings) -> tuple[list[str], list[str]]:
    """Layers and faces of all parts, whose geometry is built but not meshed.

    Args:
        parts: as for ``build_mesh``.
        table: kind of cells.

    Returns:
        "part.layer" and "part.face" names.

    Raises:
        SceneError: a builder refuses its parameters; the part is named.
    """
    layers, faces = list[str](), list[str]()
    with gmsh_session() as gmsh:
        for name, (builder, values) in parts.items():
            try:
                part = built_part(gmsh, name, builder, values, table)
                _check_number(gmsh.model.occ, part)
            except Exception as error:
                raise SceneError(f"""parts.{name}: the geometry cannot be built: {error}; change its
                    parameters""") from None
            layers += [f"{name}.{layer}" for layer in part.layers]
            faces += [f"{name}.{face}" for face in part.faces]
    return layers, faces


def _check_number(occ: Any, part: PartEntities | Swept) -> None:
    """Refuse sizes that would keep gmsh busy for hours: a slip of the unit, as a rule.

    The number of cells is a lower one: finer places are left out.

    Raises:
        ValueError: about how many cells it would be.
    """
    if isinstance(part, Swept):
        area = {n: sum(occ.getMass(2, t) for t in tags) for n, tags in part.regions.items()}
        cells = sum(s.elements * area[r] for s in part.slabs for r in s.regions) / part.size**2
    else:
        volume = {n: sum(occ.getMass(3, t) for t in tags) for n, tags in part.volumes.items()}
        # A regular tetrahedron of edge h has the volume h^3 / (6 sqrt 2).
        cells = sum(8.5 * v / part.sizes[n] ** 3 for n, v in volume.items())
    if cells > MOST_CELLS:
        raise ValueError(f"more than {cells:.0e} cells of the mesh size asked for")


def check_faces(used: Mapping[str, str], known: Collection[str]) -> None:
    """Refuse names of faces that no part has.

    Args:
        used: key of the scene -> face that it names.
        known: faces of all parts.

    Raises:
        SceneError: the key, the name, and the names there are.
    """
    for key, face in used.items():
        if face not in known:
            raise SceneError(f"{key}: no face {face!r}; there are {', '.join(sorted(known))}")

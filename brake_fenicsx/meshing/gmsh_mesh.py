"""One part to a plain mesh with gmsh, on one process."""

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from brake_fenicsx.arguments import AnyArray, Array, Ints
from brake_fenicsx.geometry.part import PartEntities, Swept

from .rawmesh import RawMesh, quality, with_mirror_image, without_unused_nodes
from .swept import Footprint, sweep

logger = logging.getLogger(__name__)

# Gmsh's plane algorithms in the order in which they are tried: frontal, Delaunay, mesh adaptation.
PLANE_ALGORITHMS = (6, 5, 1)
# Quality 3 r / R of the worst cell from which on no other algorithm is tried.
GOOD = 0.05
# Silent; without the question that comes before long work; one thread, since meshes of several
# depend on which is first; algorithms and seed that could be set elsewhere.
SETTINGS = {
    "General.Terminal": 0, "General.ExpertMode": 1, "General.NumThreads": 1,
    "Mesh.MaxNumThreads1D": 1, "Mesh.MaxNumThreads2D": 1, "Mesh.MaxNumThreads3D": 1,
    "Mesh.Algorithm": PLANE_ALGORITHMS[0], "Mesh.Algorithm3D": 1, "Mesh.RandomSeed": 1,
    "Mesh.MeshSizeFactor": 1,
}  # fmt: skip
# gmsh's numbers for cells and facets of order 1 and 2.
CELL_TYPE = {("tetrahedron", 1): 4, ("tetrahedron", 2): 11,
             ("hexahedron", 1): 5, ("hexahedron", 2): 12}  # fmt: skip
FACET_TYPE = {("tetrahedron", 1): 2, ("tetrahedron", 2): 9,
              ("hexahedron", 1): 3, ("hexahedron", 2): 10}  # fmt: skip


@dataclass(frozen=True, slots=True)
class MeshSettings:
    """How parts are meshed.

    Attributes:
        cells: "tetrahedra" or, of swept parts, "hexahedra".
        order: order of the geometry, 1 or 2.
        growth: growth of the cell size away from finer cells, size per distance.
        quality: lowest accepted cell quality: 3 r / R of tetrahedra, scaled Jacobian of hexahedra.
    """

    cells: str = "tetrahedra"
    order: int = 1
    growth: float = 0.5
    quality: float = 0.01


@contextmanager
def gmsh_session() -> Iterator[Any]:
    """Gmsh, silent, from start to end, with the same settings in every account."""
    # It sets signal handlers, which Python allows the main thread alone.
    main = threading.current_thread() is threading.main_thread()
    with nullcontext() if main else import_module("unittest.mock").patch("signal.signal"):
        import gmsh

        # Without the option files in the user's home.
        gmsh.initialize(readConfigFiles=False)
        try:
            for name, value in SETTINGS.items():
                gmsh.option.setNumber(name, value)
            yield gmsh
        finally:
            gmsh.finalize()


def mesh_part(gmsh: Any, name: str, builder: Any, values: Any, table: MeshSettings) -> RawMesh:
    """Build and mesh one part in a model of its own.

    Args:
        gmsh: the running gmsh module.
        name: name of the part.
        builder: module with ``build`` or ``sweep`` or both.
        values: the builder's parameters.
        table: kind of cells, order, growth.

    Returns:
        The mesh with layers "name.layer" and faces "name.face".

    Raises:
        ValueError: the part cannot be built so.
    """
    part = built_part(gmsh, name, builder, values, table)
    if isinstance(part, Swept):
        mesh = _swept_mesh(gmsh, name, part, table)
    else:
        mesh = _volume_mesh(gmsh, name, part, table)
        if quality(mesh).worst < table.quality:
            mesh = _layered(gmsh, name, builder, values, table) or mesh
    return with_mirror_image(mesh) if part.mirror else mesh


def built_part(
    gmsh: Any, name: str, builder: Any, values: Any, table: MeshSettings
) -> PartEntities | Swept:
    """The geometry of one part in a model of its own; see ``mesh_part``."""
    gmsh.model.add(name)
    if table.cells == "hexahedra" or not hasattr(builder, "build"):
        return _swept_part(gmsh.model.occ, name, builder, values)
    part: PartEntities = builder.build(gmsh.model.occ, values)
    return part


def _layered(
    gmsh: Any, name: str, builder: Any, values: Any, table: MeshSettings
) -> RawMesh | None:
    """Tetrahedra in layers along the sweep, where thin layers come out as slivers otherwise."""
    gmsh.model.add(f"{name} in layers")
    try:
        swept = _swept_part(gmsh.model.occ, name, builder, values)
    except ValueError:
        return None
    logger.info("part %s is meshed in layers: its thin layers would hold slivers", name)
    return _swept_mesh(gmsh, name, swept, table)


def _swept_part(occ: Any, name: str, builder: Any, values: Any) -> Swept:
    """A builder's footprint and slabs.

    Raises:
        ValueError: the builder's shape is not swept.
    """
    if not hasattr(builder, "sweep"):
        raise ValueError(
            f"part {name!r} is not swept along z and has no hexahedra;"
            ' write mesh.cells = "tetrahedra"'
        )
    swept: Swept = builder.sweep(occ, values)
    return swept


def _swept_mesh(gmsh: Any, name: str, swept: Any, table: MeshSettings) -> RawMesh:
    """Mesh the footprint and lift it."""
    model, quads = gmsh.model, table.cells == "hexahedra"
    tags = sorted({tag for region in swept.regions.values() for tag in region})
    points = model.getBoundary([(2, t) for t in tags], recursive=True, combined=False)
    model.mesh.setSize(points, swept.size)
    _fine_places(gmsh, swept, swept.size, table.growth)
    gmsh.option.setNumber("Mesh.Algorithm", 6)
    if quads:
        _quadrilaterals(gmsh)
    else:
        model.mesh.generate(2)
    if table.order == 2:
        model.mesh.setOrder(2)
    x, place = nodes_of_model(model)

    def plane(dim: int, groups: dict[str, list[int]]) -> dict[str, Ints]:
        found = {}
        for name, own in groups.items():
            kinds = [kind for tag in own for kind in model.mesh.getElementTypes(dim, tag)]
            if len(kinds) != len(own):
                raise ValueError("triangles are left in a mesh of quadrilaterals")
            each = (elements(model, place, *pair) for pair in zip(kinds, own, strict=True))
            found[name] = np.concatenate([*each])
        return found

    flat = Footprint(x[:, :2], plane(2, swept.regions), plane(1, swept.curves))
    return sweep(flat, swept, name)


def _quadrilaterals(gmsh: Any) -> None:
    """Mesh the plane model with quadrilaterals only.

    Gmsh's full-quad recombination may leave triangles where the mesh is coarse, or (gmsh 4.15)
    raise where a curve has an odd number of elements; then triangles of twice the size are each cut
    into three.
    """
    mesh, option = gmsh.model.mesh, gmsh.option.setNumber
    option("Mesh.RecombineAll", 1)
    ways = ((3, 0, 1.0), (2, 0, 1.0), (0, 1, 2.0))
    try:
        for recombination, subdivide, factor in ways:
            option("Mesh.RecombinationAlgorithm", recombination)
            option("Mesh.SubdivisionAlgorithm", subdivide)
            option("Mesh.MeshSizeFactor", factor)
            mesh.clear()
            try:
                mesh.generate(2)
            except Exception:
                if (recombination, subdivide, factor) == ways[-1]:
                    raise
                continue
            if mesh.getElementsByType(2)[0].size == 0:
                return
    finally:
        option("Mesh.RecombineAll", 0)
        option("Mesh.SubdivisionAlgorithm", 0)
        option("Mesh.MeshSizeFactor", 1.0)


def _volume_mesh(gmsh: Any, name: str, part: Any, table: MeshSettings) -> RawMesh:
    """Tetrahedra in all volumes of a part; if one is flat, other plane meshes are tried."""
    model = gmsh.model
    _point_sizes(model, part, table.growth)
    _fine_places(gmsh, part, max(part.sizes.values()), table.growth)
    gmsh.option.setNumber("Mesh.Optimize", 1)
    measure = -1.0
    for algorithm in PLANE_ALGORITHMS:
        gmsh.option.setNumber("Mesh.Algorithm", algorithm)
        model.mesh.clear()
        model.mesh.generate(3)
        if table.order == 2:
            model.mesh.setOrder(2)
        mesh = gathered(model, name, part.volumes, part.faces, "tetrahedron", table.order)
        worst = quality(mesh).worst
        if worst > measure:
            best, measure = mesh, worst
        if measure >= GOOD:
            break
    return best


def _point_sizes(model: Any, part: Any, growth: float) -> None:
    """Sizes at the corners of every layer; beside a finer layer they grow with the distance."""
    sizes = sorted(
        ((part.sizes[layer], tags) for layer, tags in part.volumes.items()), key=lambda s: -s[0]
    )
    boxes = [
        (size, np.array([model.getBoundingBox(3, t) for t in tags]).reshape(-1, 2, 3))
        for size, tags in sizes
    ]
    # Coarse layers first: where two layers share a face the finer size holds.
    for size, tags in sizes:
        for dim, point in model.getBoundary([(3, t) for t in tags], recursive=True, combined=False):
            x = np.array(model.getValue(dim, point, []))
            away = [
                (finer, np.linalg.norm(np.maximum(np.maximum(b[:, 0] - x, x - b[:, 1]), 0), axis=1))
                for finer, b in boxes
            ]
            grown = min(finer + growth * d.min() for finer, d in away if finer <= size)
            model.mesh.setSize([(dim, point)], min(size, grown))


def _fine_places(gmsh: Any, part: Any, size: float, growth: float) -> None:
    """A size that grows away from the part's fine places."""
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0 if part.fine else 1)
    gmsh.option.setNumber("Mesh.MeshSizeMax", size if part.fine else 1e22)
    if not part.fine:
        return
    field = gmsh.model.mesh.field
    rate = part.growth or growth
    numbers = []
    for finer, distance in part.fine:
        numbers.append(field.add("MathEval"))
        field.setString(numbers[-1], "F", f"{finer!r} + {rate!r} * ({distance})")
    least = field.add("Min")
    field.setNumbers(least, "FieldsList", numbers)
    field.setAsBackgroundMesh(least)


def gathered(
    model: Any,
    part: str,
    volumes: dict[str, list[int]],
    faces: dict[str, list[int]],
    shape: str,
    order: int,
) -> RawMesh:
    """Cells and named facets of the current gmsh model.

    Args:
        model: ``gmsh.model``, meshed.
        part: name of the part.
        volumes: layer name -> volume tags.
        faces: face name -> surface tags.
        shape: kind of cells.
        order: order of the geometry.
    """
    x, number = nodes_of_model(model, sort=True)

    def collect(dim: int, groups: dict[str, list[int]], kind: int) -> tuple[Ints, Ints]:
        found = [np.zeros((0, model.mesh.getElementProperties(kind)[3]), dtype=np.int64)]
        tag = [np.zeros(0, dtype=np.int64)]
        for i, entities in enumerate(groups.values(), 1):
            for entity in entities:
                found.append(elements(model, number, kind, entity))
                tag.append(np.full(len(found[-1]), i))
        return np.concatenate(found), np.concatenate(tag)

    cells, cell_tag = collect(3, volumes, CELL_TYPE[shape, order])
    facets, facet_tag = collect(2, faces, FACET_TYPE[shape, order])
    corners = 3 if shape == "tetrahedron" else 4
    layers, named = (
        {f"{part}.{name}": i for i, name in enumerate(of, 1)} for of in (volumes, faces)
    )
    mesh = RawMesh(x, shape, cells, cell_tag, facets[:, :corners], facet_tag, layers, named)
    # gmsh may leave nodes behind that no cell has; DOLFINx crashes on them.
    return without_unused_nodes(mesh)


def nodes_of_model(model: Any, sort: bool = False) -> tuple[Array, Ints]:
    """Positions of gmsh's nodes, as they come or by their tags, and the place of each tag."""
    tags, x, _ = model.mesh.getNodes()
    order = np.argsort(tags) if sort else np.arange(tags.size)
    place = np.full(int(tags.max(initial=0)) + 1, -1, dtype=np.int64)
    place[tags[order].astype(np.int64)] = np.arange(tags.size)
    return x.reshape(-1, 3)[order], place


def elements(model: Any, place: Ints, kind: int, entity: int) -> Ints:
    """Nodes of the elements of one kind on an entity of gmsh, by the place of their tags."""
    _, nodes = model.mesh.getElementsByType(kind, entity)
    return place[nodes.astype(np.int64)].reshape(-1, model.mesh.getElementProperties(kind)[3])


def discrete_model(gmsh: Any, mesh: RawMesh, facets: Ints) -> Any:
    """A gmsh model that holds a plain mesh, a physical group for each layer and face.

    Args:
        gmsh: the running gmsh module.
        mesh: the mesh.
        facets: all nodes of its named facets.

    Returns:
        ``gmsh.model``.
    """
    model, points = gmsh.model, mesh.points
    model.add("mesh")
    of = mesh.shape, mesh.order
    numbers: AnyArray = np.arange(1, len(points) + 1)
    for dim, names, kind, nodes, tag in (
        (3, mesh.layers, CELL_TYPE[of], mesh.cells, mesh.cell_tag),
        (2, mesh.faces, FACET_TYPE[of], facets, mesh.facet_tag),
    ):
        for name, number in names.items():
            own = nodes[tag == number]
            if len(own) == 0:
                continue
            model.addDiscreteEntity(dim, number)
            # All nodes are on the first entity.
            model.mesh.addNodes(dim, number, numbers, points.reshape(-1))
            numbers, points = numbers[:0], points[:0]
            model.mesh.addElementsByType(number, kind, [], own.reshape(-1) + 1)
            model.addPhysicalGroup(dim, [number], number)
            model.setPhysicalName(dim, number, name)
    return model

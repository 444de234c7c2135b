"""Pictures of meshes and mode shapes, off screen: every body from both sides, side by side.

Bodies that lie on each other hide their contact faces; drawn in a row, lowest first, they show
them. What ties glue together stays together (``bodies``).

VTK draws colours as they are: what the lamps do to them is computed at the points of a surface, of
which there are far fewer than pixels.
"""

from collections.abc import Mapping
from importlib import import_module
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index
from brake_fenicsx.compat import vtk_cells
from brake_fenicsx.folder.processes import release_memory
from brake_fenicsx.meshing.rawmesh import body_of_points

from .style import CYCLE, DPI, WIDTH, house_style, png_of

# What is seen, and the side of the eye along z.
VIEWS = (("seen from z > 0", 1.0), ("seen from z < 0", -1.0))
SHAPE_COLOURS = "viridis"
BORDER = 12  # white pixels around what is drawn
FINE = 2  # pixels are drawn so many times finer and averaged: quicker than multisampling
BAND, FOOT = 0.22, 0.55  # height [in] of a line of text, and of the colour bar
NAMES = 5  # of a legend in a line
WIDE = 1.4  # views of a larger ratio of width and height stand below each other
SCALE = 0.08  # largest displacement as drawn, as a share of the model's radius
DISTANCE = 0.12  # between neighbouring bodies, likewise
EDGE = 0x20 / 255  # grey of sharp edges
SHARP = 40.0  # angle [deg] between faces from which on their edge is drawn
# Lamps of a studio: directions to them (right, up, towards the eye), red, green and blue.
AMBIENT, DIFFUSE = 0.45, 0.65
LAMPS = np.array(
    [(0, 0, 1), (0.112, 0.766, 0.633), (-0.045, -0.966, 0.255), (0.94, 0, -0.34), (-0.94, 0, -0.34)]
)
SHINE = np.array(
    [(0.25,) * 3, (0.75, 0.73, 0.676), (0.227, 0.233, 0.25), (0.214,) * 3, (0.214,) * 3]
)
MILLISECONDS = 90  # a frame of a film is shown


def compose(
    path: Path,
    images: list[Any],
    title: str,
    note: str,
    legend: Mapping[str, str] | None = None,
) -> None:
    """Put both views pixel by pixel under one heading, with the colour bar or the legend."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    width, wide = round(WIDTH * DPI), images[0].width > WIDE * images[0].height
    column = width if wide else width // 2
    lines = FOOT if legend is None else BAND * (1 + ceil(len(legend) / NAMES))
    band, foot = round(BAND * DPI), round(lines * DPI)
    head = band * bool(title)
    rows = [image.height + band for image in images]
    height = head + (sum(rows) if wide else max(rows)) + foot
    places = dict[tuple[int, int], Any]()
    with house_style():
        figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI)
        figure.text(0.5, 1 - 0.5 * band / height, title, ha="center", va="center", fontsize=10)
        for j, (image, (view, _)) in enumerate(zip(images, VIEWS, strict=True)):
            left = 0 if wide else j * column
            top = head + (sum(rows[:j]) if wide else 0)
            text = view + ", bottom body on the left" * wide
            place = (left + 0.5 * column) / width, 1 - (top + 0.5 * band) / height
            figure.text(*place, text, ha="center", va="center", fontsize=8.5, color="#404040")
            places[left + (column - image.width) // 2, top + band] = image
        if legend is None:
            bar = figure.add_axes((0.02, 0.75 * foot / height, 0.96, 0.2 * foot / height))
            colours = ScalarMappable(cmap=SHAPE_COLOURS)
            figure.colorbar(colours, cax=bar, orientation="horizontal")
            bar.set_xlabel(f"displacement relative to its maximum [-]; {note}", fontsize=8)
        else:
            handles = [Patch(color=colour, label=name) for name, colour in legend.items()]
            place = 0.5, 0.5 * foot / height
            columns = min(NAMES, len(handles))
            figure.legend(handles=handles, loc="center", bbox_to_anchor=place, ncol=columns)
        path.write_bytes(png_of(figure, title, places))
    release_memory()


def render_mode(
    path: str | Path, V: Any, values: AnyArray, title: str = "", bodies: AnyArray | None = None
) -> Path:
    """Draw a mode shape: warped, coloured by the displacement's amplitude, bodies in a row.

    A complex mode is drawn at the phase of its largest motion; its colour is the amplitude over the
    whole period.

    Args:
        path: the PNG file.
        V: vector function space of Lagrange elements, on a mesh of this process.
        values: all dofs, real or complex, shape (dofs,).
        title: heading of the picture.
        bodies: number of the body of each node, shape (nodes,); those of the cells if not given.

    Returns:
        The path.
    """
    return Shapes(V, bodies).still(path, values, title)


def render_mesh(
    path: str | Path,
    V: Any,
    parts: AnyArray | None = None,
    names: Mapping[int, str] | None = None,
    title: str = "",
    bodies: AnyArray | None = None,
) -> Path:
    """Draw the mesh with its edges, one colour per part, bodies in a row.

    Args:
        path: the PNG file.
        V: function space of Lagrange elements, on a mesh of this process.
        parts: number of the part of each cell, shape (cells,); one part if not given.
        names: name of each part, for the legend.
        title: heading of the picture.
        bodies: see ``render_mode``.

    Returns:
        The path.
    """
    from matplotlib.colors import to_rgb

    outside, nodes, level = _outside(V, bodies, 0)
    node, faces = _plain(outside, "Polys")
    cell = _arrays().vtk_to_numpy(outside.GetCellData().GetArray("number"))
    given = np.zeros(1 + cell.max(), dtype=int) if parts is None else parts
    found, part = np.unique(given[cell], return_inverse=True)
    colours = [CYCLE[j % len(CYCLE)] for j in range(len(found))]
    paint = np.array([to_rgb(colour) for colour in colours])[part]
    camera, images = Camera(mesh=True), list[Any]()
    for _, side in VIEWS:
        view = view_of(nodes[node], side)
        points = in_a_row(nodes[node], level[node], view, side)
        lit = paint * shade(_normals(points, faces), camera.aim(points, view, side))
        images.append(camera.photograph(points, faces, lit))
    texts = [(names or {}).get(int(j), f"part {j}") for j in found]
    compose(Path(path), images, title, "", dict(zip(texts, colours, strict=True)))
    return Path(path)


class Shapes:
    """Pictures of the mode shapes of one mesh, by one camera.

    Attributes:
        node: of the mesh at each point of the surface; at a sharp edge, points of each side.
        rest: points of the bodies at rest [m], shape (points, 3).
        faces: points of each, shape (faces, 3 or 4).
        ends: points at the ends of sharp edges, two of each.
        level: of each point, see ``in_a_row``.
    """

    def __init__(self, V: Any, bodies: AnyArray | None = None):
        """Find the surface.

        Args:
            V: vector function space of Lagrange elements, on a mesh of this process.
            bodies: see ``render_mode``.
        """
        outside, nodes, level = _outside(V, bodies, 1)
        split, edges = (_vtk("FiltersCore", name)() for name in ("PolyDataNormals", "FeatureEdges"))
        split.ConsistencyOff()
        edges.ManifoldEdgesOff()
        edges.ColoringOff()
        for take in (split, edges):
            take.SetInputData(outside)
            take.SetFeatureAngle(SHARP)
            take.Update()
        self.node, self.faces = _plain(split.GetOutput(), "Polys")
        number, lines = _plain(edges.GetOutput(), "Lines")
        point = np.zeros(len(nodes), dtype=np.intp)
        point[self.node] = np.arange(len(self.node))
        self.ends: Index = point[number[lines.ravel()]]
        self.rest: Array = nodes[self.node]
        self.level: Index = level[self.node]
        self._components: int = V.dofmap.index_map_bs
        n, corners = self.faces.shape
        places = self.faces.ravel(), np.repeat(np.arange(n), corners)
        self._around = csr_matrix((np.ones(n * corners), places), (len(self.node), n))
        self._camera = Camera()

    def still(self, path: str | Path, values: AnyArray, title: str = "") -> Path:
        """Draw a mode as ``render_mode`` does; arguments as there."""
        amplitude, motion = self._motion(values)
        images, moved = list[Any](), self.rest + motion.real
        for _, side in VIEWS:
            view = view_of(moved, side)
            points = in_a_row(moved, self.level, view, side)
            axes = self._camera.aim(points, view, side)
            images.append(self._photograph(points, amplitude, axes))
        moment = ", at the phase of largest motion" if np.iscomplexobj(values) else ""
        note = f"largest displacement drawn as {100 * SCALE:.0f} % of the radius{moment}"
        compose(Path(path), images, title, note)
        return Path(path)

    def film(self, path: str | Path, values: AnyArray, frames: int = 10, width: int = 640) -> Path:
        """Draw one period of a mode, seen from z > 0, bodies in a row, as an animated WebP.

        The first frame shows the phase of the largest motion. Growth and decay are left out.

        Args:
            path: the WebP file.
            values: all dofs, real or complex, shape (dofs,).
            frames: pictures of the period.
            width: of the pictures [pixels].

        Returns:
            The path.
        """
        amplitude, motion = self._motion(values)
        view = view_of(self.rest, 1.0)
        rest = in_a_row(self.rest, self.level, view, 1.0)
        axes = self._camera.aim(rest, view, 1.0, motion, width)
        turns = np.exp(2j * np.pi * np.arange(frames) / frames)
        drawn = (self._photograph(rest + (motion * turn).real, amplitude, axes) for turn in turns)
        first, *images = drawn
        all_of_them = {"save_all": True, "append_images": images, "duration": MILLISECONDS}
        # Method 2 takes half the time of 4, whose quality it has with two more.
        first.save(path, **all_of_them, loop=0, quality=72, method=2)
        return Path(path)

    def _motion(self, values: AnyArray) -> tuple[Array, Complex]:
        """Amplitude of a mode, 1 at its maximum, and displacements as drawn [m], at the points.

        Real parts are those at the phase of the largest motion.
        """
        phase = np.exp(-0.5j * np.angle(np.sum(values.astype(complex) ** 2)))
        u = (values * phase).reshape(-1, self._components)[self.node]
        amplitude = np.linalg.norm(u, axis=1)
        top = max(float(amplitude.max()), 1e-300)
        return amplitude / top, SCALE * _radius(self.rest) / top * u

    def _photograph(self, points: Array, amplitude: Array, axes: Array) -> Any:
        from matplotlib import colormaps

        light = shade(self._around @ _normals(points, self.faces), axes)
        lit = colormaps[SHAPE_COLOURS](amplitude)[:, :3] * light
        return self._camera.photograph(points, self.faces, lit, self.ends)


def _vtk(module: str, name: str) -> Any:
    """A class of VTK, imported when the first picture is drawn."""
    return getattr(import_module(f"vtkmodules.vtk{module}"), f"vtk{name}")


def _arrays() -> Any:
    """VTK's arrays from NumPy's and back."""
    return import_module("vtkmodules.util.numpy_support")


def _points(points: Array) -> Any:
    """Points of VTK."""
    made = _vtk("CommonCore", "Points")()
    made.SetData(_arrays().numpy_to_vtk(points, deep=True))
    return made


def _cells(cells: AnyArray) -> Any:
    """Cells of VTK, all of one number of points."""
    made = _vtk("CommonDataModel", "CellArray")()
    ids = _arrays().numpy_to_vtkIdTypeArray(cells.astype(np.int64).ravel(), deep=True)
    made.SetData(cells.shape[1], ids)
    return made


def _outside(V: Any, bodies: AnyArray | None, parts: int) -> tuple[Any, Array, Index]:
    """Faces that no two cells share, as data of VTK; all nodes [m], and the level of each.

    Args:
        V: function space of Lagrange elements, on a mesh of this process.
        bodies: see ``render_mode``.
        parts: 1 cuts curved faces into flat ones between their nodes, 0 takes their corners.
    """
    cells, types, points = vtk_cells(V)
    grid = _vtk("CommonDataModel", "UnstructuredGrid")()
    grid.SetPoints(_points(points))
    grid.SetCells(int(types[0]), _cells(cells))
    for data, count in ((grid.GetPointData(), len(points)), (grid.GetCellData(), len(cells))):
        number = _arrays().numpy_to_vtk(np.arange(count), deep=True)
        number.SetName("number")
        data.AddArray(number)
    take = _vtk("FiltersGeometry", "DataSetSurfaceFilter")()
    take.SetInputData(grid)
    take.SetNonlinearSubdivisionLevel(parts)
    take.Update()
    body = body_of_points(cells, len(points)) if bodies is None else bodies
    return take.GetOutput(), points, levels(points[:, 2], body)


def _plain(data: Any, kind: str) -> tuple[Index, Index]:
    """Numbers of the points of VTK's data before, and the points of its cells of a kind."""
    found = getattr(data, f"Get{kind}")()
    number = _arrays().vtk_to_numpy(data.GetPointData().GetArray("number"))
    points = _arrays().vtk_to_numpy(found.GetConnectivityArray())
    # A ball has no sharp edge.
    return number, points.reshape(-1, max(found.GetMaxCellSize(), 2))


def levels(z: Array, body: Index) -> Index:
    """Number of the level of every point: bodies at about one height are one level, from below.

    Args:
        z: heights of the points [m].
        body: number of the body of each.
    """
    bodies = np.unique(body)
    middle = np.array([0.5 * (z[body == b].min() + z[body == b].max()) for b in bodies])
    order = np.argsort(middle, kind="stable")
    height = max(float(np.ptp(z)), 1e-300)
    level = np.zeros(len(bodies), dtype=np.intp)
    level[order] = np.concatenate([[0], np.cumsum(np.diff(middle[order]) > 0.05 * height)])
    return level[np.searchsorted(bodies, body)]


def in_a_row(points: Array, level: Index, view: Array, side: float) -> Array:
    """Points of bodies whose levels stand beside each other, the lowest to the left.

    Args:
        points: of the bodies where they are [m], shape (n, 3).
        level: of each point.
        view: direction from the bodies to the eye.
        side: +1 where the eye looks from above, -1 from below.
    """
    right = side * np.array([-view[1], view[0], 0.0]) / np.hypot(*view[:2])
    moved, edge = points.copy(), 0.0
    for j in range(level.max() + 1):
        own = level == j
        box = 0.5 * (points[own].min(axis=0) + points[own].max(axis=0))
        reach = (points[own] - box) @ right
        moved[own] += (edge - reach.min()) * right - box
        edge += np.ptp(reach) + DISTANCE * _radius(points)
    return moved


def view_of(points: Array, side: float) -> Array:
    """Direction to the eye: on the side away from the pads, so that their arcs open towards it."""
    centre = points.mean(axis=0)
    box = 0.5 * (points.min(axis=0) + points.max(axis=0))
    lean = centre - box
    angle = np.arctan2(lean[1], lean[0]) if np.hypot(*lean[:2]) > 1e-3 * _radius(points) else 1.57
    angle += np.pi + 0.35
    return np.array([np.cos(angle), np.sin(angle), 1.1 * side])


def _normals(points: Array, faces: Index) -> Array:
    """Unit normals of faces, shape (faces, 3)."""
    first, second = (points[faces[:, j]] - points[faces[:, 0]] for j in (1, -1))
    normals = np.cross(first, second)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)


def shade(normals: Array, axes: Array) -> Array:
    """Red, green and blue that come from a white surface, at most about 1, shape (n, 3).

    Args:
        normals: of any length, shape (n, 3).
        axes: unit vectors to the right, up and to the eye.
    """
    seen = normals @ axes.T
    length = np.maximum(np.linalg.norm(seen, axis=1), 1e-300)
    seen *= (np.where(seen[:, 2] < 0, -1.0, 1.0) / length)[:, None]
    return AMBIENT + DIFFUSE * np.maximum(seen @ LAMPS.T, 0.0) @ SHINE


class Camera:
    """A window off screen and what it shows, in parallel projection; to open it takes long."""

    def __init__(self, mesh: bool = False):
        """Open the window.

        Args:
            mesh: whether all edges of faces are drawn.
        """
        _vtk("RenderingOpenGL2", "OpenGLRenderWindow")
        log = _vtk("CommonCore", "Logger")
        before = log.GetCurrentVerbosityCutoff()
        log.SetStderrVerbosity(log.VERBOSITY_OFF)
        # Without a display VTK warns, then draws all the same.
        self._window = _vtk("RenderingCore", "RenderWindow")()
        log.SetStderrVerbosity(before)
        self._window.SetOffScreenRendering(1)
        self._window.SetMultiSamples(0)
        self._renderer = _vtk("RenderingCore", "Renderer")()
        self._renderer.SetBackground(1.0, 1.0, 1.0)
        self._window.AddRenderer(self._renderer)
        self._data = _vtk("CommonDataModel", "PolyData")()
        mapper, actor = (_vtk("RenderingCore", name)() for name in ("PolyDataMapper", "Actor"))
        mapper.SetInputData(self._data)
        actor.SetMapper(mapper)
        self._renderer.AddActor(actor)
        actor.GetProperty().LightingOff()
        actor.GetProperty().SetEdgeVisibility(mesh)
        actor.GetProperty().SetEdgeColor(0.0, 0.0, 0.0)
        actor.GetProperty().SetLineWidth(FINE if mesh else 1.5 * FINE)

    def aim(
        self,
        points: Array,
        view: Array,
        side: float,
        motion: AnyArray | None = None,
        width: int = 0,
    ) -> Array:
        """Look at points; the picture has little more pixels than they need: each costs time.

        Args:
            points: what is seen [m], side by side, shape (n, 3).
            view: direction to the eye.
            side: of the eye along z.
            motion: complex displacements as drawn [m], shape (n, 3); None: it is at rest.
            width: of the picture [pixels]; 0: of a page, or of half of it for a view that is not
                wide.

        Returns:
            Unit vectors to the right, up and to the eye.
        """
        radius, toward = _radius(points), view / np.linalg.norm(view)
        right = np.cross([0.0, 0.0, side], toward)
        right /= np.linalg.norm(right)
        axes = np.array([right, np.cross(toward, right), toward])
        seen = points @ axes.T
        away = 0.0 if motion is None else np.abs(motion @ axes.T)
        low, high = (seen - away).min(axis=0), (seen + away).max(axis=0)
        size = (high - low)[:2]
        if not width:
            width = round(WIDTH * DPI) // (1 if size[0] > WIDE * size[1] else 2)
        scale = float(np.min((np.array([width, 2 * width]) - 2 * BORDER) / size))
        pixels = np.ceil(scale * size).astype(int) + 2 * BORDER
        self._window.SetSize(*(FINE * pixels).tolist())
        focus, camera = 0.5 * (low + high) @ axes, self._renderer.GetActiveCamera()
        camera.SetPosition(*(focus + 6 * radius * toward))
        camera.SetFocalPoint(*focus)
        camera.SetViewUp(0.0, 0.0, side)
        camera.ParallelProjectionOn()
        camera.SetParallelScale(0.5 * pixels[1] / scale)
        camera.SetClippingRange(radius, 11 * radius)
        return axes

    def photograph(
        self, points: Array, faces: Index, colours: Array, ends: Index | None = None
    ) -> Any:
        """Picture of faces in colours of theirs or of their points.

        Args:
            points: [m], shape (n, 3).
            faces: points of each, shape (faces, 3 or 4).
            colours: red, green and blue, 1 at most, of each face of a mesh, else of each point.
            ends: points at the ends of lines, two of each.
        """
        if ends is not None:
            self._data.SetLines(_cells(len(points) + np.arange(len(ends)).reshape(-1, 2)))
            points = np.concatenate([points, points[ends]])
            colours = np.concatenate([colours, np.full((len(ends), 3), EDGE)])
        paint = (255 * np.minimum(colours, 1.0) + 0.5).astype(np.uint8)
        self._data.SetPoints(_points(points))
        self._data.SetPolys(_cells(faces))
        data = self._data.GetPointData() if ends is not None else self._data.GetCellData()
        data.SetScalars(_arrays().numpy_to_vtk(paint, deep=True))
        self._window.Render()
        width, height = self._window.GetSize()
        pixels = _vtk("CommonCore", "UnsignedCharArray")()
        self._window.GetPixelData(0, 0, width - 1, height - 1, 0, pixels, 0)
        pillow = import_module("PIL.Image")  # comes with matplotlib
        image = pillow.fromarray(_arrays().vtk_to_numpy(pixels).reshape(height, width, 3))
        return image.reduce(FINE).transpose(pillow.FLIP_TOP_BOTTOM)


def _radius(points: Array) -> float:
    return 0.5 * float(np.linalg.norm(np.ptp(points, axis=0)))

"""Pictures of meshes and mode shapes, off screen: every body from both sides, side by side.

Bodies that lie on each other hide their contact faces; drawn in a row, lowest first, they show
them. What ties glue together stays together (``bodies``).
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.arguments import AnyArray
from brake_fenicsx.compat import vtk_cells
from brake_fenicsx.folder.processes import release_memory
from brake_fenicsx.meshing.rawmesh import body_of_points

from .style import CYCLE, DPI, WIDTH, house_style

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
LIGHT: dict[str, Any] = {"ambient": 0.45, "diffuse": 0.65, "specular": 0.0}
# How a mode shape is coloured.
SHAPE = LIGHT | {"scalars": "amplitude", "cmap": SHAPE_COLOURS, "clim": (0.0, 1.0)}
SHAPE["show_scalar_bar"] = False


def compose(
    path: Path,
    images: list[AnyArray],
    title: str,
    note: str,
    legend: Mapping[str, str] | None = None,
) -> None:
    """Put both views pixel by pixel under one heading, with the colour bar or the legend."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    width, wide = round(WIDTH * DPI), images[0].shape[1] > WIDE * images[0].shape[0]
    column = width if wide else width // 2
    lines = FOOT if legend is None else BAND * (1 + ceil(len(legend) / NAMES))
    band, foot = round(BAND * DPI), round(lines * DPI)
    head = band * bool(title)
    rows = [image.shape[0] + band for image in images]
    height = head + (sum(rows) if wide else max(rows)) + foot
    with house_style():
        figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI)
        figure.text(0.5, 1 - 0.5 * band / height, title, ha="center", va="center", fontsize=10)
        for j, (image, (view, _)) in enumerate(zip(images, VIEWS, strict=True)):
            left = 0 if wide else j * column
            top = height - head - (sum(rows[:j]) if wide else 0)
            text = view + ", bottom body on the left" * wide
            place = (left + 0.5 * column) / width, (top - 0.5 * band) / height
            figure.text(*place, text, ha="center", va="center", fontsize=8.5, color="#404040")
            middle = left + (column - image.shape[1]) // 2
            figure.figimage(image, middle, top - band - image.shape[0])
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
        figure.savefig(
            path, dpi=DPI, facecolor="white", metadata={"Software": None, "Title": title}
        )


def pyvista() -> Any:
    """The drawing library, imported when the first picture is drawn."""
    return import_module("pyvista")


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
    surface, moved = mode_surface(V, values, bodies)
    surface.points = np.asarray(surface.points) + np.real(moved(surface))
    images = _photographs(surface, "amplitude")
    compose(Path(path), images, title, _note(values))
    return Path(path)


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
    grid = _grid(V, parts, bodies)
    surface = grid.extract_surface(nonlinear_subdivision=0, algorithm="dataset_surface")
    surface.point_data["level"] = _levels(surface)
    found = np.unique(surface.cell_data["part"])
    images = _photographs(surface, "part")
    legend = {(names or {}).get(int(j), f"part {j}"): _part_colour(int(j), found) for j in found}
    compose(Path(path), images, title, "", legend)
    return Path(path)


def mode_surface(
    V: Any, values: AnyArray, bodies: AnyArray | None = None
) -> tuple[Any, Callable[[Any], AnyArray]]:
    """Surface of all bodies at rest with the amplitude of a mode, and how it moves.

    Args:
        V: vector function space of Lagrange elements, on a mesh of this process.
        values: all dofs, real or complex, shape (dofs,).
        bodies: see ``render_mode``.

    Returns:
        The surface, with point data ``amplitude``, 1 at its maximum, and ``level``; and a function
        from a mesh made of it to the complex displacements as drawn [m], shape (points, 3), at
        the phase of the largest motion.
    """
    grid = _grid(V, bodies=bodies)
    u = (values * _phase(values)).reshape(-1, V.dofmap.index_map_bs)
    grid.point_data["re"], grid.point_data["im"] = u.real, u.imag
    surface = grid.extract_surface(nonlinear_subdivision=1, algorithm="dataset_surface")
    surface.point_data["level"] = _levels(surface)
    re, im = (np.asarray(surface.point_data[name]) for name in ("re", "im"))
    amplitude = np.sqrt((re**2 + im**2).sum(axis=1))
    top = max(float(amplitude.max()), 1e-300)
    surface.point_data["amplitude"] = amplitude / top
    factor = SCALE * _radius(surface) / top

    def moved(mesh: Any) -> AnyArray:
        re, im = (np.asarray(mesh.point_data[name]) for name in ("re", "im"))
        return factor * (re + 1j * im)

    return surface, moved


def _phase(values: AnyArray) -> complex:
    """Unit factor that turns a complex mode to the phase of its largest real part."""
    return complex(np.exp(-0.5j * np.angle(np.sum(values.astype(complex) ** 2))))


def _grid(V: Any, parts: AnyArray | None = None, bodies: AnyArray | None = None) -> Any:
    """Pyvista grid of the nodes of V, with the number of each point's body and each cell's part."""
    cells, types, points = vtk_cells(V)
    grid = pyvista().UnstructuredGrid({int(types[0]): cells}, points)
    grid.point_data["body"] = body_of_points(cells, len(points)) if bodies is None else bodies
    grid.cell_data["part"] = (
        np.zeros(len(cells), dtype=int) if parts is None else parts[: len(cells)]
    )
    return grid


def _levels(surface: Any) -> AnyArray:
    """Number of the level of every point: bodies at about one height are one level, from below."""
    region = np.asarray(surface.point_data["body"])
    z = np.asarray(surface.points)[:, 2]
    bodies = np.unique(region)
    middle = np.array([0.5 * (z[region == b].min() + z[region == b].max()) for b in bodies])
    order = np.argsort(middle, kind="stable")
    height = max(float(np.ptp(z)), 1e-300)
    level = np.zeros(len(bodies), dtype=int)
    level[order] = np.concatenate([[0], np.cumsum(np.diff(middle[order]) > 0.05 * height)])
    return level[np.searchsorted(bodies, region)]


def in_a_row(surface: Any, view: AnyArray, side: float) -> Any:
    """A copy whose levels stand beside each other as seen along ``view``, the lowest to the left.

    Args:
        surface: the bodies where they are.
        view: direction from the bodies to the eye.
        side: +1 where the eye looks from above, -1 from below.
    """
    points, level = np.asarray(surface.points), np.asarray(surface.point_data["level"])
    right = side * np.array([-view[1], view[0], 0.0]) / np.hypot(*view[:2])
    moved, edge = points.copy(), 0.0
    for j in range(level.max() + 1):
        own = level == j
        box = 0.5 * (points[own].min(axis=0) + points[own].max(axis=0))
        reach = (points[own] - box) @ right
        moved[own] += (edge - reach.min()) * right - box
        edge += np.ptp(reach) + DISTANCE * _radius(surface)
    out = surface.copy()
    out.points = moved
    return out


def _radius(surface: Any) -> float:
    box = np.ptp(np.asarray(surface.points), axis=0)
    return 0.5 * float(np.linalg.norm(box))


def _photographs(surface: Any, scalars: str) -> list[AnyArray]:
    """Both views of a surface, RGB arrays."""
    with pyvista().vtk_verbosity("off"):  # without a display VTK warns, then draws all the same
        return [_photograph(surface, side, scalars) for _, side in VIEWS]


def _photograph(surface: Any, side: float, scalars: str) -> AnyArray:
    """Picture of a surface from obliquely above (side = 1) or below (side = -1), RGB array."""
    view = view_of(surface, side)
    surface = in_a_row(surface, view, side)
    plotter = open_plotter(surface, view, side)
    if scalars == "part":
        found = np.unique(surface.cell_data["part"])
        for j in found:
            piece = surface.extract_cells(np.flatnonzero(surface.cell_data["part"] == j))
            plotter.add_mesh(
                piece, color=_part_colour(int(j), found), show_edges=True, line_width=FINE, **LIGHT
            )
    else:
        plotter.add_mesh(surface, smooth_shading=True, split_sharp_edges=True, **SHAPE)
        add_edges(plotter, surface)
    image = _screenshot(plotter)
    plotter.close()
    release_memory()
    return image


def _screenshot(plotter: Any) -> AnyArray:
    """What a plotter shows, RGB array."""
    pillow = import_module("PIL.Image")  # comes with matplotlib
    return np.asarray(pillow.fromarray(plotter.screenshot(return_img=True)).reduce(FINE))


def add_edges(plotter: Any, surface: Any) -> Any:
    """Draw the edges of a surface; returns them."""
    edges = surface.extract_feature_edges(40.0, manifold_edges=False)
    if edges.n_points:
        plotter.add_mesh(edges, color="#202020", line_width=1.5 * FINE)
    return edges


def open_plotter(
    surface: Any, view: AnyArray, side: float, motion: AnyArray | None = None, width: int = 0
) -> Any:
    """A plotter without a window that looks at a surface in parallel projection.

    Its picture has little more pixels than the surface: each costs time.

    Args:
        surface: what is seen, side by side.
        view: direction to the eye.
        side: of the eye along z.
        motion: complex displacements as drawn [m], shape (points, 3); None: it is at rest.
        width: of the picture [pixels]; 0: of a page, or of half of it for a view that is not wide.
    """
    radius, toward = _radius(surface), view / np.linalg.norm(view)
    right = np.cross([0.0, 0.0, side], toward)
    right /= np.linalg.norm(right)
    axes = np.array([right, np.cross(toward, right), toward])
    seen = np.asarray(surface.points) @ axes.T
    away = 0.0 if motion is None else np.abs(motion @ axes.T)
    low, high = (seen - away).min(axis=0), (seen + away).max(axis=0)
    size = (high - low)[:2]
    if not width:
        width = round(WIDTH * DPI) // (1 if size[0] > WIDE * size[1] else 2)
    scale = float(np.min((np.array([width, 2 * width]) - 2 * BORDER) / size))
    window = np.ceil(scale * size).astype(int) + 2 * BORDER
    plotter = pyvista().Plotter(off_screen=True, window_size=(FINE * window).tolist())
    plotter.disable_anti_aliasing()
    plotter.set_background("white")
    focus = 0.5 * (low + high) @ axes
    plotter.camera_position = [tuple(focus + 6 * radius * toward), tuple(focus), (0.0, 0.0, side)]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = 0.5 * window[1] / scale
    plotter.camera.clipping_range = (radius, 11 * radius)
    return plotter


def view_of(surface: Any, side: float) -> AnyArray:
    """Direction to the eye: on the side away from the pads, so that their arcs open towards it."""
    points = np.asarray(surface.points)
    centre = points.mean(axis=0)
    box = 0.5 * (points.min(axis=0) + points.max(axis=0))
    lean = centre - box
    angle = np.arctan2(lean[1], lean[0]) if np.hypot(*lean[:2]) > 1e-3 * _radius(surface) else 1.57
    angle += np.pi + 0.35
    return np.array([np.cos(angle), np.sin(angle), 1.1 * side])


def _part_colour(part: int, found: AnyArray) -> str:
    return CYCLE[int(np.searchsorted(found, part)) % len(CYCLE)]


def _note(values: AnyArray) -> str:
    moment = ", at the phase of largest motion" if np.iscomplexobj(values) else ""
    return f"largest displacement drawn as {100 * SCALE:.0f} % of the radius{moment}"


MILLISECONDS = 90  # a frame is shown


def animate_mode(
    path: str | Path,
    V: Any,
    values: AnyArray,
    frames: int = 10,
    width: int = 640,
    bodies: AnyArray | None = None,
) -> Path:
    """Draw one period of a mode, seen from z > 0, bodies in a row, as an animated WebP.

    The first frame shows the phase of the largest motion. Growth and decay are left out.

    Args:
        path: the WebP file.
        V: vector function space of Lagrange elements, on a mesh of this process.
        values: all dofs, real or complex, shape (dofs,).
        frames: pictures of the period.
        width: of the pictures [pixels].
        bodies: see ``render_mode``.

    Returns:
        The path.
    """
    pillow = import_module("PIL.Image")  # comes with matplotlib
    with pyvista().vtk_verbosity("off"):
        images = [pillow.fromarray(i) for i in _frames(V, values, frames, width, bodies)]
    all_of_them = {"save_all": True, "append_images": images[1:], "duration": MILLISECONDS}
    images[0].save(path, **all_of_them, loop=0, quality=70, method=4)
    return Path(path)


def _frames(
    V: Any, values: AnyArray, frames: int, width: int, bodies: AnyArray | None
) -> list[AnyArray]:
    """RGB pictures of one period, all from one plotter."""
    surface, moved = mode_surface(V, values, bodies)
    surface = surface.compute_normals(
        cell_normals=False, split_vertices=True, feature_angle=40.0, auto_orient_normals=False
    )
    view = view_of(surface, 1.0)
    placed = in_a_row(surface, view, 1.0)
    plotter = open_plotter(placed, view, 1.0, moved(placed), width)
    plotter.add_mesh(placed, smooth_shading=True, **SHAPE)
    drawn_meshes = placed, add_edges(plotter, placed)
    meshes = [(mesh, np.array(mesh.points), moved(mesh)) for mesh in drawn_meshes]
    drawn = []
    for theta in 2 * np.pi * np.arange(frames) / frames:
        for mesh, rest, motion in meshes:
            mesh.points = rest + np.real(motion * np.exp(1j * theta))
        plotter.render()
        drawn.append(_screenshot(plotter))
    plotter.close()
    return drawn

"""Pictures of meshes and mode shapes, off screen: every body from both sides, side by side.

Bodies that lie on each other hide their contact faces; drawn in a row, lowest first, they show
them. What ties glue together stays together (``bodies``).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.compat import vtk_cells
from brake_fenicsx.folder.processes import release_memory
from brake_fenicsx.meshing.rawmesh import body_of_points

from .style import CYCLE, house_style

# What is seen, and the side of the eye along z.
VIEWS = (("seen from z > 0", 1.0), ("seen from z < 0", -1.0))
SHAPE_COLOURS = "viridis"
PIXELS = (1000, 600)
SCALE = 0.08  # largest displacement as drawn, as a share of the model's radius
DISTANCE = 0.12  # between neighbouring bodies, likewise
MARGIN = 0.1  # of the model's radius around a surface: what moves stays in the picture
LIGHT: dict[str, Any] = {"ambient": 0.45, "diffuse": 0.65, "specular": 0.0}
SHAPE = {  # how a mode shape is coloured
    "scalars": "amplitude", "cmap": SHAPE_COLOURS, "clim": (0.0, 1.0), "show_scalar_bar": False,
    **LIGHT,
}  # fmt: skip


def trim(images: list[NDArray], margin: int = 12) -> list[NDArray]:
    """RGB pictures on one size about their middles, without the border that is white in all."""
    frame = np.max([image.shape for image in images], axis=0)
    before = [(frame - image.shape) // 2 for image in images]
    images = [
        np.pad(image, np.transpose([b, frame - image.shape - b]), constant_values=255)
        for image, b in zip(images, before, strict=True)
    ]
    ink = np.any([(image < 250).any(axis=2) for image in images], axis=0)
    marked = np.argwhere(ink)
    if marked.size == 0:
        return images
    (top, left), (bottom, right) = marked.min(axis=0), marked.max(axis=0)
    rows = slice(max(top - margin, 0), bottom + margin)
    columns = slice(max(left - margin, 0), right + margin)
    return [image[rows, columns] for image in images]


def compose(
    path: Path,
    images: list[NDArray],
    title: str,
    note: str,
    legend: Mapping[str, str] | None = None,
) -> None:
    """Put both views side by side under one heading, with the colour bar or the legend."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    with house_style():
        height, width = images[0].shape[:2]
        wide = width > 1.4 * height
        rows, columns = (2, 1) if wide else (1, 2)
        tall = 7.2 / columns * height / width * rows
        figure = Figure(figsize=(7.2, tall + 1.2), layout="constrained")
        ratios = [1.0] * rows + [0.16 * rows / tall]
        grid = figure.add_gridspec(rows + 1, columns, height_ratios=ratios)
        for j, (image, (view, _)) in enumerate(zip(images, VIEWS, strict=True)):
            axis = figure.add_subplot(grid[j, 0] if wide else grid[0, j])
            axis.imshow(image, interpolation="antialiased")
            order = ", bottom body on the left" if wide else ""
            axis.set_title(view + order, loc="center", fontsize=8.5, color="#404040")
            axis.set_axis_off()
            axis.set(xticks=(), yticks=())  # the layout would measure them
        foot = figure.add_subplot(grid[rows, :])
        if title:
            figure.suptitle(title, fontsize=10)
        if legend is None:
            colours = ScalarMappable(cmap=SHAPE_COLOURS)
            bar = figure.colorbar(colours, cax=foot, orientation="horizontal")
            bar.set_label(f"displacement relative to its maximum [-]; {note}", fontsize=8)
        else:
            foot.axis("off")
            handles = [Patch(color=colour, label=name) for name, colour in legend.items()]
            foot.legend(handles=handles, loc="center", ncol=min(5, len(handles)))
        figure.savefig(
            path, dpi=200, facecolor="white", metadata={"Software": None, "Title": title}
        )


def pyvista() -> Any:
    """The drawing library, imported when the first picture is drawn."""
    return import_module("pyvista")


def render_mode(
    path: str | Path, V: Any, values: NDArray, title: str = "", bodies: NDArray | None = None
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
    parts: NDArray | None = None,
    names: Mapping[int, str] | None = None,
    title: str = "",
    bodies: NDArray | None = None,
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
    V: Any, values: NDArray, bodies: NDArray | None = None
) -> tuple[Any, Callable[[Any], NDArray]]:
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

    def moved(mesh: Any) -> NDArray:
        re, im = (np.asarray(mesh.point_data[name]) for name in ("re", "im"))
        return factor * (re + 1j * im)

    return surface, moved


def _phase(values: NDArray) -> complex:
    """Unit factor that turns a complex mode to the phase of its largest real part."""
    return complex(np.exp(-0.5j * np.angle(np.sum(values.astype(complex) ** 2))))


def _grid(V: Any, parts: NDArray | None = None, bodies: NDArray | None = None) -> Any:
    """Pyvista grid of the nodes of V, with the number of each point's body and each cell's part."""
    cells, types, points = vtk_cells(V)
    grid = pyvista().UnstructuredGrid({int(types[0]): cells}, points)
    grid.point_data["body"] = body_of_points(cells, len(points)) if bodies is None else bodies
    grid.cell_data["part"] = (
        np.zeros(len(cells), dtype=int) if parts is None else parts[: len(cells)]
    )
    return grid


def _levels(surface: Any) -> NDArray:
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


def in_a_row(surface: Any, view: NDArray, side: float) -> Any:
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


def _photographs(surface: Any, scalars: str) -> list[NDArray]:
    """Both views of a surface, cut to the same frame, RGB arrays."""
    with pyvista().vtk_verbosity("off"):  # without a display VTK warns, then draws all the same
        return trim([_photograph(surface, side, scalars) for _, side in VIEWS])


def _photograph(surface: Any, side: float, scalars: str) -> NDArray:
    """Picture of a surface from obliquely above (side = 1) or below (side = -1), RGB array."""
    view = view_of(surface, side)
    surface = in_a_row(surface, view, side)
    plotter = open_plotter(surface, view, side, PIXELS)
    if scalars == "part":
        found = np.unique(surface.cell_data["part"])
        for j in found:
            piece = surface.extract_cells(np.flatnonzero(surface.cell_data["part"] == j))
            plotter.add_mesh(
                piece, color=_part_colour(int(j), found), show_edges=True, line_width=1, **LIGHT
            )
    else:
        plotter.add_mesh(surface, smooth_shading=True, split_sharp_edges=True, **SHAPE)
        add_edges(plotter, surface)
    plotter.enable_anti_aliasing("ssaa")
    image = np.asarray(plotter.screenshot(return_img=True))
    plotter.close()
    release_memory()
    return image


def add_edges(plotter: Any, surface: Any) -> Any:
    """Draw the edges of a surface; returns them."""
    edges = surface.extract_feature_edges(40.0, manifold_edges=False)
    if edges.n_points:
        plotter.add_mesh(edges, color="#202020", line_width=1.5)
    return edges


def open_plotter(surface: Any, view: NDArray, side: float, pixels: tuple[int, int]) -> Any:
    """A plotter without a window that looks at a surface in parallel projection.

    Its picture has these pixels at most, and little more than the surface: each costs time.
    """
    radius, toward = _radius(surface), view / np.linalg.norm(view)
    right = np.cross([0.0, 0.0, side], toward)
    right /= np.linalg.norm(right)
    axes = np.array([right, np.cross(toward, right), toward])
    seen = np.asarray(surface.points) @ axes.T
    size = np.ptp(seen, axis=0)[:2] + 2 * MARGIN * radius
    scale = float(np.min(np.array(pixels) / size))
    window = np.ceil(scale * size).astype(int)
    plotter = pyvista().Plotter(off_screen=True, window_size=window.tolist())
    plotter.set_background("white")
    focus = 0.5 * (seen.min(axis=0) + seen.max(axis=0)) @ axes
    plotter.camera_position = [tuple(focus + 6 * radius * toward), tuple(focus), (0.0, 0.0, side)]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = 0.5 * window[1] / scale
    plotter.camera.clipping_range = (radius, 11 * radius)
    return plotter


def view_of(surface: Any, side: float) -> NDArray:
    """Direction to the eye: on the side away from the pads, so that their arcs open towards it."""
    points = np.asarray(surface.points)
    centre = points.mean(axis=0)
    box = 0.5 * (points.min(axis=0) + points.max(axis=0))
    lean = centre - box
    angle = np.arctan2(lean[1], lean[0]) if np.hypot(*lean[:2]) > 1e-3 * _radius(surface) else 1.57
    angle += np.pi + 0.35
    return np.array([np.cos(angle), np.sin(angle), 1.1 * side])


def _part_colour(part: int, found: NDArray) -> str:
    return CYCLE[int(np.searchsorted(found, part)) % len(CYCLE)]


def _note(values: NDArray) -> str:
    moment = ", at the phase of largest motion" if np.iscomplexobj(values) else ""
    return f"largest displacement drawn as {100 * SCALE:.0f} % of the radius{moment}"


MOVING_PIXELS = (800, 600)
MILLISECONDS = 90  # a frame is shown


def animate_mode(
    path: str | Path,
    V: Any,
    values: NDArray,
    frames: int = 10,
    width: int = 640,
    bodies: NDArray | None = None,
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
        drawn = trim(_frames(V, values, frames, bodies))
    height, wide = drawn[0].shape[:2]
    size = width, max(1, round(width * height / wide))
    images = [pillow.fromarray(image).resize(size, pillow.LANCZOS) for image in drawn]
    images[0].save(
        path, save_all=True, append_images=images[1:], duration=MILLISECONDS, loop=0, quality=70,
        method=4,
    )  # fmt: skip
    return Path(path)


def _frames(V: Any, values: NDArray, frames: int, bodies: NDArray | None) -> list[NDArray]:
    """RGB pictures of one period, all from one plotter."""
    surface, moved = mode_surface(V, values, bodies)
    surface = surface.compute_normals(
        cell_normals=False, split_vertices=True, feature_angle=40.0, auto_orient_normals=False
    )
    view = view_of(surface, 1.0)
    placed = in_a_row(surface, view, 1.0)
    plotter = open_plotter(placed, view, 1.0, MOVING_PIXELS)
    plotter.add_mesh(placed, smooth_shading=True, **SHAPE)
    drawn_meshes = placed, add_edges(plotter, placed)
    meshes = [(mesh, np.array(mesh.points), moved(mesh)) for mesh in drawn_meshes]
    drawn = []
    for theta in 2 * np.pi * np.arange(frames) / frames:
        for mesh, rest, motion in meshes:
            mesh.points = rest + np.real(motion * np.exp(1j * theta))
        plotter.render()
        drawn.append(np.asarray(plotter.screenshot(return_img=True)))
    plotter.close()
    return drawn

"""Animated pictures of mode shapes: one period as an animated WebP, drawn off screen."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .render import (
    SHAPE,
    add_edges,
    in_a_row,
    mode_surface,
    open_plotter,
    pyvista,
    trim,
    view_of,
)

PIXELS = (560, 420)
MILLISECONDS = 90  # a frame is shown


def animate_mode(
    path: str | Path,
    V: Any,
    values: NDArray,
    frames: int = 10,
    width: int = 420,
) -> Path:
    """Draw one period of a mode, seen from z > 0, bodies in a row, as an animated WebP.

    The first frame shows the phase of the largest motion. Growth and decay are left out.

    Args:
        path: the WebP file.
        V: vector function space of Lagrange elements, on a mesh of this process.
        values: all dofs, real or complex, shape (dofs,).
        frames: pictures of the period.
        width: of the pictures [pixels].

    Returns:
        The path.
    """
    pillow = import_module("PIL.Image")  # comes with matplotlib
    with pyvista().vtk_verbosity("off"):
        drawn = trim(_frames(V, values, frames))
    height, wide = drawn[0].shape[:2]
    size = width, max(1, round(width * height / wide))
    images = [pillow.fromarray(image).resize(size, pillow.LANCZOS) for image in drawn]
    images[0].save(
        path, save_all=True, append_images=images[1:], duration=MILLISECONDS, loop=0, quality=70,
        method=4,
    )  # fmt: skip
    return Path(path)


def _frames(V: Any, values: NDArray, frames: int) -> list[NDArray]:
    """RGB pictures of one period, all from one plotter."""
    surface, moved = mode_surface(V, values)
    surface = surface.compute_normals(
        cell_normals=False, split_vertices=True, feature_angle=40.0, auto_orient_normals=False
    )
    view = view_of(surface, 1.0)
    placed = in_a_row(surface, view, 1.0)
    plotter = open_plotter(placed, view, 1.0, PIXELS)
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

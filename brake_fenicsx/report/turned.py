"""A mode shape that one turns with the mouse: a scene of vtk.js, by the library trame-vtk.

The viewer of the library is one HTML file. A page holds it once, compressed, with the scene beside
it, and loads nothing from a network.
"""

from __future__ import annotations

import gzip
import io
import json
import re
import zipfile
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

TRIANGLES = 25_000  # of a scene, so that it adds a megabyte to a page at most; more are thinned out
APART = 0.35  # distance by which levels of bodies are drawn apart, as a share of the model's radius
ICONS = b"https://kitware.github.io/vtk-js/icon/"  # of the tab, which the viewer would load


def can_turn() -> bool:
    """Whether the library is there."""
    return find_spec("trame_vtk") is not None


def write_scene(path: Path, V: Any, values: NDArray) -> Path:
    """Write a mode shape as a scene of vtk.js, bodies apart along z so that faces show.

    Args:
        path: the file, ``.vtksz``.
        V: vector function space of Lagrange elements, on a mesh of this process.
        values: all dofs, real or complex, shape (dofs,).

    Returns:
        The path.
    """
    from .render import SHAPE, mode_surface, open_plotter, pyvista, view_of

    surface, moved = mode_surface(V, values)
    points = np.asarray(surface.points) + np.real(moved(surface))
    radius = 0.5 * float(np.linalg.norm(np.ptp(points, axis=0)))
    points[:, 2] += APART * radius * np.asarray(surface.point_data["level"])
    amplitude = np.asarray(surface.point_data["amplitude"], np.float32)
    surface.points = points.astype(np.float32)
    surface.clear_data()
    surface.point_data["amplitude"] = amplitude
    surface = surface.triangulate()
    if surface.n_cells > TRIANGLES:
        surface = surface.decimate_pro(1 - TRIANGLES / surface.n_cells, preserve_topology=True)
    with pyvista().vtk_verbosity("off"):
        plotter = open_plotter(surface, view_of(surface, 1.0), 1.0, (400, 300))
        plotter.add_mesh(surface, **SHAPE)
        plotter.reset_camera()
        plotter.show(auto_close=False)
        path.write_bytes(_packed(plotter.render_window))
        plotter.close()
    return path


def _packed(window: Any) -> bytes:
    """What the viewer reads: the scene, and its arrays by their hashes."""
    vtk: Any = import_module("trame_vtk.modules.vtk.serializers")
    vtk.initialize_serializers()
    context = vtk.SynchronizationContext()
    scene = vtk.serialize(None, window, vtk.reference_id(window), context, 0)
    arrays = {
        entry["hash"]: {**entry, "content": context.get_cached_data_array(entry["hash"], False)}
        for entry in vtk.extract_array_hash(scene)
    }
    # The library names objects by their addresses: numbers make the bytes the same every time.
    text = re.sub(r'"mtime": \d+', '"mtime": 0', json.dumps({"hashes": arrays, "scene": scene}))
    for number, name in enumerate(dict.fromkeys(re.findall(r'"id": "([0-9a-f]{16})"', text))):
        text = text.replace(name, f"{number:016x}")
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr(zipfile.ZipInfo("index.json"), text, zipfile.ZIP_DEFLATED)
    return data.getvalue()


def viewer() -> bytes:
    """The HTML file of the viewer, compressed by gzip."""
    path: Path = import_module("trame_vtk.tools.vtksz2html").HTML_VIEWER_PATH
    return gzip.compress(path.read_bytes().replace(ICONS, b"data:,"), mtime=0)

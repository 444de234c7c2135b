"""Two photographs of a body to one picture: the same frame, a heading, a colour bar or a legend."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .style import house_style

# What is seen, and the side of the eye along z.
VIEWS = (("seen from z > 0", 1.0), ("seen from z < 0", -1.0))
SHAPE_COLOURS = "viridis"


def trim(images: list[NDArray], margin: int = 12) -> list[NDArray]:
    """Cut the border that is white in all RGB pictures."""
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
            axis.axis("off")
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


def heading_of(path: Path) -> str:
    """The heading drawn in a picture, or the name of its file."""
    pillow: Any = import_module("PIL.Image")  # comes with matplotlib
    with pillow.open(path) as drawn:
        return str(drawn.info.get("Title", path.stem.replace("_", " ")))

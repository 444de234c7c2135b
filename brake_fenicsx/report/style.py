"""One look for all figures: Okabe-Ito colours, print sizes, no global plotting state."""

from __future__ import annotations

import gc
import io
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from brake_fenicsx.arguments import AnyArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure

    from brake_fenicsx.results.run import RunData

# Okabe and Ito: told apart with any colour vision, and by their grey value in print.
BLACK, GREY = "#000000", "#8a8a8a"
BLUE, SKY, GREEN = "#0072B2", "#56B4E9", "#009E73"
ORANGE, VERMILION, PURPLE, YELLOW = "#E69F00", "#D55E00", "#CC79A7", "#F0E442"
CYCLE = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION, BLACK)
MARKERS = ("o", "s", "^", "D", "v", "P", "X")

APPROACH_LOOK = {
    "classical": (BLUE, "o"),
    "parametric": (ORANGE, "s"),
    "multi-scale": (GREEN, "^"),
    "joint": (PURPLE, "D"),
}
APPROACH_LINE = {"classical": ":", "parametric": "--", "multi-scale": "-", "joint": "-."}
HEIGHTS, PRESSURE = "cividis", "viridis"
DAMPING_LABEL = r"damping $-2\,\alpha/|\omega|$ [-]"
LINEAR_DAMPING = 1e-4  # below it an axis of damping is linear
KHZ = "frequency [kHz]"
WIDTH = 7.2  # [in] of a full page
DPI = 200  # of pictures
LEVEL = 4  # of the compression of a PNG

_PARAMETERS = {
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # looked for among the ticks above the axes otherwise: there are none
    "axes.labelsize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.axisbelow": True,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "mathtext.fontset": "dejavusans",
    "svg.hashsalt": "brake_fenicsx",
    "figure.dpi": DPI,
}


@contextmanager
def house_style() -> Iterator[None]:
    """Apply the look inside the block and leave matplotlib's settings as they were.

    What is not set here has matplotlib's own defaults, whatever the account's matplotlibrc says.
    """
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_PARAMETERS)
        gc.freeze()  # the collector would look at all that the program holds, at every figure
        try:
            yield
        finally:
            gc.unfreeze()


def new_figure(
    rows: int = 1, columns: int = 1, height: float = 3.4, width: float = WIDTH, **keys: Any
) -> tuple[Figure, Any]:
    """Make a figure without pyplot, so that nothing stays behind.

    Args:
        rows: rows of axes.
        columns: columns of axes.
        height: height [in].
        width: width [in].
        **keys: passed to ``Figure.subplots``.

    Returns:
        The figure and its axes, an array of shape (rows, columns).
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **keys)


def save(figure: Figure, directory: Path, name: str) -> list[Path]:
    """Write a figure as PNG (200 dpi) and SVG, the same bytes for the same data.

    Args:
        figure: the figure.
        directory: existing folder.
        name: file name without suffix.

    Returns:
        The two paths.
    """
    png, svg = directory / f"{name}.png", directory / f"{name}.svg"
    figure.set(dpi=DPI, facecolor="white")
    png.write_bytes(png_of(figure))
    # The places found stand for both files: to find them takes as long as to draw.
    figure.set_layout_engine(None)
    figure.savefig(svg, dpi=DPI, facecolor="white", metadata={"Date": None, "Creator": None})
    return [png, svg]


def png_of(
    figure: Figure, title: str = "", images: Mapping[tuple[int, int], Any] = MappingProxyType({})
) -> bytes:
    """Content of the PNG of a figure.

    Args:
        figure: the figure.
        title: what the file says of itself.
        images: pictures by the column and the row of their upper left corner.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image, PngImagePlugin

    # One canvas for layout and drawing, which then share the sizes of all texts; `savefig` takes
    # others, and draws the whole figure to no file before it looks for the places.
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    sheet = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    for place, image in images.items():
        sheet.paste(image, place)
    data, said = io.BytesIO(), PngImagePlugin.PngInfo()
    if title:
        said.add_text("Title", title)
    # Without the opaque fourth channel a file is smaller at half the time of the usual level 6.
    how: dict[str, Any] = {"dpi": (figure.dpi,) * 2, "pnginfo": said, "compress_level": LEVEL}
    sheet.save(data, "png", **how)
    return data.getvalue()


def drawn(draw: Callable[[], Figure]) -> bytes:
    """Content of the PNG of a figure that is made in the look of all figures.

    Args:
        draw: makes the figure.
    """
    with house_style():
        return png_of(draw())


def look(approach: str) -> tuple[str, str]:
    """Colour and marker of an approach, the same in every figure."""
    if approach in APPROACH_LOOK:
        return APPROACH_LOOK[approach]
    j = sum(map(ord, approach)) % 3 + 4
    return CYCLE[j], MARKERS[j]


def stroke(approach: str) -> str:
    """Line style of an approach, so that lines can be told apart without colours."""
    return APPROACH_LINE.get(approach, "-")


def label(run: RunData, approach: str) -> str:
    """Name of an approach as a figure shows it."""
    return run.label(approach).replace("$", r"\$")


def draw_field(
    axes: Axes, values: AnyArray, size: AnyArray, colours: Any, missing: str, **scale: Any
) -> Any:
    """Values over a surface as an image, x to the right.

    Args:
        axes: of the panel.
        values: shape (nx, ny); nan where there is none.
        size: sides of the surface [mm].
        colours: Matplotlib's colour map.
        missing: colour of what there is no value for.
        **scale: ``norm``, or ``vmin`` and ``vmax``.
    """
    colours = colours.copy()
    colours.set_bad(missing)
    extent = (0, float(size[0]), 0, float(size[1]))
    image = axes.imshow(
        values.T, origin="lower", extent=extent, cmap=colours, interpolation="nearest", **scale
    )
    axes.set(xlabel="x [mm]", ylabel="y [mm]")
    axes.spines[["top", "right"]].set_visible(True)
    return image


def panel(axes: Axes, letter: str, title: str) -> None:
    """Head a panel with its letter and a short title."""
    axes.set_title(f"({letter}) {title}")


def finish(axes: Axes, grid: Literal["both", "x", "y"] = "both", **keys: Any) -> None:
    """Title, labels, scales and limits of a panel as ``Axes.set`` takes them, and a light grid."""
    axes.set(**keys)
    light_grid(axes, axis=grid)


def damping_axis(axes: Axes, **keys: Any) -> None:
    """An axis of damping, linear about zero and logarithmic beyond: flutter spans decades."""
    axes.set_yscale("symlog", linthresh=LINEAR_DAMPING, linscale=0.6)
    axes.set(**keys)


def light_grid(axes: Axes, **keys: Any) -> None:
    """Draw a grid that stays behind the data in print."""
    axes.grid(color="#dddddd", linewidth=0.5, **keys)

"""Maps of heights: the scan or several, and an artificial surface beside it (Figures 4 and 6)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.results.run import Arrays, RunData, scan_heights

from .style import (
    BLUE,
    HEIGHTS,
    ORANGE,
    VERMILION,
    WIDTH,
    light_grid,
    new_figure,
    panel,
)
from .surface_figures import MM, PSD_LABEL, Q_LABEL, UM, compare, surface_statistics

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_MAPS, MAPS_IN_A_ROW = 9, 3  # of several scans


def draw_topography(run: RunData) -> Figure | None:
    """Figure 4: the levelled scan with its missing points, and two profiles through its centre.

    Of several scans the maps.
    """
    if run.surface is None or "heights" not in run.surface:
        return None
    z, size = run.surface["heights"] * UM, run.surface["size"] * MM
    if z.ndim > 2:
        return _maps(z, size, run.surface)
    figure, axes = new_figure(1, 2, height=3.3, gridspec_kw={"width_ratios": [1.25, 1]})
    image = _map(axes[0, 0], z, size, _height_limits(z))
    lost = int(np.isnan(z).sum())
    what = (
        f"{lost} of {z.size} points missing or masked (red)"
        if lost
        else f"all {z.size} points valid"
    )
    panel(axes[0, 0], "a", f"levelled scan, {z.shape[0]} x {z.shape[1]},\n{what}")
    figure.colorbar(image, ax=axes[0, 0], label="height [µm]", shrink=0.9)
    x = (np.arange(z.shape[0]) + 0.5) * size[0] / z.shape[0]
    y = (np.arange(z.shape[1]) + 0.5) * size[1] / z.shape[1]
    axes[0, 1].plot(x, z[:, z.shape[1] // 2], color=BLUE, lw=0.9, label="along x, mid y")
    axes[0, 1].plot(y, z[z.shape[0] // 2], color=ORANGE, lw=0.9, ls="--", label="along y, mid x")
    axes[0, 1].set(xlabel="position [mm]", ylabel="height [µm]")
    axes[0, 1].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1)
    light_grid(axes[0, 1])
    axes[0, 1].set_title("(b) profiles through the centre", pad=32)
    return figure


def topography_caption(run: RunData) -> str:
    """Caption of figure 4."""
    several = run.surface is not None and len(scan_heights(run.surface)) > 1
    one = "Levelled scan of the pad surface [µm], and profiles through its centre."
    shown = "Levelled scans of the pad surface [µm] at one scale of heights." if several else one
    return f"{shown} Red: points that are missing or masked."


def _maps(scans: NDArray, size: NDArray, surface: Arrays) -> Figure:
    """Maps of several scans [um], shape (scans, nx, ny), at one scale of heights."""
    shown = scans[:MOST_MAPS]
    columns = min(len(shown), MAPS_IN_A_ROW)
    rows = -(-len(shown) // columns)
    ratio = float(size[1] / size[0])
    height = min(max(rows * (0.95 + WIDTH / columns * 0.65 * ratio), 2.4), 9.5)
    figure, axes = new_figure(rows, columns, height=height)
    limits = _height_limits(shown)
    files = [str(scan["file"]) for scan in surface_statistics(surface).get("scans", [])]
    for k, axis in enumerate(axes.ravel()):
        if k >= len(shown):
            axis.set_visible(False)
            continue
        image = _map(axis, shown[k], size, limits)
        name = f"scan {k + 1}" + (f": {_short(files[k])}" if files else "")
        lost = int(np.isnan(shown[k]).sum())
        axis.set_title(f"{name}\n{f'{lost} points missing' if lost else 'all valid'}", fontsize=8)
    figure.colorbar(image, ax=list(axes.ravel()), label="height [µm]", shrink=0.9)
    if len(shown) < len(scans):
        figure.suptitle(f"the first {len(shown)} of {len(scans)} scans", fontsize=9)
    return figure


def _short(name: str, most: int = 14) -> str:
    """Beginning and end of a long name of a file, for a title."""
    half = most // 2
    name = name if len(name) <= most else f"{name[:half]}...{name[-half:]}"
    return name.replace("$", r"\$")


def draw_artificial(run: RunData) -> Figure | None:
    """Figure 6: an artificial surface beside the scan, with the heights and spectrum it reached."""
    if run.surface is None or "artificial" not in run.surface:
        return None
    s = run.surface
    shown = [("artificial surface", s["artificial"] * UM, s["artificial_size"])]
    scans = scan_heights(s)
    if len(scans):
        name = "scan" if len(scans) == 1 else f"scan 1 of {len(scans)}"
        shown = [(name, scans[0] * UM, s["size"]), *shown]
    figure, axes = new_figure(2, 2, height=6.2, gridspec_kw={"height_ratios": [1.15, 1]})
    for axis in axes[0, len(shown) :]:
        axis.set_visible(False)
    limits = _height_limits(np.concatenate([z.ravel() for _, z, _ in shown]))
    side = float(max(size.max() for _, _, size in shown)) * MM
    for j, (name, z, size) in enumerate(shown):
        image = _map(axes[0, j], z, size * MM, limits)
        axes[0, j].set(xlim=(0, side), ylim=(0, side))
        spread = f"$S_q$ = {np.nanstd(z):.1f} µm"
        panel(axes[0, j], "ab"[j], f"{name},\n{z.shape[0]} x {z.shape[1]}, {spread}")
    figure.colorbar(image, ax=list(axes[0]), label="height [µm]", shrink=0.9)
    letters = "abcd"[len(shown) :]
    compare(axes[1, 0], s, "hdf_z", "hdf_density", UM, 1 / UM)
    axes[1, 0].set(xlabel="height [µm]", ylabel="density [1/µm]")
    axes[1, 0].set_ylim(bottom=0)
    panel(axes[1, 0], letters[0], "height distribution")
    compare(axes[1, 1], s, "q", "C", 1.0, 1.0)
    axes[1, 1].set(xscale="log", yscale="log", xlabel=Q_LABEL, ylabel=PSD_LABEL)
    panel(axes[1, 1], letters[1], "radial PSD")
    for axis in axes[1]:
        light_grid(axis)
        axis.legend(loc="best")
    return figure


def _map(axes: Axes, z: NDArray, size: NDArray, limits: tuple[float, float]) -> Any:
    """Heights [um] of shape (nx, ny) as an image with x to the right, missing points in red."""
    import matplotlib

    colours = matplotlib.colormaps[HEIGHTS].copy()
    colours.set_bad(VERMILION)
    image = axes.imshow(
        z.T,
        origin="lower",
        extent=(0, float(size[0]), 0, float(size[1])),
        cmap=colours,
        vmin=limits[0],
        vmax=limits[1],
        interpolation="nearest",
    )
    axes.set(xlabel="x [mm]", ylabel="y [mm]")
    axes.spines[["top", "right"]].set_visible(True)
    return image


def _height_limits(z: NDArray) -> tuple[float, float]:
    """Colour limits that a few spikes do not stretch."""
    valid = z[np.isfinite(z)]
    if valid.size == 0:
        return 0.0, 1.0
    low, high = np.quantile(valid, [0.001, 0.999])
    return float(low), float(high) if high > low else float(low) + 1.0

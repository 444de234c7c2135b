"""Figures of the surface: heights, statistics, bearing curve, an artificial surface."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from brake_fenicsx.arguments import AnyArray
from brake_fenicsx.results.run import Arrays, RunData, scan_heights
from brake_fenicsx.surface.hdf import bearing_curve, pooled

from . import style

MOST_MAPS, MAPS_IN_A_ROW = 9, 3  # of several scans


def draw_topography(run: RunData) -> style.Figure | None:
    """Figure 4: the levelled scan with its missing points, and two profiles through its centre.

    Of several scans the maps.
    """
    if run.surface is None or "heights" not in run.surface:
        return None
    z, size = run.surface["heights"] * UM, run.surface["size"] * MM
    if z.ndim > 2:
        return _maps(z, size, run.surface)
    ratios = {"width_ratios": [1.25, 1]}
    figure, axes = style.new_figure(1, 2, height=2.9, width=6.0, gridspec_kw=ratios)
    image = _map(axes[0, 0], z, size, _height_limits(z))
    lost = np.isnan(z).sum()
    said = f"{lost} of {z.size} points missing or masked (red)"
    what = said if lost else f"all {z.size} points valid"
    style.panel(axes[0, 0], "a", f"levelled scan, {z.shape[0]} x {z.shape[1]},\n{what}")
    figure.colorbar(image, ax=axes[0, 0], label="height [µm]", shrink=0.9)
    x, y = ((np.arange(n) + 0.5) * side / n for n, side in zip(z.shape, size, strict=True))
    looks = {"color": style.BLUE, "lw": 0.9}, {"color": style.ORANGE, "lw": 0.9, "ls": "--"}
    axes[0, 1].plot(x, z[:, z.shape[1] // 2], label="along x, mid y", **looks[0])
    axes[0, 1].plot(y, z[z.shape[0] // 2], label="along y, mid x", **looks[1])
    axes[0, 1].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1)
    style.finish(axes[0, 1], xlabel="position [mm]", ylabel="height [µm]")
    axes[0, 1].set_title("(b) central profiles", pad=32)
    return figure


def topography_caption(run: RunData) -> str:
    """Caption of figure 4."""
    several = run.surface is not None and len(scan_heights(run.surface)) > 1
    one = "Levelled scan of the pad surface [µm], and profiles through its centre."
    shown = "Levelled scans of the pad surface [µm] at one scale of heights." if several else one
    return f"{shown} Red: points that are missing or masked."


def _maps(scans: AnyArray, size: AnyArray, surface: Arrays) -> style.Figure:
    """Maps of several scans [um], shape (scans, nx, ny), at one scale of heights."""
    shown = scans[:MOST_MAPS]
    columns = min(len(shown), MAPS_IN_A_ROW)
    rows = -(-len(shown) // columns)
    ratio = float(size[1] / size[0])
    height = min(max(rows * (0.95 + style.WIDTH / columns * 0.65 * ratio), 2.4), 9.5)
    figure, axes = style.new_figure(rows, columns, height=height)
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


def draw_artificial(run: RunData) -> style.Figure | None:
    """Figure 6: an artificial surface beside the scan, with the heights and spectrum it reached."""
    if run.surface is None or "artificial" not in run.surface:
        return None
    s = run.surface
    shown = [("artificial surface", s["artificial"] * UM, s["artificial_size"])]
    scans = scan_heights(s)
    if len(scans):
        name = "scan" if len(scans) == 1 else f"scan 1 of {len(scans)}"
        shown = [(name, scans[0] * UM, s["size"]), *shown]
    figure, axes = style.new_figure(2, 2, height=6.2, gridspec_kw={"height_ratios": [1.15, 1]})
    for axis in axes[0, len(shown) :]:
        axis.set_visible(False)
    limits = _height_limits(np.concatenate([z.ravel() for _, z, _ in shown]))
    side = float(max(size.max() for _, _, size in shown)) * MM
    for j, (name, z, size) in enumerate(shown):
        image = _map(axes[0, j], z, size * MM, limits)
        axes[0, j].set(xlim=(0, side), ylim=(0, side))
        spread = f"$S_q$ = {np.nanstd(z):.1f} µm"
        style.panel(axes[0, j], "ab"[j], f"{name},\n{z.shape[0]} x {z.shape[1]}, {spread}")
    figure.colorbar(image, ax=list(axes[0]), label="height [µm]", shrink=0.9)
    letters = "abcd"[len(shown) :]
    compare(axes[1, 0], s, "hdf_z", "hdf_density", UM, 1 / UM)
    axes[1, 0].set(xlabel="height [µm]", ylabel="density [1/µm]", ylim=(0, None))
    style.finish(axes[1, 0], title=f"({letters[0]}) height distribution")
    compare(axes[1, 1], s, "q", "C", 1e-3, 1.0)
    axes[1, 1].set(xscale="log", yscale="log", xlabel=Q_LABEL, ylabel=PSD_LABEL)
    style.finish(axes[1, 1], title=f"({letters[1]}) radial PSD")
    for axis in axes[1]:
        axis.legend(loc="best")
    return figure


def _map(axes: style.Axes, z: AnyArray, size: AnyArray, limits: tuple[float, float]) -> Any:
    """Heights [um] of shape (nx, ny) as an image, missing points in red."""
    import matplotlib

    colours = matplotlib.colormaps[style.HEIGHTS]
    return style.draw_field(axes, z, size, colours, style.VERMILION, vmin=limits[0], vmax=limits[1])


def _height_limits(z: AnyArray) -> tuple[float, float]:
    """Colour limits that a few spikes do not stretch."""
    valid = z[np.isfinite(z)]
    if valid.size == 0:
        return 0.0, 1.0
    low, high = np.quantile(valid, [0.001, 0.999])
    return float(low), float(high) if high > low else float(low) + 1.0


UM, MM = 1e6, 1e3
ROUND_OFF = 1e-4  # of a mean height, relative to S_q
MOMENTS = {"mean": "scan mean", "median": "scan median", "S_q": "$S_q$", "S_sk": "$S_{sk}$",
           "S_ku": "$S_{ku}$"}  # fmt: skip
Q_LABEL, PSD_LABEL = "wave number $q$ [1/mm]", "radial PSD $C$ [m$^4$]"
WAVES = ("q", "fit_q", "spectrum_q", "q_band")  # arrays of wave numbers [rad/m]


def surface_statistics(surface: Arrays) -> dict[str, Any]:
    """Statistics of the scan (lengths in m) and parameters of its fit; may be empty."""
    return dict(json.loads(str(surface["stats"])))


def draw_statistics(run: RunData) -> style.Figure | None:
    """Figure 5: height distribution, radial PSD with fit and reliable band, residual of the fit."""
    if run.surface is None:
        return None
    surface = {n: a / 1e3 if n in WAVES else a for n, a in run.surface.items()}
    figure, axes = style.new_figure(1, 2, height=3.7, gridspec_kw={"width_ratios": [1, 1.25]})
    _draw_heights(axes[0, 0], surface)
    if "q" in surface:
        axes[0, 1].remove()
        right = axes[0, 0].get_gridspec()[0, 1].subgridspec(2, 1, height_ratios=[3, 1])
        top = figure.add_subplot(right[0])
        bottom = figure.add_subplot(right[1], sharex=top)
        _draw_residual(bottom, surface)
        top.tick_params(labelbottom=False)
        top.set_xlabel("")
    else:
        top = axes[0, 1]
        top.set_xlabel(Q_LABEL)
    _draw_psd(top, surface)
    return figure


def draw_bearing_curve(run: RunData) -> style.Figure | None:
    """Bearing curve of scan and artificial surface; of several scans each, and all together."""
    if run.surface is None or "heights" not in run.surface:
        return None
    figure, axes = style.new_figure(1, 1, height=2.5, width=4.6)
    axis = axes[0, 0]
    z = run.surface["heights"]
    if np.isfinite(z).any() and np.nanstd(z) > 0:
        share, whole, scans = bearing_curves(run.surface)
        for k, height in enumerate(scans):
            text = None if k else "each scan"
            axis.plot(100 * share, height * UM, color=style.SKY, lw=0.7, label=text)
        text, width = (f"all {len(scans)} scans", 1.9) if scans else ("scan", 1.3)
        axis.plot(100 * share, whole * UM, color=style.BLUE, lw=width, label=text)
    made = run.surface.get("artificial")
    if made is not None and np.nanstd(made) > 0:
        share, height = bearing_curve(made - np.nanmean(made))
        axis.plot(100 * share, height * UM, color=style.ORANGE, ls="--", label="artificial")
    if not axis.lines:
        return None
    over = "height over the mean plane [µm]"
    style.finish(axis, xlabel="material ratio [%]", ylabel=over, xlim=(0, 100))
    axis.legend(loc="best")
    return figure


def bearing_curves(surface: Arrays) -> tuple[AnyArray, AnyArray, list[AnyArray]]:
    """Material ratios [-], heights [m] of all scans together, and of each where there are several.

    Args:
        surface: arrays of a run with scans.
    """
    each = [bearing_curve(z) for z in scan_heights(surface)]
    if len(each) == 1:
        return *each[0], []
    share, whole = bearing_curve(pooled(scan_heights(surface)))
    return share, whole, [height for _, height in each]


def _draw_heights(axes: style.Axes, surface: Arrays) -> None:
    scans = scan_heights(surface)
    z = (pooled(scans) if len(scans) > 1 else np.ravel(scans)) * UM
    z = z[np.isfinite(z)]
    if z.size:
        what = "scan" if len(scans) == 1 else f"{len(scans)} scans"
        axes.hist(z, bins=64, density=True, color="#c9dcea", label=what)
    heights, density = surface["hdf_z"] * UM, surface["hdf_density"] / UM
    axes.plot(heights, density, color=style.BLUE, label="kernel density" if z.size else "as given")
    if z.size and z.std() > 0:
        low, high = axes.get_xlim()
        x = np.linspace(low, high, 200)
        normal = np.exp(-0.5 * ((x - z.mean()) / z.std()) ** 2) / (z.std() * np.sqrt(2 * np.pi))
        axes.plot(x, normal, color=style.GREY, ls="--", label="normal")
    known = surface_statistics(surface)
    measured = () if z.size else ("mean", "median")
    text = _moments({key: value for key, value in known.items() if key not in measured})
    axes.text(0.03, 0.97, text, transform=axes.transAxes, va="top", fontsize=7.5)
    axes.set(xlabel="height over the mean plane $z$ [µm]", ylabel="density $P(z)$ [1/µm]")
    axes.set_ylim(0, 1.45 * axes.get_ylim()[1])
    axes.legend(loc="upper right", fontsize=7.5, handlelength=1.2)
    style.panel(axes, "a", "height distribution")


def _moments(stats: dict[str, Any]) -> str:
    lines = list[str]()
    for key, text in MOMENTS.items():
        if not isinstance(value := stats.get(key), int | float):
            continue
        length = key in ("mean", "median", "S_q")
        if key != "S_q" and length and abs(value) < ROUND_OFF * stats.get("S_q", 0.0):
            value = 0.0  # after levelling
        lines.append(f"{text} = ${value * UM:.3g}$ µm" if length else f"{text} = ${value:.3g}$")
    return "\n".join(lines)


def _draw_psd(axes: style.Axes, surface: Arrays) -> None:
    _draw_band(axes, surface)
    for number, C in enumerate(surface.get("scan_C", ())):
        label = None if number else "each scan"
        axes.loglog(surface["q"][C > 0], C[C > 0], lw=0.8, color=style.SKY, label=label)
    if "q" in surface:
        positive = surface["C"] > 0
        scans = len(scan_heights(surface))
        text, width = ("whole scan", 1.6) if scans == 1 else (f"mean of {scans} scans", 1.9)
        q, C = surface["q"][positive], surface["C"][positive]
        axes.loglog(q, C, color=style.BLUE, lw=width, label=text)
    stats = surface_statistics(surface)
    text = _fit_text(stats, "bi-fractal fit" if "q" in surface else "as given")
    axes.loglog(surface["fit_q"], surface["fit_C"], color=style.BLACK, ls="--", label=text)
    if _measured(surface):
        inside = surface["spectrum_q"] <= surface["fit_q"].max()
        inside &= surface["spectrum_q"] >= 0.7 * surface["fit_q"].min()
        q, C = surface["spectrum_q"][inside], surface["spectrum_C"][inside]
        axes.loglog(q, C, color=style.VERMILION, lw=1.1, label="artificial surfaces")
    q_c = stats.get("q_c")
    if isinstance(q_c, int | float) and q_c > 0:
        axes.axvline(q_c / 1e3, color=style.GREY, lw=0.8, ls=":")
        place = axes.get_xaxis_transform()  # data along x, a share of the axes along y
        axes.text(q_c / 1e3, 0.97, " $q_c$", transform=place, fontsize=8, va="top")
    axes.legend(loc="lower left", fontsize=7.5)
    style.finish(axes, title="(b) radial power spectrum", ylabel=PSD_LABEL)


def _measured(surface: Arrays) -> bool:
    """Whether artificial surfaces have the measured spectrum in place of its fit."""
    if "spectrum_C" not in surface or "q" not in surface:
        return False
    used = np.interp(surface["fit_q"], surface["spectrum_q"], surface["spectrum_C"])
    return not np.allclose(used, surface["fit_C"], rtol=0.02, atol=0.0)


def _fit_text(stats: dict[str, Any], what: str) -> str:
    parts = []
    for key, text in (("c1", "$c_1$"), ("c2", "$c_2$")):
        value, error = stats.get(key), stats.get(f"{key}_error")
        if isinstance(value, int | float):
            known = isinstance(error, int | float) and np.isfinite(error)
            spread = f" ± {error:.2f}" if known else ""
            parts.append(f"{text} = ${value:.2f}${spread}")
    return what + (": " + ",\n".join(parts) if parts else "")


def _draw_band(axes: style.Axes, surface: Arrays) -> None:
    text = "reliable band" if "q" in surface else "band"
    axes.axvspan(*surface["q_band"], color="#eef4ea", lw=0, zorder=0, label=text)


def _draw_residual(axes: style.Axes, surface: Arrays) -> None:
    """Ratio of the measured PSD to its fit, over the fitted wave numbers."""
    q, fit_q = surface["q"], surface["fit_q"]
    inside = (q >= fit_q.min()) & (q <= fit_q.max()) & (surface["C"] > 0)
    if not inside.any():
        axes.set_visible(False)
        return
    fit = np.interp(np.log(q[inside]), np.log(fit_q), np.log(surface["fit_C"]))
    ratio = surface["C"][inside] / np.exp(fit)
    _draw_band(axes, surface)
    axes.semilogx(q[inside], ratio, color=style.BLUE, lw=0.9)
    axes.axhline(1.0, color=style.BLACK, lw=0.7, ls="--")
    if _measured(surface):
        used = np.interp(fit_q, surface["spectrum_q"], surface["spectrum_C"])
        axes.semilogx(fit_q, used / surface["fit_C"], color=style.VERMILION, lw=0.9)
    what = "scan" if len(scan_heights(surface)) == 1 else "mean"
    reach = max(2.2, 1.1 * float(np.max(np.maximum(ratio, 1 / ratio))))
    style.finish(
        axes, yscale="log", xlabel=Q_LABEL, ylabel=f"{what} / fit [-]", ylim=(1 / reach, reach)
    )
    ticks = [t for t in (0.01, 0.1, 0.5, 1.0, 2.0, 10.0, 100.0) if 1 / reach < t < reach]
    axes.set_yticks(ticks, [f"{t:g}" for t in ticks])
    axes.minorticks_off()


def compare(axes: style.Axes, s: Arrays, x: str, y: str, x_unit: float, y_unit: float) -> None:
    """The same curve of the scan, or as given, and of the artificial surface."""
    scans = len(scan_heights(s))
    first = ("", "scan" if scans == 1 else f"{scans} scans", style.BLUE, "-")
    if "heights" not in s:
        first = ("" if x in s else "fit_", "as given", style.BLUE, "-")
    for prefix, text, colour, line in (first, ("artificial_", "artificial", style.ORANGE, "--")):
        if prefix + x in s:
            u, v = s[prefix + x] * x_unit, s[prefix + y] * y_unit
            good = np.isfinite(v) & (v > 0)
            axes.plot(u[good], v[good], color=colour, ls=line, label=text)

"""Figures of contact: maps of rough contact, laws, pressure on the faces of the brake."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from brake_fenicsx.arguments import AnyArray
from brake_fenicsx.results.run import Arrays, RunData, sort_approaches
from brake_fenicsx.results.tables import Columns, rows_of

from . import style
from .fields import facet_means

MOST_MAPS = 6
FEW_POINTS = 300  # fewer touching points are circled
FEW_LAWS = 5  # fewer have no band


def draw_contact_maps(run: RunData) -> style.Figure | None:
    """Figure 7: where the surface touches the rigid plane, at loads from light to heavy."""
    maps = run.maps
    if maps is None or maps["pressures"].shape[0] == 0:
        return None
    n = maps["pressures"].shape[0]
    chosen = np.unique(np.linspace(0, n - 1, min(n, MOST_MAPS)).round().astype(int))
    columns = 2 if chosen.size in (2, 4) else min(3, chosen.size)
    rows = -(-chosen.size // columns)
    figure, axes = style.new_figure(
        rows, columns, height=2.75 * rows, width=2.4 * columns + 0.9, sharex=True, sharey=True
    )
    positive = maps["pressures"][maps["pressures"] > 0] / 1e6
    limits = _limits(positive)
    image: Any = None
    for axis, j in zip(axes.flat, chosen, strict=False):
        image = _draw_map(axis, maps, int(j), limits)
    for axis in axes.flat[chosen.size :]:
        axis.set_visible(False)
    for axis in axes.flat:
        axis.label_outer()
    shape = "{} x {}".format(*maps["pressures"].shape[1:])
    text = f"contact pressure [MPa]\n{shape} points; white: no contact"
    figure.colorbar(image, ax=list(axes.flat), label=text, extend="both", shrink=0.9)
    return figure


def draw_laws(run: RunData) -> style.Figure | None:
    """Figure 8: pressure against separation, linear and log, and stiffness against pressure."""
    laws = run.laws
    if laws is None or laws["d"].shape[0] == 0:
        return None
    figure, axes = style.new_figure(1, 3, height=3.3)
    E_star = settings_of(laws).get("E_star")
    d, p = laws["d"] * 1e6, laws["p"]
    for axis, scale in ((axes[0, 0], 1e6), (axes[0, 1], E_star or 1e6)):
        _draw_bundle(axis, d, p / scale, label="each law", color=style.BLUE)
        if len(d) > 2:
            rows, at = _at_common_pressures(d, p / scale)
            looks = {"color": style.BLACK, "lw": 1.6, "label": "median separation"}
            axis.plot(np.median(rows, axis=0), at, **looks)
    x, y = "separation $d$ [µm]", "mean pressure $p$ [MPa]"
    linear = f"(a) {d.shape[0]} laws, linear"
    style.finish(axes[0, 0], title=linear, xlabel=x, ylabel=y, ylim=(0, None))
    log = f"(b) log, $E^*$ = {E_star / 1e6:.0f} MPa" if E_star else "(b) log"
    y = "$p/E^*$ [-]" if E_star else y
    style.finish(axes[0, 1], title=log, yscale="log", xlabel=x, ylabel=y)
    _draw_stiffness(axes[0, 2], laws)
    if (span := _braking(run)) is not None:
        looks = {"color": style.ORANGE, "alpha": 0.18, "lw": 0}
        axes[0, 2].axvspan(*span, label="5 to 95 % of the\nbrake's patches", **looks)
    axes[0, 0].legend(loc="upper right")
    if axes[0, 2].get_legend_handles_labels()[0]:
        axes[0, 2].legend(loc="lower right", fontsize=7.5)
    return figure


def laws_caption(run: RunData) -> str:
    """Caption of figure 8."""
    laws = run.laws or {}
    said = [
        "Library of pressure-gap laws, one line each: mean pressure of a patch against the"
        " separation of rigid plane and mean plane, linear and logarithmic, and stiffness against"
        f" pressure{', with the range of pressures on the pads' if _braking(run) else ''}.",
        "Steps at low pressure occur because only a few points touch.",
    ]
    if laws and len(laws["d"]) >= FEW_LAWS:
        said.append("Stiffness: also its median over the laws, and the band of 5 to 95 % of them.")
    if "v" in laws:
        said.append(
            "The equilibrium takes the loading stiffness, the modes the vibration stiffness: with a"
            " hardness that of elastic unloading, without one the mean loading stiffness over a"
            " third of a decade of pressure."
        )
    return " ".join([*said, *_support(laws)])


def _support(laws: Arrays) -> list[str]:
    """Pixels that carry the laws at the middle pressure, and their band over scans."""
    found = settings_of(laws).get("support")
    if not found:
        return []
    i = len(found["pressure"]) // 2
    k, v, one = (
        " to ".join(f"{found[n][j][i] / 1e9:.3g}" for j in (0, 2)) for n in ("k", "v", "v_patch")
    )
    return [
        f"At {found['pressure'][i] / 1e6:.2g} MPa {found['scan_pixels'][i]:.0f} pixels of the scan"
        f" are as high as what touches, {found['grid_pixels'][i]:.0f} of a patch touch. The laws"
        f" of 90 % of other scans of the same surface would have a mean loading stiffness of {k}"
        f" and a mean vibration stiffness of {v} N/mm³, a single patch of them {one} N/mm³"
        " (parametric bootstrap; law_support.csv)."
    ]


def settings_of(laws: Arrays) -> dict[str, Any]:
    """How a library was made."""
    settings = json.loads(str(laws["settings"])) if "settings" in laws else {}
    return settings if isinstance(settings, dict) else {}


def _draw_map(axes: style.Axes, maps: Arrays, j: int, limits: tuple[float, float]) -> Any:
    import matplotlib
    from matplotlib.colors import LinearSegmentedColormap, LogNorm
    from matplotlib.ticker import LogFormatterSciNotation

    ramp = matplotlib.colormaps["inferno_r"](np.linspace(0.3, 1.0, 256))
    colours = LinearSegmentedColormap.from_list("contact", ramp)
    p, size = maps["pressures"][j] / 1e6, maps["size"] * 1e3
    shown = np.where(p > 0, p, np.nan)
    image = style.draw_field(axes, shown, size, colours, "white", norm=LogNorm(*limits))
    touching, ratio, area = np.count_nonzero(p > 0), maps["p_over_E"][j], maps["area_fraction"][j]
    load = f"$p/E^*$ = {LogFormatterSciNotation()(float(f'{ratio:.1e}'))}"
    points = f" ({touching} points)" if touching < FEW_POINTS else ""
    axes.set_title(f"{load}\nreal contact {100 * area:.2g} %{points}", fontsize=8.5)
    if points:
        _circle(axes, p > 0, size)
    return image


def _circle(axes: style.Axes, touching: AnyArray, size: AnyArray) -> None:
    """Ring each group of touching points, which alone would be lost in print."""
    from scipy.ndimage import binary_dilation, center_of_mass, label

    groups, n = label(binary_dilation(touching, iterations=max(1, len(touching) // 64)))
    if n:
        centres = np.array(center_of_mass(touching, groups, range(1, n + 1)))
        x, y = ((centres + 0.5) * size / touching.shape).T
        axes.scatter(x, y, s=90, facecolors="none", edgecolors=style.BLUE, linewidths=0.8)


def _limits(positive: AnyArray) -> tuple[float, float]:
    """Colour limits [MPa] from the pressures of the touching points, without the tails."""
    if positive.size == 0:
        return 0.1, 1.0
    low, high = np.quantile(positive, [0.05, 0.999])
    return float(low), float(max(high, 1.5 * low))


def _draw_bundle(
    axes: style.Axes, x: AnyArray, y: AnyArray, faint: float = 1.0, **looks: Any
) -> None:
    """All laws as thin lines."""
    from matplotlib.collections import LineCollection

    lines = [np.column_stack(pair) for pair in zip(x, np.where(y > 0, y, np.nan), strict=True)]
    alpha = faint * float(np.clip(12 / len(x), 0.15, 0.8))
    axes.add_collection(LineCollection(lines, linewidths=0.7, alpha=alpha, **looks))
    axes.autoscale_view()


def _draw_stiffness(axes: style.Axes, laws: Arrays) -> None:
    """Stiffness of each law, and median and band over many laws."""
    kinds = {"k": ("of loading", style.BLUE), "v": ("of small vibrations", style.ORANGE)}
    kinds = {name: kind for name, kind in kinds.items() if name in laws}
    p, many = laws["p"] / 1e6, len(laws["p"]) >= FEW_LAWS
    for name, (text, colour) in kinds.items():
        _draw_bundle(axes, p, laws[name] / 1e9, 0.4 if many else 1.0, color=colour)
        if len(kinds) > 1:
            axes.plot([], [], color=colour, label=text)
        if many:
            rows, at = _at_common_pressures(laws[name] / 1e9, p)
            low, middle, high = np.quantile(rows, [0.05, 0.5, 0.95], axis=0)
            axes.fill_between(at, low, high, color=colour, alpha=0.35, lw=0, zorder=2.5)
            label = "median, 5 to 95 %" if name == "k" else None
            axes.plot(at, middle, color=style.BLACK, lw=1.6, zorder=3, label=label)
    style.finish(axes, title="(c) stiffness", xscale="log", yscale="log")
    axes.set(xlabel="mean pressure $p$ [MPa]", ylabel="stiffness $-p'(d)$ [N/mm$^3$]")


def _at_common_pressures(values: AnyArray, p: AnyArray) -> tuple[AnyArray, AnyArray]:
    """A quantity of each law at pressures that all laws reach, and these pressures."""
    known = [np.isfinite(row) for row in p]
    low = max(row[k].min() for row, k in zip(p, known, strict=True))
    high = min(row[k].max() for row, k in zip(p, known, strict=True))
    at = np.geomspace(low, max(high, low), 200)
    rows = []
    for own, own_p, k in zip(values, p, known, strict=True):
        order = np.argsort(own_p[k])
        rows.append(np.interp(np.log(at), np.log(own_p[k][order]), own[k][order]))
    return np.array(rows), at


def _braking(run: RunData) -> tuple[float, float] | None:
    """Range of the pressures on closed contact elements with a law [MPa], if there is a brake."""
    if run.contact is None:
        return None
    closed = run.contact["p"][(run.contact["p"] > 0) & (run.contact["law"] >= 0)]
    if closed.size < 2:
        return None
    low, high = np.quantile(closed, [0.05, 0.95]) / 1e6
    return float(low), float(high)


def draw_contact_pressure(run: RunData) -> style.Figure | None:
    """Pressure of the pads' facets at equilibrium, first stored sample of each approach."""
    contact = None if run.contact is None else sliding_rows(run, run.contact)
    if contact is None or contact["element"].size == 0:
        return None
    maps = []
    for name in sort_approaches(set(map(str, contact["approach"]))):
        mine = contact["approach"] == name
        sample = contact["sample"][mine].min()
        rows = rows_of(contact, mine & (contact["sample"] == sample))
        p = rows["p"] / 1e6
        top = float(np.quantile(p[p > 0], 0.98)) if np.any(p > 0) else 1.0
        place = f"{style.label(run, name)}, sample {sample}"
        ends = "max" if np.any(p > top) else "neither"
        maps.append(PadMap(place, rows, p, (0.0, top), "pressure [MPa]", ends, _closed))
    return draw_pads(run, maps, style.PRESSURE)


def _closed(contact: Columns) -> str:
    p, area = contact["p"], contact["area"]
    mean = np.sum(p * area) / np.sum(area) / 1e6
    return f":\n{np.sum(p > 0)} of {p.size} elements closed, mean {mean:.3g} MPa"


@dataclass(frozen=True, slots=True)
class PadMap:
    """Values of contact elements over the faces of the pads.

    Attributes:
        place: beginning of the headings.
        contact: rows of ``contact.csv`` of the elements.
        values: one for each of them.
        limits: of the colours; values up to a lower one of 0 are empty.
        bar: label of the colour bar.
        extend: ends of the bar that values pass, as Matplotlib names them.
        more: what follows in the heading of a pad, from its rows.
    """

    place: str
    contact: Columns
    values: AnyArray
    limits: tuple[float, float]
    bar: str
    extend: str = "both"
    more: Callable[[Columns], str] = lambda contact: ""


def draw_pads(run: RunData, maps: Sequence[PadMap], colours: str) -> style.Figure:
    """A row of panels with a colour bar for each map, a panel for each pad.

    Where the facets are not known, every element is drawn as a square of its area.
    """
    from matplotlib.collections import PolyCollection

    sides = len(_pad_sides(maps[0].contact["z"]))
    x, y = (np.ptp(np.concatenate([m.contact[name] for m in maps])) for name in "xy")
    height = 0.75 + 5.2 / sides * float(np.clip(y / max(x, 1e-9), 0.2, 1.5))
    figure, axes = style.new_figure(len(maps), sides, height=height * len(maps))
    for row, m in zip(axes, maps, strict=True):
        for axis, (side, inside) in zip(row, _pad_sides(m.contact["z"]), strict=True):
            pad = rows_of(m.contact, inside)
            corners, shown = _patches(pad, run.faces, m.values[inside])
            if m.limits[0] == 0:
                shown = np.where(shown > 0, shown, np.nan)
            image = PolyCollection(
                list(corners * 1e3), cmap=colours, edgecolors="#b5b5b5", lw=0.15, array=shown
            )
            image.set_clim(*m.limits)
            image.cmap.set_bad("white")
            axis.add_collection(image)
            axis.autoscale_view()
            axis.margins(0.03)
            axis.set_title(f"{m.place}, {side}{m.more(pad)}", fontsize=8)
            axis.set(ylabel="y [mm]", aspect="equal")
        figure.colorbar(image, ax=list(row), label=m.bar, extend=m.extend, shrink=0.9)
    for axis in axes[-1]:
        axis.set_xlabel("x [mm]")
    # A first layout: the labels of a colour bar, and so its width, are known once it has a place.
    if layout := figure.get_layout_engine():
        layout.execute(figure)
    return figure


def sliding_rows(run: RunData, contact: Columns) -> Columns:
    """Rows of ``contact.csv`` of faces that slide: those that stick lie elsewhere on the brake."""
    slides = None if run.faces is None else run.faces.get("slides")
    if slides is None or contact["element"].max(initial=-1) >= len(slides):
        return contact
    return rows_of(contact, slides[contact["element"]])


def _pad_sides(z: AnyArray) -> list[tuple[str, AnyArray]]:
    """Which contact elements lie on which pad, by their z [m]; each with a name."""
    if np.any(z > 0) and np.any(z < 0):
        return [("pad at z > 0", z > 0), ("pad at z < 0", z < 0)]
    return [("contact face", np.full(z.shape, True))]


def _patches(contact: Columns, faces: Arrays | None, values: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Corners of the facets of some contact elements, and means of values over each.

    Args:
        contact: rows of ``contact.csv`` of the elements.
        faces: arrays of ``contact_faces.npz``.
        values: of these elements, shape (elements,).

    Returns:
        Corners [m], shape (n, corners, 2), and values, shape (n,). Where the facets are not known,
        squares of the elements' areas.
    """
    if faces is not None and contact["element"].max() < len(faces["facet"]):
        facet, corners = faces["facet"][contact["element"]], faces["corners"]
        if np.all(facet >= 0):
            means = facet_means(facet, contact["area"], values, len(corners))
            held = np.isfinite(means)
            return corners[held][..., :2], means[held]
    centre = np.column_stack([contact["x"], contact["y"]])
    return centre[:, None, :] + _squares(centre, contact["area"]), values


def _squares(centre: AnyArray, area: AnyArray) -> AnyArray:
    """Corners [m] about the centre, shape (n, 4, 2); on a ring the sides follow the radius."""
    radius = np.linalg.norm(centre, axis=1)
    ring = radius.min() > 0.3 * radius.max()
    angle = np.arctan2(centre[:, 1], centre[:, 0]) if ring else np.zeros(len(centre))
    half = 0.5 * np.sqrt(area)[:, None, None]
    unit = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return half * np.einsum("ijn,kj->nki", turn, unit)

"""Contact pressure on both pads, one row per approach."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.results.run import Arrays, RunData, sort_approaches
from brake_fenicsx.results.tables import Columns, rows_of

from .fields import facet_means
from .style import PRESSURE, label, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_contact_pressure(run: RunData) -> Figure | None:
    """Pressure of the pads' facets at equilibrium, first stored sample of each approach.

    Where the facets are not known, every element is drawn as a square of its area.
    """
    contact = None if run.contact is None else sliding_rows(run, run.contact)
    if contact is None or contact["element"].size == 0:
        return None
    names = sort_approaches(set(map(str, contact["approach"])))
    sides = pad_sides(contact["z"])
    x, y = contact["x"] * 1e3, contact["y"] * 1e3
    height = 1.05 + 5.6 / len(sides) * float(np.clip(np.ptp(y) / max(np.ptp(x), 1e-9), 0.2, 1.5))
    figure, axes = new_figure(len(names), len(sides), height=height * len(names))
    for row, name in zip(axes, names, strict=True):
        mine = contact["approach"] == name
        sample = contact["sample"][mine].min()
        own = mine & (contact["sample"] == sample)
        p = contact["p"][own] / 1e6
        top = float(np.quantile(p[p > 0], 0.98)) if np.any(p > 0) else 1.0
        for axis, (side, inside) in zip(row, sides, strict=True):
            chosen = own & inside
            own_table = rows_of(contact, chosen)
            corners, shown = patches(own_table, run.faces, own_table["p"])
            shown = np.where(shown > 0, shown / 1e6, np.nan)
            image = draw_patches(axis, corners, shown, PRESSURE, (0.0, top))
            place = f"{label(run, name)}, sample {sample}, {side}"
            axis.set_title(_headline(place, contact, chosen), fontsize=8.5)
            axis.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
        beyond = "max" if np.any(p > top) else "neither"
        figure.colorbar(image, ax=list(row), label="pressure [MPa]", extend=beyond, shrink=0.9)
    return figure


def sliding_rows(run: RunData, contact: Columns) -> Columns:
    """Rows of ``contact.csv`` of faces that slide: those that stick lie elsewhere on the brake."""
    slides = None if run.faces is None else run.faces.get("slides")
    if slides is None or contact["element"].max(initial=-1) >= len(slides):
        return contact
    return rows_of(contact, slides[contact["element"]])


def pad_sides(z: NDArray) -> list[tuple[str, NDArray]]:
    """Which contact elements lie on which pad, by their z [m]; each with a name."""
    if np.any(z > 0) and np.any(z < 0):
        return [("pad at z > 0", z > 0), ("pad at z < 0", z < 0)]
    return [("contact face", np.full(z.shape, True))]


def _headline(place: str, contact: Columns, own: NDArray) -> str:
    closed = int(np.sum(contact["p"][own] > 0))
    mean = np.sum(contact["p"][own] * contact["area"][own]) / np.sum(contact["area"][own])
    return f"{place}:\n{closed} of {own.sum()} elements closed, mean {mean / 1e6:.3g} MPa"


def patches(contact: Columns, faces: Arrays | None, values: NDArray) -> tuple[NDArray, NDArray]:
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


def draw_patches(
    axes: Axes, corners: NDArray, values: NDArray, colours: str, limits: tuple[float, float]
) -> Any:
    """Patches coloured by a value; one that is nan is empty."""
    from matplotlib.collections import PolyCollection

    drawn = PolyCollection(list(corners * 1e3), cmap=colours, edgecolors="#b5b5b5", linewidths=0.15)
    drawn.set_array(values)
    drawn.set_clim(*limits)
    drawn.cmap.set_bad("white")
    axes.add_collection(drawn)
    axes.autoscale_view()
    axes.margins(0.03)
    return drawn


def _squares(centre: NDArray, area: NDArray) -> NDArray:
    """Corners [m] about the centre, shape (n, 4, 2); on a ring the sides follow the radius."""
    radius = np.linalg.norm(centre, axis=1)
    ring = radius.min() > 0.3 * radius.max()
    angle = np.arctan2(centre[:, 1], centre[:, 0]) if ring else np.zeros(len(centre))
    half = 0.5 * np.sqrt(area)[:, None, None]
    unit = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return half * np.einsum("ijn,kj->nki", turn, unit)

"""The squeal map: figure 9, and what the interactive one shows."""

from __future__ import annotations

from typing import Any

import numpy as np

from brake_fenicsx.arguments import AnyArray
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.squeal import squeals

from . import style
from .mode_cards import ModePictures

MANY_POINTS = 2000  # beyond this a scatter is rasterised inside the SVG
DRAWN_POINTS = 50_000  # of a scatter; of more every n-th is drawn
MOST = 20_000  # modes that a page holds
VERDICTS = {"stable": 0, "unstable": 1}


def draw_squeal_map(run: RunData) -> style.Figure | None:
    """Figure 9: frequency against damping, one panel per approach, where squeal lies shaded.

    Unstable modes that do not count as squeal are grey, above a line at the threshold. The damping
    axis is linear about zero and logarithmic beyond: flutter spans three decades.
    """
    if run.modes is None or run.modes["mode"].size == 0:
        return None
    # All panels on one page of print, at full width.
    damping = run.modes["damping"]
    low, high = min(float(damping.min()), 0.0), max(float(damping.max()), 0.0)
    reach = max(high - low, 1e-6)
    # Room above the points for the legend.
    limits = min(3 * (low - 0.08 * reach), -3e-3), max(20 * (high + 0.3 * reach), 2e-2)
    figure, axes = _panels(run, min(2.1, 6.0 / len(run.approaches)), limits)
    f, damping, verdict = (run.modes[name] for name in ("frequency_hz", "damping", "verdict"))
    squeal = squeals(run.modes, run.threshold)
    for axis, approach in zip(axes.flat, run.approaches, strict=True):
        good = run.squeal.of_good(approach)
        for name, kind, colour, marker, size in (
            ("stable", verdict == "stable", style.BLUE, "o", 12),
            ("unstable, no squeal", (verdict == "unstable") & ~squeal, style.GREY, "v", 20),
            ("squeal", squeal, style.VERMILION, "v", 20),
            ("neutral", verdict == "neutral", style.BLACK, "s", 14),
        ):
            rows = np.flatnonzero(good & kind)
            few, text = _thinned(rows), f"{name}: {rows.size}"
            _scatter(axis, f[few] / 1e3, damping[few], colour, marker, size, text)
        axis.legend(loc="upper left", ncol=4, bbox_to_anchor=(0, 1.02), handletextpad=0.1)
    return figure


def _panels(
    run: RunData, height: float, limits: tuple[float, float]
) -> tuple[style.Figure, AnyArray]:
    """One panel per approach over shared axes, squeal shaded, counts in the title."""
    n, ticks = len(run.approaches), [-0.1, -0.01, -0.001, 0.0, 0.001, 0.01, 0.1]
    figure, axes = style.new_figure(n, 1, height=0.7 + height * n, sharex=True, sharey=True)
    for axis, approach in zip(axes.flat, run.approaches, strict=True):
        axis.axhspan(-1e3, -run.threshold, color="#fbeee6", lw=0, zorder=0)
        axis.axhline(0.0, color=style.BLACK, lw=0.6, zorder=1)
        if run.threshold:
            axis.axhline(-run.threshold, color=style.VERMILION, lw=0.8, ls="--", zorder=1)
        text = f"squeal: {run.criterion}"
        axis.text(
            0.995, 0.03, text, transform=axis.transAxes, ha="right", color=style.VERMILION, size=8
        )
        style.damping_axis(axis, yticks=ticks, ylim=limits, title=_headline(run, approach))
        style.finish(axis, "y", ylabel=style.DAMPING_LABEL.replace("damping ", "damping\n"))
    top = float(run.modes["frequency_hz"].max()) / 1e3 if run.modes else 1.0
    axes[-1, 0].set(xlabel=style.KHZ, xlim=(0, 1.02 * top))
    return figure, axes


def _headline(run: RunData, approach: str) -> str:
    record = run.squeal.count(approach)
    failed = f" ({record.failed} more failed)" if record.failed else ""
    modes = f"{record.squeal} of {record.modes} modes squeal"
    if record.samples == 1:
        return f"{style.label(run, approach)}: 1 run{failed}, {modes}"
    share = f"{record.squeal_samples} of {record.samples} samples squeal{failed}"
    return f"{style.label(run, approach)}: {share}, {modes}"


def _scatter(
    axes: style.Axes, x: AnyArray, y: AnyArray, colour: str, marker: str, size: float, text: str
) -> None:
    if x.size == 0:
        return
    many = x.size > MANY_POINTS
    x, y = _thinned(x), _thinned(y)
    size, alpha = (0.5 * size, 0.35) if many else (size, 0.8)
    looks: dict[str, Any] = {"c": colour, "marker": marker, "alpha": alpha, "label": text}
    axes.scatter(x, y, s=size, linewidths=0, rasterized=many, zorder=3, **looks)


def _thinned(values: AnyArray) -> AnyArray:
    """At most as many values as a scatter draws."""
    return values[:: max(1, -(-values.size // DRAWN_POINTS))]


def squeal_map(run: RunData, pictures: ModePictures, most: int = MOST) -> dict[str, Any] | None:
    """What the template of the map shows.

    Args:
        run: the results.
        pictures: pictures of mode shapes.
        most: number of modes; of more than these a part is taken, squeal modes first.

    Returns:
        ``data`` for the script, columns of one length; ``shown`` of ``total`` modes and how they
        were selected; None without modes.
    """
    if run.modes is None or run.modes["mode"].size == 0:
        return None
    names, modes = run.approaches, run.modes
    number = np.full(len(modes["mode"]), -1, dtype=np.int8)
    for j, name in enumerate(names):
        number[run.squeal.of_good(name)] = j
    hits = squeals(modes, run.threshold)
    total = int(np.sum(number >= 0))
    chosen, selection = _selected(number >= 0, hits, most)
    if chosen.size == 0:
        return None
    verdict = np.array([VERDICTS.get(str(v), 2) for v in modes["verdict"][chosen]])
    partner = modes["partner"][chosen] if "partner" in modes else np.full(chosen.size, np.nan)
    data = {
        "names": [run.label(name) for name in names],
        "approach": number[chosen].tolist(),
        "sample": modes["sample"][chosen].tolist(),
        "mode": modes["mode"][chosen].tolist(),
        "frequency": _rounded(modes["frequency_hz"][chosen], 7),
        "damping": _rounded(modes["damping"][chosen], 4),
        "error": _rounded(run.errors[chosen], 2),
        "verdict": verdict.tolist(),
        "family": modes["family"][chosen].astype(int).tolist(),
        "partner": np.where(np.isnan(partner.astype(float)), -1, partner).astype(int).tolist(),
        "thinned": chosen.size < total,
        "families": {
            f"{names.index(name)}:{f.key}": {
                "khz": f.kilohertz,
                "share": f"{f.share.hits} of {f.share.n} samples",
                "shape": pictures.of_family(f),
            }
            for name, families in run.families.items() for f in families if f.key >= 0
        },
        "shapes": {
            f"{names.index(name)}:{sample}:{mode}": key
            for (name, sample, mode), key in pictures.by_mode.items() if name in names
        },
    }  # fmt: skip
    return {
        "data": data,
        "approaches": data["names"],
        "first": names.index(run.lead),
        "threshold": f"{run.threshold:g}",
        "shown": int(chosen.size),
        "total": total,
        "selection": selection,
    }


def _selected(known: AnyArray, hits: AnyArray, most: int) -> tuple[AnyArray, str]:
    """Rows of the table that are shown, and how they were taken: every n-th, squeal modes first."""
    squeal, others = np.flatnonzero(known & hits), np.flatnonzero(known & ~hits)
    if squeal.size + others.size <= most:
        return np.flatnonzero(known), "all"
    step = -(-squeal.size // (most // 2)) if squeal.size else 1
    kept = squeal[::step]
    rest = -(-others.size // max(most - kept.size, 1)) if others.size else 1
    said = "all squeal modes" if step == 1 else f"one in {step} of the squeal modes"
    return np.sort(
        np.concatenate([kept, others[::rest]])
    ), f"{said} and one in {rest} of the others"


def _rounded(values: AnyArray, digits: int) -> list[float | None]:
    """Numbers of few digits; None for what is not finite."""
    return [float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in values.astype(float)]

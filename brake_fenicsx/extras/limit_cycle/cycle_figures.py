"""How loud: growth of the families over their amplitude, and loudness over the samples."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.report.page_blocks import Block, Table, Text
from brake_fenicsx.report.style import CYCLE, GREY, label, light_grid, new_figure
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.squeal import kilohertz
from brake_fenicsx.results.tables import Columns, Value

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEARD = ("stable", "undecided", "undamped")  # outcomes whose loudness is stated
ENDED = (*HEARD, "gives way")  # outcomes at which growth ends
DOUBTS: dict[str, str] = {
    "undamped": "{} have no damping: growth ends there, but no vibration settles.",
    "gives way": "{} cycles give way to another vibration, which may be several times larger and is"
    " not computed: no loudness is stated.",
    "none": "{} modes grow beyond the largest amplitude, or their branch is lost: no number.",
    "unstable": "{} cycles are thresholds of a kick beyond which a vibration grows.",
}
MOST, LEVEL = 6, "level_1m_db"  # families of an approach, the loudest first; their loudness
NOTE = (
    "How far squeal grows: the periodic vibration at which the growth of a mode is zero, because"
    " patches open, stiffen or yield. Every family is computed alone: where several grow together,"
    " each changes the others, and their levels do not add. Without damping no vibration settles."
    " Friction keeps its direction unless the damping term slope acts: where the slip velocity"
    " exceeds the sliding speed, the cycle lies beyond that assumption and is smaller in reality."
    " The sound level is an estimate: the faces lie in a rigid wall, 1 m away in the open."
)


def cycle_blocks(run: RunData) -> list[Block]:
    """The loudest families in words and numbers."""
    table = run.extras.get("limit_cycle_families")
    if table is None or not table["family"].size:
        return []
    heads = [
        "approach", "family", "frequency [kHz]", "samples that grow", "how growth ends",
        "level at 1 m [dB]", "5 % to 95 % of samples [dB]", "disc velocity [mm/s]",
        "gap amplitude [um]", "rank by loudness", "rank by damping",
    ]  # fmt: skip
    rows: list[list[Value]] = []
    shown = {(name, family) for name in run.approaches for family in _loudest(run, name)}
    for i, place in enumerate(zip(map(str, table["approach"]), table["family"], strict=True)):
        if place not in shown:
            continue
        cell = {name: column[i] for name, column in table.items()}
        ends = [cell[f"{LEVEL}_{q}"] for q in (5, 95)]
        rows.append([
            run.label(str(cell["approach"])), int(cell["family"]),
            frequency_text(run, *place), int(cell["growing_samples"]), str(cell["outcomes"]),
            _text(cell[f"{LEVEL}_50"], ".0f"),
            "{:.0f} to {:.0f}".format(*ends) if np.all(np.isfinite(ends)) else "-",
            _text(cell["disc_mm_s_50"], ".3g"), _text(cell["gap_um_50"], ".3g"),
            _text(cell["rank_by_loudness"], ".0f"), int(cell["rank_by_damping"]),
        ])  # fmt: skip
    return [
        Text(" ".join([NOTE, *_doubts(run.extras["limit_cycle"])])),
        Table.without_empty(heads, rows),
    ]


def draw_growth(run: RunData) -> Figure | None:
    """Growth rate over amplitude of the loudest families; cycles where it crosses zero."""
    points, cycles = run.extras.get("limit_cycle_growth"), run.extras.get("limit_cycle")
    if points is None or cycles is None or not points["mode"].size:
        return None
    names = [name for name in run.approaches if name in points["approach"]]
    figure, axes = new_figure(1, len(names), sharey=True)
    for axis, approach in zip(axes[0], names, strict=True):
        for colour, family in zip(CYCLE, _loudest(run, approach), strict=False):
            own = (points["approach"] == approach) & (points["family"] == family)
            pairs = np.unique(np.array([points["sample"][own], points["mode"][own]]), axis=1).T
            for i, (sample, mode) in enumerate(pairs):
                line = own & (points["sample"] == sample) & (points["mode"] == mode)
                text = f"{frequency_text(run, approach, family)} kHz" if i == 0 else None
                axis.plot(
                    points["amplitude_um"][line], points["alpha_1_s"][line], color=colour, lw=0.9,
                    alpha=0.8, label=text,
                )  # fmt: skip
            ended = (cycles["approach"] == approach) & (cycles["family"] == family)
            for words, fill in ((ENDED, colour), ("unstable", "none")):
                at = cycles["amplitude_um"][ended & _begins(cycles, words)]
                # To the layout, unclipped markers of no points lie in the corner of the figure.
                if at.size:
                    axis.plot(at, np.zeros_like(at), "o", ms=5, mec=colour, mfc=fill, clip_on=False)
        axis.axhline(0.0, color=GREY, lw=0.8)
        axis.set_xscale("log")
        axis.set_xlabel("amplitude of the gap, rms of patches [um]")
        axis.set_title(label(run, approach))
        axis.legend()
        light_grid(axis)
    axes[0, 0].set_ylabel("growth rate alpha [1/s]")
    return figure


def draw_loudness(run: RunData) -> Figure | None:
    """Level of the loudest families over the samples."""
    cycles = run.extras.get("limit_cycle")
    if cycles is None or not np.isfinite(np.asarray(cycles[LEVEL], float)).any():
        return None
    levels, names = [], []
    for approach in run.approaches:
        for family in _loudest(run, approach):
            own = (cycles["approach"] == approach) & (cycles["family"] == family)
            own &= _begins(cycles, HEARD) & np.isfinite(cycles[LEVEL])
            if own.any():
                levels.append(cycles[LEVEL][own])
                kilo = frequency_text(run, approach, family)
                names.append(f"{kilo} kHz\n{label(run, approach)}")
    if not levels:
        return None
    figure, axes = new_figure(1, 1, height=3.0)
    axes[0, 0].boxplot(levels, whis=(5, 95), widths=0.5)
    axes[0, 0].set_xticks(range(1, len(names) + 1), names, fontsize=7.5)
    axes[0, 0].set_ylabel("sound pressure level at 1 m [dB]")
    light_grid(axes[0, 0], axis="y")
    return figure


def _loudest(run: RunData, approach: str) -> list[int]:
    table = run.extras["limit_cycle_families"]
    own = table["approach"] == approach
    return [int(family) for family in table["family"][own][:MOST]]


def frequency_text(run: RunData, approach: str, family: int) -> str:
    """Frequency of a family [kHz]: that of its squeal modes, as everywhere on the page."""
    for one in run.squeal.families(approach):
        if one.key == family:
            return one.kilohertz
    table = run.extras["limit_cycle_families"]
    own = (table["approach"] == approach) & (table["family"] == family)
    return kilohertz(table["frequency_hz"][own].tolist())[0]


def loudness_text(run: RunData, approach: str, family: int) -> str:
    """How growth of a family ends, and how loud; empty without limit cycles."""
    table = run.extras.get("limit_cycle_families")
    if table is None:
        return ""
    for i in np.flatnonzero((table["approach"] == approach) & (table["family"] == family)):
        level = float(table[f"{LEVEL}_50"][i])
        loud = f"; {level:.0f} dB at 1 m" if np.isfinite(level) else ""
        return f"{table['outcomes'][i]}{loud}"
    return ""


def _doubts(cycles: Columns) -> list[str]:
    """What single cycles cannot say, counted."""
    fast = _begins(cycles, ENDED) & (np.nan_to_num(cycles["slip_over_speed"]) > 1)
    counts = {"{} cycles exceed the sliding speed.": fast}
    counts |= {text: _begins(cycles, words) for words, text in DOUBTS.items()}
    return [text.format(int(n.sum())) for text, n in counts.items() if n.any()]


def _begins(cycles: Columns, words: str | tuple[str, ...]) -> NDArray[np.bool_]:
    """Rows whose outcome begins with one of some words."""
    return np.array([str(text).startswith(words) for text in cycles["outcome"]], dtype=bool)


def _text(value: float, form: str) -> str:
    return format(value, form) if np.isfinite(value) else "-"

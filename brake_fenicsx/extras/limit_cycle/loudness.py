"""How loud squeal becomes, from stored samples: limit_cycle*.csv, figures, blocks of the page.

A family's loudness is that of the first cycle that its growth ends at in each sample, or of the end
of its growth where nothing damps it; cycles that give way to another vibration have none. Families
are ranked by the median of the level where the faces radiate, else by that of the velocity of the
disc or of the gap; beside it stands their rank by damping.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from brake_fenicsx.report import style
from brake_fenicsx.report.page_blocks import Block, Table, Text
from brake_fenicsx.results import squeal, tables
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.stored import StoredSamples

from .cycles import HEARD, MEASURES
from .growth import GIVES_WAY

ENDED = (*HEARD, GIVES_WAY)  # outcomes at which growth ends; those of HEARD state a loudness
DOUBTS: dict[str, str] = {
    "undamped": "{} have no damping: growth ends there, but no vibration settles.",
    GIVES_WAY: "{} cycles give way to another vibration, which may be several times larger and is"
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
HEADS = (
    "approach", "family", "frequency [kHz]", "samples that grow", "how growth ends",
    "level at 1 m [dB]", "5 % to 95 % of samples [dB]", "disc velocity [mm/s]",
    "gap amplitude [um]", "rank by loudness", "rank by damping",
)  # fmt: skip

MODE = ("approach", "sample", "family", "mode")
CYCLES = (*MODE, "linear_frequency_hz", "linear_alpha_1_s", "outcome", *MEASURES)
GROWTH = (*MODE, "amplitude_um", "alpha_1_s", "frequency_hz")
OF = "approach", "family", "frequency_hz", "growing_samples", "cycles"
LOUD = "level_1m_db_5", "level_1m_db_50", "level_1m_db_95", "disc_mm_s_50", "gap_um_50"
FAMILIES = *OF, *LOUD, "rank_by_loudness", "rank_by_damping", "outcomes"
# Numbers that families are ranked by, one after the other where those before are missing or equal.
LOUDNESS = ("level_1m_db", "disc_mm_s", "gap_um")


def cycle_tables(stored: StoredSamples) -> dict[str, tables.RowTable]:
    """Tables limit_cycle, limit_cycle_growth and limit_cycle_families, by their names."""
    rows, texts = list(_cycles(stored)), ("approach", "outcome", "outcomes")
    return {
        "limit_cycle": tables.RowTable(CYCLES, rows, texts),
        "limit_cycle_growth": tables.RowTable(GROWTH, _growth(stored), texts),
        "limit_cycle_families": tables.RowTable(FAMILIES, _families(rows), texts),
    }


def _cycles(stored: StoredSamples) -> Iterator[list[Any]]:
    columns = ("cycle_mode", "cycle_kind", "cycle_values")
    for place, s, (kind, values) in _stored(stored, columns):
        numbers = (float(v) if np.isfinite(v) else None for v in values)
        yield [*place, s.imag / (2 * np.pi), s.real, str(kind), *numbers]


def _growth(stored: StoredSamples) -> Iterator[list[Any]]:
    columns = ("branch_mode", "branch_amplitude", "branch_s")
    for place, _, (a, s) in _stored(stored, columns):
        yield [*place, 1e6 * float(a), float(s.real), float(s.imag / (2 * np.pi))]


def _stored(
    stored: StoredSamples, columns: tuple[str, ...]
) -> Iterator[tuple[list[Any], complex, list[Any]]]:
    """Values of ``MODE`` of each stored row, the linear eigenvalue, and the other columns."""
    for task, data, family in stored.with_arrays("cycle_", "branch_"):
        if columns[0] not in data:
            continue
        for mode, *values in zip(*(data[name] for name in columns), strict=True):
            yield [*task, int(family[mode]), int(mode)], complex(data["s"][mode]), values


def _families(rows: list[list[Any]]) -> list[list[Any]]:
    """One row for each family of each approach, the loudest first."""
    every, out = pd.DataFrame(rows, columns=CYCLES), []
    for _, own in every.astype(dict.fromkeys(LOUDNESS, float)).groupby("approach"):
        found = [_family(members) for _, members in own.groupby("family", sort=False)]
        table = pd.DataFrame(found, columns=(*FAMILIES, "growth", "heard"))
        table["rank_by_damping"] = table.growth.rank(ascending=False, method="first")
        by = ["level_1m_db_50", "disc_mm_s_50", "gap_um_50"]
        table = table.sort_values(by, ascending=False, kind="stable", ignore_index=True)
        for rank, row in enumerate(table.to_dict("records"), 1):
            row["rank_by_loudness"] = rank if row["heard"] else None
            row["rank_by_damping"] = int(row["rank_by_damping"])
            out.append([None if row[name] != row[name] else row[name] for name in FAMILIES])
    return out


def _family(members: pd.DataFrame) -> list[Any]:
    """``FAMILIES`` of a family without its ranks; its growth over its frequency; if it is heard."""
    ended = members[members.outcome.str.startswith((*HEARD, GIVES_WAY))]
    first = ended.drop_duplicates(["sample", "mode"])
    heard = first[first.outcome.str.startswith(HEARD)]
    level = heard.level_1m_db.quantile([0.05, 0.5, 0.95])
    words = [text.partition(":")[0] for text in first.outcome[::-1]]
    words += ["no end"] * int(members.outcome.str.startswith("none").sum())
    outcomes = ", ".join(f"{n} {word}" for word, n in Counter(words).most_common())
    growth = (2 * members.linear_alpha_1_s / members.linear_frequency_hz).median()
    of = members.approach.iloc[0], members.family.iloc[0], members.linear_frequency_hz.mean()
    motion = heard.disc_mm_s.quantile(), heard.gap_um.quantile()
    loud = members["sample"].nunique(), len(first), *level, *motion, None, None
    return [*of, *loud, outcomes, growth, len(heard) > 0]


def cycle_blocks(run: RunData) -> list[Block]:
    """The loudest families in words and numbers."""
    if not len(families := _loudest(run)):
        return []
    rows = [
        [run.label(f.approach), f.family, frequency_text(run, f.approach, f.family),
         f.growing_samples, f.outcomes, _text(f.level_1m_db_50, ".0f"),
         _text(f.level_1m_db_5, ".0f", f" to {f.level_1m_db_95:.0f}"),
         _text(f.disc_mm_s_50, ".3g"), _text(f.gap_um_50, ".3g"),
         _text(f.rank_by_loudness, ".0f"), f.rank_by_damping]
        for f in families.itertuples()
    ]  # fmt: skip
    cycles = pd.DataFrame(run.extras["limit_cycle"])
    return [Text(" ".join([NOTE, *_doubts(cycles)])), Table.without_empty(HEADS, rows)]


def draw_growth(run: RunData) -> style.Figure | None:
    """Growth rate over amplitude of the loudest families; cycles where it crosses zero."""
    points, cycles = _table(run, "limit_cycle_growth"), _table(run, "limit_cycle")
    if not len(points):
        return None
    names = [name for name in run.approaches if name in set(points.approach)]
    figure, axes = style.new_figure(1, len(names), sharey=True)
    for axis, approach in zip(axes[0], names, strict=True):
        shown = _loudest(run)
        for colour, family in zip(
            style.CYCLE, shown.family[shown.approach == approach], strict=False
        ):
            text: str | None = f"{frequency_text(run, approach, family)} kHz"
            for _, line in _of(points, approach, family).groupby(["sample", "mode"]):
                looks = {"color": colour, "lw": 0.9, "alpha": 0.8, "label": text}
                axis.plot(line.amplitude_um, line.alpha_1_s, **looks)
                text = None
            ended = _of(cycles, approach, family)
            for words, fill in ((ENDED, colour), ("unstable", "none")):
                at = ended.amplitude_um[ended.outcome.str.startswith(words)]
                # To the layout, unclipped markers of no points lie in the corner of the figure.
                if at.size:
                    axis.plot(at, np.zeros_like(at), "o", ms=5, mec=colour, mfc=fill, clip_on=False)
        axis.axhline(0.0, color=style.GREY, lw=0.8)
        axis.set_xscale("log")
        axis.set_xlabel("amplitude of the gap, rms of patches [um]")
        axis.set_title(style.label(run, approach))
        axis.legend()
        style.light_grid(axis)
    axes[0, 0].set_ylabel("growth rate alpha [1/s]")
    return figure


def draw_loudness(run: RunData) -> style.Figure | None:
    """Level of the loudest families over the samples."""
    cycles, levels, names = _table(run, "limit_cycle"), [], []
    for f in _loudest(run).itertuples():
        own = _of(cycles, f.approach, f.family)
        level = own[LEVEL][own.outcome.str.startswith(HEARD)].dropna()
        if level.size:
            levels.append(level)
            kilo = frequency_text(run, f.approach, f.family)
            names.append(f"{kilo} kHz\n{style.label(run, f.approach)}")
    if not levels:
        return None
    figure, axes = style.new_figure(1, 1, height=3.0)
    axes[0, 0].boxplot(levels, whis=(5, 95), widths=0.5)
    axes[0, 0].set_xticks(range(1, len(names) + 1), names, fontsize=7.5)
    axes[0, 0].set_ylabel("sound pressure level at 1 m [dB]")
    style.light_grid(axes[0, 0], axis="y")
    return figure


def frequency_text(run: RunData, approach: str, family: int) -> str:
    """Frequency of a family [kHz]: that of its squeal modes, as everywhere on the page."""
    for one in run.squeal.families(approach):
        if one.key == family:
            return one.kilohertz
    own = _of(_table(run, "limit_cycle_families"), approach, family)
    return squeal.kilohertz(own.frequency_hz.tolist())[0]


def loudness_text(run: RunData, approach: str, family: int) -> str:
    """How growth of a family ends, and how loud; empty without limit cycles."""
    for f in _of(_table(run, "limit_cycle_families"), approach, family).itertuples():
        level = f.level_1m_db_50
        return f"{f.outcomes}; {level:.0f} dB at 1 m" if np.isfinite(level) else f.outcomes
    return ""


def _table(run: RunData, name: str) -> pd.DataFrame:
    """A table of limit cycles; without rows where the run has none."""
    return pd.DataFrame(run.extras.get(name, {"approach": [], "family": []}))


def _of(table: pd.DataFrame, approach: str, family: int) -> pd.DataFrame:
    return table[(table.approach == approach) & (table.family == family)]


def _loudest(run: RunData) -> pd.DataFrame:
    """Rows of the loudest families of each approach, approaches in the order of the page."""
    table = _table(run, "limit_cycle_families")
    each = [table[table.approach == name].head(MOST) for name in run.approaches]
    return pd.concat([table.head(0), *each])


def _doubts(cycles: pd.DataFrame) -> list[str]:
    """What single cycles cannot say, counted."""
    fast = cycles.outcome.str.startswith(ENDED) & (cycles.slip_over_speed > 1)
    counts = {"{} cycles exceed the sliding speed.": fast}
    counts |= {text: cycles.outcome.str.startswith(words) for words, text in DOUBTS.items()}
    return [text.format(int(n.sum())) for text, n in counts.items() if n.any()]


def _text(value: float, form: str, more: str = "") -> str:
    return f"{value:{form}}{more}" if np.isfinite(value) else "-"

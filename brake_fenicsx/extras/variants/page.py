"""What the pages of two runs, of countermeasures and of a budget share: figure, cells, layout."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from brake_fenicsx import __version__
from brake_fenicsx.report import style
from brake_fenicsx.report.page_blocks import Block, Picture, Text, render, write_page
from brake_fenicsx.results.squeal import kilohertz

Row = dict[str, Any]  # cells of a table by column: str, int, float, or None where empty
Ends = tuple[float, float]


@dataclass(frozen=True, slots=True)
class ShareChange:
    """A line of the figure: shares of samples that squeal before and after a change.

    Attributes:
        label: of the line.
        before: share before the change.
        after: share after it; nan if it is not known.
        ends: 95 % interval of the share after it.
        change: 95 % interval of the change.
        independent: whether the samples after it are other ones, drawn hollow.
    """

    label: str
    before: float
    after: float
    ends: Ends | None = None
    change: Ends | None = None
    independent: bool = False


def page_of_changes(
    path: Path,
    title: str,
    intro: Sequence[str],
    blocks: Sequence[Block],
    links: Sequence[tuple[str, str]] = (),
) -> Path:
    """Write a page: sentences, pictures and tables, links.

    Args:
        path: of the page, in an existing folder.
        title: its heading.
        intro: sentences below it.
        blocks: what follows.
        links: address and text.
    """
    texts, now = list(map(Text, intro)), f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC"
    shown = {"title": title, "intro": texts, "blocks": list(blocks), "links": list(links)}
    page = render("plain.html.j2", **shown, version=__version__, written=now)
    return write_page(path, page)


def picture_of(
    lines: Sequence[ShareChange], names: tuple[str, str], caption: str, own: Ends | None = None,
    limit: float | None = None,
) -> Picture:  # fmt: skip
    """Picture of some changes, the first one on top.

    Args:
        lines: the changes.
        names: what is before and after them.
        caption: text below it.
        own: 95 % interval of the scene's own share, as a change.
        limit: share that is marked.
    """

    def draw() -> style.Figure:
        """Shares before and after, and beside them the changes where they have intervals."""
        both = any(line.change for line in lines)
        rows = sum(1 + 0.6 * line.label.count("\n") for line in lines)
        figure, axes = style.new_figure(
            1, 1 + both, height=max(1.7, 0.25 * rows + 1.1), sharey=True
        )
        left, right = axes[0, 0], axes[0, -1]
        hollow = {"s": 50, "facecolor": "none", "edgecolor": style.BLUE, "lw": 1.5, "zorder": 4}
        for y, line in enumerate(lines):
            a, b = names if y == 0 else (None, None)
            left.plot([line.before, line.after], [y, y], color=style.GREY, lw=1.0, zorder=2)
            if line.ends:
                left.plot(line.ends, [y, y], color=style.GREY, lw=3.0, alpha=0.5, zorder=1)
            left.scatter([line.before], [y], label=a, **hollow)
            left.scatter(
                [line.after], [y], 22, color=style.VERMILION, marker="D", zorder=3, label=b
            )
            if line.change:
                right.plot(line.change, [y, y], color=style.GREY, lw=1.5)
            if both:
                face = "white" if line.independent else "black"
                change = [line.after - line.before]
                right.scatter(change, [y], 16, facecolor=face, edgecolor="black", zorder=3)
        left.set_yticks(range(len(lines)), [line.label.replace("$", r"\$") for line in lines])
        left.set(ylim=(len(lines) - 0.5, -0.5), xlim=(-0.03, 1.03))
        left.set_xlabel("share of samples that squeal [-]")
        left.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=2)
        if limit is not None:
            left.axvline(limit, color="black", lw=0.6, ls=":")
        if both:
            right.axvline(0.0, color="black", lw=0.6)
            right.set_xlabel("change, 95 % interval [-]")
            if own:
                right.axvspan(
                    *own, color=style.GREY, alpha=0.25, lw=0, label="interval of the scene itself"
                )
                right.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0))
        for axis in axes.flat:
            style.light_grid(axis, axis="x")
        return figure

    return Picture(style.drawn(draw), caption)


def frequency_text(hertz: float | None, among: Iterable[float | None]) -> str:
    """A frequency [Hz] in kHz, with the digits that tell it from others; a dash for None."""
    return "-" if hertz is None else kilohertz([hertz, *(f for f in among if f is not None)])[0]


def share_of(value: float | None, samples: int) -> str:
    """Share of samples that squeal; of one sample whether it does."""
    if value is None:
        return "-"
    if samples == 1:
        return "yes" if value else "no"
    return f"{100 * value:.0f} % of {samples}"


def change_of(row: Row) -> str:
    """Change of a probability, with its interval where chance has a part in it."""
    ends, text = interval_of(row), f"{row['change']:+.3f}"
    return text if ends is None else f"{text} ({ends[0]:+.3f} to {ends[1]:+.3f})"


def interval_of(row: Row) -> Ends | None:
    """Ends of the interval of a change; None without."""
    return None if row["change_low"] is None else (row["change_low"], row["change_high"])

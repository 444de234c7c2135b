"""Two countermeasures together: the share of samples that squeal over a grid of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

from brake_fenicsx.arguments import Array, Ints
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.log import logger
from brake_fenicsx.folder.processes import on_first
from brake_fenicsx.report import style
from brake_fenicsx.report.page_blocks import Picture, Table, Text
from brake_fenicsx.results.answer import share_text
from brake_fenicsx.results.tables import Value, text_table, write_rows
from brake_fenicsx.scene.keys import dotted, key_parts
from brake_fenicsx.scene.scalars import changes_bodies
from brake_fenicsx.scene.units import quantity_text, to_si, usual_unit

from .countermeasure_keys import Countermeasure
from .countermeasures import Search
from .countermeasures_page import AFTER, percent_text, short_quantity, verified_text, what_is_wanted
from .page import Row, page_of_changes
from .trial import MOST, Worst, allowed, limits

MOST_POINTS = 50  # along one side
SHARE = "squeal", "samples", "share", "share_low", "share_high"
COLUMNS = "value_1", "value_2", *SHARE, "enough", "smallest"
HEADS = ("smallest change of both", "samples that squeal (exact 90 % interval)",
         "in a run with it", "any family there", "verified by a run", "note")  # fmt: skip


@dataclass(frozen=True, slots=True)
class Grid:
    """Samples that squeal over two numbers.

    Attributes:
        levers: the two.
        values: from the scene's to the farthest of each, SI, shape (points,).
        hits: of ``samples`` that squeal, shape (points, points).
        samples: how many there are.
    """

    levers: tuple[Countermeasure, Countermeasure]
    values: tuple[Array, Array]
    hits: Ints
    samples: int

    @property
    def smallest(self) -> tuple[int, int] | None:
        """Place of the smallest change that is enough: least sum of both, each over its range.

        Of equal ones that after which fewer samples squeal; None where none is enough.
        """
        steps = np.add.outer(np.arange(len(self.hits)), np.arange(self.hits.shape[1]))
        share = self.hits / self.samples
        cost = np.where(self.hits <= allowed(self.samples), steps + share / 2, np.inf)
        i, j = np.unravel_index(int(np.argmin(cost)), cost.shape)
        return (int(i), int(j)) if np.isfinite(cost[i, j]) else None


def find_together(
    scene: str | Path,
    comm: MPI.Comm,
    directory: str | Path | None = None,
    overrides: Sequence[str] = (),
    cache: str | Path | None = None,
    keys: Sequence[str] = (),
    points: int = 6,
) -> Path | None:
    """Try two countermeasures of a scene together, on a grid, and verify the smallest change.

    What an earlier call in the folder finished is not done again; collective.

    Args:
        scene: path of the scene.
        comm: processes that share the work.
        directory: folder of the results; SCENE-countermeasures in the working directory if not
            given.
        overrides: "key=value" replacements in the scene.
        cache: folder of laws and reduced models that runs share; one in the folder if not given.
        keys: of the two.
        points: values of each, from the scene's to the farthest.

    Returns:
        The page; None where nothing is to be stopped.

    Raises:
        SceneError: the scene is wrong or does not name both, or the folder holds others.
        BrakeError: the run of the scene as it is failed.
    """
    search = Search(scene, comm, directory, overrides, cache)
    named = {c.key: c for c in search.scene.section("countermeasures")}
    keys = [dotted(*key_parts(key)) for key in keys]
    if len({*keys}) != 2 or not named.keys() >= {*keys}:
        raise SceneError(f"""--together {" ".join(keys)}: name two of the scene's countermeasures,
            {", ".join(named)}""")
    if points not in range(2, MOST_POINTS + 1):
        raise SceneError(f"--points {points}: give 2 to {MOST_POINTS} values of each number")
    # Along the first one, samples begin at each other's equilibria.
    first, second = sorted(
        (named[k] for k in keys), key=lambda c: changes_bodies(search.scene, c.key)
    )
    search.changes({first: first.stop, second: second.stop})
    if (worst := search.worst()) is None:
        return None
    grid = _grid(search, worst, first, second, points)
    search.release()
    at, notes = grid.smallest, ["no pair of values is sufficient"]
    verified: Row = {"verified": "no"}
    if at is not None:
        pair = {c: float(v[i]) for c, v, i in zip(grid.levers, grid.values, at, strict=True)}
        verified, notes = search.verified("after-together", pair, worst)
    cells = _cells(grid, verified, "; ".join([*notes, *search.about(*grid.levers)]))
    if comm.rank == 0:
        print(text_table(HEADS, [cells]))
    return on_first(
        partial(_write, search.runs.folder, worst, grid, cells, "share_after" in verified), comm
    )


def _grid(
    search: Search, worst: Worst, first: Countermeasure, second: Countermeasure, points: int
) -> Grid:
    """Samples that squeal at every pair of values; collective."""
    name = f"{first.key} x {second.key}, {points}"
    known: list[list[int]] = search.found.get(name, {}).get("hits", [])
    x, y = (np.asarray(np.linspace(c.start, c.stop, points), float) for c in (first, second))
    if len(known) < points:
        trial = search.trial(worst, first, second)
        for value in map(float, y[len(known) :]):
            logger.info("%s = %s: samples ...", second.key, quantity_text(value, second.unit))
            fixed = {second.key: value}
            known = [*known, [sum(trial.outcomes(float(v), fixed)) for v in x]]
            search.keep(name, {"hits": known})
    return Grid((first, second), (x, y), np.array(known).T, len(worst.samples))


def _cells(grid: Grid, verified: Row, note: str) -> list[Any]:
    """The one row of the page, in the order of HEADS."""
    fewest = np.unravel_index(int(np.argmin(grid.hits)), grid.hits.shape)
    at = grid.smallest or (int(fewest[0]), int(fewest[1]))
    there = zip(grid.levers, grid.values, at, strict=True)
    said = ("" if grid.smallest else "none; fewest samples squeal with ") + ", ".join(
        f"{c.key} = {short_quantity(v[i], c.unit)}{'' if i else ' (as now)'}" for c, v, i in there
    )
    hits = int(grid.hits[at])
    share = hits / grid.samples, *limits(hits, grid.samples)
    after = share_text(*map(verified.get, AFTER)) if grid.smallest else "-"
    loud = percent_text(verified.get("any_after"))
    return [said, share_text(*share), after, loud, verified_text(verified), note]


def _write(folder: Path, worst: Worst, grid: Grid, cells: list[Any], ran: bool) -> Path:
    """together.csv and together.html."""
    rows: list[list[Value]] = []
    for (i, j), hits in np.ndenumerate(grid.hits):
        pair = [float(v[k]) for v, k in zip(grid.values, (i, j), strict=True)]
        ends = limits(int(hits), grid.samples)
        enough = "yes" if hits <= allowed(grid.samples) else "no"
        best = "yes" if (i, j) == grid.smallest else "no"
        rows.append(
            [*pair, int(hits), grid.samples, float(hits / grid.samples), *ends, enough, best]
        )
    write_rows(folder / "together.csv", COLUMNS, rows)
    return page_of_changes(
        folder / "together.html",
        "Two countermeasures together",
        what_is_wanted(worst, "Sufficient"),
        [
            Picture(style.drawn(partial(draw_grid, grid)),
                    "Share of samples in which the worst family squeals over both numbers. Circle:"
                    " the scene; star: the smallest sufficient change, the least sum of both"
                    " relative to their ranges."),
            Text("Verified: in a whole run with both changes the interval of the worst family lies"
                 f" below {100 * MOST:.0f} %."),
            Table(HEADS, [cells]),
        ],
        [("after-together/compare.html", "the scene before and after")] if ran else [],
    )  # fmt: skip


def draw_grid(grid: Grid) -> style.Figure:
    """Shares over both numbers, in the units of the scene's habits."""
    figure, axes = style.new_figure(1, 1, height=4.2, width=6.4)
    axis, units = axes[0, 0], [usual_unit(c.unit) for c in grid.levers]
    x, y = (
        v / (to_si(f"1 {unit}", c.unit) if unit else 1.0)
        for v, unit, c in zip(grid.values, units, grid.levers, strict=True)
    )
    share = grid.hits / grid.samples
    cells = axis.pcolormesh(x, y, share.T, cmap="cividis", vmin=0, vmax=max(share.max(), MOST))
    figure.colorbar(cells, label="share of samples that squeal [-]")
    few = len(share) <= 12
    for (i, j), value in np.ndenumerate(share) if few else ():
        dark = value < 0.5 * share.max()
        axis.text(x[i], y[j], f"{100 * value:.0f} %", ha="center", va="center", fontsize=7,
                  color="white" if dark else "black")  # fmt: skip
    whole: dict[str, Any] = {"color": "white", "mec": "black", "clip_on": False, "ls": "none"}
    shift = 0.3 * (y[1] - y[0]) if few else 0.0
    axis.plot(x[0], y[0] + shift, "o", ms=8, label="scene", **whole)
    if (at := grid.smallest) is not None:
        axis.plot(x[at[0]], y[at[1]] + shift, "*", ms=13, label="smallest change", **whole)
    for name, c, unit in zip("xy", grid.levers, units, strict=True):
        key = c.key.replace("$", r"\$")
        axis.set(**{f"{name}label": f"{key} [{unit or '-'}]"})
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=2)
    return figure

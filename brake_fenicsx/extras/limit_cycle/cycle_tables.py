"""limit_cycle*.csv: how large squeal becomes, from stored samples, and families ranked by it.

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
from numpy.typing import NDArray

from brake_fenicsx.extras.limit_cycle.floquet import GIVES_WAY, UNDECIDED
from brake_fenicsx.extras.limit_cycle.growth import STABLE, UNDAMPED
from brake_fenicsx.extras.limit_cycle.sample import HEARD, MEASURES
from brake_fenicsx.results.stored import StoredSamples
from brake_fenicsx.results.tables import RowTable

MODE = ("approach", "sample", "family", "mode")
CYCLES = (*MODE, "linear_frequency_hz", "linear_alpha_1_s", "outcome", *MEASURES)
GROWTH = (*MODE, "amplitude_um", "alpha_1_s", "frequency_hz")
FAMILIES = (
    "approach", "family", "frequency_hz", "growing_samples", "cycles", "level_1m_db_5",
    "level_1m_db_50", "level_1m_db_95", "disc_mm_s_50", "gap_um_50", "rank_by_loudness",
    "rank_by_damping", "outcomes",
)  # fmt: skip
LOUDNESS = ("level_1m_db", "disc_mm_s", "gap_um")


def cycle_tables(stored: StoredSamples) -> dict[str, RowTable]:
    """Tables limit_cycle, limit_cycle_growth and limit_cycle_families, by their names."""
    rows, texts = list(_cycles(stored)), ("approach", "outcome", "outcomes")
    return {
        "limit_cycle": RowTable(CYCLES, rows, texts),
        "limit_cycle_growth": RowTable(GROWTH, _growth(stored), texts),
        "limit_cycle_families": RowTable(FAMILIES, _families(rows), texts),
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
    members: dict[tuple[str, int], list[dict[str, Any]]] = {}
    for row in rows:
        named = dict(zip(CYCLES, row, strict=True))
        members.setdefault((named["approach"], named["family"]), []).append(named)
    out = []
    for approach in dict.fromkeys(name for name, _ in members):
        own = [(number, found) for (name, number), found in members.items() if name == approach]
        first = [_first_cycles(found) for _, found in own]
        heard = [[c for c in cycles if c["outcome"].startswith(HEARD)] for cycles in first]
        loud = _ranks([[_median(cycles, name) for name in LOUDNESS] for cycles in heard])
        calm = _ranks([
            [np.median([2 * m["linear_alpha_1_s"] / m["linear_frequency_hz"] for m in found])]
            for _, found in own
        ])  # fmt: skip
        each = zip(own, first, heard, loud, calm, strict=True)
        for (number, found), ended, cycles, rank, damping in sorted(each, key=lambda x: x[3]):
            levels = [c["level_1m_db"] for c in cycles if c["level_1m_db"] is not None]
            spread = np.quantile(levels, [0.05, 0.5, 0.95]).tolist() if levels else [None] * 3
            out.append([
                approach, number, float(np.mean([m["linear_frequency_hz"] for m in found])),
                len({m["sample"] for m in found}), len(ended), *spread,
                _median(cycles, "disc_mm_s"), _median(cycles, "gap_um"),
                rank if cycles else None, damping, _outcomes(ended, found),
            ])  # fmt: skip
    return sorted(out, key=lambda row: row[0])


def _outcomes(ended: list[dict[str, Any]], members: list[dict[str, Any]]) -> str:
    """How many modes end their growth in which way, such as "3 stable, 1 gives way"."""
    words = [c["outcome"].partition(":")[0] for c in ended]
    words += ["no end" for m in members if m["outcome"].startswith("none")]
    return ", ".join(f"{n} {word}" for word, n in Counter(words).most_common())


def _first_cycles(members: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The first cycle that growth ends at, of each mode of each sample."""
    ended = [
        m for m in members if m["outcome"].startswith((STABLE, GIVES_WAY, UNDECIDED, UNDAMPED))
    ]
    return list({(m["sample"], m["mode"]): m for m in reversed(ended)}.values())


def _median(cycles: list[dict[str, Any]], name: str) -> float | None:
    values = [c[name] for c in cycles if c[name] is not None]
    return float(np.median(values)) if values else None


def _ranks(values: list[list[float | None]]) -> NDArray[np.intp]:
    """Ranks from 1 for the largest; a column decides where those before it are missing or equal."""
    keys = [[-np.inf if v is None else float(v) for v in row] for row in values]
    order = sorted(range(len(keys)), key=lambda i: keys[i], reverse=True)
    ranks = np.zeros(len(keys), dtype=np.intp)
    ranks[order] = np.arange(1, len(keys) + 1)
    return ranks

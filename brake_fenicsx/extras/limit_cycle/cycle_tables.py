"""limit_cycle*.csv: how large squeal becomes, from stored samples, and families ranked by it.

A family's loudness is that of the first cycle that its growth ends at in each sample, or of the end
of its growth where nothing damps it; cycles that give way to another vibration have none. Families
are ranked by the median of the level where the faces radiate, else by that of the velocity of the
disc or of the gap; beside it stands their rank by damping.
"""

from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from brake_fenicsx.results.stored import StoredSamples
from brake_fenicsx.results.tables import RowTable

from .cycles import HEARD, MEASURES
from .growth import GIVES_WAY

MODE = ("approach", "sample", "family", "mode")
CYCLES = (*MODE, "linear_frequency_hz", "linear_alpha_1_s", "outcome", *MEASURES)
GROWTH = (*MODE, "amplitude_um", "alpha_1_s", "frequency_hz")
FAMILIES = (
    "approach", "family", "frequency_hz", "growing_samples", "cycles", "level_1m_db_5",
    "level_1m_db_50", "level_1m_db_95", "disc_mm_s_50", "gap_um_50", "rank_by_loudness",
    "rank_by_damping", "outcomes",
)  # fmt: skip
# Numbers that families are ranked by, one after the other where those before are missing or equal.
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
    return [
        members.approach.iloc[0], members.family.iloc[0], members.linear_frequency_hz.mean(),
        members["sample"].nunique(), len(first), *level, heard.disc_mm_s.quantile(),
        heard.gap_um.quantile(), None, None, outcomes, growth, len(heard) > 0,
    ]  # fmt: skip

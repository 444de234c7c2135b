"""What the candidates of the first screen leave out: doublets, and worse modes elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from .counts import FamilyCount, good_modes
from .rundata import RunData

CANDIDATES = 3
CLOSE = 0.01  # relative distance of two frequencies that may be those of a doublet


def beside_candidates(
    run: RunData, families: Mapping[str, list[FamilyCount]], lead: str
) -> list[str]:
    """Sentences about the candidates, which are the most severe families of one approach.

    Args:
        run: the results.
        families: of each approach, the most severe first.
        lead: approach of the candidates.

    Returns:
        Neighbours that may be one doublet, and the worst mode of another approach where it has a
        lower damping than all candidates.
    """
    chosen = families[lead][:CANDIDATES]
    return [*_doublets(run, families[lead], chosen), *_worse(run, families, lead, chosen)]


def _doublets(run: RunData, found: list[FamilyCount], chosen: list[FamilyCount]) -> list[str]:
    """Two modes of one shape turned by an angle may change their numbers between samples."""
    numbered = [f for f in found if f.family >= 0 and f.share.n > 1]
    numbered.sort(key=lambda f: f.frequency)
    said = []
    for pair in pairwise(numbered):
        low, high = pair
        if high.frequency - low.frequency > CLOSE * high.frequency or not {*pair} & {*chosen}:
            continue
        modes = good_modes(run, low.approach, squeal=True)
        own = np.isin(modes["family"], [f.family for f in pair])
        hits = np.unique(modes["sample"][own]).size
        one, two = (f"{f.frequency / 1e3:.3f}" for f in sorted(pair, key=found.index))
        said.append(
            f"{one} and {two} kHz lie close together and may be one doublet: at least one squeals"
            f" in {hits} of {low.share.n} samples."
        )
    return said


def _worse(
    run: RunData,
    families: Mapping[str, list[FamilyCount]],
    lead: str,
    chosen: list[FamilyCount],
) -> list[str]:
    """The mode of lowest damping of another approach, where no candidate has a lower one."""
    others = [f for name, found in families.items() if name != lead for f in found]
    if not others or not chosen:
        return []
    worst = min(others, key=lambda f: f.worst)
    if worst.worst >= min(f.worst for f in chosen):
        return []
    modes = good_modes(run, worst.approach, squeal=True)
    frequency = modes["frequency_hz"][np.argmin(modes["damping"])]
    return [
        f"Another approach has a mode with a lower damping: {frequency / 1e3:.3f} kHz, damping"
        f" {worst.worst:.2g} ({run.label(worst.approach)})."
    ]

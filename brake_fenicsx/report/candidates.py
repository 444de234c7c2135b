"""What the candidates of the first screen leave out: doublets, and worse modes elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.squeal import Family

CANDIDATES = 3
CLOSE = 0.01  # relative distance of two frequencies that may be those of a doublet


def beside_candidates(run: RunData, families: Mapping[str, list[Family]], lead: str) -> list[str]:
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


def _doublets(run: RunData, found: list[Family], chosen: list[Family]) -> list[str]:
    """Two modes of one shape turned by an angle may change their numbers between samples."""
    numbered = [f for f in found if f.key >= 0 and f.share.n > 1]
    numbered.sort(key=lambda f: f.frequency)
    said = []
    for pair in pairwise(numbered):
        low, high = pair
        if high.frequency - low.frequency > CLOSE * high.frequency or not {*pair} & {*chosen}:
            continue
        modes = run.squeal.squeal_modes(low.approach)
        hits = modes["sample"][modes.key.isin([f.key for f in pair])].nunique()
        one, two = (f"{f.frequency / 1e3:.3f}" for f in sorted(pair, key=found.index))
        said.append(
            f"{one} and {two} kHz lie close together and may be one doublet: at least one squeals"
            f" in {hits} of {low.share.n} samples."
        )
    return said


def _worse(
    run: RunData,
    families: Mapping[str, list[Family]],
    lead: str,
    chosen: list[Family],
) -> list[str]:
    """The mode of lowest damping of another approach, where no candidate has a lower one."""
    others = [f for name, found in families.items() if name != lead for f in found]
    if not others or not chosen:
        return []
    worst = min(others, key=lambda f: f.worst)
    if worst.worst >= min(f.worst for f in chosen):
        return []
    modes = run.squeal.squeal_modes(worst.approach)
    frequency = modes.frequency_hz[modes.damping.idxmin()]
    return [
        f"Another approach has a mode with a lower damping: {frequency / 1e3:.3f} kHz, damping"
        f" {worst.worst:.2g} ({run.label(worst.approach)})."
    ]

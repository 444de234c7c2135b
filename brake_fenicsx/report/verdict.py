"""The first screen of the page: verdict, strongest candidates, conditions, warnings."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from brake_fenicsx.results.ensemble_statistics import wilson
from brake_fenicsx.results.limits import limit_rows
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.squeal import ApproachCount, Family
from brake_fenicsx.results.tables import Value

from .figures import lost_figures
from .mode_cards import Card, ModePictures, family_card
from .overview import open_points, share_text
from .page_blocks import Block, Table

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
        one, two = (f.kilohertz for f in sorted(pair, key=found.index))
        said.append(
            f"{one} and {two} kHz lie close together and may be one doublet: at least one squeals"
            f" in {hits} of {low.share.n} samples."
        )
    return said


def _worse(
    run: RunData, families: Mapping[str, list[Family]], lead: str, chosen: list[Family]
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


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a reader sees first.

    Attributes:
        text: the verdict in one sentence; empty if the run has none.
        level: "squeal", "open" or "calm", for its colour.
        limits: table of what squeals at each limit of the damping; the text follows it.
        more: sentences that follow it.
        cards: the strongest candidates.
        notes: sentences about the candidates, below them.
        facts: conditions of the run, name and value.
        warnings: warnings of the run, without a full stop.
        blocks: what follows them.
    """

    text: str = ""
    level: str = ""
    limits: list[Block] = field(default_factory=list)
    more: list[str] = field(default_factory=list)
    cards: list[Card] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    facts: list[tuple[str, str]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    blocks: list[Block] = field(default_factory=list)


def make_verdict(
    run: RunData, families: Mapping[str, list[Family]], lead: str, pictures: ModePictures
) -> Verdict:
    """The first screen of a run with modes.

    Args:
        run: the results.
        families: of each approach, the most severe first.
        lead: approach that the verdict is about; empty without one.
        pictures: pictures of mode shapes.
    """
    facts, warnings = conditions(run, lead), warnings_of(run)
    if not lead:
        return Verdict("This run computed no modes.", facts=facts, warnings=warnings)
    counted = run.squeal.count(lead)
    text, level = _sentence(run, counted)
    others = [name for name in families if name != lead]
    more = _failure(run, counted)
    more += [_other(run, run.squeal.count(name), families[name]) for name in others]
    cards = [
        family_card(run, f, pictures, rank)
        for rank, f in enumerate(families[lead][:CANDIDATES], start=1)
    ]
    notes = beside_candidates(run, families, lead)
    return Verdict(text, level, _limits(run, counted), more, cards, notes, facts, warnings)


def leading_approach(run: RunData) -> str:
    """The approach with the most of what varies, of those with good samples; several of them first.

    Args:
        run: the results.

    Returns:
        Its name; empty without modes and samples.
    """
    counts = [run.squeal.count(name) for name in run.approaches]
    several = [c.approach for c in counts if c.samples > 1]
    good = [c.approach for c in counts if c.samples]
    return (several or good or run.approaches or [""])[-1]


def warnings_of(run: RunData) -> list[str]:
    """Warnings of the run, and what its computation leaves open."""
    found = run.summary.get("warnings")
    lines = [str(text) for text in found] if isinstance(found, list) else []
    lines += lost_figures(run.directory)
    return [*lines, text] if (text := open_points(run)) else lines


def _sentence(run: RunData, c: ApproachCount) -> tuple[str, str]:
    name, share = run.label(c.approach), wilson(c.squeal_samples, c.samples)
    if c.samples == 0:
        said = "the only sample" if c.failed == 1 else f"all {c.failed} samples"
        return f"No verdict: {said} failed ({name}).", ""
    limit = f"with a {run.criterion}"
    if c.samples == 1:
        if c.squeal:
            modes = f"{c.squeal} squeal mode{'' if c.squeal == 1 else 's'}"
            return f"Squeal is predicted: {modes} {limit} in one run ({name}).", "squeal"
        return f"No squeal mode {limit} in one run ({name}).", "calm"
    interval = f"95 % interval {100 * share.low:.0f} to {100 * share.high:.0f} %"
    said = (
        f"{c.squeal_samples} of {c.samples} samples have a squeal mode {limit}"
        f" ({100 * share.value:.0f} %, {interval}; {name})."
    )
    most = settings_in_effect(run, "samples").get("limit", 0.5)
    if c.squeal_samples == 0:
        return f"No squeal was found: {said}", "calm"
    if share.low > most:
        return f"Squeal is likely at the limit of the scene: {said}", "squeal"
    if share.high < most:
        return f"Squeal is possible: {said}", "open"
    return (
        f"Squeal is possible, its probability may lie on either side of {100 * most:g} %: {said}",
        "open",
    )


def _failure(run: RunData, c: ApproachCount) -> list[str]:
    """The most frequent error, where all samples of an approach failed."""
    if c.samples or not c.failed or run.samples is None:
        return []
    own = run.samples["approach"] == c.approach
    texts = [str(text) for text in run.samples["status"][own]]
    kinds = [re.sub(r"\d+", "0", text) for text in texts]  # their numbers differ between samples
    kind, number = Counter(kinds).most_common(1)[0]
    first = kinds.index(kind)
    sample, text = run.samples["sample"][own][first], texts[first].rstrip(".")
    often = f"The most frequent error ({number} of {c.failed}), here of sample {sample}"
    return [f"{often if c.failed > 1 else 'Its error'}: {text}."]


def _limits(run: RunData, c: ApproachCount) -> list[Block]:
    """What squeals at each limit of the damping."""
    what = "samples that squeal" if c.samples > 1 else "squeal modes"
    rows: list[list[Value]] = []
    for r in limit_rows(run, [c.approach]):
        share = share_text(r.share, r.share_low, r.share_high)
        counted = f"{r.squeal_samples} of {r.samples}: {share}"
        rows.append([
            r.limit, f"{r.damping_below:g}", counted if c.samples > 1 else str(r.squeal_modes)
        ])  # fmt: skip
    return [Table(["limit", "damping below", what], rows)] if rows else []


def _other(run: RunData, c: ApproachCount, found: list[Family]) -> str:
    """One sentence about an approach that the verdict is not about."""
    name = run.label(c.approach)
    if c.samples == 0:
        return " ".join([f"{name}: all samples failed.", *_failure(run, c)])
    if not found:
        return f"{name}: no squeal mode."
    most = f"most severe {found[0].kilohertz} kHz (damping {found[0].median:.2g})"
    if c.samples == 1:
        return f"{name}: {c.squeal} squeal mode{'' if c.squeal == 1 else 's'}, {most}."
    return f"{name}: {c.squeal_samples} of {c.samples} samples squeal, {most}."


UNDAMPED = "none named"


def conditions(run: RunData, lead: str) -> list[tuple[str, str]]:
    """Under which conditions the brake was studied, name and value.

    Args:
        run: the results; its summary is read.
        lead: approach whose forces are shown.
    """
    return [
        (name, text)
        for name, text in (
            ("Friction coefficient", _friction(run)),
            ("Load", _loads(run)),
            ("Damping", UNDAMPED if run.damping == "" and run.modes is not None else run.damping),
            ("Speed", _speed(run)),
            *_forces(run, lead),
            ("Samples", _samples(run)),
            ("Squeal", _squeal(run)),
        )
        if text
    ]


def settings_in_effect(run: RunData, section: str) -> Mapping[str, Any]:
    """Values of a section of the scene, defaults too; empty where there are none.

    Args:
        run: the results.
        section: its name.
    """
    found = run.summary.get("in_effect", {}).get(section)
    return found if isinstance(found, Mapping) else {}


def _friction(run: RunData) -> str:
    found = run.summary.get("friction")
    if not isinstance(found, Mapping) or not found:
        return ""
    if len({*found.values()}) == 1:
        return str(next(iter(found.values())))
    return ", ".join(f"{run.label(name)} {text}" for name, text in found.items())


def _loads(run: RunData) -> str:
    said = []
    for face, load in settings_in_effect(run, "loads").items():
        if isinstance(load, Mapping):
            if (p := load.get("pressure")) is not None:
                said.append(f"{p / 1e6:.4g} MPa on {face}")
            if (force := load.get("force")) is not None:
                said.append(f"force ({', '.join(f'{x:.4g}' for x in force)}) N on {face}")
            said += [f"{kind} on {face}" for kind in ("moment", "displacement") if kind in load]
    return ", ".join(said)


def _speed(run: RunData) -> str:
    return str(settings_in_effect(run, "motion").get("speed") or "")


def _forces(run: RunData, lead: str) -> list[tuple[str, str]]:
    """Normal force of each pad and brake torque of all, means over the samples."""
    found = run.summary.get("contact_forces")
    pads = found.get(lead) if isinstance(found, Mapping) else None
    if not isinstance(pads, Mapping) or not pads:
        return []
    normal = [f"{pad['normal_N']:.4g} N" for pad in pads.values()]
    said = ", ".join(dict.fromkeys(normal))
    if len(normal) > 1:
        said += f" on each of {len(normal)} pads" if len({*normal}) == 1 else ""
    facts = [("Normal force", said)]
    torques = [pad.get("torque_N_m") for pad in pads.values()]
    if all(isinstance(x, int | float) for x in torques):
        facts.append(("Brake torque", f"{sum(torques):.4g} N m"))
    return facts


def _samples(run: RunData) -> str:
    counts = [run.squeal.count(name) for name in run.approaches]
    return ", ".join(
        f"{run.label(c.approach)} {c.samples}" + (f" ({c.failed} failed)" if c.failed else "")
        for c in counts
    )


def _squeal(run: RunData) -> str:
    """What counts as squeal, and in which band."""
    if run.modes is None:
        return ""
    band, where = settings_in_effect(run, "stability").get("band"), ""
    if isinstance(band, list) and len(band) == 2:
        where = f", {band[0] / 1e3:g} to {band[1] / 1e3:g} kHz"
    return f"unstable mode with {run.criterion}{where}"

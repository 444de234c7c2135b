"""The first screen of the page: verdict, strongest candidates, conditions, warnings."""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

from brake_fenicsx.results.answer import limit_rows, open_points, share_text
from brake_fenicsx.results.ensemble_statistics import Proportion, wilson
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.squeal import ApproachCount, Family

from . import figures, page_blocks
from .mode_cards import Card, ModePictures, family_card, mode_text

CANDIDATES = 3
CLOSE = 0.01  # relative distance of two frequencies that may be those of a doublet
ENOUGH = 300  # samples; of fewer the verdict says what so many would narrow the interval to
WIDE = 0.1  # width of an interval from which it does
UNDAMPED = "none named"
# Warnings of pictures and files, which leave modes and counts as they are.
ASIDE = re.compile(r" left out: |^shape of the mode |^results in .* differ|not read: ")


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a reader sees first.

    Attributes:
        text: the verdict in one sentence; empty if the run has none.
        level: "squeal", "open" or "calm", for its colour.
        limits: table of what squeals at each limit of the damping; it follows the text.
        more: sentences that follow it.
        warnings: what the verdict depends on beside the samples, without a full stop.
        cards: the strongest candidates.
        notes: sentences about the candidates, below them.
        facts: conditions of the run, name and value.
    """

    text: str = ""
    level: str = ""
    limits: list[page_blocks.Block] = field(default_factory=list)
    more: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    cards: list[Card] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    facts: list[tuple[str, str]] = field(default_factory=list)


def make_verdict(run: RunData, pictures: ModePictures) -> Verdict:
    """The first screen of a run of a brake; its verdict is about ``run.lead``.

    Args:
        run: the results.
        pictures: pictures of mode shapes.
    """
    facts, warnings, families = conditions(run), warnings_of(run)[0], run.families
    if not run.lead:
        return Verdict("This run computed no modes.", facts=facts, warnings=warnings)
    counted, chosen = run.squeal.count(run.lead), families[run.lead][:CANDIDATES]
    text, level, more = _sentences(run, counted, pictures)
    more += _failure(run, counted)
    others = [name for name in families if name != run.lead]
    more += [_other(run, run.squeal.count(name), families[name]) for name in others]
    warnings = [*filter(None, [open_points(run)]), *warnings]
    cards = [family_card(run, f, pictures, rank) for rank, f in enumerate(chosen, start=1)]
    notes = [*_doublets(run, chosen), *_worse(run, chosen)]
    return Verdict(text, level, _limits(run, counted), more, warnings, cards, notes, facts)


def warnings_of(run: RunData) -> tuple[list[str], list[str]]:
    """Warnings that change what a reader believes of the verdict, and those that do not."""
    found = run.summary.get("warnings")
    every = [*map(str, found)] if isinstance(found, list) else []
    aside = [text for text in every if ASIDE.search(text)]
    return [t for t in every if t not in aside], [*aside, *figures.lost_figures(run.directory)]


def _sentences(
    run: RunData, c: ApproachCount, pictures: ModePictures
) -> tuple[str, str, list[str]]:
    """The verdict, its level, and the sentences that say how sure it is."""
    name, limit = run.label(c.approach), f"with a {run.criterion}"
    if c.samples == 0:
        said = "the only sample" if c.failed == 1 else f"all {c.failed} samples"
        return f"No verdict: {said} failed ({name}).", "", []
    if c.squeal == 0:
        if c.samples == 1:
            return f"No squeal mode {limit} in one run ({name}).", "calm", []
        share = wilson(0, c.samples)
        said = f"No squeal was found: a squeal mode {limit} in {_often(share, name)}."
        return said, "calm", _few(share)
    worst = run.families[c.approach][0]
    where = f"{worst.kilohertz} kHz{mode_text(run, worst, pictures)}"
    if c.samples == 1:
        modes = f"{c.squeal} squeal mode{'' if c.squeal == 1 else 's'}"
        said = f"Squeal is predicted at {where}: {modes} {limit} in one run ({name})."
        return said, "squeal", []
    share, most = wilson(c.squeal_samples, c.samples), run.in_effect("samples").get("limit", 0.5)
    if share.low > most:
        said, level = "Squeal is likely at the limit of the scene", "squeal"
    elif share.high < most:
        said, level = "Squeal is possible", "open"
    else:
        said = f"Squeal is possible, its probability may lie on either side of {100 * most:g} %"
        level = "open"
    more = _few(worst.share)
    if worst.share.hits != share.hits:
        more = [f"At least one squeal mode {limit} in {_often(share)}.", *more]
    return f"{said}: {where}, in {_often(worst.share, name)}.", level, more


def _often(share: Proportion, *about: str) -> str:
    """In how many samples, with the interval of the probability."""
    often = f"all {share.n}" if share.hits == share.n else f"{share.hits} of {share.n}"
    interval = f"95 % interval {100 * share.low:.0f} to {100 * share.high:.0f} %"
    return f"{often} samples ({'; '.join([interval, *about])})"


def _few(share: Proportion) -> list[str]:
    """What more samples would narrow an interval to, where it is wide."""
    if share.n >= ENOUGH or share.high - share.low < WIDE:
        return []
    more = wilson(round(share.value * ENOUGH), ENOUGH)
    now, then = (50 * (s.high - s.low) for s in (share, more))
    return [
        f"{share.n} samples are few (+-{now:.0f} %): {ENOUGH} with the same share would give"
        f" {100 * more.low:.0f} to {100 * more.high:.0f} % (+-{then:.1g} %)."
    ]


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


def _limits(run: RunData, c: ApproachCount) -> list[page_blocks.Block]:
    """What squeals at each limit of the damping."""
    what = "samples that squeal" if c.samples > 1 else "squeal modes"
    rows = []
    for r in limit_rows(run, [c.approach]):
        counted = str(r.squeal_modes)
        if c.samples > 1:
            share = share_text(r.share, r.share_low, r.share_high)
            counted = f"{r.squeal_samples} of {r.samples}: {share}"
        rows.append([r.limit, f"{r.damping_below:g}", counted])
    return [page_blocks.Table(["limit", "damping below", what], rows)] if rows else []


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


def _doublets(run: RunData, chosen: list[Family]) -> list[str]:
    """Two modes of one shape turned by an angle may change their numbers between samples."""
    found = run.families[run.lead]
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


def _worse(run: RunData, chosen: list[Family]) -> list[str]:
    """The mode of lowest damping of another approach, where no candidate has a lower one."""
    others = [f for name, found in run.families.items() if name != run.lead for f in found]
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


def conditions(run: RunData) -> list[tuple[str, str]]:
    """Under which conditions the brake was studied, name and value; forces are of ``run.lead``."""
    return [
        (name, text)
        for name, text in (
            ("Friction coefficient", _friction(run)),
            ("Load", _loads(run)),
            ("Damping", UNDAMPED if run.damping == "" and run.modes is not None else run.damping),
            ("Speed", _speed(run)),
            *_forces(run),
            ("Samples", _samples(run)),
            ("Squeal", _squeal(run)),
        )
        if text
    ]


def _friction(run: RunData) -> str:
    found = run.summary.get("friction")
    if not isinstance(found, Mapping) or not found:
        return ""
    if len({*found.values()}) == 1:
        return str(next(iter(found.values())))
    return ", ".join(f"{run.label(name)} {text}" for name, text in found.items())


def _loads(run: RunData) -> str:
    said = []
    for face, load in run.in_effect("loads").items():
        if isinstance(load, Mapping):
            if (p := load.get("pressure")) is not None:
                said.append(f"{p / 1e6:.4g} MPa on {face}")
            if (force := load.get("force")) is not None:
                said.append(f"force ({', '.join(f'{x:.4g}' for x in force)}) N on {face}")
            said += [f"{kind} on {face}" for kind in ("moment", "displacement") if kind in load]
    return ", ".join(said)


def _speed(run: RunData) -> str:
    return str(run.in_effect("motion").get("speed") or "")


def _forces(run: RunData) -> list[tuple[str, str]]:
    """Normal force of each pad and brake torque of all, means over the samples."""
    found = run.summary.get("contact_forces")
    pads = found.get(run.lead) if isinstance(found, Mapping) else None
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
    band, where = run.in_effect("stability").get("band"), ""
    if isinstance(band, list) and len(band) == 2:
        where = f", {band[0] / 1e3:g} to {band[1] / 1e3:g} kHz"
    return f"unstable mode with {run.criterion}{where}"

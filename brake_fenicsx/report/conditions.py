"""Conditions under which the brake was studied, for the first screen of the page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from brake_fenicsx.results.run import RunData

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

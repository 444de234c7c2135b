"""Figures of the summary over the samples of an approach, and over those that were verified."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from brake_fenicsx.folder.sample_files import Task

from .accuracy import eigenvalue_errors
from .stored import PROVEN, StoredSamples


def sample_facts(stored: StoredSamples) -> dict[str, Any]:
    """Figures over the samples of each approach.

    Args:
        stored: the samples.

    Returns:
        "samples", by approach, "failed_samples" and, where something beside the modes of a sample
        failed, "lost_extras".
    """
    names = [str(name) for name in stored.rows["approach"]]
    good = [status == "ok" for status in stored.rows["status"]]
    facts: dict[str, Any] = {
        "samples": {name: _approach(stored, name, names, good)
                    for name in dict.fromkeys(name for name, _ in stored.tasks)},
        "failed_samples": good.count(False),
    }  # fmt: skip
    each = zip(names, stored.rows["sample"], stored.of_each("lost"), strict=True)
    if lost := [(f"{name} {k}", text) for name, k, text in each if text]:
        (where, text), more = lost[0], len(lost) - 1
        others = f", and in {more} more samples" if more else ""
        facts["lost_extras"] = [f"{text} (sample {where}{others})"]
    return facts


def _approach(
    stored: StoredSamples, name: str, names: list[str], good: list[bool]
) -> dict[str, Any]:
    """Figures over the good samples of an approach."""
    own = [i for i, (of, ok) in enumerate(zip(names, good, strict=True)) if ok and of == name]

    def values(key: str) -> list[Any]:
        every = stored.of_each(key)
        return [every[i] for i in own if every[i] is not None]

    about: dict[str, Any] = {"good": len(own)}
    if kinds := values("count_kind"):
        mine = np.asarray(stored.modes["approach"] == name)
        verdict = stored.modes["verdict"][mine]
        about |= {
            "modes": int(mine.sum()), "counted_by": _sentence(kinds[0], values("counted")[0]),
            "not_complete": sum(kind != PROVEN for kind in kinds),
            "tolerance_missed": sum(map(int, values("tolerance_missed"))),
            "largest_error": float(np.fmax.reduce(eigenvalue_errors(stored.modes)[mine],
                                                  initial=0.0)),
            "unstable": int((verdict == "unstable").sum()),
            "neutral": int((verdict == "neutral").sum()),
            "seconds_per_stability": float(np.median(values("stability_seconds"))),
        }  # fmt: skip
    if rejected := values("rejected"):
        about["rejected_draws"] = sum(map(int, rejected))
    if beyond := max(map(float, values("beyond_laws")), default=0.0):
        about["force_share_beyond_laws"] = beyond
    if own:
        about["seconds_per_equilibrium"] = float(np.median(values("equilibrium_seconds")))
        about["newton_iterations"] = float(np.median(values("equilibrium_iterations")))
    return about


def _sentence(kind: str, how: str) -> str:
    """What the summary says of how the modes of a sample were counted."""
    return how if kind == PROVEN else f"{'not proven' if kind == 'counted' else kind}: {how}"


def verification(stored: StoredSamples, verify: Sequence[Task], verified: str) -> dict[str, Any]:
    """Reduced samples against full order.

    Args:
        stored: the samples.
        verify: those of the verification.
        verified: approach that they verify.
    """
    errors, wrong, beyond, compared = [np.zeros(0)], 0, 0, 0
    for task in verify:
        full, mine = (stored.store.samples.load(t) or {} for t in (task, (verified, task[1])))
        if "s" not in full or "s" not in mine or mine["s"].size != full["s"].size:
            continue
        compared += 1
        error = np.abs(mine["s"] - full["s"])
        beyond += int(np.sum(~(error <= mine["error"] + full["error"])))
        errors.append(error / np.abs(full["s"]))
        pairs = zip(mine["verdict"], full["verdict"], strict=True)
        wrong += sum({str(a), str(b)} == {"stable", "unstable"} for a, b in pairs)
    error = np.concatenate(errors)
    return {
        "samples_asked": len(verify), "samples_compared": compared,
        "eigenvalues": int(error.size), "wrong_verdicts": wrong,
        "errors_beyond_estimates": beyond,
        "largest_relative_error": float(error.max()) if error.size else None,
        "median_relative_error": float(np.median(error)) if error.size else None,
    }  # fmt: skip

"""Sums over the samples of an approach, for the summary of a run."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .blocks import SampleBlock

PROVEN = "proven"  # kind of a count, see ``brake_fenicsx.stability.modes.Counting``

Array = NDArray[np.float64]


@dataclass
class Counts:
    """Sums over the good samples of an approach."""

    good: int = 0
    failed: int = 0
    modes: int = 0
    unstable: int = 0
    neutral: int = 0
    tolerance_missed: int = 0
    not_complete: int = 0
    largest_error: float = 0.0
    beyond_laws: float = 0.0
    rejected: int | None = None
    counted_by: str | None = None
    forces: list[Array] = field(default_factory=list)
    of_each: dict[str, list[float]] = field(default_factory=dict)

    def add_samples(self, block: SampleBlock, own: NDArray[np.intp]) -> None:
        """Samples of a block by their places."""
        self.good += own.size
        kinds, words = (block.scalars(name, None) for name in ("count_kind", "counted"))
        counts = [(kinds[i], words[i]) for i in own if kinds[i] is not None]
        if counts and self.counted_by is None:
            self.counted_by = _sentence(*counts[0])
        self.not_complete += sum(kind != PROVEN for kind, _ in counts)
        for name in ("stability_seconds", "equilibrium_seconds", "equilibrium_iterations"):
            values = block.scalars(name, None)
            known = self.of_each.setdefault(name, [])
            known += [float(values[i]) for i in own if values[i] is not None]
        beyond = block.scalars("beyond_laws", 0.0)
        self.beyond_laws = max([self.beyond_laws, *(float(beyond[i]) for i in own)])
        missed = block.scalars("tolerance_missed", 0)
        self.tolerance_missed += sum(int(missed[i]) for i in own)
        if "rejected" in block:
            rejected = block.scalars("rejected", 0)
            self.rejected = (self.rejected or 0) + sum(int(rejected[i]) for i in own)
        forces = block.each("forces")
        self.forces += [f.copy() for i in own if (f := forces[i]) is not None]

    def add_modes(self, block: SampleBlock, own: NDArray[np.bool_]) -> None:
        """Modes of a block that are of the approach."""
        from brake_fenicsx.stability.modes import relative_errors

        error = relative_errors(block.column("s")[own], block.column("error")[own])
        verdict = block.column("verdict")[own]
        self.modes += int(own.sum())
        self.largest_error = max(self.largest_error, float(np.fmax.reduce(error, initial=0.0)))
        self.unstable += int((verdict == "unstable").sum())
        self.neutral += int((verdict == "neutral").sum())

    def facts(self) -> dict[str, Any]:
        """Figures for the summary."""
        about: dict[str, Any] = {"good": self.good}
        if self.counted_by is not None:
            about |= {
                "modes": self.modes, "counted_by": self.counted_by,
                "not_complete": self.not_complete, "tolerance_missed": self.tolerance_missed,
                "largest_error": self.largest_error, "unstable": self.unstable,
                "neutral": self.neutral,
                "seconds_per_stability": float(np.median(self.of_each["stability_seconds"])),
            }  # fmt: skip
        if self.rejected is not None:
            about["rejected_draws"] = self.rejected
        if self.beyond_laws:
            about["force_share_beyond_laws"] = self.beyond_laws
        if self.good:
            for name, key in (("seconds_per_equilibrium", "equilibrium_seconds"),
                              ("newton_iterations", "equilibrium_iterations")):  # fmt: skip
                about[name] = float(np.median(self.of_each[key]))
        return about


def _sentence(kind: str, how: str) -> str:
    """What the summary says of how the modes of a sample were counted."""
    return how if kind == PROVEN else f"{'not proven' if kind == 'counted' else kind}: {how}"

"""What becomes of the samples in the states of a brake, as stored beside their modes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from .matrix import Array, Frame


@dataclass(frozen=True, slots=True)
class Outcomes:
    """What becomes of the samples of an approach in all states.

    Attributes:
        approach: its name.
        samples: samples that have modes in each state, shape (states,).
        failed: those that have none.
        missed: modes beyond the tolerance.
        reasons: the first reason why a sample has none, or "".
        modes: growing modes, with columns sample, state, family (-1: none), frequency [Hz] and
            damping.
    """

    approach: str
    samples: Any
    failed: Any
    missed: Any
    reasons: list[str]
    modes: Frame

    def squeals(self, threshold: float, family: int | None = None) -> Any:
        """Samples with squeal in each state, shape (states,).

        Args:
            threshold: modes squeal whose damping lies below minus this.
            family: that counts; all if None.
        """
        m = self.modes[self.modes.damping < -threshold]
        return self.counted(m if family is None else m[m.family == family])

    def counted(self, modes: Frame) -> Any:
        """Samples that have one of some modes in each state, shape (states,)."""
        pairs = modes[["sample", "state"]].drop_duplicates()
        return np.bincount(pairs.state, minlength=len(self.samples))

    def share(self, count: Any) -> Array:
        """A number of samples over those that have modes; nan where none has."""
        return np.where(self.samples > 0, count / np.maximum(self.samples, 1), np.nan)


def outcomes(stored: Any) -> Iterator[Outcomes]:
    """What the stored samples say of the states, by approach."""
    import pandas as pd

    groups: dict[str, list[Any]] = {}
    for (approach, _), data, family in stored.with_arrays("state_"):
        groups.setdefault(approach, []).append((data, np.append(family, -1)))
    for approach, group in groups.items():
        modes = pd.concat([
            pd.DataFrame({
                "sample": k, "state": data["state_of"], "family": family[data["state_mode"]],
                "frequency": data["state_s"].imag / (2 * np.pi), "damping": data["state_damping"],
            }) for k, (data, family) in enumerate(group)
        ])  # fmt: skip
        texts = np.array([data["state_outcome"] for data, _ in group])
        reasons = [next((str(t) for t in column if t), "") for column in texts.T]
        good, missed = (texts == "").sum(axis=0), sum(data["state_missed"] for data, _ in group)
        yield Outcomes(approach, good, len(group) - good, missed, reasons, modes)

"""Shares of a run: the tasks of a job array compute the samples of one scene in parts."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from brake_fenicsx.errors import SceneError

T = TypeVar("T")

SLURM = "SLURM_ARRAY_TASK"


@dataclass(frozen=True, slots=True)
class Share:
    """One of several parts of about equal size.

    Attributes:
        number: which one, from 1 to ``of``.
        of: how many there are.
    """

    number: int
    of: int

    def __str__(self) -> str:
        return f"{self.number} of {self.of}"

    def part(self, tasks: Sequence[T]) -> list[T]:
        """The tasks of this share: neighbours, so that few archives hold samples of several."""
        n = len(tasks)
        return list(tasks[n * (self.number - 1) // self.of : n * self.number // self.of])


def read_share(text: str) -> Share:
    """Read ``I/N``; of an empty text the share is that of this task of a SLURM job array.

    Raises:
        SceneError: the text is no share, or the environment names no job array.
    """
    if not text:
        return _of_slurm()
    match = re.fullmatch(r"(\d+)/(\d+)", text)
    if match is None or not 1 <= int(match[1]) <= int(match[2]):
        raise SceneError(f"--share {text}: write I/N with I from 1 to N, such as --share 3/16")
    return Share(int(match[1]), int(match[2]))


def _of_slurm() -> Share:
    try:
        here, low, high, count = (
            int(os.environ[f"{SLURM}_{name}"]) for name in ("ID", "MIN", "MAX", "COUNT")
        )
    except (KeyError, ValueError):
        raise SceneError(
            f"--share: {SLURM}_ID, _MIN, _MAX and _COUNT are not set, this is no task of a SLURM"
            " job array; write I/N, such as --share 3/16"
        ) from None
    # Numbers may have steps, as in --array=0-30:2; a list with gaps has no such order.
    step = (high - low) // max(count - 1, 1)
    number = 1 if count == 1 else (here - low) // max(step, 1) + 1
    if count > 1 and (low + (count - 1) * step != high or low + (number - 1) * step != here):
        raise SceneError(
            f"--share: {count} tasks of a job array from {low} to {high} are not evenly spaced;"
            " write --array=1-N, or --share I/N"
        )
    return Share(number, count)

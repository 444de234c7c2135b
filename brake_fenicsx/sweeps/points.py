"""Modes of one sample of a scene at values of a parameter; nearby equilibria are starts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.uncertainty.study import Study

from .state import State

Array = NDArray[np.float64]

# Equilibria that are kept as starts.
KEPT = 8


class Points:
    """Modes of a sample over one scalar of the scene; see ``branches.Solve``."""

    def __init__(
        self,
        study: Study,
        task: tuple[str, int],
        key: str,
        fixed: Mapping[str, float] | None = None,
    ):
        """Choose the sample.

        Args:
            study: the samples of the scene, prepared.
            task: approach and number of the sample.
            key: dotted key of the scalar.
            fixed: values of further scalars, SI.
        """
        self._study, self._task, self._key = study, task, key
        self._fixed = dict(fixed or {})
        self._gaps: dict[float, Array] = {}

    def __call__(self, x: float) -> State:
        """The modes at a value of the scalar, SI."""
        start = None
        if self._gaps:
            start = self._gaps[min(self._gaps, key=lambda known: abs(known - x))]
        eq, modes = self._study.solved(self._task, {**self._fixed, self._key: x}, start)
        self._gaps[x] = eq.g
        if len(self._gaps) > KEPT:
            self._gaps.pop(next(iter(self._gaps)))
        return State.of(x, modes, eq.k_vibration)

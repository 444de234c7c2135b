"""Followed branches and their events as arrays to store."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .branches import Followed
from .events import Event

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class StoredLine:
    """What is stored of one sample over one parameter, one array for each attribute.

    Attributes:
        x: values of the parameter that were computed, shape (states,).
        branch: number of the branch of each row.
        state: number of the state of each row.
        s: eigenvalue of each row [1/s].
        error: its estimated error [1/s].
        verdict: its verdict.
        begin: why each branch begins, shape (branches,).
        end: why it ends.
        kind: which event each one is, shape (events,).
        at: value of the parameter there.
        accuracy: of the value.
        event_s: eigenvalue there [1/s].
        pair: the two branches, -1 for none, shape (events, 2).
        vector: right vectors there, shape (events, m).
        stopped: why there are no modes beyond the last value; empty if there are all.
    """

    x: Array
    branch: NDArray[np.intp]
    state: NDArray[np.intp]
    s: NDArray[np.complex128]
    error: Array
    verdict: NDArray[np.str_]
    begin: NDArray[np.str_]
    end: NDArray[np.str_]
    kind: NDArray[np.str_]
    at: Array
    accuracy: Array
    event_s: NDArray[np.complex128]
    pair: NDArray[np.intp]
    vector: NDArray[np.complex64]
    stopped: str

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> StoredLine:
        """From what ``line_arrays`` made."""
        arrays = {f.name: data[f.name] for f in fields(cls)}
        return cls(**arrays | {"stopped": str(data["stopped"])})

    @property
    def events(self) -> Iterator[Event]:
        """The events."""
        every = (self.kind, self.at, self.accuracy, self.event_s, self.pair, self.vector)
        for kind, x, error, s, pair, vector in zip(*every, strict=True):
            one, two = pair.tolist()
            yield Event(str(kind), float(x), float(error), complex(s), (one, two), vector)

    def rows(self) -> Iterator[tuple[int, int, complex, float, str]]:
        """State, branch, lambda [1/s], its error and verdict of every row."""
        every = (self.state, self.branch, self.s, self.error, self.verdict)
        return zip(*(column.tolist() for column in every), strict=True)


def line_arrays(
    followed: Followed, events: Sequence[Event], numbers: Sequence[int]
) -> dict[str, Any]:
    """Arrays to store.

    Args:
        followed: the branches.
        events: their events.
        numbers: number that each branch is stored under.
    """
    branches, states = followed.branches, followed.states

    def of(items: Sequence[Any], name: str, kind: type) -> NDArray[Any]:
        return np.array([getattr(item, name) for item in items], dtype=kind)

    def of_modes(name: str, kind: type) -> NDArray[Any]:
        places = ((i, m) for b in branches for i, m in zip(b.states, b.modes, strict=True))
        return np.array([getattr(states[i], name)[m] for i, m in places], dtype=kind)

    size = len(states[0].right)
    pairs = [[numbers[i] if i >= 0 else -1 for i in e.branches] for e in events]
    return {
        "x": of(states, "x", float),
        "branch": np.repeat(np.array(numbers, np.intp), [len(b.states) for b in branches]),
        "state": np.array([i for b in branches for i in b.states], dtype=np.intp),
        "s": of_modes("s", complex),
        "error": of_modes("error", float),
        "verdict": of_modes("verdict", str),
        "begin": of(branches, "begin", str),
        "end": of(branches, "end", str),
        "kind": of(events, "kind", str),
        "at": of(events, "x", float),
        "accuracy": of(events, "error", float),
        "event_s": of(events, "s", complex),
        "pair": np.array(pairs, dtype=np.intp).reshape(-1, 2),
        "vector": of(events, "vector", np.complex64).reshape(-1, size),
        "stopped": followed.stopped,
    }

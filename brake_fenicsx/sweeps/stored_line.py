"""Followed branches and their events as arrays to store."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .branches import Followed
from .events import Event
from .state import State

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class StoredLine:
    """What was stored of one sample over one parameter.

    Attributes:
        x: values of the parameter that were computed, shape (states,).
        branch: number of the branch of each row.
        state: number of the state of each row.
        s: eigenvalue of each row [1/s].
        error: its estimated error [1/s].
        verdict: its verdict.
        begin: why each branch begins, shape (branches,).
        end: why it ends.
        events: the events.
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
    events: list[Event]
    stopped: str

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> StoredLine:
        """From what ``line_arrays`` made."""
        names = "kind", "at", "accuracy", "event_s", "pair", "vector"
        events = [
            Event(str(kind), float(x), float(e), complex(s), (int(p[0]), int(p[1])), v)
            for kind, x, e, s, p, v in zip(*(data[name] for name in names), strict=True)
        ]
        return cls(
            data["x"], data["branch"], data["state"], data["s"], data["error"], data["verdict"],
            data["begin"], data["end"], events, str(data["stopped"]),
        )  # fmt: skip

    def rows(self) -> Iterator[tuple[int, int, complex, float, str]]:
        """State, branch, lambda [1/s], its error and verdict of every row."""
        every = (self.state, self.branch, self.s, self.error, self.verdict)
        for state, branch, s, error, verdict in zip(*every, strict=True):
            yield int(state), int(branch), complex(s), float(error), str(verdict)


def line_arrays(followed: Followed, events: list[Event], numbers: list[int]) -> dict[str, Any]:
    """Arrays to store.

    Args:
        followed: the branches.
        events: their events.
        numbers: number that each branch is stored under.
    """
    states: list[State] = followed.states
    rows = [
        (numbers[b.number], i, states[i].s[m], states[i].error[m], states[i].verdict[m])
        for b in followed.branches
        for i, m in zip(b.states, b.modes, strict=True)
    ]
    branch, state, s, error, verdict = zip(*rows, strict=True) if rows else ((),) * 5
    size = len(states[0].right)
    vectors = np.zeros((len(events), size), np.complex64)
    for row, event in zip(vectors, events, strict=True):
        row[:] = event.vector
    pairs = [[numbers[i] if i >= 0 else -1 for i in e.branches] for e in events]
    return {
        "x": np.array([a.x for a in states]),
        "branch": np.array(branch, dtype=np.intp), "state": np.array(state, dtype=np.intp),
        "s": np.array(s, dtype=complex), "error": np.array(error, dtype=float),
        "verdict": np.array(verdict, dtype=str),
        "number": np.array(numbers, dtype=np.intp),
        "begin": np.array([b.begin for b in followed.branches], dtype=str),
        "end": np.array([b.end for b in followed.branches], dtype=str),
        "kind": np.array([e.kind for e in events], dtype=str),
        "at": np.array([e.x for e in events]),
        "accuracy": np.array([e.error for e in events]),
        "event_s": np.array([e.s for e in events], dtype=complex),
        "pair": np.array(pairs, dtype=np.intp).reshape(-1, 2),
        "vector": vectors,
        "solves": followed.solves, "stopped": followed.stopped,
    }  # fmt: skip

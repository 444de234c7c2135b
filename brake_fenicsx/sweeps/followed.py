"""Modes followed over a scalar: as an object of Python, and as arrays to store."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index
from brake_fenicsx.display import Shown, html_table

from .branches import Followed
from .events import Event


@dataclass(repr=False, eq=False)
class Branches(Shown):
    """Modes followed over a scalar of the scene; ``plot`` takes two axes.

    Attributes:
        values: of the scalar, SI, shape (values,).
        frequency: of every branch at every value [Hz], nan where it is not in the band, shape
            (branches, values).
        damping: -2 alpha / |omega| [-], likewise.
        events: where modes merge, split, begin and end to squeal; ``kind``, ``x``, ``s`` and
            ``branches`` of each.
        ends: why each branch ends.
        name: of the scalar, with its SI unit.
        threshold: a mode squeals where its damping lies below minus this.
    """

    values: Array
    frequency: Array
    damping: Array
    events: list[Event]
    ends: list[str]
    name: str = ""
    threshold: float = 0.0
    PANELS: ClassVar[int] = 2

    def __repr__(self) -> str:
        """One line."""
        merge = sum(e.kind == "merging" for e in self.events)
        return (
            f"Branches({len(self.frequency)} over {self.values.size} values from"
            f" {self.values[0]:g} to {self.values[-1]:g}, {merge} mergings)"
        )

    def _repr_html_(self) -> str:
        """Events as a table of a notebook."""
        rows = [[e.kind, e.x, abs(e.s.imag) / (2 * np.pi), e.s.real] for e in self.events]
        heads = ("event", self.name or "value", "frequency [Hz]", "alpha [1/s]")
        return html_table(repr(self), heads, rows)

    def _columns(self) -> dict[str, AnyArray]:
        """One row for each branch at each value where it is in the band."""
        branch, at = np.nonzero(np.isfinite(self.frequency))
        f, damping = self.frequency[branch, at], self.damping[branch, at]
        place = {"branch": branch, "value": self.values[at]}
        return {**place, "frequency_hz": f, "damping": damping, "real_1_s": -np.pi * f * damping}

    def _draw(self, *axes: Any) -> None:
        """Frequency and damping over the scalar; branches that squeal are coloured."""
        for f, damping in zip(self.frequency, self.damping, strict=True):
            loud = bool(np.any(damping < -self.threshold))
            style: dict[str, Any] = {} if loud else {"color": "0.75", "lw": 0.8, "zorder": 1}
            (line,) = axes[0].plot(self.values, f / 1e3, **style)
            text = f"{np.nanmean(f) / 1e3:.3f} kHz" if loud else None
            axes[1].plot(self.values, damping, **{**style, "color": line.get_color()}, label=text)
        axes[0].set_ylabel("frequency [kHz]")
        axes[1].axhline(-self.threshold, color="0.3", lw=0.6, ls=":")
        axes[1].set(xlabel=self.name, ylabel=r"damping $-2\,\alpha/|\omega|$ [-]")
        if axes[1].get_legend_handles_labels()[1]:
            axes[1].legend()


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
    branch: Index
    state: Index
    s: Complex
    error: Array
    verdict: NDArray[np.str_]
    begin: NDArray[np.str_]
    end: NDArray[np.str_]
    kind: NDArray[np.str_]
    at: Array
    accuracy: Array
    event_s: Complex
    pair: Index
    vector: NDArray[np.complex64]
    stopped: str

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> "StoredLine":
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


def line_arrays(followed: Followed, events: Sequence[Event]) -> dict[str, Any]:
    """Arrays to store of some branches and their events."""
    branches, states = followed.branches, followed.states

    def of(items: Sequence[Any], name: str, kind: type) -> AnyArray:
        return np.array([getattr(item, name) for item in items], dtype=kind)

    def of_modes(name: str, kind: type) -> AnyArray:
        places = ((i, m) for b in branches for i, m in zip(b.states, b.modes, strict=True))
        return np.array([getattr(states[i], name)[m] for i, m in places], dtype=kind)

    size = len(states[0].right)
    return {
        "x": of(states, "x", float),
        "branch": np.repeat(np.arange(len(branches)), [len(b.states) for b in branches]),
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
        "pair": of(events, "branches", np.intp).reshape(-1, 2),
        "vector": of(events, "vector", np.complex64).reshape(-1, size),
        "stopped": followed.stopped,
    }

"""Modes followed over a scalar of the scene, as an object of Python."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.display import Shown, html_table

if TYPE_CHECKING:
    from brake_fenicsx.sweeps.events import Event

Array = NDArray[np.float64]


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

    def _columns(self) -> dict[str, NDArray[Any]]:
        """One row for each branch at each value where it is in the band."""
        branch, at = np.nonzero(np.isfinite(self.frequency))
        f, damping = self.frequency[branch, at], self.damping[branch, at]
        return {
            "branch": branch, "value": self.values[at], "frequency_hz": f, "damping": damping,
            "real_1_s": -np.pi * f * damping,
        }  # fmt: skip

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

"""Tables, modes and branches in Python: data frames, figures, tables of notebooks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, ClassVar

from brake_fenicsx.errors import SceneError

if TYPE_CHECKING:
    import pandas as pd

MOST = 30  # rows that are shown


class Shown:
    """What has columns, and may be drawn: the habits of pandas and Matplotlib for all of them.

    A class of it has ``_columns()``, arrays by name, and ``_draw(*axes)`` for its ``PANELS``, one
    above the other.
    """

    __slots__ = ()
    PANELS: ClassVar[int] = 1

    def _columns(self) -> Mapping[str, Any]:
        raise NotImplementedError

    def _draw(self, *axes: Any) -> None:
        raise NotImplementedError

    def to_pandas(self) -> pd.DataFrame:
        """The table as a data frame, its columns named as in the files of a run."""
        import pandas as pd

        return pd.DataFrame(dict(self._columns()))

    def plot(self, ax: Any = None) -> Any:
        """Draw it.

        Args:
            ax: axes of Matplotlib, an array of them where it has several panels; made if not given.

        Returns:
            These axes.

        Raises:
            SceneError: fewer or more axes than panels.
        """
        if ax is None:
            import matplotlib.pyplot as plt

            _, ax = plt.subplots(self.PANELS, 1, sharex=True, constrained_layout=True)
        panels = list(getattr(ax, "flat", ax if isinstance(ax, list | tuple) else [ax]))
        if len(panels) != self.PANELS:
            raise SceneError(f"""plot: ax has {len(panels)} axes, and {self.PANELS} are drawn; give
                plt.subplots({self.PANELS})[1], or none""")
        self._draw(*panels)
        return ax


def html_table(title: str, heads: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A small table for a notebook; every text is escaped.

    Args:
        title: stands above it.
        heads: headings of the columns.
        rows: cells; numbers are shown with five digits, of many rows the first 30.
    """

    def line(cells: Sequence[Any], tag: str) -> str:
        shown = (f"{cell:.5g}" if isinstance(cell, float) else str(cell) for cell in cells)
        return "<tr>" + "".join(f"<{tag}>{escape(text)}</{tag}>" for text in shown) + "</tr>"

    left = len(rows) - MOST
    more = f"<p>and {left} more</p>" if left > 0 else ""
    body = "".join(line(row, "td") for row in rows[:MOST])
    return f"<p>{escape(title)}</p><table>{line(heads, 'th')}{body}</table>{more}"


def mesh_grid(V: Any, u: Any) -> Any:
    """A complex field on the mesh as a grid of pyvista, with the point data "re" and "im".

    Args:
        V: vector function space of Lagrange elements.
        u: all its dofs, shape (dofs,); scaled so that the largest displacement is 1.
    """
    import numpy as np
    import pyvista

    from brake_fenicsx.compat import vtk_cells

    cells, types, points = vtk_cells(V)
    grid = pyvista.UnstructuredGrid({int(types[0]): cells}, points)
    vectors = np.reshape(u, (-1, 3))
    vectors = vectors / max(float(np.linalg.norm(vectors, axis=1).max(initial=0.0)), 1e-300)
    grid["re"], grid["im"] = np.real(vectors), np.imag(vectors)
    return grid

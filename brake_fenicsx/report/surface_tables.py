"""Surface and laws as tables for other programs: parameters, spectrum, bearing curve, laws."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.folder.files import whole_file
from brake_fenicsx.results.run import Arrays, RunData
from brake_fenicsx.results.tables import Value, write_rows

from .micro_figures import settings_of
from .surface_figures import bearing_curves, surface_statistics
from .surface_section import of_surface, parameter_columns, parameter_rows, scans_of

LAW_COLUMNS = {
    "d": "d_m",
    "p": "p_Pa",
    "k": "k_Pa_per_m",
    "v": "k_vibration_Pa_per_m",
    "area": "touching_share",
}
SUPPORT_COLUMNS = (
    "p_Pa", "scan_pixels", "grid_pixels",
    *(f"{name}_{share}_Pa_per_m" for name in ("k", "k_vibration") for share in ("5", "50", "95")),
)  # fmt: skip
HEIGHTS = "artificial_surface"


def write_surface_tables(run: RunData) -> list[Path]:
    """Write laws.csv, and the tables of the surface into ``tables``.

    A run of a surface alone also gets its first artificial surface: artificial_surface.npz and, in
    metres, artificial_surface.csv.

    Args:
        run: the results.

    Returns:
        Paths written; what the run has no numbers for is left out.
    """
    folder, tables, written = run.directory, run.directory / "tables", list[Path]()
    if run.laws is not None and "count" in run.laws:
        heads = [head for name, head in LAW_COLUMNS.items() if name in run.laws]
        rows = _law_rows(run.laws)
        written.append(write_rows(folder / "laws.csv", ("law", "step", *heads), rows))
    if run.laws is not None and (support := settings_of(run.laws).get("support")):
        tables.mkdir(exist_ok=True)
        columns = [support[name] for name in ("pressure", "scan_pixels", "grid_pixels")]
        table = zip(*columns, *support["k"], *support["v"], strict=True)
        written.append(write_rows(tables / "law_support.csv", SUPPORT_COLUMNS, table))
    if (s := run.surface) is None:
        return written
    tables.mkdir(exist_ok=True)
    if surface_statistics(s):
        path = tables / "surface.csv"
        written.append(write_rows(path, parameter_columns(run), parameter_rows(run)))
    if "q" in s:
        each = [*s["scan_C"]] if scans_of(run) else []
        low, high = s["q_band"]
        # The fit is a power law on both sides of a corner, which its own table resolves.
        fit = np.exp(np.interp(np.log(s["q"]), np.log(s["fit_q"]), np.log(s["fit_C"])))
        inside = (s["q"] >= low) & (s["q"] <= high)
        within = [float(c) if i else None for c, i in zip(fit, inside, strict=True)]
        reliable = ["yes" if i else "no" for i in inside]
        spectrum = zip(s["q"], s["C"], within, reliable, *each, strict=True)
        of_scans = [f"C_scan_{k}_m4" for k in range(1, len(each) + 1)]
        heads = ["q_rad_per_m", "C_m4", "fit_m4", "reliable", *of_scans]
        written.append(write_rows(tables / "spectrum.csv", heads, spectrum))
    if "heights" in s and np.isfinite(s["heights"]).any():
        share, whole, scans = bearing_curves(s)
        of_scans = [f"height_scan_{k}_m" for k in range(1, len(scans) + 1)]
        heads = ["material_ratio", "height_m", *of_scans]
        path = tables / "bearing_curve.csv"
        written.append(write_rows(path, heads, zip(share, whole, *scans, strict=True)))
    if of_surface(run) and "artificial" in s:
        written += _write_heights(folder, s["artificial"], s["artificial_size"])
    return written


def _law_rows(laws: Arrays) -> Iterator[list[Value]]:
    """One row for each step of each law."""
    arrays = [laws[name] for name in LAW_COLUMNS if name in laws]
    for i, count in enumerate(laws["count"]):
        for j in range(int(count)):
            yield [i, j, *(float(array[i, j]) for array in arrays)]


def _write_heights(folder: Path, heights: NDArray, size: NDArray) -> list[Path]:
    """Heights [m], shape (nx, ny), and their size [m], as npz and as text with a row for each x."""
    paths = [folder / f"{HEIGHTS}.npz", folder / f"{HEIGHTS}.csv"]
    for path in paths:
        with whole_file(path) as part, part.open("wb") as file:
            if path.suffix == ".npz":
                np.savez(file, heights=heights, size=size)
            else:
                np.savetxt(file, heights, fmt="%.7e", delimiter=",")
    return paths

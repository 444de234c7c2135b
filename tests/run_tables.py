"""Tables of a synthetic run: written by a test as CSV files, read back as the columns of a run."""

from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pandas as pd

from brake_fenicsx.report.mode_cards import ModeShape
from brake_fenicsx.results import run as runs
from brake_fenicsx.results.driver_tables import ContactDriver, Driver
from brake_fenicsx.results.output import ContactElement
from brake_fenicsx.results.probabilities import Convergence, Probability, Sensitivity
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.tables import TEXTS, as_array
from brake_fenicsx.sweeps.sweep_tables import ChartRow, CriticalRow, CurveRow, EventRow, SweepRow

CONTACT, DRIVERS, CONTACT_DRIVERS = (t.names() for t in (ContactElement, Driver, ContactDriver))
SENSITIVITY, PROBABILITIES = Sensitivity.names(), Probability.names()
CHART, CRITICAL, CURVE = (t.names() for t in (ChartRow, CriticalRow, CurveRow))
# After approach, sample, value of a chart and, of the first, value.
SWEEP, EVENTS = SweepRow.names()[4:], EventRow.names()[3:]
SHAPE_COLUMNS = ModeShape.names()
TEXT = {
    *TEXTS, "stage", "quantity", "most_severe", "counted_by", "kind", "parameter", "outcome",
    *(name for kind in (Sensitivity, Probability, Convergence, ModeShape, Driver)
      for name, t in kind.__annotations__.items() if "str" in str(t) and "int" not in str(t)),
} - {"sample"}  # fmt: skip
SWEEPS = ("sweep", "lock_in", "chart", "critical", "critical_curve")
CYCLES = ("limit_cycle", "limit_cycle_growth", "limit_cycle_families")


def cells(rows):
    """Values of rows of a table."""
    return [list(astuple(row)) for row in rows]


def mode(approach, sample, number, f, damping, family=-1, error=1e-6):
    """A row of modes.csv of a frequency [Hz] and a damping."""
    verdict = "unstable" if damping < 0 else "stable" if damping > 0 else "neutral"
    real = -damping * np.pi * f
    return [approach, sample, number, f, real, damping, 1e-12, error, 2.0, verdict, family]


def read_rows(path):
    """One mapping for each row of a CSV file: text, int, float, or None of an empty cell."""
    columns = _cells(path)
    rows = zip(*columns.values(), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in rows]


def read_columns(path):
    """Arrays of the columns of a CSV file; empty cells are nan, or "" among texts."""
    return {name: as_array(values, name in TEXT) for name, values in _cells(path).items()}


def _cells(path):
    table = pd.read_csv(path, dtype=str, keep_default_na=False)
    return {name: [_value(name, cell) for cell in table[name]] for name in table}


def _value(name, cell):
    if name in TEXT:
        return cell
    for kind in (int, float):
        try:
            return kind(cell)
        except ValueError:
            pass
    return cell or None


def read_run(directory):
    """A run of the tables that a test wrote into a folder, beside its other files."""
    if isinstance(directory, RunData):
        return directory
    folder = Path(directory)

    def table(name):
        path = folder / f"{name}.csv"
        return read_columns(path) if path.is_file() else None

    def tables(names):
        return {name: columns for name in names if (columns := table(name)) is not None}

    if any(folder.glob("*.csv")) and not (folder / "summary.json").is_file():
        run = replace(runs.read_run(folder, {"name": "tables"}), summary={})
    else:
        run = runs.read_run(folder)
    found = {name: table(name) for name in ("modes", "samples", "contact", "drivers")}
    found["driver_maps"] = table("drivers_contact")
    named = {"sweep": SWEEPS, "extras": CYCLES, "causes": ("probabilities", "sensitivity")}
    found |= {name: tables(files) for name, files in named.items()}
    return replace(run, **{name: value for name, value in found.items() if value})

"""Modes of a prepared scene at full order, and what those of the reduced model must hold."""

import csv

import numpy as np

from brake_fenicsx.samples.solve import full_modes


def at_full_order(prepared, values=None, approach="multi-scale"):
    """Modes of the first sample at full order, the equilibrium too."""
    study = prepared.study
    sample = study.sample((approach, 0), values)
    return full_modes(study.models, sample, study.balance(sample))


def agrees(found, exact, least=5, more=1e-6):
    """No mode is missed, each lies within the stated errors; true relative errors.

    ``more``: relative, since the equilibria differ by the interpolation of the compliance.
    """
    assert found.s.size == exact.s.size >= least
    distance = np.abs(found.s - exact.s)
    assert np.all(distance <= found.error + exact.error + more * np.abs(exact.s))
    return distance / np.abs(exact.s)


def text_rows(path):
    """Rows of a CSV file as texts by column."""
    with path.open() as file:
        return list(csv.DictReader(file))


def stored_eigenvalues(folder, approach="multi-scale", sample=0):
    """lambda [1/s] and its stated error of every mode of a sample in modes.csv."""
    rows = [
        r for r in text_rows(folder / "modes.csv")
        if (r["approach"], r["sample"]) == (approach, str(sample))
    ]  # fmt: skip
    s = [complex(float(r["real_1_s"]), 2 * np.pi * float(r["frequency_hz"])) for r in rows]
    return np.array(s), np.array([float(r["error_estimate"]) for r in rows])

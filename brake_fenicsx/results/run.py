"""What a run directory holds, read once; any part may be absent."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import extras
from brake_fenicsx.folder.arrays import read_npz, reading

from .columns import is_parquet
from .squeal import SquealTable
from .tables import CONTACT, MODES, SAMPLES, Columns, read_columns

Arrays = dict[str, NDArray]

# Names of approaches as a person reads them, the simplest first.
APPROACHES = {
    "classical": "Classical", "parametric": "Parametric", "multi-scale": "Multi-scale",
    "joint": "Joint",
}  # fmt: skip
SMOOTH = "Smooth contact"  # the approach "multi-scale" of a scene without roughness
SWEEP = ("sweep", "lock_in", "chart", "critical", "critical_curve")
# of every surface, scanned or given by numbers
SURFACE = ("stats", "hdf_z", "hdf_density", "fit_q", "fit_C", "q_band")


@dataclass(frozen=True)
class RunData:
    """The results of one run; a part that the scene did not ask for is None or empty.

    Attributes:
        directory: where the run wrote.
        modes: columns of ``modes.csv``, arrays of shape (n_modes,).
        samples: columns of ``samples.csv``, arrays of shape (n_samples,).
        contact: columns of ``contact.csv``, arrays of shape (n_elements,).
        drivers: columns of ``drivers.csv``, arrays of shape (n_derivatives,).
        driver_maps: columns of ``drivers_contact.csv``.
        laws: arrays of ``laws.npz``.
        surface: arrays of ``surface.npz``.
        maps: arrays of ``contact_maps.npz``.
        faces: arrays of ``contact_faces.npz``.
        sweep: tables of a sweep by the stem of their files, such as ``lock_in``.
        extras: tables of extras, likewise.
        summary: content of ``summary.json``.
        scene: text of ``scene.toml``.
    """

    directory: Path
    modes: Columns | None = None
    samples: Columns | None = None
    contact: Columns | None = None
    drivers: Columns | None = None
    driver_maps: Columns | None = None
    laws: Arrays | None = None
    surface: Arrays | None = None
    maps: Arrays | None = None
    faces: Arrays | None = None
    sweep: dict[str, Columns] = field(default_factory=dict)
    extras: dict[str, Columns] = field(default_factory=dict)
    summary: dict[str, Any] = field(default_factory=dict)
    scene: str | None = None

    @cached_property
    def squeal(self) -> SquealTable:
        """Its modes that squeal, counted."""
        return SquealTable(self.modes, self.samples, self.threshold)

    @cached_property
    def errors(self) -> NDArray[np.float64]:
        """Errors of the eigenvalues over |lambda|, shape (n_modes,); nan of rigid modes."""
        from .accuracy import eigenvalue_errors

        return eigenvalue_errors(self.modes) if self.modes is not None else np.zeros(0)

    @cached_property
    def approaches(self) -> list[str]:
        """Names of the approaches that were run, in the order of the figures."""
        import pandas as pd

        names: set[str] = set()
        for table in (self.samples, self.modes):
            if table is not None:
                names.update(map(str, pd.unique(table["approach"])))
        return sort_approaches(names)

    @property
    def threshold(self) -> float:
        """An unstable mode counts as squeal where its damping lies below minus this."""
        return float(self.summary.get("in_effect", {}).get("stability", {}).get("threshold", 0.0))

    @property
    def criterion(self) -> str:
        """What the damping of an unstable mode must be to count as squeal."""
        return f"damping below {-self.threshold if self.threshold else 0:g}"

    @property
    def damping(self) -> str | None:
        """Terms of damping that the scene names; empty without any, None where it is not known."""
        if not self.summary.get("in_effect"):
            return None
        terms = self.summary.get("damping")
        return ", ".join(map(str, terms)) if isinstance(terms, dict) else ""

    def label(self, approach: str) -> str:
        """Name of an approach as a person reads it: "multi-scale" names roughness that is there."""
        contacts = self.summary.get("in_effect", {}).get("contact", {}).values()
        rough = any(c.get("law") == "library" or c.get("gap", "none") != "none" for c in contacts)
        if approach == "multi-scale" and contacts and not rough:
            return SMOOTH
        return APPROACHES.get(approach, approach)


def sort_approaches(names: set[str]) -> list[str]:
    """Order approaches: the known ones from the simplest on, then the others by name."""
    known = [name for name in APPROACHES if name in names]
    return known + sorted(names - set(APPROACHES))


def scan_heights(surface: Arrays) -> list[NDArray]:
    """Heights of each scan of a surface [m], shape (nx, ny) each; none with numbers alone."""
    if "heights" not in surface:
        return []
    return [*surface["heights"].reshape(-1, *surface["heights"].shape[-2:])]


def read_run(directory: str | Path | RunData) -> RunData:
    """Read all that a run has written.

    Args:
        directory: the run directory, or results already read, which are handed back.

    Returns:
        The results; parts whose file is absent are None or empty.

    Raises:
        SceneError: the directory is missing, holds no result, or a file of it cannot be read.
    """
    if isinstance(directory, RunData):
        return directory
    root = Path(directory)
    if not root.is_dir():
        what = "a file, and no folder of results" if root.is_file() else "no such run directory"
        raise SceneError(f"{root}: {what}; run the scene first")
    scene = root / "scene.toml"
    run = RunData(
        directory=root,
        modes=_table(root / "modes.csv", MODES),
        samples=_table(root / "samples.csv", SAMPLES),
        contact=_table(root / "contact.csv", CONTACT),
        drivers=_table(root / "drivers.csv", ("approach", "sample", "parameter", "kind")),
        driver_maps=_table(root / "drivers_contact.csv", ("approach", "sample", "element")),
        laws=_arrays(root / "laws.npz", ("d", "p", "k")),
        surface=_arrays(root / "surface.npz", SURFACE),
        maps=_arrays(root / "contact_maps.npz", ("size", "p_over_E", "pressures", "area_fraction")),
        faces=_arrays(root / "contact_faces.npz", ("corners", "facet")),
        sweep=_tables(root, SWEEP),
        extras=_tables(root, [name for extra in extras() for name in extra.tables]),
        summary=_json(root / "summary.json"),
        scene=scene.read_text(encoding="utf-8") if scene.is_file() else None,
    )
    if not any((run.modes, run.samples, run.contact, run.laws, run.surface, run.maps, run.summary)):
        raise SceneError(
            f"{root}: contains no result of a run (modes.csv, laws.npz, surface.npz, ...)"
        )
    return run


def _table(path: Path, required: Sequence[str]) -> Columns | None:
    there = path.is_file() or is_parquet(path)
    return read_columns(path, required) if there else None


def _tables(root: Path, names: Sequence[str]) -> dict[str, Columns]:
    found = {name: _table(root / f"{name}.csv", ()) for name in names}
    return {name: table for name, table in found.items() if table is not None}


def _arrays(path: Path, required: Sequence[str]) -> Arrays | None:
    if not path.is_file():
        return None
    with reading(path, "as an npz file", "run the stage again"):
        arrays = read_npz(path)
    missing = [name for name in required if name not in arrays]
    if missing:
        raise SceneError(f"{path}: array {', '.join(missing)} is missing; run the stage again")
    return arrays


def _json(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise SceneError(f"{path}: not JSON ({error}); run the scene again") from error
    if not isinstance(content, dict):
        raise SceneError(f"{path}: contains {type(content).__name__}, not a table of names")
    return content

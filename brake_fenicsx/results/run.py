"""A run: its stored samples and all else that its folder holds; any part may be absent."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from brake_fenicsx.arguments import AnyArray, Array, likely
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import extras, load
from brake_fenicsx.folder.arrays import read_npz, reading
from brake_fenicsx.folder.store import PREPARED, Store

from . import driver_tables, sample_blocks
from .squeal import Family, SquealTable
from .stored import StoredModes, StoredSamples
from .tables import Columns

if TYPE_CHECKING:
    import pandas as pd

Arrays = dict[str, AnyArray]

# Names of approaches as a person reads them, the simplest first.
APPROACHES = {n: n.capitalize() for n in ("classical", "parametric", "multi-scale", "joint")}
SMOOTH = "Smooth contact"  # the approach "multi-scale" of a scene without roughness
# Files of tables that need more than the samples: the brake, lines of a sweep, resampling.
CONTACT, SWEEP, CAUSES = "contact.npz", "sweep.npz", "causes.npz"
# of every surface, scanned or given by numbers
SURFACE = ("stats", "hdf_z", "hdf_density", "fit_q", "fit_C", "q_band")


@dataclass(frozen=True)
class RunData:
    """The results of one run; a part that the scene did not ask for is None or empty.

    Attributes:
        directory: where the run wrote.
        stored: the samples that the columns are of; None where these are given.
        modes: columns of ``modes.csv``, arrays of shape (n_modes,).
        samples: columns of ``samples.csv``, arrays of shape (n_samples,).
        contact: columns of ``contact.csv``, arrays of shape (n_elements,).
        drivers: columns of ``drivers.csv``, arrays of shape (n_derivatives,).
        driver_maps: columns of ``drivers_contact.csv``.
        causes: ``probabilities`` and ``sensitivity``, columns of their CSV files.
        laws: arrays of ``laws.npz``.
        surface: arrays of ``surface.npz``.
        maps: arrays of ``contact_maps.npz``.
        faces: arrays of ``contact_faces.npz``.
        sweep: columns of the tables of a sweep by the stem of their files, such as ``lock_in``.
        extras: columns of the tables of extras, likewise.
        summary: content of ``summary.json``.
        scene: text of ``scene.toml``.
    """

    directory: Path
    stored: StoredSamples | None = None
    modes: Columns | None = None
    samples: Columns | None = None
    contact: Columns | None = None
    drivers: Columns | None = None
    driver_maps: Columns | None = None
    causes: dict[str, Columns] = field(default_factory=dict)
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
    def errors(self) -> Array:
        """Errors of the eigenvalues over |lambda|, shape (n_modes,); nan of rigid modes."""
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
    def families(self) -> dict[str, list[Family]]:
        """Families that squeal of each approach, the most severe first."""
        return {name: self.squeal.families(name) for name in self.approaches}

    @cached_property
    def lead(self) -> str:
        """The approach that a verdict is about; empty without modes and samples.

        That with the most of what varies, of those with good samples; several of them first.
        """
        counts = [self.squeal.count(name) for name in self.approaches]
        several = [c.approach for c in counts if c.samples > 1]
        good = [c.approach for c in counts if c.samples]
        return (several or good or self.approaches or [""])[-1]

    def in_effect(self, section: str) -> Mapping[str, Any]:
        """Values of a section of the scene, defaults too; empty where there are none."""
        values = self.summary.get("in_effect", {}).get(section)
        return values if isinstance(values, Mapping) else {}

    @property
    def threshold(self) -> float:
        """An unstable mode counts as squeal where its damping lies below minus this."""
        return float(self.in_effect("stability").get("threshold", 0.0))

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

    def to_pandas(self, table: str = "modes") -> pd.DataFrame:
        """A table of the run as a data frame.

        Args:
            table: "modes", "samples", or the stem of another CSV file, such as "lock_in".

        Raises:
            SceneError: the run has no such table.
        """
        import pandas as pd

        names = ("modes", "samples", "contact", "drivers")
        there = {name: held for name in names if (held := getattr(self, name)) is not None}
        there |= {"drivers_contact": self.driver_maps} if self.driver_maps is not None else {}
        there |= {**self.causes, **self.sweep, **self.extras}
        if table not in there:
            raise SceneError(f"""{self.directory}: no table {table!r}{likely(table, there)}; there
                are {", ".join(there)}""")
        return pd.DataFrame({name: there[table][name] for name in there[table]})

    def label(self, approach: str) -> str:
        """Name of an approach as a person reads it: "multi-scale" names roughness that is there."""
        contacts = self.in_effect("contact").values()
        rough = any(c.get("law") == "library" or c.get("gap", "none") != "none" for c in contacts)
        if approach == "multi-scale" and contacts and not rough:
            return SMOOTH
        return APPROACHES.get(approach, approach)


def eigenvalue_errors(modes: Columns) -> Array:
    """Error estimates of the eigenvalues of a table over |lambda|; nan of rigid modes."""
    from brake_fenicsx.stability.modes import relative_errors

    names = "real_1_s", "frequency_hz", "error_estimate"
    parts = modes.parts(*names) if isinstance(modes, StoredModes) else [modes]
    each = ([np.asarray(part[name], float) for name in names] for part in parts)
    found = [relative_errors(real + 2j * np.pi * f, error) for real, f, error in each]
    return np.concatenate([np.zeros(0), *found])


def sort_approaches(names: set[str]) -> list[str]:
    """Order approaches: the known ones from the simplest on, then the others by name."""
    known = [name for name in APPROACHES if name in names]
    return known + sorted(names - set(APPROACHES))


def scan_heights(surface: Arrays) -> list[AnyArray]:
    """Heights of each scan of a surface [m], shape (nx, ny) each; none with numbers alone."""
    if "heights" not in surface:
        return []
    return [*surface["heights"].reshape(-1, *surface["heights"].shape[-2:])]


def read_run(directory: str | Path | RunData, summary: dict[str, Any] | None = None) -> RunData:
    """Read all that a run has written, and its samples block by block.

    Args:
        directory: the run directory, or results already read, which are handed back.
        summary: what ``summary.json`` will have, of a run at work; that of the file if None.

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
    summary = _json(root / "summary.json") if summary is None else summary
    run = RunData(
        directory=root,
        contact=read_tables(root / CONTACT).get("contact"),
        causes=read_tables(root / CAUSES),
        laws=_arrays(root / "laws.npz", ("d", "p", "k")),
        surface=_arrays(root / "surface.npz", SURFACE),
        maps=_arrays(root / "contact_maps.npz", ("size", "p_over_E", "pressures", "area_fraction")),
        faces=_arrays(root / "contact_faces.npz", ("corners", "facet")),
        sweep=read_tables(root / SWEEP),
        summary=summary,
        scene=scene.read_text(encoding="utf-8") if scene.is_file() else None,
    )
    if (stored := _stored(run)) is not None:
        run = replace(run, **_of_samples(run, stored))
    if not any((run.stored, run.contact, run.laws, run.surface, run.maps, run.summary)):
        what = "no result of a run (samples, laws.npz, surface.npz, ...)"
        raise SceneError(f"{root}: contains {what}")
    return run


def _stored(run: RunData) -> StoredSamples | None:
    """The samples of a folder; None where no sample is there."""
    store = Store(run.directory)
    store.digest = store.known()
    if not store.digest or not (count := _json(store.path(PREPARED))):
        return None
    tasks = [(name, k) for name, n in count.items() for k in range(n)]
    settings = run.summary.get("in_effect", {})
    threshold = run.threshold if "stability" in settings.get("stages", ("stability",)) else None
    stored = StoredSamples(store, tasks, sample_blocks.tabulation_of(store, tasks, threshold))
    return stored if stored.rows["approach"] else None


def _of_samples(run: RunData, stored: StoredSamples) -> dict[str, Any]:
    """Parts of a run that its samples tell."""
    in_effect = run.summary.get("in_effect", {})
    parts: dict[str, Any] = {"stored": stored, "samples": stored.samples, "extras": {}}
    if stored.modes.any or "stability" in in_effect.get("stages", ()):
        parts["modes"] = stored.modes
    for extra in extras():
        if extra.make_tables and not in_effect.keys().isdisjoint(extra.sections):
            tables = load(extra.make_tables)(stored)
            parts["extras"] |= {name: table.columns for name, table in tables.items()}
        if extra.stage and not in_effect.keys().isdisjoint(extra.sections):
            parts["extras"] |= read_tables(run.directory / f"{extra.name}.npz")
    drivers = driver_tables.driver_table(stored, run.threshold)
    if drivers.cells:
        maps = driver_tables.contact_driver_table(stored, run.threshold)
        parts |= {"drivers": drivers.columns, "driver_maps": maps.columns}
    return parts


def save_tables(store: Store, name: str, tables: Mapping[str, Columns]) -> None:
    """Keep columns of tables in a file of arrays.

    Args:
        store: the results folder.
        name: of the file.
        tables: columns by the name of their table.
    """
    every = ((f"{t}/{c}", values) for t, columns in tables.items() for c, values in columns.items())
    store.save(name, **dict(every))


def read_tables(path: Path) -> dict[str, Columns]:
    """Columns of ``save_tables`` by the name of their table; none without the file.

    Raises:
        SceneError: the file is damaged.
    """
    tables: dict[str, dict[str, AnyArray]] = {}
    for name, values in (_arrays(path, ()) or {}).items():
        table, _, column = name.partition("/")
        tables.setdefault(table, {})[column] = values
    return dict(tables)


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

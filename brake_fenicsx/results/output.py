"""Tables at the end of a run: CSV files for users, arrays of what the samples do not tell."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.extensions import load, named
from brake_fenicsx.folder import sample_files
from brake_fenicsx.folder.memory import release_memory
from brake_fenicsx.folder.processes import on_first
from brake_fenicsx.folder.sample_files import Task
from brake_fenicsx.folder.store import Store
from brake_fenicsx.macro.contact_elements import Contact
from brake_fenicsx.samples.forces import contact_of, force_statistics
from brake_fenicsx.samples.numbering import dof_points
from brake_fenicsx.samples.study import Study
from brake_fenicsx.scene.in_effect import in_effect

from . import sample_blocks as blocks
from .counts import sample_facts, verification
from .driver_tables import contact_driver_table, driver_table
from .family_shapes import FILE as SHAPES
from .family_shapes import family_shapes
from .run import CAUSES, CONTACT, read_run, save_tables
from .stored import StoredSamples
from .tables import MODES, Row, RowTable, column_writer

if TYPE_CHECKING:
    from .probabilities import Ensemble

First = Mapping[Task, Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class ContactElement(Row):
    """A row of contact.csv: a contact element of the first good sample of an approach."""

    approach: str
    sample: int
    element: int
    x: float
    y: float
    z: float
    area: float
    g: float
    g_cr: float
    p: float
    k: float
    k_vibration: float
    law: int


def prepare_blocks(study: Study) -> None:
    """Let blocks of samples be tabulated as they are packed; collective.

    Where there are more samples than a block has, the first ones of every approach are computed.
    A share computes none: without the families of a folder that was prepared its blocks are packed
    as they are, and the end of the run tabulates them.
    """
    stability = study.scene.stability
    many = stability is not None and len(study.tasks) > sample_files.BLOCK
    there = on_first(lambda: study.store.path(blocks.FOUNDERS).is_file(), study.comm)
    if many and not there:
        if study.store.share is not None:
            return
        study.run(blocks.FOUNDING)
        on_first(lambda: _keep_founders(study), study.comm)
    tabulate = blocks.tabulation_of(
        study.store, study.tasks, None if stability is None else stability.threshold
    )
    own = {name for name, _ in study.tasks}
    study.store.samples.tabulate = lambda tasks, load: (
        tabulate(tasks, load) if tasks[0][0] in own else None
    )


def _keep_founders(study: Study) -> None:
    made = blocks.founders_of(study.store, study.tasks)
    vectors, frequencies = np.array(made.vectors), np.array(made.frequencies)
    study.store.save(blocks.FOUNDERS, vectors=vectors, frequencies=frequencies)


def write_results(study: Study) -> First:
    """Write the tables, count, and keep figures for the summary in the study; collective.

    Returns:
        What was stored of the first good sample of each approach.
    """
    points = dof_points(study.brake)
    first, facts, found = on_first(lambda: _tables(study, points), study.comm)
    release_memory()
    study.facts |= facts
    if found is not None:
        from .probabilities import cause_tables, find_causes, probability_facts

        samples = study.scene.samples
        find_causes(samples, found, study.comm)

        def write() -> dict[str, Any]:
            tables = cause_tables(samples, found)
            for name, table in tables.items():
                table.write(study.store.path(f"{name}.csv"))
            save_tables(study.store, CAUSES, {n: t.columns for n, t in tables.items()})
            return probability_facts(samples, found)

        study.facts["probabilities"] = on_first(write, study.comm)
    if study.brake.stuck:
        from brake_fenicsx.samples.forces import stuck_states

        study.facts["stuck_contact"] = on_first(
            lambda: stuck_states(study.scene, study.brake, first, study.displacements(first)),
            study.comm,
        )
    return first


def _tables(
    study: Study, points: NDArray[np.float64]
) -> tuple[First, dict[str, Any], list[Ensemble] | None]:
    """The same on one process, but for the causes of squeal, which all share."""
    scene, path, stability = study.scene, study.store.path, study.scene.stability
    run = read_run(study.store.directory, {"in_effect": in_effect(scene)})
    if (stored := run.stored) is None:
        raise ValueError(f"{run.directory}: no samples")
    facts = sample_facts(stored)
    if study.verify:
        facts["verification"] = verification(stored, study.verify, study.verified)
    first = {task[0]: data for task, data in stored.first.items()}
    facts["contact_forces"] = {
        name: force_statistics(scene, study.brake, first[name], values)
        for name, values in stored.forces().items()
    }
    tables = {
        "samples": RowTable(tuple(stored.rows), zip(*stored.rows.values(), strict=True)),
        "contact": RowTable.of(ContactElement, _contact(stored, study.brake.contact)),
    }
    save_tables(study.store, CONTACT, {"contact": tables["contact"].columns})
    if "stability" in scene.stages:
        with column_writer(path("modes.csv"), MODES) as write:
            for part in stored.modes.parts():
                write(part)
        if stored.members.vectors:
            study.families = np.array(stored.members.vectors).T
            # A sweep compares modes that begin to squeal with the squealing mode of each family.
            study.squealing = [*stored.squealing_members]
            for n, vector in stored.squealing_members.items():
                study.families[:, n] = vector
        _write_shapes(study, points, stored)
    if stability is not None and study.drivers is not None:
        tables["drivers"] = driver_table(stored, stability.threshold)
        tables["drivers_contact"] = contact_driver_table(stored, stability.threshold)
    for extra in named(scene) if stability is not None else ():
        if extra.make_tables:
            tables |= load(extra.make_tables)(stored)
    for name, table in tables.items():
        table.write(path(f"{name}.csv"))
    found = None
    if stability is not None and {"stability", "uncertainty"} <= {*scene.stages}:
        from .probabilities import ensembles

        found = ensembles(run, stability.band)
    return stored.first, facts, found


def _contact(stored: StoredSamples, contact: Contact) -> Iterator[ContactElement]:
    """Contact elements of the first good sample of each approach."""
    for task, d in stored.first.items():
        own = contact_of(contact, d)
        names = ("g", "g_cr", "p", "k", "k_vibration")
        values = np.column_stack([own.points, own.w, *(d[name] for name in names)])
        for i, (row, law) in enumerate(zip(values, d["law"], strict=True)):
            yield ContactElement.of(*task, i, *map(float, row), int(law))


def _write_shapes(study: Study, points: NDArray[np.float64], stored: StoredSamples) -> None:
    """Shapes of the families that squeal, for comparisons with other runs."""
    if known := stored.squealing_members:
        u = study.models.coordinates.displacements(np.array([*known.values()]).T)
        body = study.models.numbering.body
        study.store.save(SHAPES, **family_shapes(points, body, u, np.array([*known])))


def save_stage(store: Store, name: str, tables: Mapping[str, RowTable]) -> None:
    """Write the tables of an extra's stage, and keep their columns.

    Args:
        store: the results folder.
        name: of the extra.
        tables: by their stem; none on other processes than the first.
    """
    for stem, table in tables.items():
        table.write(store.path(f"{stem}.csv"))
    if tables:
        save_tables(store, f"{name}.npz", {stem: table.columns for stem, table in tables.items()})

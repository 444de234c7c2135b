"""Tables of a run from its stored samples: samples.csv, modes.csv, contact.csv and what follows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.folder.processes import on_first
from brake_fenicsx.folder.sample_files import Task
from brake_fenicsx.uncertainty.forces import forces_of_sample, forces_of_samples
from brake_fenicsx.uncertainty.numbering import dof_points
from brake_fenicsx.uncertainty.shapes import FILE as SHAPES
from brake_fenicsx.uncertainty.shapes import family_shapes
from brake_fenicsx.uncertainty.study import Study

from .run import RunData
from .stored import Results
from .tables import CONTACT, MODES, SAMPLES, read_columns, write_rows


def write_results(study: Study) -> dict[Task, dict[str, Any]]:
    """Write the tables, count, and keep figures for the summary in the study; collective.

    Returns:
        What was stored of the first good sample of each approach.
    """
    points = dof_points(study.brake)
    first, facts = on_first(lambda: _tables(study, points), study.comm)
    study.facts |= facts
    if study.brake.stuck:
        from brake_fenicsx.uncertainty.stuck_states import stuck_states

        study.facts["stuck_contact"] = on_first(
            lambda: stuck_states(study.scene, study.brake, first, study.displacement), study.comm
        )
    return first


def _tables(
    study: Study, points: NDArray[np.float64]
) -> tuple[dict[Task, dict[str, Any]], dict[str, Any]]:
    """The same on one process: all samples are read."""
    scene, path, stability = study.scene, study.store.path, study.scene.stability
    results = Results(
        study.store, study.tasks, study.verify, study.verified,
        stability.threshold if stability else 0.0, study.brake.contact.speed > 0,
        forces_of_sample(scene, study.brake),
    )  # fmt: skip
    facts = results.facts()
    facts["contact_forces"] = forces_of_samples(scene, results.derived)
    write_rows(path("samples.csv"), results.sample_columns(SAMPLES), results.samples())
    if "stability" in scene.stages:
        write_rows(path("modes.csv"), results.mode_columns(MODES), results.modes())
        if results.members.vectors:
            study.families = np.array(results.members.vectors).T
        _write_shapes(study, points, results)
    write_rows(path("contact.csv"), CONTACT, results.contact(study.brake.contact))
    if stability is not None and study.drivers is not None:
        from .driver_tables import write_drivers

        write_drivers(path(), results, stability.threshold)
    if study.cycles is not None:
        from .cycle_tables import write_cycles

        write_cycles(path(), results)
    if stability is not None and {"stability", "uncertainty"} <= {*scene.stages}:
        from .probabilities import ensembles, write_causes

        modes, table = (read_columns(path(f"{name}.csv")) for name in ("modes", "samples"))
        settings = {"in_effect": {"stability": {"threshold": stability.threshold}}}
        found = ensembles(RunData(path(), modes, table, summary=settings), stability.band)
        facts["probabilities"] = write_causes(path(), scene.samples, found)
    return {task: results.stored[task] for task in results.first()}, facts


def _write_shapes(study: Study, points: NDArray[np.float64], results: Results) -> None:
    """Shapes of the families that squeal, for comparisons with other runs."""
    numbers, vectors = results.squealing_members()
    if numbers:
        u, body = study.models.shapes(vectors), study.models.numbering.body
        study.store.save(SHAPES, **family_shapes(points, body, u, np.array(numbers)))

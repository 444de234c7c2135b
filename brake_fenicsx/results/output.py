"""The end of a run: CSV files, arrays of what the samples do not tell, figures of the summary."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from brake_fenicsx.extensions import load, named
from brake_fenicsx.folder import sample_files
from brake_fenicsx.folder.processes import on_first, release_memory
from brake_fenicsx.folder.sample_files import Task
from brake_fenicsx.folder.store import Store
from brake_fenicsx.macro.contact_elements import Contact
from brake_fenicsx.samples.forces import contact_of, force_statistics, stuck_states
from brake_fenicsx.samples.numbering import dof_places
from brake_fenicsx.samples.study import Study
from brake_fenicsx.scene.digest import in_effect

from . import driver_tables, families, probabilities
from . import sample_blocks as blocks
from .run import CAUSES, CONTACT, eigenvalue_errors, read_run, save_tables
from .stored import PROVEN, StoredSamples
from .tables import Row, RowTable, column_writer

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
        on_first(lambda: blocks.keep_founders(study.store, study.tasks), study.comm)
    tabulate = blocks.tabulation_of(
        study.store, study.tasks, None if stability is None else stability.threshold
    )
    approaches = {name for name, _ in study.tasks}
    study.store.samples.tabulate = lambda tasks, load: (
        tabulate(tasks, load) if tasks[0][0] in approaches else None
    )


def write_results(study: Study) -> First:
    """Write the tables, count, and keep figures for the summary in the study; collective.

    Returns:
        What was stored of the first good sample of each approach.
    """
    first, facts, approaches = on_first(lambda: _tables(study), study.comm)
    release_memory()
    study.facts |= facts
    if approaches is not None:
        samples = study.scene.samples
        probabilities.find_causes(samples, approaches, study.comm)

        def write() -> dict[str, Any]:
            tables = probabilities.cause_tables(samples, approaches)
            for name, table in tables.items():
                table.write(study.store.path(f"{name}.csv"))
            save_tables(study.store, CAUSES, {n: t.columns for n, t in tables.items()})
            return probabilities.probability_facts(samples, approaches)

        study.facts["probabilities"] = on_first(write, study.comm)
    if study.brake.stuck:
        study.facts["stuck_contact"] = on_first(
            lambda: stuck_states(study.scene, study.brake, first, study.displacements(first)),
            study.comm,
        )
    return first


def _tables(study: Study) -> tuple[First, dict[str, Any], list[probabilities.Ensemble] | None]:
    """The same on one process, but for the causes of squeal, which all share."""
    scene, path, stability = study.scene, study.store.path, study.scene.stability
    run = read_run(study.store.directory, {"in_effect": in_effect(scene)})
    if (stored := run.stored) is None:
        raise ValueError(f"{run.directory}: no samples")
    facts = sample_facts(stored)
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
        with column_writer(path("modes.csv"), [*stored.modes], stored.modes.rows) as write:
            for part in stored.modes.parts():
                write(part)
        _keep_families(study, stored)
    if (of_modes := study.models.stability) is not None and of_modes.drivers:
        tables["drivers"] = driver_tables.driver_table(stored, of_modes.threshold)
        tables["drivers_contact"] = driver_tables.contact_driver_table(stored, of_modes.threshold)
    for extra in named(scene) if stability is not None else ():
        if extra.make_tables:
            tables |= load(extra.make_tables)(stored)
    for name, table in tables.items():
        table.write(path(f"{name}.csv"))
    approaches = None
    if stability is not None and {"stability", "uncertainty"} <= {*scene.stages}:
        approaches = probabilities.ensembles(run, stability.band)
    return stored.first, facts, approaches


def _keep_families(study: Study, stored: StoredSamples) -> None:
    """Vectors of the families for a sweep, and their shapes for comparisons with other runs."""
    known = stored.squealing_members
    if stored.members.vectors:
        study.families = np.array(stored.members.vectors).T
        # A sweep compares modes that begin to squeal with the squealing mode of each family.
        study.squealing = [*known]
        for n, vector in known.items():
            study.families[:, n] = vector
    if known:
        places = dof_places(study.brake, study.models.numbering.body)
        u = study.models.coordinates.displacements(np.array([*known.values()]).T)
        study.store.save(families.SHAPES, **families.family_shapes(places, u, np.array([*known])))


def _contact(stored: StoredSamples, contact: Contact) -> Iterator[ContactElement]:
    """Contact elements of the first good sample of each approach."""
    for task, d in stored.first.items():
        elements = contact_of(contact, d)
        names = ("g", "g_cr", "p", "k", "k_vibration")
        values = np.column_stack([elements.points, elements.w, *(d[name] for name in names)])
        for i, (row, law) in enumerate(zip(values, d["law"], strict=True)):
            yield ContactElement.of(*task, i, *map(float, row), int(law))


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


def sample_facts(stored: StoredSamples) -> dict[str, Any]:
    """Figures over the samples of each approach.

    Args:
        stored: the samples.

    Returns:
        "samples", by approach, "failed_samples" and, where something beside the modes of a sample
        failed, "lost_extras".
    """
    names = [str(name) for name in stored.rows["approach"]]
    good = [status == "ok" for status in stored.rows["status"]]
    approaches = dict.fromkeys(name for name, _ in stored.tasks)
    figures = {name: _approach(stored, name, names, good) for name in approaches}
    facts: dict[str, Any] = {"samples": figures, "failed_samples": good.count(False)}
    each = zip(names, stored.rows["sample"], stored.of_each("lost"), strict=True)
    if lost := [(f"{text} (sample {name} {k}") for name, k, text in each if text]:
        others = f", and in {len(lost) - 1} more samples" if lost[1:] else ""
        facts["lost_extras"] = [f"{lost[0]}{others})"]
    return facts


def _approach(
    stored: StoredSamples, name: str, names: list[str], good: list[bool]
) -> dict[str, Any]:
    """Figures over the good samples of an approach."""
    rows = [i for i, (of, ok) in enumerate(zip(names, good, strict=True)) if ok and of == name]

    def values(key: str) -> list[Any]:
        every = stored.of_each(key)
        return [every[i] for i in rows if every[i] is not None]

    about: dict[str, Any] = {"good": len(rows)}
    if kinds := values("count_kind"):
        said = {PROVEN: "", "counted": "not proven: "}.get(kinds[0], f"{kinds[0]}: ")
        mine = np.asarray(stored.modes["approach"] == name)
        verdict = stored.modes["verdict"][mine]
        largest = np.fmax.reduce(eigenvalue_errors(stored.modes)[mine], initial=0.0)
        about |= {
            "modes": int(mine.sum()),
            "counted_by": said + values("counted")[0],
            "not_complete": sum(kind != PROVEN for kind in kinds),
            "tolerance_missed": sum(map(int, values("tolerance_missed"))),
            "largest_error": float(largest),
            "unstable": int((verdict == "unstable").sum()),
            "neutral": int((verdict == "neutral").sum()),
            "seconds_per_stability": float(np.median(values("stability_seconds"))),
        }
    if rejected := values("rejected"):
        about["rejected_draws"] = sum(map(int, rejected))
    if beyond := max(map(float, values("beyond_laws")), default=0.0):
        about["force_share_beyond_laws"] = beyond
    if rows:
        about["seconds_per_equilibrium"] = float(np.median(values("equilibrium_seconds")))
        about["newton_iterations"] = float(np.median(values("equilibrium_iterations")))
    return about


def verification(study: Study) -> dict[str, Any]:
    """Reduced samples against full order, by what is stored of both; empty without any."""
    if not study.verify:
        return {}
    errors, wrong, beyond, compared = [np.zeros(0)], 0, 0, 0
    for task in study.verify:
        both = task, (study.verified, task[1])
        full, mine = (study.store.samples.load(t) or {} for t in both)
        if "s" not in full or "s" not in mine or mine["s"].size != full["s"].size:
            continue
        compared += 1
        error = np.abs(mine["s"] - full["s"])
        beyond += int(np.sum(~(error <= mine["error"] + full["error"])))
        errors.append(error / np.abs(full["s"]))
        pairs = zip(mine["verdict"], full["verdict"], strict=True)
        wrong += sum({str(a), str(b)} == {"stable", "unstable"} for a, b in pairs)
    error = np.concatenate(errors)
    return {
        "samples_asked": len(study.verify), "samples_compared": compared,
        "eigenvalues": int(error.size), "wrong_verdicts": wrong,
        "errors_beyond_estimates": beyond,
        "largest_relative_error": float(error.max()) if error.size else None,
        "median_relative_error": float(np.median(error)) if error.size else None,
    }  # fmt: skip

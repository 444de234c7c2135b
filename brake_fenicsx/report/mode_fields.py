"""What is seen of a study: fields for ParaView, pictures of squeal modes, the contact faces."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.processes import in_turns, on_first
from brake_fenicsx.sample_files import Task
from brake_fenicsx.scene.in_effect import in_effect
from brake_fenicsx.tables import read_columns

from .counts import ModeKey, representative_modes
from .rundata import RunData

if TYPE_CHECKING:
    from brake_fenicsx.uncertainty.study import Study

MOST = 4  # modes drawn for each approach, of the most severe families


def write_mode_fields(study: Study, first: Mapping[Task, Mapping[str, Any]]) -> None:
    """Write fields/*.xdmf, figures/mode_*.png and contact_faces.npz; collective.

    Equilibrium and contact are those of the first sample of each approach; modes are of its most
    severe families, of each the squeal mode of median damping.

    Args:
        study: the study.
        first: what was stored of the first good sample of each approach.
    """
    store, comm = study.store, study.comm
    if comm.rank == 0:
        shutil.rmtree(store.path("fields"), ignore_errors=True)
        for name in ("fields", "figures"):
            store.path(name).mkdir(exist_ok=True)
        for old in store.path("figures").glob("mode_*.png"):
            old.unlink()
    comm.Barrier()
    faces = contact_faces(study)
    for task, data in first.items():
        _write_equilibrium(study, task, data, faces)
    run, drawn = _severe(study)
    for chosen in drawn:
        _write_modes(study, run, chosen)
    if comm.rank > 0:
        return
    from .fields import say_once

    say_once(study.brake.elastic.free.V, store.path("fields"))


def contact_faces(study: Study) -> dict[str, NDArray]:
    """Facets of the interfaces' first faces, and the facet of every contact element; collective.

    An element of "patch" or "quadrature" belongs to the facet whose centre is nearest; one of
    "node" to none.

    Args:
        study: the study; process 0 writes its contact_faces.npz.

    Returns:
        ``corners`` in cyclic order [m], shape (facets, 3 or 4, 3), ``facet``, -1: none, and
        ``slides``, whether an element's faces slide.
    """
    from scipy.spatial import KDTree

    from brake_fenicsx.macro.faces import gather_face

    b = study.brake
    facet, corners, count = np.full(len(b.w), -1), [], 0
    for i, table in enumerate(study.scene.contact.values()):
        face = gather_face(b.mesh, b.elastic.free, table.faces[0])
        if table.discretisation != "node":
            own = b.contact.interface == i
            facet[own] = count + KDTree(face.centre).query(b.points[own])[1]
        corners.append(face.corners)
        count += len(face.corners)
    found = {"corners": np.concatenate(corners), "facet": facet, "slides": b.contact.speed > 0}
    if study.comm.rank == 0:
        study.store.save("contact_faces.npz", **found)
    return found


def _write_equilibrium(
    study: Study, task: Task, data: Mapping[str, Any], faces: dict[str, NDArray]
) -> None:
    """Displacement; pressure, gap, stiffness and state of every contact element."""
    from .contact_fields import facet_means, write_facets, write_points
    from .fields import write_fields

    folder, name, V = study.store.path("fields"), task[0], study.brake.elastic.free.V
    # On one process: the factor of all bodies is large.
    u = on_first(lambda: study.displacement(task, data), study.comm)
    if study.comm.rank != 0:
        return
    u = study.brake.elastic.free.expand(u)
    if study.brake.lift is not None:
        u = u + study.brake.lift
    write_fields(folder / f"equilibrium_{name}.xdmf", V, {"u_e": u})
    values = {key: data[key] for key in ("g", "g_cr", "p", "k", "k_vibration")}
    values["active"] = (data["p"] > 0).astype(float)
    write_points(folder / f"contact_{name}.xdmf", study.brake.points, values)
    facet, corners = faces["facet"], faces["corners"]
    if np.any(facet >= 0):
        means = {
            key: facet_means(facet, study.brake.w, v, len(corners)) for key, v in values.items()
        }
        held = np.isfinite(means["p"])
        means = {key: v[held] for key, v in means.items()}
        write_facets(folder / f"pressure_{name}.xdmf", corners[held], means)


def _severe(study: Study) -> tuple[RunData, list[list[ModeKey]]]:
    """Tables of the study, and the modes drawn of each approach that squeals; collective."""
    found: tuple[RunData, list[list[ModeKey]]] | None = None
    if study.comm.rank == 0:
        folder = study.store.directory
        run = RunData(
            folder,
            modes=read_columns(folder / "modes.csv") if "stability" in study.scene.stages else None,
            samples=read_columns(folder / "samples.csv"),
            summary={"in_effect": in_effect(study.scene)},
        )
        keys = (representative_modes(run, name, MOST) for name in run.approaches)
        found = run, [chosen for chosen in keys if chosen]
    return study.comm.bcast(found, root=0)


def _write_modes(study: Study, run: RunData, chosen: list[ModeKey]) -> None:
    """Real and imaginary part of some modes of an approach, one period of each, and its picture.

    The processes take the modes in turns.
    """
    from brake_fenicsx.report.render import render_mode
    from brake_fenicsx.report.style import label

    from .fields import write_fields, write_phases

    store, name, V = study.store, chosen[0].approach, study.brake.elastic.free.V

    def draw(i: int) -> tuple[str, NDArray[np.complex128]]:
        mode = chosen[i]
        task = (name, mode.sample)
        x = displacements(study, task, study.stored(task), np.array([mode.mode]))[:, 0]
        hertz, share = f"{mode.frequency:05.0f}Hz", mode.family.share
        shape = study.brake.elastic.free.expand(x)
        write_phases(store.path("fields", f"phase_{name}_{hertz}.xdmf"), V, shape)
        often = f"; family squeals in {share.hits} of {share.n} samples" if share.n > 1 else ""
        title = (
            f"{label(run, name)}, sample {mode.sample}: {mode.frequency:.0f} Hz,"
            f" damping {mode.damping:.2e}{often}"
        )
        render_mode(store.path("figures", f"mode_{name}_{hertz}.png"), V, shape, title)
        return f"mode_{hertz}", shape

    fields = dict(in_turns(len(chosen), draw, study.comm))
    if study.comm.rank == 0:
        write_fields(store.path("fields", f"modes_{name}.xdmf"), V, fields)


def displacements(
    study: Study, task: Task, data: Mapping[str, Any], chosen: NDArray[np.intp]
) -> NDArray[np.complex128]:
    """Displacements of some unstable modes of a stored sample, shape (dofs, chosen).

    Args:
        study: the study.
        task: the sample.
        data: what was stored of it.
        chosen: numbers of the modes.
    """
    if "vectors" in data:
        column = {int(m): j for j, m in enumerate(data["vector_mode"])}
        kept = data["vectors"][:, [column[int(i)] for i in chosen]]
        return kept.astype(complex)
    from brake_fenicsx.uncertainty.solve import expanded

    return expanded(study.models, task[0], study._draw(*task), data, chosen)

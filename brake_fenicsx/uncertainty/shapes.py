"""What is seen of a study: fields for ParaView, pictures of unstable modes, the contact faces."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .ensemble import Task
from .results import Results

if TYPE_CHECKING:
    from .study import Study

# Unstable modes drawn for each approach, the most unstable first.
MOST = 4


def write_shapes(study: Study, results: Results) -> None:
    """Write fields/*.xdmf, figures/mode_*.png and contact_faces.npz; collective.

    Equilibrium and contact are those of the first sample of each approach, modes those of its first
    sample that has an unstable one.

    Args:
        study: the study.
        results: its stored samples.
    """
    store, comm = study.store, study.comm
    if comm.rank == 0:
        for name in ("fields", "figures"):
            store.path(name).mkdir(exist_ok=True)
        for old in store.path("figures").glob("mode_*.png"):
            old.unlink()
    comm.Barrier()
    faces = contact_faces(study)
    for task in results.first():
        _write_equilibrium(study, task, results.stored[task], faces)
    for task in _unstable_samples(results):
        _write_modes(study, task, results.stored[task])
    from brake_fenicsx.report.fields import say_once

    say_once(study.brake.elastic.free.V, store.path("fields"))


def contact_faces(study: Study) -> dict[str, NDArray]:
    """Facets of the interfaces' first faces, and the facet of every contact element; collective.

    An element of "patch" or "quadrature" belongs to the facet whose centre is nearest; one of
    "node" to none.

    Args:
        study: the study; process 0 writes its contact_faces.npz.

    Returns:
        ``corners`` in cyclic order [m], shape (facets, 3 or 4, 3), and ``facet``, -1: none.
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
    found = {"corners": np.concatenate(corners), "facet": facet}
    if study.comm.rank == 0:
        study.store.save("contact_faces.npz", **found)
    return found


def _write_equilibrium(
    study: Study, task: Task, data: dict[str, Any], faces: dict[str, NDArray]
) -> None:
    """Displacement; pressure, gap, stiffness and state of every contact element."""
    from brake_fenicsx.report.contact_fields import facet_means, write_facets, write_points
    from brake_fenicsx.report.fields import write_fields

    folder, name, V = study.store.path("fields"), task[0], study.brake.elastic.free.V
    u = study.brake.local(study.displacement(task, data))
    write_fields(folder / f"equilibrium_{name}.xdmf", V, {"u_e": u})
    if study.comm.rank != 0:
        return
    values = {key: data[key] for key in ("g", "g_cr", "p", "k")}
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


def _unstable_samples(results: Results) -> list[Task]:
    """The first good sample of each approach that has an unstable mode."""
    chosen: dict[str, Task] = {}
    for task in results.good():
        if np.any(results.stored[task].get("verdict", np.zeros(0, str)) == "unstable"):
            chosen.setdefault(task[0], task)
    return list(chosen.values())


def _write_modes(study: Study, task: Task, data: dict[str, Any]) -> None:
    """Real and imaginary part of the most unstable modes, one period of each, and its picture."""
    from brake_fenicsx.report.fields import write_fields, write_phases
    from brake_fenicsx.report.render import render_mode
    from brake_fenicsx.report.style import label

    store, name, V = study.store, task[0], study.brake.elastic.free.V
    chosen, X = _unstable(study, task, data)
    fields = {}
    for i, x in zip(chosen, X.T, strict=True):
        hertz, damping = abs(data["s"][i].imag) / 2 / np.pi, float(data["damping"][i])
        fields[f"mode_{hertz:05.0f}Hz"] = local = study.brake.local(x)
        write_phases(store.path("fields", f"phase_{name}_{hertz:05.0f}Hz.xdmf"), V, local)
        title = f"{label(name)}, sample {task[1]}: {hertz:.0f} Hz, damping {damping:.2e}"
        render_mode(store.path("figures", f"mode_{name}_{hertz:05.0f}Hz.png"), V, local, title)
    write_fields(store.path("fields", f"modes_{name}.xdmf"), V, fields)


def _unstable(study: Study, task: Task, data: dict[str, Any]) -> tuple[NDArray, NDArray]:
    """Numbers and displacements of the most unstable modes."""
    if "s" not in data:
        return np.zeros(0, dtype=int), np.zeros((len(study.brake.f), 0))
    unstable = np.flatnonzero(data["verdict"] == "unstable")
    chosen = unstable[np.argsort(data["damping"][unstable], kind="stable")][:MOST]
    column = {int(m): j for j, m in enumerate(data.get("vector_mode", ()))}
    kept = [column[int(i)] for i in chosen if int(i) in column]
    if "vectors" in data:
        return chosen, study.models.numbering.present(data["vectors"][:, kept].astype(complex))
    from .solve import expanded

    return chosen, expanded(study.models, task[0], study._draw(*task), data, chosen)

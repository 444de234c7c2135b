"""Displacements of the first sample of each approach: fields for ParaView, pictures of modes."""

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
    """Write fields/*.xdmf and figures/mode_*.png; collective.

    Args:
        study: the study.
        results: its stored samples.
    """
    from brake_fenicsx.report.fields import write_fields, write_points
    from brake_fenicsx.report.render import render_mode

    store, comm, V = study.store, study.comm, study.brake.elastic.free.V
    if comm.rank == 0:
        for name in ("fields", "figures"):
            store.path(name).mkdir(exist_ok=True)
    comm.Barrier()
    for task in results.first():
        data, name = results.stored[task], task[0]
        u = study.brake.local(study.displacement(task, data))
        write_fields(store.path("fields", f"equilibrium_{name}.xdmf"), V, {"u_e": u})
        if comm.rank == 0:
            values = {key: data[key] for key in ("g", "g_cr", "p", "k")}
            write_points(store.path("fields", f"contact_{name}.xdmf"), study.brake.points, values)
        chosen, X = _unstable(study, task, data)
        fields = {}
        for i, x in zip(chosen, X.T, strict=True):
            hertz, damping = abs(data["s"][i].imag) / 2 / np.pi, float(data["damping"][i])
            local = study.brake.local(x)
            label = f"mode_{hertz:05.0f}Hz"
            fields[label] = local
            title = f"{name}, {hertz:.0f} Hz, damping {damping:.2e}"
            render_mode(store.path("figures", f"mode_{name}_{hertz:05.0f}Hz.png"), V, local, title)
        if fields:
            write_fields(store.path("fields", f"modes_{name}.xdmf"), V, fields)


def _unstable(study: Study, task: Task, data: dict[str, Any]) -> tuple[NDArray, NDArray]:
    """Numbers and displacements of the most unstable modes."""
    if "s" not in data:
        return np.zeros(0, dtype=int), np.zeros((len(study.brake.f), 0))
    unstable = np.flatnonzero(data["verdict"] == "unstable")
    chosen = unstable[np.argsort(data["damping"][unstable], kind="stable")][:MOST]
    if "vectors" in data:
        column = {int(m): j for j, m in enumerate(data["vector_mode"])}
        return chosen, data["vectors"][:, [column[int(i)] for i in chosen]].astype(complex)
    if study.changing is not None and study.changes_bodies(task[0]):
        drawn = dict(zip(map(str, data["random_names"]), data["random"], strict=True))
        modes = study.changing.modes(drawn, data["k"], data["mu"])
        return chosen, study.changing.basis.displacements(modes.right[:, chosen])
    s, a = data["s"][chosen], data["coordinates"][:, chosen].astype(complex)
    return chosen, study.reduced.expand(s, a, data["k"], data["mu"])

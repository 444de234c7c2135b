"""Materials of one sample: some constants of a scene's table replaced, all others kept.

Engineering constants of any material that is not isotropic are the nine E_1, E_2, E_3, nu_12,
nu_31, nu_32, G_12, G_13, G_23 (nu_ij: strain along j over that along i under a stress along i), so
that E_3 changes at fixed E_1, nu_12, nu_31. A transversely isotropic material becomes orthotropic
where they ask for it; a stiffness C11, ... keeps the model of the table.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.scene import MaterialTable

from .material import engineering_constants, orthotropic
from .material_table import stiffness

Array = NDArray[np.float64]

# Our names of the constants, and those of ``engineering_constants``.
NAMES = {
    "E_1": "E_x", "E_2": "E_y", "E_3": "E_z", "nu_12": "nu_xy", "nu_31": "nu_zx",
    "G_12": "G_xy", "G_13": "G_xz", "G_23": "G_yz",
}  # fmt: skip


def constants(table: MaterialTable) -> dict[str, float]:
    """Every constant that may be random, with its value in the scene [Pa or -]."""
    if table.model == "isotropic":
        names = ("E", "nu") if table.E is not None else ("C11", "C12")
        return {name: float(np.ravel(getattr(table, name))[0]) for name in names}
    C = stiffness(table)
    found = engineering_constants(C)
    S = np.linalg.inv(C)
    values = {ours: float(found[name]) for ours, name in NAMES.items()}
    values["nu_32"] = float(-S[2, 1] / S[2, 2])
    given = [n for n in MaterialTable.__dataclass_fields__ if n[0] == "C"]
    return values | {n: float(getattr(table, n)) for n in given if getattr(table, n) is not None}


def varied_stiffness(table: MaterialTable, values: Mapping[str, float]) -> Array:
    """Stiffness [Pa] of the table with some constants replaced, shape (6, 6), material axes.

    Args:
        table: the material of the scene.
        values: constant -> its value in the sample.

    Raises:
        SceneError: the compliance is not positive definite, or a modulus is not positive.
    """
    if table.model == "isotropic" or next(iter(values))[0] == "C":
        changed: dict[str, Any] = dict(values)
        return stiffness(replace(table, **changed))
    c = constants(table) | dict(values)
    E = np.array([c["E_1"], c["E_2"], c["E_3"]])
    nu = np.array([c["nu_12"], c["nu_31"] * E[0] / E[2], c["nu_32"] * E[1] / E[2]])
    return orthotropic(E, nu, np.array([c["G_23"], c["G_13"], c["G_12"]]))

"""Datasets of universal files as test software writes them by pyuff."""

import numpy as np
import pytest


def geometry(points, unit=1.0, first=1, kind=2411, definition=0, shown=0):
    """Units and nodes: points [m] in a unit of so many to the metre, coordinate systems."""
    zero, (x, y, z) = np.zeros(len(points), int), np.asarray(points).T * unit
    return [
        {"type": 164, "units_code": 9, "length": unit, "force": 1.0, "temp": 1.0,
         "temp_offset": 0.0},
        {"type": kind, "node_nums": first + np.arange(len(points)), "def_cs": zero + definition,
         "disp_cs": zero + shown, "color": zero, "x": x, "y": y, "z": z},
    ]  # fmt: skip


def function(x, values, node, **labels):
    """A function of a node, an accelerance of force 1 along z unless labels say other things."""
    given = {
        "func_type": 4, "rsp_node": node, "rsp_dir": 3, "ref_node": 1, "ref_dir": 3,
        "ordinate_spec_data_type": 12, "orddenom_spec_data_type": 13,
    }  # fmt: skip
    return pytest.importorskip("pyuff").prepare_58(
        binary=0, data=values, x=x, id1="", rsp_ent_name="NONE", ref_ent_name="NONE",
        abscissa_spacing=1, abscissa_spec_data_type=18, **given | labels,
    )  # fmt: skip


def write_sets(path, sets):
    """Write datasets as one file; returns it."""
    pytest.importorskip("pyuff").UFF(str(path)).write_sets(sets, mode="overwrite")
    return path

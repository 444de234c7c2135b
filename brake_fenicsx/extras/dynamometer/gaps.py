"""Gaps that a state imposes on contact elements: a formula, or a table over the face."""

from __future__ import annotations

import ast
import operator
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.build.interfaces import scene_motion
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import reading
from brake_fenicsx.macro.contact_elements import Contact
from brake_fenicsx.macro.sliding_friction import Rotation
from brake_fenicsx.scene import Scene

from .matrix import read_columns

Array = NDArray[np.float64]
OPERATIONS: dict[type, Any] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
    ast.Div: operator.truediv, ast.Pow: operator.pow, ast.USub: operator.neg,
}  # fmt: skip
FUNCTIONS: dict[str, Any] = {
    "sin": np.sin,
    "cos": np.cos,
    "exp": np.exp,
    "sqrt": np.sqrt,
    "abs": np.abs,
}


def imposed_gap(scene: Scene, contact: Contact, state: Mapping[str, float]) -> Array:
    """Gap that a state adds to each contact element [m], shape (elements,).

    Args:
        scene: its section ``states.gap`` has a formula or a file for an interface. A formula is in
            metres, of x, y, z and r, the distance from the axis [m], and of the state's numbers.
        contact: the elements.
        state: pressure [Pa], speed [rad/s or m/s] and temperature [degC].

    Raises:
        SceneError: the interface, the formula or the file is none.
    """
    from scipy.interpolate import griddata

    out, names, motion = np.zeros(contact.interface.size), list(scene.contact), scene_motion(scene)
    for name, given in dict(scene.section("states").gap).items():
        if name not in names:
            raise SceneError(f"states.gap.{name}: contact has only {', '.join(names)}")
        own = contact.interface == names.index(name)
        x = contact.points[own]
        if given.endswith(".csv"):
            path = scene.path(given)
            columns = read_columns(path, {"x": "m", "y": "m", "gap": "m"})
            with reading(path, "as gaps over a face", "give x, y and gap all over the face"):
                at, xy, gap = (columns["x"], columns["y"]), x[:, :2], columns["gap"]
                inside, nearest = (griddata(at, gap, xy, how) for how in ("linear", "nearest"))
                out[own] = np.where(np.isfinite(inside), inside, nearest)
            continue
        flat = motion.local(x) if isinstance(motion, Rotation) else x
        known = dict(zip("xyz", x.T, strict=True)) | {"r": np.hypot(*flat.T[:2])} | dict(state)
        out[own] = formula(given, known, f"states.gap.{name}")
    return out


def formula(text: str, known: Mapping[str, Any], where: str) -> Array:
    """Value of a formula of numbers, names, + - * / ** and ``FUNCTIONS``; it is never run as code.

    Args:
        text: the formula.
        known: values of its names.
        where: key that has it.

    Raises:
        SceneError: another thing stands in it, or its value is not finite.
    """

    def value(node: ast.AST) -> Any:
        match node:
            case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
                return np.float64(number)
            case ast.Name(id=name) if name in known:
                return known[name]
            case ast.BinOp(left, op, right) if type(op) in OPERATIONS:
                return OPERATIONS[type(op)](value(left), value(right))
            case ast.UnaryOp(op, inner) if type(op) is ast.USub:
                return -value(inner)
            case ast.Call(func=ast.Name(id=name), args=[inner], keywords=[]) if name in FUNCTIONS:
                return FUNCTIONS[name](value(inner))
        raise ValueError(f"{ast.unparse(node)!r} is none of {', '.join([*known, *FUNCTIONS])}")

    try:
        with np.errstate(all="ignore"):
            found = np.asarray(value(ast.parse(text, mode="eval").body), float)
        if not np.isfinite(found).all():
            raise ValueError("is not finite on every contact element")
    except (ValueError, SyntaxError, RecursionError, MemoryError, OverflowError) as error:
        raise SceneError(f"{where} = {text[:80]!r}: {error}; write a formula in metres") from None
    return found

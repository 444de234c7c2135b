"""TOML tables to dataclasses: known keys, units, signs, choices, nothing missing."""

from __future__ import annotations

import difflib
import tomllib
import types
import typing
from collections.abc import Mapping
from dataclasses import MISSING, field, fields
from typing import Any

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene.units import to_si


def key(unit: str = "", default: Any = MISSING, **metadata: Any) -> Any:
    """A field of a scene: unit, default, sign, choices; units of a list whose values differ."""
    metadata["unit"] = unit
    return (
        field(metadata=metadata)
        if default is MISSING
        else field(default=default, metadata=metadata)
    )


def override(table: dict[str, Any], text: str) -> None:
    """Replace one key of a scene: "section.key=value", the value TOML or a bare string."""
    name, sign, value = text.partition("=")
    if not sign:
        raise SceneError(f"--set {text}: write key=value")
    try:
        parsed = tomllib.loads(f"x = {value}")["x"]
    except tomllib.TOMLDecodeError:
        parsed = value.strip()
    *path, last = _key_parts(name.strip())
    for step in path:
        table = table.setdefault(step, {})
    table[last] = parsed


def _key_parts(name: str) -> list[str]:
    """The parts of a dotted key, quoted parts kept whole."""
    try:
        nested = tomllib.loads(f"{name} = 0")
    except tomllib.TOMLDecodeError:
        raise SceneError(f"--set {name}: not a dotted key") from None
    parts = []
    while isinstance(nested, dict):
        ((part, nested),) = nested.items()
        parts.append(part)
    return parts


def check_keys(table: Mapping[str, Any], known: set[str], where: str) -> None:
    """Refuse unknown keys, with the nearest known one."""
    for name in table:
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(sorted(known))}"
            raise SceneError(
                f"{where + '.' if where else ''}{name} = {table[name]!r}: unknown key; {hint}"
            )


def read_table(cls: Any, table: Any, where: str) -> Any:
    """Fill a dataclass from a table: known keys, units, signs, choices, nothing missing."""
    if not isinstance(table, dict):
        raise SceneError(f"{where} = {table!r}: write a table")
    check_keys(table, {f.name for f in fields(cls)}, where)
    hints = typing.get_type_hints(cls)
    values = {}
    for f in fields(cls):
        if f.name in table:
            values[f.name] = _value(f, hints[f.name], table[f.name], f"{where}.{f.name}")
        elif f.default is MISSING and f.default_factory is MISSING:
            raise SceneError(f"{where}.{f.name}: missing; it has no default")
    return cls(**values)


def _value(f: Any, hint: Any, value: Any, where: str) -> Any:
    kinds = typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,)
    said = f"{where} = {value!r}"
    for kind in kinds:
        if hasattr(kind, "__dataclass_fields__") and isinstance(value, dict):
            return read_table(kind, value, where)
    choices = f.metadata.get("choices")
    if choices and value not in choices:
        raise SceneError(f"{said}: use one of {', '.join(map(str, choices))}")
    sequence = next((k for k in kinds if typing.get_origin(k) is tuple), None)
    if sequence is not None and isinstance(value, list):
        inner = typing.get_args(sequence)[0]
        units = f.metadata.get("units", (f.metadata.get("unit", ""),) * len(value))
        if len(units) != len(value):
            raise SceneError(f"{said}: write {len(units)} values, [{', '.join(units)}]")
        return tuple(_scalar(f, (inner,), v, said, u) for v, u in zip(value, units, strict=True))
    return _scalar(f, kinds, value, said, f.metadata.get("unit", ""))


def _scalar(f: Any, kinds: tuple[Any, ...], value: Any, said: str, unit: str) -> Any:
    if bool in kinds:
        if not isinstance(value, bool):
            raise SceneError(f"{said}: write true or false")
        return value
    if str in kinds and isinstance(value, str):
        return value
    if int in kinds and float not in kinds:
        if not isinstance(value, int) or isinstance(value, bool):
            raise SceneError(f"{said}: write a whole number")
        number: float = value
    elif float in kinds:
        try:
            number = to_si(value, unit)
        except ValueError as error:
            raise SceneError(f"{said}: {error}") from None
    else:
        wanted = " or ".join("a list" if typing.get_origin(k) is tuple else
                             "a table" if hasattr(k, "__dataclass_fields__") else "text"
                             for k in kinds if k is not types.NoneType)  # fmt: skip
        raise SceneError(f"{said}: write {wanted}")
    sign = f.metadata.get("sign", "positive")
    if (sign == "positive" and not number > 0) or (sign == "zero" and not number >= 0):
        raise SceneError(f"{said}: must be {'positive' if sign == 'positive' else 'zero or more'}")
    return number

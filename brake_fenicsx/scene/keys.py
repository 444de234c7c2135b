"""TOML tables to dataclasses by pydantic: known keys, units, signs, choices, nothing missing.

Fields of a dataclass and their metadata are the one source of what is read here, of the JSON Schema
(``json_schema``) and of docs/scene.md.
"""

import inspect
import json
import math
import re
import tomllib
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, Field, field, fields, is_dataclass
from functools import cache, partial
from types import MappingProxyType
from typing import Annotated, Any, Literal, NotRequired, Required

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Tag,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
)
from pydantic import Field as Key
from typing_extensions import TypedDict

from brake_fenicsx.arguments import likely
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import absent

from .units import DIMENSIONS, to_si, with_unit

DIALECT = "https://json-schema.org/draft/2020-12/schema"
# A number, then a unit; no comma, which is a decimal point to some and nothing to others.
QUANTITY = {"anyOf": [{"type": "string", "pattern": r"^[^,]*\d[^,]*$"}, {"const": 0}]}
ANY_UNIT = {"anyOf": [QUANTITY, {"type": "number"}]}
SIGNS: Any = {"positive": {"gt": 0}, "zero": {"ge": 0}, "any": {}}
# Whole numbers are no larger than the samples or steps that any computer gets through.
MOST = 10**7
# Sections of tables by names that a user chooses.
NAMED = ("parts", "materials", "contact", "ties")
TEXTS = {
    "missing": "missing; it has no default", "dict_type": "write a table",
    "string_type": "write text", "bool_type": "write true or false",
    "int_type": "write a whole number", "tuple_type": "write a list, [.., ..]",
    "greater_than": "must be positive", "greater_than_equal": "must be zero or more",
    "less_than_equal": "too large",
}  # fmt: skip


class KeyMistake(ValueError):
    """A mistake below the value at hand: its text, and the keys that lead there."""

    def __init__(self, text: str, *keys: str):
        super().__init__(text)
        self.keys = keys


class UnknownKey(KeyMistake):
    """A key that a table does not have, and those that it may have."""

    def __init__(self, name: str, names: tuple[str, ...]):
        super().__init__("unknown key", name)
        self.names = names


def key(unit: str = "", default: Any = MISSING, **metadata: Any) -> Any:
    """A field of a scene: unit, default or the class of what is empty, and of these as needed.

    ``sign`` ("positive" if absent, "zero", "any"), ``choices``, ``most`` of a whole number,
    ``units`` of a list whose values differ, ``band`` of usual values, ``rule`` (what holds for the
    value, or for each value of a table, and the remedy where it does not), ``internal`` for what no
    scene writes, ``write`` for what to write in place of another type, ``type`` that gives
    pydantic's type where the hint does not.
    """
    given: Any = {"default_factory" if isinstance(default, type) else "default": default}
    return field(**given, metadata={"unit": unit, **metadata})


def below(limit: float, remedy: str) -> tuple[Callable[[float], bool], str]:
    """The rule that a number lies below a limit."""
    return lambda value: value < limit, remedy


def between(least: float, most: float) -> tuple[Callable[[float], bool], str]:
    """The rule that a number lies between limits beyond which it means nothing."""
    return lambda value: least <= value <= most, f"must lie between {least:g} and {most:g}"


def rising_pair(values: tuple[float, ...]) -> bool:
    """Whether a list is a lowest and a highest value."""
    return len(values) == 2 and values[0] < values[1]


def two_names(values: tuple[str, ...]) -> bool:
    """Whether a list is two different names."""
    return len(values) == len({*values}) == 2


def vector(values: Any) -> bool:
    """Whether a list is a value for each of three axes, not all zero; what is no list passes."""
    return not isinstance(values, tuple) or (len(values) == 3 and any(values))


def read_table(cls: Any, table: Any) -> Any:
    """Fill a dataclass from a table.

    Raises:
        SceneError: the key, its value and the remedy.
    """
    try:
        return _adapter(cls).validate_python(table)
    except ValidationError as error:
        raise SceneError(_line(error.errors()[0], table, cls)) from None


def walk(
    value: Any, keys: tuple[str, ...] = (), about: Mapping[str, Any] = MappingProxyType({})
) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any], Any]]:
    """All values of a table at any depth, each after what is in it.

    Args:
        value: the dataclass of a table, or a value in it.
        keys: that lead to it.
        about: metadata of its field.

    Yields:
        Keys, metadata and value.
    """
    inside: list[tuple[str, Any, Any]] = []
    if isinstance(value, dict):
        inside = [(str(name), inner, about) for name, inner in value.items()]
    elif is_dataclass(value):
        inside = [(f.name, getattr(value, f.name), f.metadata) for f in fields(value)]
    for name, inner, its in inside:
        if not its.get("internal"):
            yield from walk(inner, (*keys, name), its)
    yield keys, about, value


def contradictions(table: Any) -> Iterator[str]:
    """Values that break the rule of their key, and keys that contradict those beside them.

    Args:
        table: the dataclass of a table; those in it that have a method ``contradictions`` give
            texts that continue their key.
    """
    for keys, about, value in walk(table):
        if "rule" in about and value is not None and not isinstance(value, dict):
            (holds, remedy), unit = about["rule"], about["unit"]
            if not holds(value):
                text = f"{value:g}" if isinstance(value, float) else shown(value)
                yield f"{dotted(*keys)} = {text}{unit and ' '}{unit}: {remedy}"
        for text in getattr(value, "contradictions", tuple)():
            yield dotted(*keys) + text


def json_schema(cls: Any) -> dict[str, Any]:
    """JSON Schema of the tables that fill a dataclass."""
    return {"$schema": DIALECT, **_adapter(cls).json_schema()}


def dotted(*keys: str) -> str:
    """Keys as they are written in a scene, quoted where they must be."""
    return ".".join(k if re.fullmatch(r"[\w-]+", k, re.ASCII) else json.dumps(k) for k in keys)


def key_parts(name: str) -> list[str]:
    """The parts of a dotted key, quoted parts kept whole.

    Raises:
        SceneError: not a dotted key.
    """
    parts = []
    try:
        nested = tomllib.loads(f"{name} = 0")
        while isinstance(nested, dict):
            ((part, nested),) = nested.items()
            parts.append(part)
    except (ValueError, RecursionError):
        raise SceneError(f"{shown(name)}: not a dotted key") from None
    return parts


def shown(value: Any) -> str:
    """A value as a message shows it: that of a list as it is written."""
    text = repr([*value] if isinstance(value, tuple) else value)
    return text if len(text) <= 100 else f"{text[:97]}..."


@cache
def meanings(cls: Any) -> dict[str, str]:
    """Meaning of each key, from the section Attributes of the docstring, without units."""
    _, _, block = (inspect.getdoc(cls) or "").partition("Attributes:\n")
    entries = re.findall(r"^    (\w+): (.*(?:\n {8}.*)*)", block, re.M)
    # The unit stands beside the meaning; docstrings name SI's. Sections of a scene stay.
    units = re.compile(rf" \[({'|'.join(re.escape(u) for u in DIMENSIONS if u)})\]")
    plain = {name: " ".join(text.replace("``", "`").split()) for name, text in entries}
    return {name: units.sub("", text).rstrip(".") for name, text in plain.items()}


def kinds_of(hint: Any) -> tuple[Any, ...]:
    """What a key may hold: the members of a union without None."""
    union = typing.get_origin(hint) in (types.UnionType, typing.Union)
    return tuple(
        k for k in (typing.get_args(hint) if union else (hint,)) if k is not types.NoneType
    )


def kind_text(kind: Any, unit: str = "") -> str:
    """What one writes for a kind."""
    origin = typing.get_origin(kind)
    if origin is tuple:
        return f"list of {kind_text(kinds_of(typing.get_args(kind)[0])[0], unit)}"
    if origin is Literal:
        return " or ".join(f'"{word}"' for word in typing.get_args(kind))
    if origin is dict or is_dataclass(kind):
        return "table"
    words = {str: "text", bool: "true or false", int: "whole number"}
    return words.get(kind) or (DIMENSIONS[unit] if unit else "number")


def keys_of(cls: Any) -> Iterable[tuple[Field, Any]]:
    """Keys of a dataclass that a scene may write, each with its type."""
    hints = typing.get_type_hints(cls)
    return [(f, hints[f.name]) for f in fields(cls) if not f.metadata.get("internal")]


def tables(cls: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    """Tables below a dataclass in the order of its keys, each before its own.

    Args:
        cls: the dataclass.
        above: how their names begin.

    Yields:
        The table as a scene has it, "[ties.NAME]" where the user names it, and the dataclass.
    """
    for f, hint in keys_of(cls):
        for kind in kinds_of(hint):
            name, inner = f"{above}{f.name}", typing.get_args(kind)
            if typing.get_origin(kind) is dict:
                kind, name = inner[1], f"{name}.NAME"
            elif typing.get_origin(kind) is tuple:
                kind, name = inner[0], f"[{name}]"
            if is_dataclass(kind):
                yield f"[{name}]", kind
                yield from tables(kind, f"{name}.")


def table_type(make: Callable[..., Any], *sources: Any, **more: Any) -> Any:
    """Type of a table with the keys of some dataclasses: what pydantic reads.

    Args:
        make: gets what the table holds by name.
        sources: the dataclasses.
        more: types of keys of the first one, which the table then must have; None: it may not.
    """
    held = {}
    for cls in sources:
        for f, hint in keys_of(cls):
            asked = cls is sources[0] and f.name in more
            kind = more[f.name] if asked else value_type(hint, f.metadata)
            if kind is None:
                continue
            default = partial(_add_default, f=f)
            about = Key(description=meanings(cls).get(f.name), json_schema_extra=default)
            needed = f.default is f.default_factory is MISSING or asked
            wrapper = Required if needed else NotRequired
            held[f.name] = wrapper[Annotated[kind, about]]
    named: Any = TypedDict
    table = named(sources[-1].__name__, held)
    table.__pydantic_config__ = {"extra": "forbid"}
    known = BeforeValidator(partial(_known, names=tuple(held)))
    return Annotated[table, known, AfterValidator(lambda values: make(**values))]


def value_type(hint: Any, about: Mapping[str, Any]) -> Any:
    """Type of a key's value as pydantic reads it, from the hint and the metadata of its field."""
    if "type" in about:
        return about["type"]()
    kind, *others = kinds_of(hint)
    if others:
        return _union((kind, *others), about)
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if isinstance(kind, type) and is_dataclass(kind):
        return _table(kind)
    if origin is dict:
        return dict[str, value_type(inner[1], about)]  # type: ignore[misc]
    if origin is tuple and "units" in about:
        units = about["units"]
        members: Any = tuple(value_type(inner[0], {**about, "unit": u}) for u in units)
        return Annotated[tuple[members], BeforeValidator(partial(_as_many, units=units))]
    if origin is tuple:
        return tuple[value_type(inner[0], about), ...]  # type: ignore[misc]
    choices = inner if origin is Literal else about.get("choices")
    if choices:
        return Annotated[Literal[choices], BeforeValidator(partial(_one_of, choices=choices))]
    unit, sign = about.get("unit", ""), SIGNS[about.get("sign", "positive")]
    if kind is float:
        number: Any = Annotated[float, Key(**sign), BeforeValidator(partial(to_si, unit=unit))]
        schema = {"": None, "*": ANY_UNIT}.get(unit, QUANTITY)
        return Annotated[number, WithJsonSchema(schema)] if schema else number
    limits = {**sign, "le": about.get("most", MOST)} if kind is int else {}
    return Annotated[kind, Key(strict=True, **limits)]


def _union(kinds: tuple[Any, ...], about: Mapping[str, Any]) -> Any:
    """Type of a value of one of several kinds, chosen by its shape."""
    unit = about.get("unit", "")
    wanted = about.get("write") or " or ".join(kind_text(kind, unit) for kind in kinds)
    tagged = [Annotated[value_type(k, about), Tag(f"({i})")] for i, k in enumerate(kinds)]
    chosen = Discriminator(lambda v: _member(v, kinds, unit), "shape", f"write {wanted}")
    return Annotated[typing.Union[tuple(tagged)], chosen]  # noqa: UP007


def written_default(f: Field) -> Any:
    """The default of a key as a scene would write it; None where there is none."""
    value = f.default_factory() if f.default_factory is not MISSING else f.default
    nothing = value in (None, MISSING, (), {}) or is_dataclass(value)
    if nothing or (isinstance(value, float) and not math.isfinite(value)):
        return None
    return with_unit(value, f.metadata.get("unit", ""))


def _add_default(schema: dict[str, Any], f: Field) -> None:
    value = written_default(f)
    if value is not None:
        schema["default"] = list(value) if isinstance(value, tuple) else value


@cache
def _adapter(cls: Any) -> TypeAdapter[Any]:
    return TypeAdapter(_table(cls))


@cache
def _table(cls: Any) -> Any:
    return table_type(cls, cls)


def _known(table: Any, names: tuple[str, ...]) -> Any:
    """Refuse unknown keys."""
    for name in table if isinstance(table, dict) else ():
        if name not in names:
            raise UnknownKey(name, names)
    return table


def _hint(name: str, names: tuple[str, ...], root: Any) -> str:
    """What an unknown key may stand for: a key of another section, or like it."""
    if homes := _homes(name, root):
        return f"; {name} belongs to {' or '.join(homes)}"
    return likely(name, names) or f"; known: {', '.join(sorted(names))}"


def _homes(name: str, root: Any) -> list[str]:
    """Tables that have a key of this name."""
    return [t for t, cls in tables(root) if any(f.name == name for f, _ in keys_of(cls))]


def _one_of(value: Any, choices: tuple[Any, ...]) -> Any:
    if not any(value == c and type(value) is type(c) for c in choices):
        raise ValueError(f"use one of {', '.join(map(str, choices))}{likely(value, choices)}")
    return value


def _as_many(value: Any, units: tuple[str, ...]) -> Any:
    if isinstance(value, list) and len(value) != len(units):
        raise ValueError(f"write {len(units)} values, [{', '.join(units)}]")
    return value


def _member(value: Any, kinds: tuple[Any, ...], unit: str) -> str | None:
    """Which member of a union a value is meant to be, by its shape alone: the first that fits."""
    numbers = (int, float, str) if unit else (int, float)
    types: dict[Any, tuple[type, ...]] = {Literal: (str,), tuple: (list,), float: numbers}
    for i, kind in enumerate(kinds):
        origin = dict if is_dataclass(kind) else typing.get_origin(kind) or kind
        fits = type(value) in types.get(origin, (origin,))
        if origin is Literal:
            fits = fits and value in typing.get_args(kind)
        # Beside a word, another word is no quantity.
        if fits and not (i and origin is float and isinstance(value, str) and value.isalpha()):
            return f"({i})"
    return None


def _remedy(error: Any, keys: list[str], table: Any, root: Any) -> str:
    """What some kinds of mistakes are, as a rule, and how they are put right."""
    kind, named = error["type"], f"[{'.'.join([*keys[:-1], 'NAME'])}]"
    if kind == "dict_type" and named in _homes(keys[-1], root):
        return f"; {keys[-1]} belongs to {named}"
    if kind == "less_than_equal":
        return f", {error['ctx']['le']} at most"
    if kind == "greater_than_equal" and keys == ["stability", "threshold"]:
        return "; 0.01 counts modes with a damping below -0.01"
    if kind == "missing" and len(keys) == 3 and keys[0] in NAMED:
        others = ", ".join(name for name in table[keys[0]] if name != keys[1])
        return f" ({keys[0]} there are beside {keys[1]}: {others})" if others else ""
    return ""


def _line(error: Any, table: Any, root: Any) -> str:
    """Key, value and remedy of a mistake that pydantic found in the table of a dataclass."""
    cause = error.get("ctx", {}).get("error")
    # Members of a union and places in a list are no keys.
    keys = [k for k in error["loc"] if isinstance(k, str) and not re.fullmatch(r"\(.*\)", k)]
    keys += getattr(cause, "keys", ())
    text = str(cause) if cause else TEXTS.get(error["type"], error["msg"])
    text += _remedy(error, keys, table, root)
    if isinstance(cause, UnknownKey):
        text = absent(keys[-1]) or text + _hint(keys[-1], cause.names, root)
    value = table
    for name in keys:
        if not isinstance(value, dict) or name not in value:
            return f"{dotted(*keys)}: {text}"
        value = value[name]
    if isinstance(value, str) and re.fullmatch(r"[+-]?\d+,\d+", value):
        text += f"; decimals have a point, {value.replace(',', '.')}"
    elif isinstance(value, str) and "number" in text and re.fullmatch(r"[-+\d.eE]+", value):
        text += f"; without quotes, {value}"
    return f"{dotted(*keys)} = {shown(value)}: {text}"
